"""Points of an implicit sheet over many slow points at once, by Newton's method."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import sympy as sp

from gsp.errors import DeclarationError
from gsp.systems.arguments import check_array, shown
from gsp.systems.flow import Point, complete
from gsp.systems.system import SlowFastSystem

# A root is accepted when the last Newton correction is below this, relative to 1 + |y|, or to a smaller size + |y|.
NEWTON_TOLERANCE = 1e-12
NEWTON_STEPS = 40
# Fast coordinates that differ by less, relative to their size, are equal: points are found to 1e-12 (1 + |y|).
EQUAL = 1e-10
# With more fast variables than this matrices are solved as sparse ones. Eigenvalues of one sample take milliseconds:
# fewer samples are taken, and between them those nearest to the axis are followed by shift and invert.
LARGE = 32


def fast_lengths(y: np.ndarray, units: Sequence[float] | None) -> np.ndarray:
    """How far a branch reaches in each fast variable (n_fast,), by most of its samples y (m, n_fast).

    The few next to a pole do not say it. A variable that is constant is as long as it is large; one that is 0 as its
    unit, or as the longest of the others where none is known, or 1.
    """
    finite = y[np.isfinite(y).all(axis=1)]
    if not len(finite):
        return np.ones(y.shape[1])
    low, high = np.quantile(finite, (0.1, 0.9), axis=0)
    lengths = high - low
    known = float(lengths.max()) or 1.0 if units is None else np.array(units)
    sizes = np.maximum(np.abs(low), np.abs(high))
    sizes = np.where(sizes > EQUAL * known, sizes, known)
    return np.where(lengths > EQUAL * sizes, lengths, sizes)


class Allowance:
    """Continuation steps that a search may still take along a sheet; `spent` when it was denied some."""

    def __init__(self, steps: int) -> None:
        self.left = steps
        self.spent = False

    def take(self, steps: int) -> bool:
        """Whether `steps` more may be taken."""
        self.spent = self.spent or steps > self.left
        self.left -= 0 if self.spent else steps
        return not self.spent


def signs(matrices: np.ndarray) -> np.ndarray:
    """Signs (m,) of the determinants of finite matrices (m, n, n)."""
    if matrices.shape[-1] <= LARGE:
        return np.linalg.slogdet(matrices)[0]
    return np.array([_sign(factors) for factors in _decomposed(matrices)])


def _decomposed(matrices: np.ndarray) -> Iterator[Any]:
    """The sparse LU factors of each of the finite matrices (m, n, n), None of a singular one."""
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    # One pattern for all: to find that of each takes several times as long as its factors.
    kept = np.ascontiguousarray((matrices != 0.0).any(axis=0).T)
    columns, rows = (places.astype(np.intc) for places in np.nonzero(kept))
    starts = np.searchsorted(columns, np.arange(len(kept) + 1)).astype(np.intc)
    for values in np.ascontiguousarray(matrices[:, rows, columns]):
        try:
            yield splu(csc_matrix((values, rows, starts), shape=matrices.shape[1:]))
        except RuntimeError:
            yield None


def _sign(factors) -> float:
    from sympy.combinatorics import Permutation

    if factors is None:
        return 0.0
    turns = [Permutation(order.tolist()).signature() for order in (factors.perm_r, factors.perm_c)]
    return float(np.prod(np.sign(factors.U.diagonal())) * np.prod(turns))


def solve_each(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Batched solution of A s = b; not a number where A is singular."""
    if matrices.shape[-1] > LARGE:
        result = np.full_like(vectors, np.nan)
        finite = np.flatnonzero(np.isfinite(matrices).all(axis=(1, 2)))
        for i, factors in zip(finite, _decomposed(matrices[finite])):
            if factors is not None:
                result[i] = factors.solve(vectors[i])
        return result
    if matrices.shape[-1] == 1:
        with np.errstate(divide="ignore", invalid="ignore"):
            return vectors / matrices[:, :, 0]
    try:
        return np.linalg.solve(matrices, vectors[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        result = np.full_like(vectors, np.nan)
        for i, (matrix, vector) in enumerate(zip(matrices, vectors)):
            try:
                result[i] = np.linalg.solve(matrix, vector)
            except np.linalg.LinAlgError:
                continue
        return result


def newton_at_each(
    residual_at: Callable[[np.ndarray], np.ndarray],
    jacobian_at: Callable[[np.ndarray], np.ndarray],
    x: np.ndarray,
    y: np.ndarray,
    *,
    size: float = 1.0,
    tolerance: float = NEWTON_TOLERANCE,
    steps: int = NEWTON_STEPS,
) -> tuple[np.ndarray, np.ndarray]:
    """Newton's method at all points (x, y) at once; returns y (m, n_fast) and which points converged (m,).

    `size` is what counts as a unit of y beside |y|, when a step is small.
    """
    n = y.shape[1]
    good, small_before = np.zeros((2, len(x)), dtype=bool)
    active = np.arange(len(x))
    y = y.copy()
    for _ in range(steps):
        z = np.hstack([x[active], y[active]])
        residual = residual_at(z)
        jacobian = jacobian_at(z).reshape(-1, n, n)
        finite = np.isfinite(residual).all(axis=1) & np.isfinite(jacobian).all(axis=(1, 2))
        active, residual, jacobian = active[finite], residual[finite], jacobian[finite]
        step = solve_each(jacobian, residual)
        # A step whose length is beyond doubles leads nowhere.
        with np.errstate(over="ignore"):
            length = np.linalg.norm(step, axis=1)
        finite = np.isfinite(length)
        active, step, length = active[finite], step[finite], length[finite]
        # Damped to steps of length 1 + |y|: a nearly singular Jacobian must not throw the point away.
        far = np.linalg.norm(y[active], axis=1)
        y[active] -= step * ((1.0 + far) / np.maximum(length, 1.0 + far))[:, None]
        small = length <= tolerance * (size + far)
        # In units in which y is tiny a small correction may be a large share of it: once more, and it is none.
        done = small & ((length <= tolerance**0.5 * far) | small_before[active])
        small_before[active] = small
        good[active[done]] = True
        active = active[~done]
        if len(active) == 0:
            break
    return y, good


def distinct(points: np.ndarray, *, size: float = 1.0) -> np.ndarray:
    """The points (k, n) that are not rounding of one another beside `size`, in order."""
    found: list[np.ndarray] = []
    for candidate in points:
        scale = 1e-8 * (size + np.linalg.norm(candidate))
        if all(np.linalg.norm(candidate - other) > scale for other in found):
            found.append(candidate)
    return np.array(sorted(found, key=tuple)).reshape(-1, points.shape[1])


def guesses(near, count: int, fast: Sequence[sp.Symbol]) -> np.ndarray:
    """`near` as starts (m, n_fast) of Newton's method, finite; raises `DeclarationError` otherwise."""
    names = ", ".join(s.name for s in fast)
    be = f"finite numbers for {names}, (n_fast,) or (m, n_fast)"
    array = check_array(near, what="near", be=be)
    if np.isfinite(array).all() and array.size:
        try:
            return np.array(np.broadcast_to(array, (count, len(fast))))
        except ValueError:
            pass
    raise DeclarationError(f"near is {be}.", got=f"{shown(near)} for {count} points")


def place(system: SlowFastSystem, point: Point) -> tuple[np.ndarray, np.ndarray]:
    """(x, y) of a point that names every state; raises `DeclarationError` otherwise."""
    values = np.array(complete(point, system.states, what="point"))
    return values[: len(system.x)], values[len(system.x) :]
