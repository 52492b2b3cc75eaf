"""A fast subspace where no variable is fast by itself: linear coordinates from the Jacobian at one place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.linalg
import sympy as sp

from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.reductions.fast_parts import FastPart
from gsp.scales.conservation import conserved_by
from gsp.systems.region import balancing_units
from gsp.systems.system import VectorField


def fast_directions(field: VectorField, place: np.ndarray, count: int, gap: float) -> list[FastPart]:
    """The part of the field along the `count` fastest directions of its Jacobian at `place` (n,).

    N are the fast directions, reduced to rows of the unit matrix, and f the components of the field along them; none
    where the fast rates do not decay, or variables are fast by themselves. A slow manifold has such directions to the
    inverse of the `gap` between the rates only, so that the simplest numbers that near are taken. What is conserved is
    so along them exactly.
    """
    coordinates, laws = conserved_by(field)
    free = coordinates.free
    matrix = compile_flow(field).jacobians(place[None, :], parameter_vector(field, None))[0]
    matrix = matrix[free] @ coordinates.embedding
    if not np.isfinite(matrix).all() or not 0 < count < len(free):
        return []
    # Units in which what moves along a fast mode is alike: a velocity changes by as many lengths as its rate is large.
    sizes = balancing_units(matrix)
    matrix = matrix * sizes / sizes[:, None]
    rates = np.linalg.eigvals(matrix)
    rates = rates[np.argsort(-np.abs(rates))]
    if not (rates.real[:count] < 0.0).all():
        return []
    limit = 0.5 * float(np.abs(rates[count - 1 : count + 1]).sum())
    right = _subspace(matrix, limit, count)
    left = _subspace(matrix.T, limit, count)
    if right is None or left is None:
        return []
    own = _simplest(right, sizes, gap)
    exact = _embedding(field, free, laws) * own
    if all(np.count_nonzero(column) == 1 for column in np.array(exact).T):
        return []
    rows = _simplest(left, 1.0 / sizes, gap).T
    inner = rows * own
    if inner.det() == 0:
        return []
    components = (inner.inv() * rows) * sp.Matrix([field.rates[i] for i in free])
    directions = tuple(
        {s: exact[i, k] for i, s in enumerate(field.states) if exact[i, k] != 0} for k in range(count)
    )
    told = ", ".join(str(sp.Add(*(number * s for s, number in d.items()))) for d in directions)
    return [FastPart(f"quasi-steady state along {told}", directions, tuple(components))]


def _embedding(field: VectorField, free: np.ndarray, laws: Sequence[sp.Expr]) -> sp.Matrix:
    """How all states move with those that are `free`: each law gives the first of its own."""
    states = field.states
    bound = [i for i in range(len(states)) if i not in free]
    held = dict(zip(bound, laws))
    return sp.Matrix(
        len(states),
        len(free),
        lambda i, k: -held[i].coeff(states[free[k]]) if i in held else sp.Integer(int(free[k] == i)),
    )


def _subspace(matrix: np.ndarray, limit: float, count: int) -> np.ndarray | None:
    """The invariant subspace (n, count) of eigenvalues that are larger than the limit."""

    def is_fast(real: float, imaginary: float = 0.0) -> bool:
        return float(np.hypot(real, imaginary)) > limit

    answer: Any = scipy.linalg.schur(matrix, sort=is_fast, output="real")
    _, vectors, found = answer
    return vectors[:, :count] if found == count else None


def _simplest(basis: np.ndarray, sizes: np.ndarray, gap: float) -> sp.Matrix:
    """The space of a `basis` in units of `sizes`, to 1/gap of these, with rows of the unit matrix where its largest
    minors are."""
    answer: Any = scipy.linalg.qr(basis.T, pivoting=True)
    pivots = np.sort(answer[2][: basis.shape[1]])
    units = sizes[:, None] / sizes[pivots]
    entries = basis @ np.linalg.inv(basis[pivots]) * units
    near = units / gap
    return sp.Matrix(*entries.shape, [_fraction(*pair) for pair in zip(entries.flat, near.flat)])


def _fraction(entry: float, near: float) -> sp.Rational:
    """The number of the least denominator that is so near to `entry`."""
    found = _simplest_between(Fraction(float(entry - near)), Fraction(float(entry + near)))
    return sp.Rational(found.numerator, found.denominator)


def _simplest_between(low: Fraction, high: Fraction) -> Fraction:
    """The number of the least denominator from `low` to `high`, by their continued fractions."""
    if low <= 0 <= high:
        return Fraction(0)
    if high < 0:
        return -_simplest_between(-high, -low)
    whole = math.ceil(low)
    if whole <= high:
        return Fraction(whole)
    return whole - 1 + 1 / _simplest_between(1 / (high - whole + 1), 1 / (low - whole + 1))
