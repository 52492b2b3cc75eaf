"""Matrices that become singular along a curve, told by one smooth number: the bordered, minimally augmented test.

For a matrix M(u) of corank 1 somewhere, and borders b, c that are not orthogonal to its null vectors,

    [ M    b ] [v]   [0]                            [ M^T  c ] [w]   [0]
    [ c^T  0 ] [s] = [1],   s(u) = 0 <=> det M = 0,  [ b^T  0 ] [s] = [1],   ds = -w^T dM v,

(Govaerts 2000, chapter 3). With M = g_y this is a fold; with M = 2 g_y (.) I, the bialternate product, whose
eigenvalues are the sums of two eigenvalues of g_y, it is a Hopf point or a neutral saddle (Kuznetsov 2004, 10.2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from gsp.critical.layer_problem import LayerProblem
from gsp.critical.normal_forms import bordered

MatrixMap = Callable[[np.ndarray], np.ndarray]


def identity(matrix: np.ndarray) -> np.ndarray:
    """The matrix itself: (..., n, n)."""
    return matrix


def bialternate(matrix: np.ndarray) -> np.ndarray:
    """2 A (.) I for A (..., n, n): (..., m, m) with m = n(n - 1)/2; linear in A (Kuznetsov 2004, 10.2.2)."""
    pairs = list(combinations(range(matrix.shape[-1]), 2))
    result = np.zeros((*matrix.shape[:-2], len(pairs), len(pairs)))
    for row, (q, p) in enumerate(pairs):
        for column, (s, r) in enumerate(pairs):
            entry = result[..., row, column]
            if r == q:
                entry -= matrix[..., p, s]
            if r == p:
                entry += matrix[..., q, s]
            if s == q:
                entry += matrix[..., p, r]
            if s == p:
                entry -= matrix[..., q, r]
    return result


@dataclass(frozen=True)
class Null:
    """What one bordered solve gives: the test `s`, its gradient (N,), and v, w that span the null spaces at s = 0."""

    s: float
    gradient: np.ndarray
    right: np.ndarray
    left: np.ndarray


@dataclass(frozen=True)
class Singular:
    """{g = 0, s = 0}: where `of`(g_y) is singular, with fixed borders, in `units` of that matrix.

    s does not depend on the units, but in volts and shares of channels the least singular value would.
    """

    problem: LayerProblem
    of: MatrixMap
    b: np.ndarray
    c: np.ndarray
    units: np.ndarray
    # The last point and its solves, of which the value and the slope both are made.
    _last: dict[bytes, Null] = field(default_factory=dict, compare=False, repr=False)

    def null(self, u: np.ndarray) -> Null:
        """The bordered solves at u; raises `numpy.linalg.LinAlgError` where the borders do not serve."""
        place = u.tobytes()
        if place not in self._last:
            found = self._solved(u)
            self._last.clear()
            self._last[place] = found
        return self._last[place]

    def _solved(self, u: np.ndarray) -> Null:
        k = len(self.problem.free)
        g_y = self.problem.jacobian(u)[:, k:]
        changes = np.moveaxis(self.problem.second(u)[:, k:, :], 2, 0)
        ratio = self.units / self.units[:, None]
        M, dM = self.of(g_y) * ratio, self.of(changes) * ratio
        n, matrix = len(M), bordered(M, self.b, self.c)
        if not (np.isfinite(matrix).all() and np.isfinite(dM).all()):
            raise np.linalg.LinAlgError("not finite")
        unit = np.eye(n + 1)[n]
        v, w = np.linalg.solve(matrix, unit), np.linalg.solve(matrix.T, unit)
        gradient = -np.einsum("i,lij,j->l", w[:n], dM, v[:n])
        return Null(float(v[n]), gradient, v[:n] * self.units, w[:n] / self.units)

    def residual(self, u: np.ndarray) -> np.ndarray:
        """(g, s) at u: (n + 1,); NaN where there is none."""
        try:
            s = self.null(u).s
        except np.linalg.LinAlgError:
            s = float("nan")
        return np.append(self.problem.residual(u), s)

    def jacobian(self, u: np.ndarray) -> np.ndarray:
        """Derivatives of (g, s) at u: (n + 1, N)."""
        try:
            gradient = self.null(u).gradient
        except np.linalg.LinAlgError:
            gradient = np.full(len(u), np.nan)
        return np.vstack([self.problem.jacobian(u), gradient])


def singular_near(problem: LayerProblem, of: MatrixMap, u: np.ndarray, scales: np.ndarray) -> Singular:
    """`Singular` with the borders that are best at u: the singular vectors of the least singular value, in `scales`."""
    k = len(problem.free)
    # Of a product of two states the unit is that of the product.
    units = np.exp(np.diag(of(np.diag(np.log(scales[k:])))))
    # Scaled to the size of M, so that the bordered matrix is as well conditioned as it can be.
    M = of(problem.jacobian(u)[:, k:]) * units / units[:, None]
    left, sizes, right = np.linalg.svd(M)
    # Of one fast variable the matrix itself vanishes: what is nothing beside its changes over the scales is none.
    changes = of(np.moveaxis(problem.second(u)[:, k:, :] * scales, 2, 0)) * units / units[:, None]
    size = max(sizes[0], np.finfo(float).eps * np.nan_to_num(np.abs(changes)).max(initial=0.0)) or 1.0
    return Singular(problem, of, size * left[:, -1], right[-1], units)
