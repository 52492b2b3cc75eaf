"""The critical manifold over two free variables: a triangulated sheet with its stability and its folds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import sympy as sp

from gsp.critical.continuation.critical_curve import NamedPoints, Options
from gsp.critical.continuation.curve_continuation import box_of, check_controls, check_inside
from gsp.critical.continuation.fold_curve import FoldCurve, fold_curve, two_free
from gsp.critical.continuation.simplices import Grid, Mesh, march
from gsp.critical.continuation.special_points import ZERO_EIGENVALUE, fold_vectors
from gsp.critical.layer_problem import (
    Bounds,
    LayerProblem,
    check_bounds,
    corrected_start,
    layer_problem,
    least_norm_newton,
    natural_scales,
    points_near,
)
from gsp.critical.minimally_augmented import identity, singular_near
from gsp.errors import BranchError, DeclarationError, Status
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.systems.arguments import check_noun, check_progress, check_whole
from gsp.systems.flow import Point, frozen, in_words
from gsp.systems.region import Interval
from gsp.systems.system import SlowFastSystem

# d! simplices to a cube: 720 for four fast variables, 5040 for five.
MOST_FAST = 4


@dataclass(frozen=True)
class SheetStats:
    """What a sheet cost: cubes that it crosses, cubes where g is not finite, vertices that needed a second method."""

    cells: int
    skipped: int
    repaired: int


@dataclass(frozen=True, eq=False, repr=False)
class CriticalSheet(NamedPoints, Drawn, Tabular):
    """A connected sheet of M0 in a box, as triangles.

    `points` (m, n) have the columns `names`, and `sheet["x"]` is one of them; `triangles` (k, 3) are rows of it,
    all oriented alike. `eigenvalues` (m, n_fast) are those of g_y, `unstable` (m,) counts those to the right of the
    axis. Triangles end at the folds, whose vertices are `on_fold` (m,), so that `triangle_unstable` (k,) is one
    number inside each. `folds` are the curves of folds on the sheet. `residual` is the largest |g| at a vertex by what
    a cube's sides make of it: how many cubes the vertices are off M0.
    """

    what = "sheet"
    problem: LayerProblem
    points: np.ndarray
    triangles: np.ndarray
    eigenvalues: np.ndarray
    unstable: np.ndarray
    triangle_unstable: np.ndarray
    on_fold: np.ndarray
    on_crossing: np.ndarray
    folds: tuple[FoldCurve, ...]
    residual: float
    status: Status
    message: str
    stats: SheetStats

    def __repr__(self) -> str:
        return (
            f"CriticalSheet({len(self.points)} points, {len(self.triangles)} triangles over "
            f"{', '.join(self.free)}, {len(self.folds)} folds, {self.status.name})"
        )

    def __str__(self) -> str:
        lines = [f"sheet of the critical manifold over {', '.join(self.free)}"]
        lines += [f"  {name} from {self[name].min():.6g} to {self[name].max():.6g}" for name in self.names]
        kinds, counts = np.unique(self.triangle_unstable, return_counts=True)
        lines += [f"  {count} triangles with {kind} unstable" for kind, count in zip(kinds, counts)]
        lines += [f"  fold: {fold!r}" for fold in self.folds]
        return "\n".join([*lines, f"  {self.message}"])


def critical_sheet(
    system: SlowFastSystem,
    *,
    start: Point,
    bounds: Bounds,
    parameter: sp.Symbol | str | None = None,
    free: tuple[sp.Symbol | str, ...] | None = None,
    resolution: int | None = None,
    max_points: int = 200_000,
    tolerance: float = 1e-10,
    progress: Callable[[float], None] | None = None,
) -> CriticalSheet:
    """The sheet of M0 through `start` over two free variables, within `bounds`, triangulated.

    The free variables are both slow ones, the two named in `free`, or a slow one and `parameter`; each has
    bounds, cut into `resolution` cubes: 32 by default, and 16 where three or four fast variables put five to ten
    times as many triangles into each. Fast variables may be bounded too; where they are not, their size at the
    start sets the size of a cube. Vertices are corrected onto M0; parts of M0 that are thinner than a cube, or not
    connected to the start within the bounds, are not found.

    Raises `DeclarationError` for a call that is not well formed and `BranchError` when no point of M0 is near
    `start`. Simplicial continuation after Allgower and Georg (1990).

    >>> a, b, y, eps = sp.symbols("a b y epsilon")
    >>> system = SlowFastSystem(slow={a: y, b: -y}, fast={y: y**3 + a*y + b}, epsilon=eps)
    >>> box = {"a": (-1, 1), "b": (-1, 1), "y": (-2, 2)}
    >>> sheet = critical_sheet(system, start={"a": -1, "b": 0, "y": 1}, bounds=box, resolution=12)
    >>> [len(fold.special) for fold in sheet.folds], sheet.residual < 1e-12
    ([1], True)
    """
    check_noun(system, SlowFastSystem, verb="critical_sheet")
    if len(system.y) > MOST_FAST:
        raise DeclarationError(
            f"a sheet is triangulated for up to {MOST_FAST} fast variables.",
            "Continue curves with continue_critical, one for each value of a slow variable.",
            got=len(system.y),
        )
    if resolution is None:
        resolution = 32 if len(system.y) <= 2 else 16
    check_whole(resolution, what="resolution", least=2, most=10**6, be="a whole number of at least 2")
    check_progress(progress)
    controls = check_controls(0.01, 0.04, max_points, tolerance)
    problem, guess = layer_problem(system, two_free(system, parameter, free), start)
    box = check_bounds(bounds, problem)
    missing = [s.name for s in problem.free if s.name not in box]
    if missing:
        raise DeclarationError(
            f"bounds gives no interval for {', '.join(missing)}.", "A sheet needs both.", got=box
        )
    check_inside(problem, guess, box, "start")
    scales = natural_scales(problem, guess, box)
    u = corrected_start(problem, guess, scales, tolerance)
    check_inside(problem, u, box, "the point of M0 next to start")
    box = _off_poles(problem, u, box)
    grid = _grid(problem, u, box, scales, resolution)
    with np.errstate(all="ignore"):
        mesh = march(problem.residual, grid, u, n=problem.size, most=max_points, progress=progress)
        if not len(mesh.nodes):
            sizes = in_words((s.name, size) for s, size in zip(problem.unknowns, grid.size))
            raise BranchError(
                "none of the cubes next to start is crossed by M0, as far as the values at their corners tell.",
                "Raise resolution, or give bounds for the fast variables, which set the size of a cube.",
                got=f"cubes of {sizes}",
            )
        return _finished(
            problem, _Builder(problem, grid, mesh, scales, box_of(problem, box)), Options(box, controls)
        )


def _off_poles(problem: LayerProblem, u: np.ndarray, box: Mapping[str, Interval]) -> dict[str, Interval]:
    """The box with edges on which g is not finite moved in by rounding, as by luck some of them are already."""
    moved = {}
    for i, symbol in enumerate(problem.unknowns):
        if symbol.name in box:
            low, high = box[symbol.name]
            at_ends = np.stack([u, u])
            at_ends[:, i] = low, high
            finite = np.isfinite(problem.residual(at_ends)).all(axis=1)
            rounding = np.where(finite, 0.0, np.finfo(float).eps * (abs(low) + abs(high)))
            moved[symbol.name] = (float(low + rounding[0]), float(high - rounding[1]))
    return moved


def _grid(
    problem: LayerProblem, u: np.ndarray, box: Mapping[str, Interval], scales: np.ndarray, resolution: int
) -> Grid:
    origin, size, counts = np.empty(len(u)), np.empty(len(u)), np.full(len(u), -1)
    for i, symbol in enumerate(problem.unknowns):
        if symbol.name in box:
            low, high = box[symbol.name]
            origin[i], size[i], counts[i] = low, (high - low) / resolution, resolution
        else:
            # Half a cube off, so that a start on a plane of symmetry is not on a plane of nodes.
            size[i] = 2.0 * scales[i] / resolution
            origin[i] = u[i] - 0.5 * size[i]
    return Grid(origin, size, counts)


class _Builder:
    """Vertices corrected onto M0, merged, and split where g_y is `singular` (m,)."""

    def __init__(
        self, problem: LayerProblem, grid: Grid, mesh: Mesh, scales: np.ndarray, bounds: np.ndarray
    ) -> None:
        self.problem, self.grid, self.mesh, self.scales, self.bounds = problem, grid, mesh, scales, bounds
        self.repaired = 0
        # Coordinates in which a vertex must not move: those of a bound that its whole face lies on.
        ends = (mesh.nodes == 0) | (mesh.nodes == grid.counts)
        self.held = ends.all(axis=1) & (grid.counts >= 0) & (mesh.nodes == mesh.nodes[:, :1]).all(axis=1)
        # Vertices that no correction brings onto M0: g changes its sign across a pole too.
        self.lost = np.zeros(len(mesh.nodes), dtype=bool)
        self.u = self._polished()
        self.triangles = mesh.triangles
        self.singular = np.zeros(len(self.u), dtype=bool)
        self._split()
        if self.lost.any():
            self._drop_lost()
        self._orient()

    def _polished(self) -> np.ndarray:
        """Newton's method of least norm, which moves neighbours alike; within its face where that fails."""
        corners = self.grid.nodes(self.mesh.nodes)
        u = np.einsum("mi,mid->md", self.mesh.weights, corners)
        # Sums of equal numbers by weights that sum to one are equal to them up to rounding only.
        exact = np.where(self.mesh.nodes[:, 0] == 0, self.bounds[:, 0], self.bounds[:, 1])
        first = np.where(self.held, exact, u)
        u = first.copy()
        edges = corners[:, 1:] - corners[:, :1]
        # A vertex may leave its face by half of the face; beyond, it is corrected in another way.
        every, reach = np.arange(len(u)), 0.5 * np.abs(edges).max(axis=1) + 0.25 * self.grid.size
        across = np.where(self.held, 0.0, self.grid.size)[:, None, :] * np.eye(u.shape[1])
        far = self._correct_rows(u, first, every, across, reach)
        rest = self._correct_rows(u, first, far, edges, reach)
        outside = np.flatnonzero((np.abs(self._confined(u) - u) > 1e-9 * self.grid.size).any(axis=1))
        wrong = np.union1d(rest, outside)
        found = self._repaired(first[wrong], self.held[wrong])
        self.lost[wrong] = np.isnan(found).any(axis=1)
        u[wrong] = np.where(self.lost[wrong, None], first[wrong], found)
        return np.where(self.held, exact, self._confined(u))

    def _correct_rows(
        self, u: np.ndarray, first: np.ndarray, rows: np.ndarray, ways: np.ndarray, reach: np.ndarray
    ) -> np.ndarray:
        """Correct those `rows` of `first` into `u` along their `ways`; which of them go beyond `reach`, or nowhere."""
        if not rows.size:
            return rows
        u[rows], settled = self._corrected(first[rows], ways[rows])
        return rows[~settled | (np.abs(u[rows] - first[rows]) > reach[rows]).any(axis=1)]

    def _corrected(self, u: np.ndarray, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Newton's method from points (m, d) in the directions `ways` (m, k, d), and which of them it settled."""
        length = np.full(len(u), np.inf)
        for _ in range(12):
            value = self.problem.residual(u)
            slope = np.einsum("mij,mkj->mik", self.problem.jacobians(u), ways)
            good = np.isfinite(slope).all(axis=(1, 2)) & np.isfinite(value).all(axis=1)
            step = np.zeros((len(u), ways.shape[1]))
            step[good] = np.einsum("mij,mj->mi", np.linalg.pinv(slope[good], rcond=1e-13), value[good])
            u = u - np.einsum("mi,mid->md", step, ways)
            length = np.where(good, np.abs(step).max(axis=1), np.inf)
            if length.max(initial=0.0) < 1e-15:
                break
        return u, length < 1e-9

    def _confined(self, u: np.ndarray) -> np.ndarray:
        """Points (..., d) moved onto the bounds that they are beyond."""
        return np.clip(u, self.bounds[:, 0], self.bounds[:, 1])

    def _repaired(self, u: np.ndarray, held: np.ndarray) -> np.ndarray:
        """The points of M0 next to u (m, N), NaN where there is none, by steps of least norm, along bounds beyond."""
        self.repaired += len(u)
        u, held, found, left = u.copy(), held.copy(), np.full(u.shape, np.nan), np.arange(len(u))
        for _ in range(u.shape[1]):
            near = points_near(self.problem, u[left], np.where(held[left], 0.0, self.grid.size), 1e-12)
            known = np.isfinite(near).all(axis=1)
            left, near = left[known], near[known]
            inside = self._confined(near)
            held[left] |= inside != near
            u[left] = inside
            kept = (inside == near).all(axis=1)
            found[left[kept]], left = near[kept], left[~kept]
        return found

    def _drop_lost(self) -> None:
        kept = self.triangles[~self.lost[self.triangles].any(axis=1)]
        used, places = np.unique(kept, return_inverse=True)
        self.triangles = places.reshape(kept.shape)
        self.u, self.held, self.singular = self.u[used], self.held[used], self.singular[used]

    def _determinants(self) -> np.ndarray:
        return np.linalg.det(self.problem.fast_jacobians(self.u))

    def _split(self) -> None:
        """Cut the triangles where det g_y changes its sign."""
        value = self._determinants()
        sign = value > 0.0
        edges = np.sort(self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges = np.unique(edges[sign[edges[:, 0]] != sign[edges[:, 1]]], axis=0)
        if len(edges) == 0:
            return
        a, b = edges.T
        share = (value[a] / (value[a] - value[b]))[:, None]
        fixed = self.held[a] & self.held[b] & (self.u[a] == self.u[b])
        fresh = self.u[a] + share * (self.u[b] - self.u[a])
        found = np.array([self._fold_between(*edge) for edge in zip(fresh, fixed)])
        true = np.isfinite(found).all(axis=1)
        found[~true] = self._repaired(fresh[~true], fixed[~true])
        lost = np.isnan(found).any(axis=1)
        place = {(int(a), int(b)): len(self.u) + i for i, (a, b) in enumerate(edges)}
        self.u = np.vstack([self.u, np.where(lost[:, None], fresh, found)])
        self.held = np.vstack([self.held, fixed])
        self.singular = np.concatenate([self.singular, true])
        self.lost = np.concatenate([self.lost, lost])
        mixed = sign[self.triangles].sum(axis=1) % 3 != 0
        pieces = []
        for triangle in self.triangles[mixed].tolist():
            odd = next(i for i in range(3) if sum(sign[j] == sign[triangle[i]] for j in triangle) == 1)
            a, b, c = triangle[odd], triangle[(odd + 1) % 3], triangle[(odd + 2) % 3]
            p, q = place[min(a, b), max(a, b)], place[min(a, c), max(a, c)]
            pieces += [(a, p, q), (p, b, c), (p, c, q)]
        self.triangles = np.vstack([self.triangles[~mixed], pieces])

    def _fold_between(self, u: np.ndarray, fixed: np.ndarray) -> np.ndarray:
        """The fold next to u, within the bounds and two cubes; NaN when there is none."""
        try:
            system = singular_near(self.problem, identity, u, self.scales)
        except np.linalg.LinAlgError:
            return np.full(u.shape, np.nan)
        found = least_norm_newton(system, u, np.where(fixed, 0.0, self.grid.size), 1e-12)
        if found is None or (np.abs(found - u) > 2.0 * self.grid.size).any():
            return np.full(u.shape, np.nan)
        return np.where((self._confined(found) == found).all(), found, np.nan)

    def _orient(self) -> None:
        """Triangles turned so that det[g_u; both edges] is positive in the middle: one side of the sheet."""
        corners = self.u[self.triangles] / self.scales
        sides = corners[:, 1:] - corners[:, :1]
        slopes = self.problem.jacobians(self.u[self.triangles].mean(axis=1)) * self.scales
        flip = np.linalg.det(np.concatenate([slopes, sides], axis=1)) < 0.0
        self.triangles[flip] = self.triangles[flip][:, [0, 2, 1]]


def _finished(problem: LayerProblem, built: _Builder, options: Options) -> CriticalSheet:
    u, mesh = built.u, built.mesh
    eigenvalues = problem.eigenvalues(u)
    count = (np.real(eigenvalues) > 0.0).sum(axis=1)
    size = np.abs(eigenvalues).max(axis=1, keepdims=True, initial=0.0)
    at_rest = (np.real(eigenvalues) > ZERO_EIGENVALUE * size).sum(axis=1)
    count = np.where(built.singular, at_rest, count)
    off = np.where(built.singular, -1, count)[built.triangles].max(axis=1)
    inside = np.where(off >= 0, off, count[built.triangles].max(axis=1))
    crossing = np.zeros(len(u), dtype=bool)
    crossing[built.singular] = [_crosses(problem, v, built.grid.size) for v in u[built.singular]]
    on_fold = built.singular & ~crossing
    folds = _folds(problem, built, on_fold, options)
    status = Status.COMPLETE if mesh.complete else Status.TOO_MANY_POINTS
    if mesh.skipped or built.lost.any():
        status = Status.NON_FINITE
    ending = status if status is not Status.NON_FINITE else f"{status.name}: it ends where g is not finite"
    message = f"{len(u)} points and {len(built.triangles)} triangles: {ending}"
    if crossing.any():
        message = f"{message}; another sheet crosses it at {_ranges(problem, u[crossing], built.grid.size)}"
    return CriticalSheet(
        problem=problem,
        points=frozen(problem.rows(u)),
        triangles=frozen(built.triangles),
        eigenvalues=frozen(eigenvalues),
        unstable=frozen(count),
        triangle_unstable=frozen(inside),
        on_fold=frozen(on_fold),
        on_crossing=frozen(crossing),
        folds=folds,
        residual=_residual(problem, u, built.grid.size),
        status=status,
        message=message,
        stats=SheetStats(mesh.cells, mesh.skipped, built.repaired),
    )


def _residual(problem: LayerProblem, u: np.ndarray, size: np.ndarray) -> float:
    left = np.abs(problem.residual(u))
    moved = np.abs(problem.jacobians(u)) @ size
    return float(np.divide(left, moved, out=left, where=left > 0.0).max(initial=0.0))


def _crosses(problem: LayerProblem, u: np.ndarray, size: np.ndarray) -> bool:
    """Whether the rows of g_u (n, N) are dependent at u, where g_y is singular: M0 is no manifold there."""
    left = fold_vectors(problem, u, size[len(problem.free) :])[1]
    change = np.einsum("i,ijk->jk", left, problem.second(u)) * size[:, None] * size
    # Sheets cross where the rows of g_u are dependent, up to this share of what they change by over one cube.
    return bool(np.abs(left @ problem.jacobian(u) * size).max() <= 1e-5 * np.abs(change).max())


def _ranges(problem: LayerProblem, u: np.ndarray, size: np.ndarray) -> str:
    """Where the points (m, N) lie, in words; what is nothing beside a cube is 0."""
    low, high = (np.where(np.abs(ends) > 1e-9 * size, ends, 0.0) for ends in (u.min(axis=0), u.max(axis=0)))
    texts = [(s.name, f"{a:.6g}", f"{b:.6g}") for s, a, b in zip(problem.unknowns, low, high, strict=True)]
    return ", ".join(f"{name} = {a}" if a == b else f"{name} from {a} to {b}" for name, a, b in texts)


def _folds(
    problem: LayerProblem, built: _Builder, on_fold: np.ndarray, options: Options
) -> tuple[FoldCurve, ...]:
    """The curves of folds through the vertices `on_fold`, each once."""
    seeds = built.u[on_fold]
    # From the inside first: a start on a bound would be continued one way only.
    held = built.held[on_fold].any(axis=1)
    seeds = np.vstack([seeds[~held], seeds[held]])
    curves: list[FoldCurve] = []
    columns = [problem.names.index(s.name) for s in problem.unknowns]
    # Curves of folds on one sheet that are followed at most.
    while len(seeds) and len(curves) < 16:
        curve = fold_curve(problem, seeds[0], options, built.scales)
        curves.append(curve)
        seeds = seeds[1:]
        distance = _distances(seeds / built.grid.size, curve.points[:, columns] / built.grid.size)
        seeds = seeds[distance > 1.0]
    return tuple(curves)


def _distances(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Distance of each point (m, d) to a polygonal line (k, d)."""
    best = np.full(len(points), np.inf)
    for a, b in pairwise(line):
        side = b - a
        share = np.clip((points - a) @ side / max(float(side @ side), 1e-300), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - a - share[:, None] * side, axis=1))
    return best
