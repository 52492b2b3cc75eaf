"""The slow manifold itself over a box of slow variables, to rounding where the problem allows it.

h solves the invariance equation epsilon Dh(x) f(x, h, epsilon) = g(x, h, epsilon) (Fenichel 1979). It is unique up
to exp(-c/epsilon) only; here M_epsilon is the surface that the flow makes of its past: an attracting one is
followed forward from upstream, a repelling one backward from downstream, one of saddle type both ways at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache

import numpy as np
import sympy as sp

from gsp.critical.branch import Branch
from gsp.critical.common_units import common_units, sized
from gsp.critical.loss_kind import LossKind
from gsp.errors import BranchError, DeclarationError, Status
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity, Kind, classify
from gsp.slow.chebyshev import ChebyshevSurface, interpolate, nodes
from gsp.slow.grids_at_rest import CHOPPED, FIRST_SIZE, LARGEST_SIZE, ROUGH, coarse_rest, doubled
from gsp.slow.orbit_segments import Segments, SegmentSolver
from gsp.slow.sampled_manifold import SampledManifold, defect_of
from gsp.slow.slow_track import divide
from gsp.systems.arguments import check_noun, check_number, check_whole
from gsp.systems.flow import check_epsilon, in_words
from gsp.systems.region import Interval, check_region, digits_between
from gsp.systems.system import SlowFastSystem

SMALLEST_TOLERANCE = 1e-14
# The residual over the gap is the error to leading order: on random systems it fell short of it by up to 1.11.
SAFETY = 2.0
# What the estimated error may exceed the tolerance by before the status says so.
SLACK = 10.0


def solve_manifold(
    branch: Branch,
    *,
    region: Mapping[str, Interval] | Mapping[sp.Symbol, Interval],
    epsilon: float,
    tolerance: float = 1e-10,
    max_points: int | None = None,
) -> SampledManifold:
    """The slow manifold over the box `region` of one to three slow variables, as a `SampledManifold`.

    At Chebyshev points of the box orbit segments of the full flow are solved; the degree of the interpolant is
    raised until its coefficients are below `tolerance`, relative to the size of y or 1, in units in which no state's
    numbers are tiny or huge. No grid of more than `max_points` is solved for, and when that does not do `status` is
    TOO_MANY_POINTS and the error estimate says what is left; where so many do not resolve M0 itself, no segment is
    solved. Segments may leave the region as far as M0 stays normally hyperbolic there. Intervals for fast variables
    choose the sheet of an implicit branch that has none fixed.

    A fold in the region, an orbit that ends, a Newton iteration that fails and the like are told by `status` and
    `message`. Raises `DeclarationError` for arguments that are not well formed and `BranchError` when the branch
    has no point in the region or several sheets to choose from.

    >>> from gsp.slow.solved_manifold import solve_manifold
    >>> s, x, y, eps = sp.symbols("s x y epsilon")
    >>> system = SlowFastSystem(slow={s: -s}, fast={x: x + s**2, y: -y + x*s}, epsilon=eps)
    >>> manifold = solve_manifold(solve_critical(system).branches[0], region={"s": (0, 1)}, epsilon=0.1)
    >>> manifold.kind, manifold.evaluate(0.5).round(9)
    (<Kind.SADDLE: 'saddle'>, array([-0.20833333, -0.14880952]))
    """
    check_noun(branch, Branch, verb="solve_manifold")
    system = branch.system
    slow = [s.name for s in system.x]
    if len(slow) > 3:
        raise DeclarationError(
            "solve_manifold takes one to three slow variables.",
            "Use zero_derivative at the points that matter.",
            got=f"{len(slow)}: {', '.join(slow)}",
        )
    box = check_region(region, [s.name for s in system.states], required=slow)
    value = check_epsilon(epsilon)
    be = f"a number from {SMALLEST_TOLERANCE:g}, which is near rounding, to 1"
    tolerance = check_number(tolerance, what="tolerance", be=be, least=SMALLEST_TOLERANCE, below=1.0)
    least = FIRST_SIZE[len(slow)] ** len(slow)
    if max_points is not None:
        be = f"a whole number of at least {least}, the first grid over {len(slow)} slow variables, or None"
        check_whole(max_points, what="max_points", least=least, most=10**9, be=be)
    sheet = _sheet(branch, box)
    slow_box = {name: box[name] for name in slow}
    verdict = _classified(sheet, tuple(slow_box.items()))
    work = _Work(sheet, box, value, float(tolerance), verdict, max_points)
    if verdict.kind is Kind.LOST:
        return work.lost()
    return work.run()


@lru_cache(maxsize=4)
def _classified(sheet: Branch, box: tuple[tuple[str, Interval], ...]) -> Hyperbolicity:
    """The verdict over the box, which is the same at every epsilon and tolerance."""
    return classify(sheet, region=dict(box))


class _Work:
    """One call of `solve_manifold`, its sheet fixed and classified; lengths are in common `units` (n,) of the states,
    and places are told from the system's centres, `centre` (n,).

    What is told is in those of the system: places, the values of the result, and its errors.
    """

    def __init__(
        self,
        branch: Branch,
        box: Mapping[str, Interval],
        epsilon: float,
        tolerance: float,
        verdict: Hyperbolicity,
        max_points: int | None,
    ) -> None:
        self.asked, self.box, self.epsilon, self.tolerance = branch, box, epsilon, tolerance
        self.verdict = verdict
        self.system = branch.system
        intervals = np.array([box[s.name] for s in self.system.x])
        own, self.centre = branch.about_centres, branch.system.centre
        self.x_centre, self.y_centre = np.split(self.centre, [len(self.system.x)])
        intervals = intervals - self.x_centre[:, None]
        x, y = _spread(own, intervals)
        self.units = common_units(own.system, np.hstack([x, sized(own, y)]))
        self.x_units, self.y_units = np.split(self.units, [len(self.system.x)])
        self.branch = own.moved_into(self.units)
        self.intervals = intervals / self.x_units[:, None]
        self.notes: list[str] = []
        self.errors: np.ndarray | None = None
        self.selection = 0.0
        # Whether an orbit was met that cannot be followed as far as the tolerance asks for.
        self.history_ends = False
        self.most = max_points
        # Whether a finer grid would have had more points than are allowed.
        self.short = False

    def lost(self) -> SampledManifold:
        """No surface: M0 itself is not normally hyperbolic over the region."""
        verdict = self.verdict
        # Where the field's domain ends nothing is lost but the branch.
        losses = [loss for loss in verdict.losses if loss.kind is not LossKind.DOMAIN_END]
        if losses:
            loss = next((loss for loss in losses if not loss.is_hyperbolic), losses[0])
            status = Status.NON_FINITE if loss.is_pole else Status.FOLD_REACHED
            what = "; ".join(loss.headline for loss in losses[:3])
            text = f"the critical manifold is not normally hyperbolic over the region: {what}"
        else:
            failing = next(c for c in verdict.conditions if not c.holds)
            status = Status.FOLD_REACHED
            text = f"the region leaves the branch or its type changes in it: {failing.fact}{self._edge()}"
        return self._result(status, f"{text}. Shrink the region.", None)

    def _edge(self) -> str:
        """Where the branch was still real next to points where it is not."""
        grid = nodes(self.intervals, [33 if len(self.intervals) == 1 else 9] * len(self.intervals))
        x = grid.reshape(-1, len(self.intervals))
        if self.branch.is_explicit:
            real = np.isfinite(self.branch.graph_values(x, allow_complex=True)).all(axis=1)
        elif self.branch.seed is not None:
            real = self.branch.follow(x)[1]
        else:
            return ""
        return "" if real.all() else f"; there is no point over {self._place(x[np.argmin(real)])}"

    def run(self) -> SampledManifold:
        """Raise the degree until the coefficients have fallen below the tolerance."""
        d = len(self.intervals)
        hopeless = self._hopeless()
        if hopeless:
            return self._result(Status.TOO_MANY_POINTS, hopeless, None)
        eigenvalues = self.verdict.eigenvalues(self._middle)[0]
        solver = SegmentSolver(
            self.branch,
            epsilon=self.epsilon,
            unstable=int((np.real(eigenvalues) > 0).sum()),
            tolerance=self.tolerance,
        )
        sizes = [FIRST_SIZE[d]] * d
        values = np.full((*sizes, len(self.system.y)), np.nan)
        self.errors = np.full(sizes, np.inf)
        while True:
            grid = nodes(self.intervals, sizes)
            todo = np.isnan(values).all(axis=-1)
            failure = self._solve(solver, grid, values, todo)
            if failure is not None:
                return self._result(*failure, None, grid, values)
            surface = interpolate(self.intervals, values)
            scale = max(1.0, float(np.abs(values).max()))
            # What the ends of the segments leave is not smooth, and no degree resolves it.
            rough = surface.tails() > max(ROUGH * self.tolerance * scale, self.selection)
            growing = rough & (np.array(sizes) < LARGEST_SIZE[d])
            if not growing.any():
                break
            finer_sizes = doubled(sizes, growing)
            if not self._allowed(finer_sizes):
                self.short = True
                self.notes.append(
                    f"the {self.most} points allowed do not resolve the surface along {self._axes(growing)}, the next "
                    f"grid has {math.prod(finer_sizes)}"
                )
                break
            sizes = finer_sizes
            places = tuple(slice(None, None, 2 if grows else 1) for grows in growing)
            finer, errors = np.full((*sizes, len(self.system.y)), np.nan), np.full(sizes, np.inf)
            finer[places], errors[places] = values, self.errors
            values, self.errors = finer, errors
        if self.selection > SLACK * self.tolerance * scale and not self.history_ends:
            worst = int(np.argmax(self.errors))
            self.notes.append(
                f"the segments are good to {self._length(self.selection)} only, at "
                f"{self._place(grid.reshape(-1, d)[worst])}: the field is not smooth there or an orbit is too long"
            )
        elif rough.any() and not self.short:
            self.notes.append(
                f"{LARGEST_SIZE[d]} points along {self._axes(rough)} do not resolve the surface; shrink the region"
            )
        return self._checked(surface.chopped(CHOPPED * self.tolerance * scale), grid, values)

    @property
    def _middle(self) -> np.ndarray:
        """The middle of the region, (1, n_slow)."""
        return (self.intervals.mean(axis=1) * self.x_units + self.x_centre)[None, :]

    def _hopeless(self) -> str:
        """Why the points allowed cannot do, as M0 alone tells; empty where they may, or M0 has no point somewhere."""
        coarse = coarse_rest(self.branch, self.intervals, self._allowed)
        if coarse is None:
            return ""
        most = LARGEST_SIZE[len(self.intervals)] ** len(self.intervals)
        most = most if self.most is None else min(self.most, most)
        return (
            f"the {most} points allowed do not resolve even the critical manifold along {self._axes(coarse.rough)}: on "
            f"{math.prod(coarse.sizes)} of them {coarse.left:.1g} of its size is left, the next grid has "
            f"{math.prod(doubled(coarse.sizes, coarse.rough))}; no segment was solved. Shrink the region."
        )

    def _allowed(self, sizes: list[int]) -> bool:
        return self.most is None or math.prod(sizes) <= self.most

    def _axes(self, chosen: np.ndarray) -> str:
        return ", ".join(s.name for s, one in zip(self.system.x, chosen) if one)

    def _solve(self, solver: SegmentSolver, grid, values, todo) -> tuple[Status, str] | None:
        """Fill in the values at the nodes `todo`; (status, message) when a segment fails."""
        x = grid[todo]
        try:
            y = self.branch.points(x)
        except BranchError as error:
            return Status.FOLD_REACHED, f"the region leaves the branch: {error}"
        spectrum = np.abs(np.linalg.eigvals(solver.fast_jacobian(np.hstack([x, y]))))
        ratio = float((spectrum.max(axis=1) / spectrum.min(axis=1)).max())
        if ratio > 1.0 / self.epsilon and not self.notes:
            self.notes.append(
                f"the fast rates differ by a factor {ratio:.3g}, more than 1/epsilon: there is a third time scale"
            )
        segments = solver.solve(x, y)
        error = segments.error
        assert self.errors is not None
        values[todo], self.errors[todo] = segments.y, error
        failed = [i for i, status in enumerate(segments.status) if not status.ok]
        if failed:
            return self._failure(segments, x, failed)
        self.selection = max(self.selection, float(error.max()))
        short = segments.is_cut_short & (error > self.tolerance)
        if short.any() and not self.history_ends:
            self.history_ends = True
            i = int(np.argmax(np.where(short, error, 0.0)))
            self.notes.append(
                f"the orbit through {self._place(x[i])} can be followed only to {self._state(segments.ends[i])}, so "
                f"that what is fixed there is still felt, by {self._length(error[i])}"
            )
        return None

    def _failure(self, segments: Segments, x: np.ndarray, failed: list[int]) -> tuple[Status, str]:
        i = failed[0]
        status = segments.status[i]
        text = f"{len(failed)} of {len(x)} orbit segments failed, the first at {self._place(x[i])}: {status.meaning}"
        reached = float(segments.reached[failed].min())
        if reached > 0.0:
            text += f"; the segments were solved up to epsilon = {reached:.3g}, asked was {self.epsilon:g}"
        if segments.is_cut_short[i]:
            text += f"; the orbit can be followed only to {self._state(segments.ends[i])}"
        return status, f"{text}. Lower epsilon, or shrink the region away from there."

    # -- the finished surface ----------------------------------------------------------------------

    def _checked(self, surface: ChebyshevSurface, grid: np.ndarray, values: np.ndarray) -> SampledManifold:
        # Points at which the residual is looked at.
        unit = np.random.default_rng(0).random((300, len(self.intervals)))
        x = self.intervals[:, 0] + unit * (self.intervals[:, 1] - self.intervals[:, 0])
        defect, normal = defect_of(self.branch, surface, self.epsilon, x)
        each = np.abs(divide(normal, defect[:, :, None])[:, :, 0])
        error = np.linalg.norm(each, axis=1)
        y = surface(x)
        rounding = 4e-16 * (1.0 + float(np.abs(y).max()))
        estimate = SAFETY * float(error.max()) + self.selection + rounding
        estimates = SAFETY * each.max(axis=0) + self.selection + rounding
        status, lost = Status.SUCCESS, False
        unstable = (np.real(np.linalg.eigvals(normal)) > 0).sum(axis=1)
        expected = int((np.real(self.verdict.eigenvalues(self._middle)[0]) > 0).sum())
        scale = 1.0 + float(np.abs(y).max())
        if not np.isfinite(estimate):
            status, lost = Status.NON_FINITE, True
        elif (unstable != expected).any():
            status, lost = Status.HYPERBOLICITY_LOST, True
            place = self._place(x[np.argmax(unstable != expected)])
            self.notes.insert(0, f"the normal rates change their type on the slow manifold, at {place}")
        elif estimate > SLACK * self.tolerance * scale:
            unresolved = Status.TOO_MANY_POINTS if self.short else Status.NOT_CONVERGED
            status = Status.HISTORY_ENDS if self.history_ends else unresolved
            # What may be off by its own size says nothing of where the slow manifold is.
            lost = estimate > scale
        rate = self.verdict.rates.r(self.epsilon)
        if rate < 1.0:
            self.notes.append(f"the normal rate does not dominate the tangential one (ratio {rate:.2g})")
        where = self._place(x[int(np.argmax(error))])
        largest = float((self.y_units * estimates).max())
        text = f"{len(grid.reshape(-1, grid.shape[-1]))} segments, estimated error {largest:.2g}"
        if not status.ok:
            text += f" (tolerance {self.tolerance:g}), largest residual near {where}"
        text = "; ".join([text, *self.notes])
        if lost:
            return self._result(status, f"{text}. Lower epsilon, or shrink the region.", None, grid, values)
        return self._result(status, text, surface, grid, values, estimates)

    def _result(
        self, status: Status, message: str, surface, grid=None, values=None, estimates: np.ndarray | None = None
    ) -> SampledManifold:
        nx, ny = len(self.system.x), len(self.system.y)
        points = np.empty((0, nx)) if grid is None else grid.reshape(-1, nx).copy()
        solved = np.empty((0, ny)) if values is None else values.reshape(-1, ny).copy()
        errors = np.full(len(points), np.inf) if self.errors is None else self.errors.reshape(-1).copy()
        points, solved = points * self.x_units + self.x_centre, solved * self.y_units + self.y_centre
        errors = errors * self.y_units.max()
        estimates = self.y_units * (np.full(ny, np.inf) if estimates is None else estimates)
        estimates = estimates + np.finfo(float).eps * np.abs(self.y_centre)
        for array in (points, solved, errors, estimates):
            array.setflags(write=False)
        return SampledManifold(
            branch=self.asked,
            region=self.box,
            epsilon=self.epsilon,
            tolerance=self.tolerance,
            kind=self.verdict.kind,
            gap=self.verdict.gap,
            nodes=points,
            values=solved,
            node_errors=errors,
            error_estimates=estimates,
            status=status,
            message=message if status.ok else f"{status.name}: {message}",
            surface=surface
            and surface.in_units(self.x_units, self.y_units).moved(self.x_centre, self.y_centre),
        )

    def _place(self, x: np.ndarray) -> str:
        return _place_in(self.box, self.system, x * self.x_units + self.x_centre)

    def _length(self, size: float) -> str:
        """A length of the fast variables, at most."""
        return f"{size * self.y_units.max():.2g}"

    def _state(self, z: np.ndarray) -> str:
        return self.asked.system.place(zip(self.system.states, z * self.units + self.centre))


def _spread(sheet: Branch, intervals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points x (m, n_slow) spread over the box, and y (m, n_fast) of the sheet over them, NaN where it has none."""
    x = nodes(intervals, [FIRST_SIZE[len(intervals)]] * len(intervals)).reshape(-1, len(intervals))
    if sheet.is_explicit:
        return x, sheet.graph_values(x, allow_complex=True)
    y, good = sheet.follow(x)
    return x, np.where(good[:, None], y, np.nan)


def _place_in(box: Mapping[str, Interval], system: SlowFastSystem, x: np.ndarray) -> str:
    """A place over the region, so that places there can be told apart."""
    digits = {s.name: digits_between(box[s.name]) for s in system.x}
    return in_words(zip(system.x, x.tolist()), more=digits)


def _sheet(branch: Branch, box: Mapping[str, Interval]) -> Branch:
    """The branch with one sheet fixed: by its seed, or the one within the bounds at the centre of the region."""
    if branch.is_explicit or branch.seed is not None:
        return branch
    system = branch.system
    centre = np.array([[0.5 * sum(box[s.name]) for s in system.x]])
    bounds = {s.name: box[s.name] for s in system.y if s.name in box}
    found = branch.roots(centre, bounds=bounds)
    place = _place_in(box, system, centre[0])
    if len(found) != 1:
        raise BranchError(
            f"the branch {branch} has {len(found)} points over the centre of the region, "
            f"{place}{(' within the bounds' if bounds else '')}.",
            "Fix a sheet with branch.through({...}), or bound the fast variables.",
        )
    return branch.through(dict(zip(system.states, [*centre[0], *found[0]])))
