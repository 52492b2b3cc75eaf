"""A fast subspace where no variable is fast by itself: linear coordinates from the Jacobian at one place."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import scipy.linalg
import sympy as sp

from gsp.algebra.local_series import DENOMINATOR
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.reductions.fast_parts import FastPart
from gsp.systems.system import VectorField


def fast_directions(field: VectorField, place: np.ndarray, ratio: float, *, most: int) -> list[FastPart]:
    """The part of the field along the fast subspace of its Jacobian at `place`, at the widest gap between its rates
    that leaves `most` fast directions at most.

    N are the fast directions, reduced to rows of the unit matrix, and f the components of the field along them; none
    where the fast rates do not decay, the gap is less than `ratio`, or variables are fast by themselves.
    """
    n = len(field.states)
    matrix = compile_flow(field).jacobians(place[None, :], parameter_vector(field, None))[0]
    if not np.isfinite(matrix).all() or most < 1:
        return []
    rates = np.sort(np.linalg.eigvals(matrix).real)
    decays = rates < 0.0
    if not decays[0]:
        return []
    gaps = [rates[k] / rates[k + 1] if decays[k + 1] else np.inf for k in range(most) if decays[k]]
    if not gaps:
        return []
    count = int(np.argmax(gaps)) + 1
    if gaps[count - 1] < ratio:
        return []
    limit = 0.5 * (rates[count - 1] + rates[count])
    right = _subspace(matrix, limit, count)
    left = _subspace(matrix.T, limit, count)
    if right is None or left is None:
        return []
    N = _reduced(right)
    if all(np.count_nonzero(column) == 1 for column in N.T):
        return []
    exact = sp.Matrix(n, count, [_fraction(entry) for entry in N.flat])
    rows = sp.Matrix(count, n, [_fraction(entry) for entry in _reduced(left).T.flat])
    inner = rows * exact
    if inner.det() == 0:
        return []
    components = (inner.inv() * rows) * sp.Matrix(list(field.rates))
    directions = tuple(
        {s: exact[i, k] for i, s in enumerate(field.states) if exact[i, k] != 0} for k in range(count)
    )
    told = ", ".join(str(sp.Add(*(number * s for s, number in d.items()))) for d in directions)
    return [FastPart(f"quasi-steady state along {told}", directions, tuple(components))]


def _subspace(matrix: np.ndarray, limit: float, count: int) -> np.ndarray | None:
    """The invariant subspace (n, count) of eigenvalues whose real part is below the limit."""
    answer: Any = scipy.linalg.schur(matrix, sort=lambda real, imaginary=0.0: real < limit, output="real")
    _, vectors, found = answer
    return vectors[:, :count] if found == count else None


def _reduced(basis: np.ndarray) -> np.ndarray:
    """The same space with rows of the unit matrix where its largest minors are."""
    answer: Any = scipy.linalg.qr(basis.T, pivoting=True)
    pivots = answer[2]
    return basis @ np.linalg.inv(basis[pivots[: basis.shape[1]]])


def _fraction(entry: float) -> sp.Rational:
    near = Fraction(float(entry)).limit_denominator(DENOMINATOR)
    return sp.Rational(near.numerator, near.denominator)
