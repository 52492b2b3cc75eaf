"""Bodies that turn together: what their angles, and the velocities of their places, are best measured from.

Once bodies in a plane are turned together, the metric M and the forms A are as they were, in velocities that turn with
them: for angles at the rates nu, and W the generator of a turn of two velocities, sum_k nu_k dM/dq_k + W^T M + M W = 0
and sum_k nu_k dA/dq_k + A W = 0. Such turns are guessed at generic points: a wrong guess makes no equation wrong.
"""

from __future__ import annotations

import itertools
from fractions import Fraction
from functools import lru_cache

import numpy as np
import sympy as sp

from gsp.mechanics.algebra import entries, generic_points, numbers
from gsp.mechanics.lagrangian import LagrangianSystem
from gsp.mechanics.velocity_forms import rank
from gsp.systems.flow import Values


def turned_velocities(system: LagrangianSystem, forms: sp.ImmutableMatrix) -> list[sp.ImmutableMatrix]:
    """Orthogonal matrices (n, n) of velocities along axes that turn with one of the bodies; `forms` are A (k, n)."""
    angles, pairs, values = _changes(system, forms)
    alone, found = values[:, : len(angles)], []
    for (i, j), turned in zip(pairs, values[:, len(angles) :].T):
        if not turned.any() or rank(np.column_stack([alone, turned])) > rank(alone):
            continue
        turns = np.linalg.lstsq(alone, -turned)[0]
        for q, turn in zip(angles, turns):
            if share := Fraction(float(turn)).limit_denominator(12):
                R = sp.eye(len(system.coordinates))
                R[i, i] = R[j, j] = sp.cos(q / sp.Rational(share))
                R[i, j] = sp.sin(q / sp.Rational(share))
                R[j, i] = -R[i, j]
                found.append(sp.ImmutableMatrix(R))
    return found


def turned_together(system: LagrangianSystem, forms: sp.ImmutableMatrix) -> dict[sp.Symbol, list[sp.Expr]]:
    """Angles that are turned together, with what each may be measured from, the axes last.

    Bodies that are hinged to one another have such angles, from an axis in space: formulas are shortest in those
    between neighbours.
    """
    angles, _, values = _changes(system, forms)
    if len(angles) < 2:
        return {}
    turns = np.linalg.svd(values)[2][rank(values) :, : len(angles)]
    if not turns.any():
        return {}
    turns = np.linalg.svd(turns)[2][: rank(turns)]
    axes: list[int] = []
    for i in range(len(angles)):
        if len(axes) < len(turns) and rank(turns[:, [*axes, i]]) > len(axes):
            axes.append(i)
    turns = np.linalg.solve(turns[:, axes], turns)
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


@lru_cache(maxsize=1)
def _changes(
    system: LagrangianSystem, forms: sp.ImmutableMatrix
) -> tuple[list[sp.Symbol], list[tuple[int, int]], np.ndarray]:
    """(angles, pairs of the other coordinates, how M and A change by a turn of each, in columns of numbers)."""
    coordinates, M = system.coordinates, system.raw_mass_matrix
    parts = [*entries(M), *entries(forms)]
    turning = set().union(*(f.free_symbols for e in parts for f in e.atoms(sp.sin, sp.cos)))
    angles = [q for q in coordinates if q in turning]
    pairs = list(itertools.combinations([i for i, q in enumerate(coordinates) if q not in turning], 2))
    if not angles:
        return [], [], np.zeros((0, 0))
    columns = [[sp.diff(e, q) for e in parts] for q in angles]
    for i, j in pairs:
        W = sp.zeros(len(coordinates), len(coordinates))
        W[i, j], W[j, i] = -1, 1
        columns.append([*entries(M * W - W * M), *entries(forms * W)])
    symbols = (*coordinates, *system.velocities, *system.clock)
    points = generic_points(3, len(symbols))
    values = numbers([*itertools.chain(*columns)], symbols, points, system.values)
    rows = values.reshape(len(points), len(columns), len(parts)).transpose(0, 2, 1).reshape(-1, len(columns))
    # A generic point may be one where a metric is not real, as sqrt(1/4 - x^2) is.
    rows = rows[np.isfinite(rows).all(axis=1)]
    return (angles, pairs, rows) if len(rows) else ([], [], rows)


def _ratio(turn: list[sp.Rational], other: list[sp.Rational]) -> sp.Rational | None:
    """The factor by which `turn` is `other`; None where it is no multiple."""
    factor = next((a / b for a, b in zip(turn, other) if b), None)
    return factor if factor is not None and turn == [factor * b for b in other] else None
