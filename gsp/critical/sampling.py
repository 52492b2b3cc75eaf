"""A branch sampled over a region: its points, the fast Jacobian there, and which samples share a sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative, without_overflow
from gsp.algebra.laurent import laurent
from gsp.critical.branch import Branch
from gsp.critical.sheet_points import Allowance
from gsp.critical.spectrum import eigenvalues
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_function, finite_rows
from gsp.systems.region import Interval

# Points per axis for one and two slow variables; a Sobol sequence of 2^SOBOL points beyond.
GRID = {1: 257, 2: 33}
SOBOL = 11
# A point is in a box when it lies outside by less than this, relative to its width: a loss on the edge counts.
EDGE = 1e-9
# Least singular value of g_y, relative to the largest, at which Newton's method has lost half of its digits.
NEARLY_SINGULAR = 1e-4


class Sampler:
    """Compiled Jacobians of one branch, evaluated in batches at points z = (x, y) on it."""

    def __init__(self, branch: Branch) -> None:
        self.branch = branch
        self.system = branch.system
        epsilon = self.system.epsilon
        zero = sp.Integer(0)
        self.f = [laurent(e, epsilon, order=0).get(0, zero) for e in self.system.f]
        self.g = [laurent(e, epsilon, order=0).get(0, zero) for e in self.system.g]
        self.p = compile_flow(self.system).constants

    # -- points ------------------------------------------------------------------------------------

    def points(self, x: np.ndarray, box: Mapping[str, Interval]) -> tuple[np.ndarray, np.ndarray]:
        """Points (k, n_slow + n_fast) of the branch over the grid `x`, and the row of x that each belongs to.

        Rows without a sample have no real point over them; without a seed, none within the fast bounds of `box`.
        """
        system, branch = self.system, self.branch
        bounds = {y.name: box[y.name] for y in system.y if y.name in box}
        if branch.is_explicit or branch.seed is not None:
            y, real = self.over(x, None)
            rows = np.flatnonzero(real)
            z = np.hstack([x, y])[rows]
        else:
            found = [branch.roots(point[None, :], bounds=bounds) for point in x]
            rows = np.repeat(np.arange(len(x)), [len(roots) for roots in found])
            y = np.vstack(found)
            z = np.hstack([x[rows], y])
        return z, rows

    def inside(self, z: np.ndarray, box: Mapping[str, Interval]) -> np.ndarray:
        """Which points `z` (m, n) lie in `box`, to rounding; coordinates that are not a number are not looked at."""
        good = np.ones(len(z), dtype=bool)
        for i, symbol in enumerate(self.system.states):
            if symbol.name in box:
                low, high = box[symbol.name]
                slack = EDGE * (high - low)
                good &= ~((z[:, i] < low - slack) | (z[:, i] > high + slack))
        return good

    def over(
        self, x: np.ndarray, start: np.ndarray | None, *, allowance: Allowance | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """y (m, n_fast) over `x` on the sheets through `start` (m, n), and where there is a real point.

        Sheets are followed within `allowance`, when one is given.
        """
        if self.branch.is_explicit:
            y = self.branch.graph_values(x, allow_complex=True)
            return y, finite_rows(y)
        nx = len(self.system.x)
        # Newton's method may throw a point so far that its length overflows; the point is given up then.
        with np.errstate(over="ignore", invalid="ignore"):
            if start is None:
                return self.branch.follow(x, allowance=allowance)
            return self.branch.follow(x, start=(start[:, :nx], start[:, nx:]), allowance=allowance)

    def links(self, z: np.ndarray, rows: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pairs (a, b), each (m, n), of points on one sheet over neighbouring rows of `x`."""
        first, second = neighbours(len(x), x.shape[1])
        # A row may carry several samples, one for each sheet.
        order = np.argsort(rows, kind="stable")
        sorted_rows = rows[order]
        low = np.searchsorted(sorted_rows, first, side="left")
        count = np.searchsorted(sorted_rows, first, side="right") - low
        offset = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        a = z[order[np.repeat(low, count) + offset]]
        target = x[np.repeat(second, count)]
        y, good = self.over(target, a)
        return a[good], np.hstack([target, y])[good]

    # -- values ------------------------------------------------------------------------------------

    def compiled(self, outputs: Sequence[sp.Expr]):
        """`outputs` as a compiled function of z."""
        system = self.system
        return compile_function(
            tuple(outputs),
            arguments=system.states,
            epsilon=system.epsilon,
            parameters=tuple(system.parameters),
        )

    def _derivatives(self, outputs: Sequence[sp.Expr]):
        """`outputs` as a compiled function of z; where they overflow as they stand, in a form that does not."""
        plain = self.compiled(outputs)
        bounded: list = []

        def evaluate(z: np.ndarray, p: np.ndarray) -> np.ndarray:
            values = plain(z, p)
            lost = ~finite_rows(values)
            if lost.any():
                if not bounded:
                    bounded.append(self.compiled([without_overflow(e) for e in outputs]))
                values = np.array(values)
                values[lost] = bounded[0](z[lost], p)
            return values

        return evaluate

    @cached_property
    def _g_y(self):
        return self._derivatives([derivative(g, y) for g in self.g for y in self.system.y])

    @cached_property
    def _all_jacobians(self):
        return self._derivatives([derivative(e, s) for e in (*self.f, *self.g) for s in self.system.states])

    @cached_property
    def _second(self):
        entries = [derivative(g, y) for g in self.g for y in self.system.y]
        return self._derivatives([derivative(entry, s) for entry in entries for s in self.system.states])

    @cached_property
    def _rates(self):
        return self.compiled([*self.f, *self.g])

    @cached_property
    def _equilibria(self):
        return self.compiled(self.g)

    def rates(self, z: np.ndarray) -> np.ndarray:
        """(f, g) at `z` (m, n): (m, n)."""
        return self._rates(z, self.p)

    def jacobians(self, z: np.ndarray) -> np.ndarray:
        """Derivatives of (f, g) by (x, y) at `z` (m, n): (m, n, n)."""
        n = len(self.system.states)
        return self._all_jacobians(z, self.p).reshape(-1, n, n)

    def equilibria(self, z: np.ndarray) -> np.ndarray:
        """g at `z` (m, n): (m, n_fast)."""
        return self._equilibria(z, self.p)

    def equilibria_jacobian(self, z: np.ndarray) -> np.ndarray:
        """Derivatives of g by (x, y) at `z` (m, n): (m, n_fast, n)."""
        nx, n = len(self.system.x), len(self.system.states)
        return self._all_jacobians(z, self.p).reshape(-1, n, n)[:, nx:, :]

    def fast_jacobian(self, z: np.ndarray) -> np.ndarray:
        """g_y at `z` (m, n): (m, n_fast, n_fast)."""
        n = len(self.system.y)
        return self._g_y(z, self.p).reshape(-1, n, n)

    def second(self, z: np.ndarray) -> np.ndarray:
        """d(g_y)/dz at `z` (m, n): (m, n_fast, n_fast, n)."""
        n = len(self.system.y)
        return self._second(z, self.p).reshape(-1, n, n, z.shape[1])

    def eigenvalues(self, z: np.ndarray) -> np.ndarray:
        """Eigenvalues of g_y at `z` (m, n): complex (m, n_fast), not a number where g_y is not finite."""
        matrices = self.fast_jacobian(z)
        finite = np.isfinite(matrices).all(axis=(1, 2))
        values = np.full(matrices.shape[:2], complex(np.nan))
        if finite.any():
            values[finite] = eigenvalues(matrices[finite])
        return values

    def is_singular(self, z: np.ndarray) -> bool:
        """Whether g_y is nearly singular at most of the points `z` (m, n)."""
        matrices = self.fast_jacobian(z)
        sizes = np.linalg.svd(matrices[np.isfinite(matrices).all(axis=(1, 2))], compute_uv=False)
        return bool(len(sizes)) and bool(np.mean(sizes[:, -1] <= NEARLY_SINGULAR * sizes.max()) > 0.5)

    def residual(self, z: np.ndarray) -> float:
        """Largest |g| at `z`, relative to 1 + |z|."""
        values = np.abs(self.equilibria(z))
        return float(np.nanmax(values / (1.0 + np.abs(z).max(axis=1, keepdims=True))))

    def _slopes(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(J, y_x, usable): the whole Jacobian, y_x = g_y^-1 g_x, and the samples where both exist."""
        nx, n = len(self.system.x), len(self.system.states)
        J = self._all_jacobians(z, self.p).reshape(-1, n, n)
        usable = finite_rows(J)
        usable[usable] = np.abs(np.linalg.det(J[usable][:, nx:, nx:])) > 0.0
        J = J[usable]
        return J, np.linalg.solve(J[:, nx:, nx:], J[:, nx:, :nx]), usable

    def tangential_rate(self, z: np.ndarray) -> float:
        """Largest |eigenvalue| of the symmetric part of f_x - f_y g_y^-1 g_x."""
        rates = self.tangential_rates(z)
        usable = np.isfinite(rates)
        return float(rates[usable].max()) if usable.any() else float("inf")

    def tangential_rates(self, z: np.ndarray) -> np.ndarray:
        """The same at each of `z` (m, n): (m,), infinite where g_y is singular or not finite."""
        nx = len(self.system.x)
        J, slope, usable = self._slopes(z)
        rates = np.full(len(z), np.inf)
        if usable.any():
            A = J[:, :nx, :nx] - J[:, :nx, nx:] @ slope
            rates[usable] = np.abs(np.linalg.eigvalsh((A + A.transpose(0, 2, 1)) / 2)).max(axis=1)
        return rates

    def jacobian_variation(self, z: np.ndarray) -> float:
        """Largest entry of the total derivative D_x g_y = d(g_y)/dx - d(g_y)/dy g_y^-1 g_x."""
        nx = len(self.system.x)
        _, slope, usable = self._slopes(z)
        if not usable.all() or len(z) == 0:
            return float("inf")
        T = self.second(z)
        return float(np.abs(T[..., :nx] - np.einsum("mijk,mkl->mijl", T[..., nx:], slope)).max())


def grid(box: np.ndarray) -> np.ndarray:
    """Sample points (m, n) of a box (n, 2): a grid with its corners in one and two dimensions, else Sobol."""
    n = len(box)
    if n in GRID:
        axes = [np.linspace(low, high, GRID[n]) for low, high in box]
        return np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
    from scipy.stats import qmc

    unit = qmc.Sobol(n, scramble=False).random_base2(SOBOL)
    corners = (np.arange(2 ** min(n, 10))[:, None] >> np.arange(n)) & 1
    points = np.vstack([unit, corners])
    return box[:, 0] + points * (box[:, 1] - box[:, 0])


def neighbours(rows: int, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of rows of a `grid`: next to each other along an axis, or in the order of the Sobol sequence."""
    index = np.arange(rows)
    if dimension not in GRID:
        return index[:-1], index[1:]
    table = index.reshape((GRID[dimension],) * dimension)
    pairs = [(np.delete(table, -1, axis), np.delete(table, 0, axis)) for axis in range(dimension)]
    return tuple(np.concatenate([pair[side].ravel() for pair in pairs]) for side in (0, 1))  # pyright: ignore[reportReturnType]
