"""A branch sampled over a region: its points, the fast Jacobian there, and which samples share a sheet."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import entries, slopes
from gsp.algebra.laurent import laurent
from gsp.algebra.substitution import substituted
from gsp.critical.branch import Branch
from gsp.critical.sheet_points import LARGE, Allowance, fast_lengths, solve_each
from gsp.critical.slow_metric import ROUNDING, frozen_rates, least_metric
from gsp.critical.spectrum import eigenvalues, symmetrised
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over, finite_rows
from gsp.systems.region import EDGE, ImageBox, Interval, balancing_units

# Points per axis for one and two slow variables; a Sobol sequence of 2^11 points beyond.
GRID = {1: 257, 2: 33}
COARSE = {1: 33, 2: 9}


class Sampler:
    """Compiled Jacobians of one branch, evaluated in batches at points z = (x, y) on it."""

    def __init__(self, branch: Branch) -> None:
        self.branch = branch
        self.system = branch.system
        epsilon, zero = self.system.epsilon, sp.Integer(0)
        self.f = [laurent(e, epsilon, order=0).get(0, zero) for e in self.system.f]
        self.g = [laurent(e, epsilon, order=0).get(0, zero) for e in self.system.g]
        self.p = compile_flow(self.system).constants

    @property
    def is_large(self) -> bool:
        """Whether there are so many fast variables that samples are few."""
        return len(self.system.y) > LARGE

    def grid(self, box: Mapping[str, Interval]) -> np.ndarray:
        """Slow points (m, n_slow) over `box`, at which the branch is sampled."""
        return grid(np.array([box[s.name] for s in self.system.x]), coarse=self.is_large)

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
        if isinstance(box, ImageBox):
            good[good] = box.exists(z[good])
        return good

    def counted(self, x: np.ndarray, box: Mapping[str, Interval]) -> np.ndarray:
        """Which slow points `x` (m, n_slow) states of the region have: all but in the box of an image."""
        if not isinstance(box, ImageBox):
            return np.ones(len(x), dtype=bool)
        return box.exists(np.hstack([x, np.full((len(x), len(self.system.y)), np.nan)]))

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

    def bisected(
        self,
        a: np.ndarray,
        b: np.ndarray,
        is_like: Callable[[np.ndarray], np.ndarray],
        *,
        halvings: int = np.finfo(float).nmant,
    ) -> tuple[np.ndarray, np.ndarray]:
        """The last points (m, n) of sheets on the way from `a` (m, n) to the slow points of `b` that are like their a,
        as `is_like` says of points (m, n), and the next ones; those of b where the sheet has none.
        """
        nx = len(self.system.x)
        low, high_x, beyond = a.copy(), b[:, :nx].copy(), b.copy()
        for _ in range(halvings):
            x = 0.5 * (low[:, :nx] + high_x)
            y, good = self.over(x, low)
            z = np.hstack([x, np.nan_to_num(y)])
            same = good & is_like(z)
            low[same], high_x[~same] = z[same], x[~same]
            beyond[good & ~same] = z[good & ~same]
        return low, beyond

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
        """`outputs` as a compiled function of z.

        Whole exponents are put in: n (n - 1) u^(n - 2) is 0 at n = 1 and u = 0 as well.
        """
        whole = {s: value for s, value in self.system.parameters.items() if value.is_Integer}
        powers = {power for e in outputs for power in e.atoms(sp.Pow)}
        raised = {s for power in powers for s in power.exp.free_symbols & whole.keys()}
        put_in = {s: whole[s] for s in raised}
        return compile_over(self.system, [substituted(e, put_in) if put_in else e for e in outputs])

    @cached_property
    def _g_y(self):
        return self.compiled(entries(self.g, self.system.y))

    @cached_property
    def _all_jacobians(self):
        return self.compiled(entries((*self.f, *self.g), self.system.states))

    @cached_property
    def _second(self):
        """Where d(g_y)/dz is not 0 throughout, three arrays (k,) for row, column and state; and its values there."""
        first = slopes(self.g, self.system.y)
        places, values = list(first), slopes(first.values(), self.system.states)
        rows = np.array([(*places[e], k) for e, k in values], dtype=int).reshape(-1, 3).T
        return rows, self.compiled(list(values.values()))

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

    def bent(self, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        """d(g_y v)/dz at points z (m, n) for vectors v (m, n_fast): (m, n_fast, n)."""
        (i, j, k), values = self._second
        found = np.zeros((*v.shape, z.shape[1]))
        np.add.at(found, (np.arange(len(z))[:, None], i, k), values(z, self.p) * v[:, j])
        return found

    def followed(self, z: np.ndarray, near: complex) -> np.ndarray:
        """The eigenvalues (k,) of g_y at z (n,) nearest to the point of the axis beside `near`, by shift and invert.

        All of them where g_y is as good as symmetric; one that lies on that point is given alone. Not a number where
        g_y is not finite.
        """
        from scipy.sparse import csc_matrix
        from scipy.sparse.linalg import ArpackError, eigs

        matrix = self.fast_jacobian(z[None, :])[0]
        if not np.isfinite(matrix).all():
            return np.array([complex(np.nan)])
        symmetric = symmetrised(matrix)
        if symmetric is not None:
            return np.linalg.eigvalsh(symmetric)
        shift = 1j * near.imag if near.imag else 0.0
        whole = csc_matrix(matrix.astype(complex) if near.imag else matrix)
        n = len(matrix)
        try:
            # The same start each time, for the same answer.
            found: Any = eigs(
                whole,
                k=min(2, n - 2),
                ncv=min(40, n),
                sigma=shift,
                v0=np.ones(n),
                tol=1e-9,  # pyright: ignore[reportArgumentType]
                return_eigenvectors=False,
            )
            return found
        except ArpackError:
            return eigenvalues(matrix[None])[0]
        except RuntimeError:
            # The shifted matrix has no decomposition.
            return np.array([complex(0.0, near.imag)])

    def eigenvalues(self, z: np.ndarray) -> np.ndarray:
        """Eigenvalues of g_y at `z` (m, n): complex (m, n_fast), not a number where g_y is not finite."""
        if not self.is_large:
            return self._spectra(z)
        # Samples are asked for theirs as ends of links again.
        rows = [row.tobytes() for row in np.ascontiguousarray(z)]
        new = [i for i, row in enumerate(rows) if row not in self._known]
        self._known |= dict(zip([rows[i] for i in new], self._spectra(z[new])))
        return np.array([self._known[row] for row in rows]).reshape(len(z), len(self.system.y))

    @cached_property
    def _known(self) -> dict[bytes, np.ndarray]:
        return {}

    @cached_property
    def is_constant(self) -> bool:
        """Whether g_y is the same everywhere."""
        return not len(self._second[0][0])

    def _spectra(self, z: np.ndarray) -> np.ndarray:
        matrices = self.fast_jacobian(z)
        finite = np.isfinite(matrices).all(axis=(1, 2))
        values = np.full(matrices.shape[:2], complex(np.nan))
        if finite.all() and self.is_large and self.is_constant and len(matrices):
            values[:] = eigenvalues(matrices[:1])
        elif finite.any():
            values[finite] = eigenvalues(matrices[finite])
        return values

    def fast_lengths(self, z: np.ndarray) -> np.ndarray:
        """How far the branch reaches in each fast variable (n_fast,), by its points `z` (m, n).

        In those that are 0 at all of them as far as g_y makes it of the others.
        """
        units, nx = self.branch.units, len(self.system.x)
        lengths, is_zero = fast_lengths(z[:, nx:], units and units[nx:]), ~z[:, nx:].any(axis=0)
        if self.is_large or is_zero.all() or not is_zero.any():
            return lengths
        matrices = np.abs(self.fast_jacobian(z))
        own = balancing_units(matrices[np.isfinite(matrices).all(axis=(1, 2))].sum(axis=0))
        return np.where(is_zero, own * np.exp(np.log(lengths / own)[~is_zero].mean()), lengths)

    def is_singular(self, z: np.ndarray) -> bool:
        """Whether g_y is nearly singular at most of the points `z` (m, n)."""
        # Singular values of a large matrix take long, and most of the points are told by every eighth.
        matrices = self.fast_jacobian(z[:: 8 if self.is_large else 1])
        matrices = matrices[np.isfinite(matrices).all(axis=(1, 2))] * self.fast_lengths(z)
        # Each row by its largest entry anywhere: neither units nor factors of equations make a matrix singular.
        largest = np.abs(matrices).max(axis=(0, 2), initial=0.0)
        sizes = np.linalg.svd(matrices / np.where(largest > 0.0, largest, 1.0)[:, None], compute_uv=False)
        # Least singular value of g_y, relative to the largest, at which Newton's method has lost half of its
        # digits.
        return bool(len(sizes)) and bool(np.mean(sizes[:, -1] <= 1e-4 * sizes.max()) > 0.5)

    def residual(self, z: np.ndarray) -> float:
        """Largest |g| at `z` by what the branch's own `fast_lengths` make of it: how far `z` is off, in those."""
        left, lengths = np.abs(self.equilibria(z)), self.fast_lengths(z)
        # One by one: matrices of all points may not find room.
        moved = np.array([(np.abs(self.fast_jacobian(point[None]))[0] @ lengths) for point in z])
        return float(np.nanmax(np.divide(left, moved, out=left, where=left > 0.0)))

    def rounding(self, z: np.ndarray) -> float:
        """The largest `residual` that the rounding of `z` makes of a point of the branch."""
        lengths, shares = self.fast_lengths(z), []
        for point in z:
            slopes = np.abs(self.equilibria_jacobian(point[None])[0])
            moved = slopes[:, len(self.system.x) :] @ lengths
            rounded = np.finfo(float).eps * slopes @ np.abs(point)
            shares.append(np.max(rounded / moved, initial=0.0, where=rounded < moved))
        return float(max(shares))

    def _slopes(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(J, y_x, usable): the whole Jacobian, y_x = g_y^-1 g_x, and the samples where both exist."""
        nx, n = len(self.system.x), len(self.system.states)
        J = self._all_jacobians(z, self.p).reshape(-1, n, n)
        usable = finite_rows(J)
        if self.is_large:
            columns = [solve_each(J[usable][:, nx:, nx:], J[usable][:, nx:, k]) for k in range(nx)]
            slope = np.stack(columns, axis=2)
            good = finite_rows(slope)
            usable[usable] = good
            return J[usable], slope[good], usable
        usable[usable] = np.linalg.slogdet(J[usable][:, nx:, nx:])[0] != 0.0
        J = J[usable]
        return J, np.linalg.solve(J[:, nx:, nx:], J[:, nx:, :nx]), usable

    def tangents(self, z: np.ndarray) -> np.ndarray:
        """dz/dx along the sheet at `z` (m, n): (m, n, n_slow), not a number where the sheet has no slope."""
        nx = len(self.system.x)
        _, slope, usable = self._slopes(z)
        found = np.full((*z.shape, nx), np.nan)
        found[usable] = np.concatenate([np.broadcast_to(np.eye(nx), (len(slope), nx, nx)), -slope], axis=1)
        if self.branch.is_explicit and not usable.all():
            # Where another branch passes through a graph, g_y is singular and the graph has its slope.
            found[~usable, :nx] = np.eye(nx)
            found[~usable, nx:] = self._graph_slopes(z[~usable], self.p).reshape(-1, *slope.shape[1:])
        return found

    @cached_property
    def _graph_slopes(self):
        graph = self.branch.graph or {}
        return self.compiled(entries([graph[y] for y in self.system.y], self.system.x))

    def slow_jacobians(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(A, usable): f_x - f_y g_y^-1 g_x (k, n_slow, n_slow) at those of `z` (m, n) where it is finite."""
        nx = len(self.system.x)
        J, slope, usable = self._slopes(z)
        own, by_way = J[:, :nx, :nx], J[:, :nx, nx:] @ slope
        A = own - by_way
        # What cancels is 0: which slow variables drive which is told by the entries.
        terms = np.abs(own) + np.abs(J[:, :nx, nx:]) @ np.abs(slope)
        A[np.abs(A) <= ROUNDING * terms] = 0.0
        finite = finite_rows(A)
        usable[usable] = finite
        return A[finite], usable

    def tangential_rate(self, z: np.ndarray) -> float:
        """Largest rate at which neighbours on the branch part or approach, in the metric in which that is least."""
        A, usable = self.slow_jacobians(z)
        return float(least_metric(A).rates(A).max()) if usable.any() else float("inf")

    def tangential_rates(self, z: np.ndarray) -> np.ndarray:
        """The same at each of `z` (m, n) by itself: (m,), infinite where g_y is singular or not finite."""
        A, usable = self.slow_jacobians(z)
        rates = np.full(len(z), np.inf)
        rates[usable] = frozen_rates(A)
        return rates

    def jacobian_variation(self, z: np.ndarray) -> float:
        """Largest entry of the total derivative D_x g_y = d(g_y)/dx - d(g_y)/dy g_y^-1 g_x."""
        along = self.tangents(z)
        if not finite_rows(along).all() or len(z) == 0:
            return float("inf")
        (i, j, k), values = self._second
        if not len(i):
            return 0.0
        moved = values(z, self.p)[:, :, None] * along[:, k]
        # What belongs to one entry of g_y stands in a row.
        starts = np.flatnonzero(np.append(True, (np.diff(i) != 0) | (np.diff(j) != 0)))
        return float(np.abs(np.add.reduceat(moved, starts, axis=1)).max())


def grid(box: np.ndarray, *, coarse: bool = False) -> np.ndarray:
    """Sample points (m, n) of a box (n, 2): a grid with its corners in one and two dimensions, else Sobol."""
    n = len(box)
    sides = COARSE if coarse else GRID
    if n in sides:
        axes = [np.linspace(low, high, sides[n]) for low, high in box]
        return np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
    from scipy.stats import qmc

    unit = qmc.Sobol(n, scramble=False).random_base2(6 if coarse else 11)
    corners = (np.arange(2 ** min(n, 5 if coarse else 10))[:, None] >> np.arange(n)) & 1
    points = np.vstack([unit, corners])
    return box[:, 0] + points * (box[:, 1] - box[:, 0])


def neighbours(rows: int, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of rows of a `grid`: next to each other along an axis, or in the order of the Sobol sequence."""
    index = np.arange(rows)
    if dimension not in GRID:
        return index[:-1], index[1:]
    table = index.reshape((round(rows ** (1 / dimension)),) * dimension)
    pairs = [(np.delete(table, -1, axis), np.delete(table, 0, axis)) for axis in range(dimension)]
    return tuple(np.concatenate([pair[side].ravel() for pair in pairs]) for side in (0, 1))  # pyright: ignore[reportReturnType]
