"""Bodies that turn together: what their angles, and the velocities of their places, are best measured from.

Guesses at generic points, by which formulas get shorter: a wrong one makes no equation wrong.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import sympy as sp

from gsp.mechanics.algebra import entries, generic_points, numbers
from gsp.mechanics.lagrangian import LagrangianSystem
from gsp.mechanics.velocity_forms import VelocityForms, rank
from gsp.systems.flow import Values


def turned_velocities(system: LagrangianSystem, constraints: VelocityForms) -> list[sp.ImmutableMatrix]:
    """Orthogonal matrices (n, n) of velocities along axes that turn with one of the bodies.

    The metric M and the forms A are as they were once bodies in a plane are turned together: with R the rotation of
    two velocities, R^T M R and A R do not depend on the angle of the turn, so that the sum of d/dq by the angles takes
    M to -(W^T M + M W) and A to -A W, W = dR/dangle.
    """
    n, coordinates = len(system.coordinates), system.coordinates
    M, A = system.raw_mass_matrix, constraints.rows
    angles = _angles(system, [*entries(M), *entries(A)])
    symbols = (*coordinates, *system.velocities, *system.clock)
    points, found = generic_points(3, len(symbols)), []
    columns = [[sp.diff(e, q) for e in (*entries(M), *entries(A))] for q in angles]
    for i, j in itertools.combinations([i for i in range(n) if coordinates[i] not in angles], 2):
        W = sp.zeros(n, n)
        W[i, j], W[j, i] = -1, 1
        turned = [*entries(M * W - W * M), *entries(A * W)]
        values = numbers([*itertools.chain(*columns), *turned], symbols, points, system.values)
        values = (
            values.reshape(len(points), len(angles) + 1, -1).transpose(0, 2, 1).reshape(-1, len(angles) + 1)
        )
        if not (angles and values[:, -1].any() and rank(values) == rank(values[:, :-1])):
            continue
        turns = np.linalg.lstsq(values[:, :-1], -values[:, -1])[0]
        for q, turn in zip(angles, turns):
            if share := Fraction(float(turn)).limit_denominator(12):
                R = sp.eye(n)
                R[i, i] = R[j, j] = sp.cos(q / sp.Rational(share))
                R[i, j] = sp.sin(q / sp.Rational(share))
                R[j, i] = -R[i, j]
                found.append(sp.ImmutableMatrix(R))
    return found


def _angles(system: LagrangianSystem, expressions: Sequence[sp.Expr]) -> list[sp.Symbol]:
    turning = set().union(*(f.free_symbols for e in expressions for f in e.atoms(sp.sin, sp.cos)))
    return [q for q in system.coordinates if q in turning]


def turned_together(system: LagrangianSystem, metric: Sequence[sp.Expr]) -> dict[sp.Symbol, list[sp.Expr]]:
    """Angles that, turned together, leave the metric as it is, with what each may be measured from, the axes last.

    Bodies that are hinged to one another have such angles, from an axis in space: the metric is shortest in those
    between neighbours. A guess at generic points: a wrong one makes no equation wrong.
    """
    angles = _angles(system, metric)
    if len(angles) < 2:
        return {}
    symbols = (*system.coordinates, *system.clock)
    slopes = [sp.diff(e, q) for e in metric for q in angles]
    values = numbers(slopes, symbols, generic_points(3, len(symbols)), system.values).reshape(-1, len(angles))
    kept = np.linalg.svd(values)[2][rank(values) :]
    axes = []
    for i in range(len(angles)):
        if len(axes) < len(kept) and rank(kept[:, [*axes, i]]) > len(axes):
            axes.append(i)
    if not axes:
        return {}
    turns = np.linalg.solve(kept[:, axes], kept)
    ratios = [[sp.Rational(Fraction(float(turn)).limit_denominator(12)) for turn in row] for row in turns.T]
    found = {}
    for i, q in enumerate(angles):
        if i not in axes and any(ratios[i]):
            together = {j: _ratio(ratios[i], ratios[j]) for j in range(len(angles)) if j != i}
            alone = [factor * angles[j] for j, factor in together.items() if factor]
            found[q] = [*alone, sp.Add(*[factor * angles[j] for factor, j in zip(ratios[i], axes)])]
    return found


def measured(measured_from: Values, q: sp.Symbol, reference: sp.Expr) -> dict[sp.Symbol, sp.Expr]:
    """`measured_from` with q measured from `reference`; an angle there that q carries changes places with q."""
    carriers = reference.free_symbols
    while not carriers.isdisjoint(measured_from) and q not in carriers:
        carriers = set().union(*(measured_from[p].free_symbols for p in carriers if p in measured_from))
    after = {**measured_from, q: reference}
    if q in carriers:
        (carried,) = reference.free_symbols
        after[carried] = measured_from[q] * carried / reference
    return after


def _ratio(turn: list[sp.Rational], other: list[sp.Rational]) -> sp.Rational | None:
    """The factor by which `turn` is `other`; None where it is no multiple."""
    factor = next((a / b for a, b in zip(turn, other) if b), None)
    return factor if factor is not None and turn == [factor * b for b in other] else None
