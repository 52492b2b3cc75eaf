"""Claims: what each method does at positions, epsilons and tolerances, by running it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from gsp.comparison.compared_runs import sense
from gsp.comparison.comparison import compare
from gsp.critical.sampling import Sampler
from gsp.errors import GspError, Status
from gsp.integration.methods import Method
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.lowering.compiled_function import finite_rows
from gsp.scenes.bearing import no_slip_of
from gsp.scenes.study import Study
from gsp.slow.series import SeriesManifold
from gsp.slow.slow_points import zero_derivative
from gsp.systems.flow import Flow
from gsp.systems.region import state_sizes
from gsp.systems.tolerances import absolute_tolerance

# Share of the span for which a run follows a position.
HORIZON = 0.04
# The full run that everything is compared with.
RTOL = 1e-11
# Explicit steps against implicit ones: with so many times the field calls stability holds them back.
RIVALS, WASTE = (Method.RADAU9, Method.DOP853), 4.0
MAX_STEPS = 20_000
# Relative errors that differ by less are equal to rounding; it is what the points of reference are asked for.
ROUNDING = 1e-13

MANIFOLD = "slow manifold"
NEWTON = "Newton's method"
EXPLICIT = "explicit steps"
IMPLICIT = "implicit steps"
NO_SLIP = "no-slip"
# How the runs of an order end that was refused, or that the exact algebra did not come to.
NOT_REACHED = "ORDER_NOT_REACHED"


@dataclass(frozen=True, eq=False, repr=False)
class Claim:
    """What one method did: `measure` (n_epsilons, n_columns), which holds where it is at most `bound` and finite.

    `requirement` says what was measured. NaN stands for "could not be run here", which does not hold; where that is
    so in every cell, `reason` may say why. `endings`, where they are known, are the names of how the run of each cell
    ended.
    """

    method: str
    requirement: str
    measure: np.ndarray
    bound: float | np.ndarray
    reason: str = ""
    endings: np.ndarray | None = None

    @property
    def is_measured(self) -> bool:
        """Whether there is a measure in any cell."""
        return not bool(np.isnan(self.measure).all())

    @property
    def holds(self) -> np.ndarray:
        """Booleans (n_epsilons, n_columns)."""
        with np.errstate(invalid="ignore"):
            return np.isfinite(self.measure) & (self.measure <= self.bound)

    @property
    def share(self) -> float:
        """Share of the cells in which it holds."""
        return float(self.holds.mean())

    def __repr__(self) -> str:
        return f"Claim({self.method}: holds in {100 * self.share:.0f} % of {self.measure.size} cells)"


def reduced_name(order: int) -> str:
    """The name of the claim on the reduced flow of this order."""
    return f"reduced flow {order}"


def series_name(order: int) -> str:
    """The name of the claim on the series through this order."""
    return f"series {order}"


class Survey:
    """Fills the maps over positions, one epsilon at a time."""

    def __init__(
        self,
        study: Study,
        series: SeriesManifold,
        axis: str,
        positions: np.ndarray,
        epsilons: np.ndarray,
        orders: tuple[int, ...],
        tolerance: float,
    ) -> None:
        self.study = study
        self.series = series
        self.epsilons = epsilons
        self.orders = orders
        self.tolerance = tolerance
        self.system = study.system
        self.branch = study.branch
        self.slow = [s.name for s in self.system.x]
        self.x = np.tile([study.start[s] for s in self.slow], (positions.size, 1))
        self.x[:, self.slow.index(axis)] = positions
        self.y, self.there = self._sheet()
        scene = study.scene
        known = state_sizes(study.region, study.start)
        own = np.array([known.get(s.name, 0.0) for s in self.system.y])
        own = np.maximum(own, np.abs(self.y[self.there]).max(axis=0, initial=0.0))
        # How large each fast variable is: distances in y are relative to it.
        self.sizes = np.where(own > 0.0, own, 1.0)
        self.atol = absolute_tolerance(RTOL, study.region, study.start)
        span = scene.span
        self.piece = sense(study) * HORIZON * (span[1] - span[0])
        self.width = float(positions[-1] - positions[0])
        self.flows = {n: study.reduced(n, reconstructed=False) for n in orders}
        cells = (epsilons.size, positions.size)
        names = (NEWTON, MANIFOLD, *map(series_name, orders), *map(reduced_name, orders), EXPLICIT, IMPLICIT)
        self.measures = {name: np.full(cells, np.nan) for name in names}
        self.best_order = np.full(cells, -1)
        self.measures[NEWTON][:] = self._newton()
        self.runs = 0

    def _sheet(self) -> tuple[np.ndarray, np.ndarray]:
        """Points of M0 on the scene's sheet over the positions, and where there are any."""
        if self.branch.is_explicit:
            y = self.branch.graph_values(self.x, allow_complex=True)
            return y, finite_rows(y)
        return self.branch.follow(self.x)

    def _newton(self) -> np.ndarray:
        """Distance of what Newton's method finds from the scene's start from the sheet; nan where it finds nothing."""
        start = [self.study.start[s.name] for s in self.system.y]
        result = np.full(len(self.x), np.nan)
        sampler = Sampler(self.branch)
        for j, (x, y) in enumerate(zip(self.x, self.y)):
            if not self.there[j]:
                continue
            found = newton(sampler, x, np.array(start), self.sizes)
            if found is not None:
                result[j] = self._relative(found - y)
        return result

    def _relative(self, differences: np.ndarray) -> np.ndarray:
        """The largest of differences in y (..., n_fast), each over the size of its variable."""
        return np.abs(differences / self.sizes).max(axis=-1)

    def visit(self, i: int) -> None:
        epsilon = float(self.epsilons[i])
        rows = np.flatnonzero(self.there)
        if rows.size == 0:
            return
        y = np.full_like(self.y, np.nan)
        y[rows] = self._on_manifold(self.x[rows], self.y[rows], epsilon)
        rows = rows[np.isfinite(y[rows]).all(axis=1)]
        ends = np.full((len(self.x), len(self.system.states)), np.nan)
        for j in map(int, rows):
            self._series(i, j, y[j], epsilon)
            ends[j] = self._runs(i, j, y[j], epsilon)
        known = np.isfinite(ends).all(axis=1)
        self.measures[MANIFOLD][i, known] = self._distances(ends[known], epsilon)

    def _on_manifold(self, x: np.ndarray, near: np.ndarray, epsilon: float) -> np.ndarray:
        """Points of the slow manifold (m, n_fast) over `x`, by the zero-derivative principle from `near`.

        NaN where it is not known to the tolerance: nothing is compared with what may be off by more.
        """
        points = zero_derivative(self.branch, x, epsilon=epsilon, tolerance=ROUNDING, near=near)
        known = points.error <= self.tolerance * np.linalg.norm(self.sizes)
        return np.where(known[:, None], points.y, np.nan)

    def _series(self, i: int, j: int, y: np.ndarray, epsilon: float) -> None:
        terms = self.series.terms(self.x[j][None, :], epsilon, near=self.y[j])[0]
        errors = self._relative(np.cumsum(terms, axis=0) - y)
        for n in self.orders:
            self.measures[series_name(n)][i, j] = errors[n]
        if np.isfinite(errors).any():
            # Orders whose errors differ by rounding are as good as one another.
            self.best_order[i, j] = int(np.flatnonzero(errors <= np.nanmin(errors) + ROUNDING)[-1])

    def _runs(self, i: int, j: int, y: np.ndarray, epsilon: float) -> np.ndarray:
        """Fills the measures of the runs from a position; the state in which the full one ends, NaN where it fails."""
        start = dict(zip(self.slow, map(float, self.x[j])))
        whole = start | {s.name: float(v) for s, v in zip(self.system.y, y)}
        full, explicit = (self._run(self.system, whole, epsilon, method=method) for method in RIVALS)
        if full is None or not full.status.ok:
            return np.full(len(self.system.states), np.nan)
        end = full.y[:, -1]
        nx = len(self.slow)
        self.measures[IMPLICIT][i, j] = full.stats.rejected / full.stats.steps
        if explicit is not None:
            self.measures[EXPLICIT][i, j] = (
                explicit.stats.field_calls / full.stats.field_calls if explicit.status.ok else np.inf
            )
        for n, flow in self.flows.items():
            reduced = self._run(flow, start, epsilon)
            if reduced is not None and reduced.status.ok:
                reached = np.array([reduced[name][-1] for name in self.slow])
                self.measures[reduced_name(n)][i, j] = np.abs(reached - end[:nx]).max() / self.width
        return end

    def _distances(self, ends: np.ndarray, epsilon: float) -> np.ndarray:
        """Distances in y of states (m, n) from the slow manifold, by the zero-derivative principle next to them."""
        nx = len(self.slow)
        if not len(ends):
            return np.empty(0)
        try:
            found = self._on_manifold(ends[:, :nx], ends[:, nx:], epsilon)
        except GspError:
            if len(ends) == 1:
                return np.full(1, np.nan)
            return np.concatenate([self._distances(end[None, :], epsilon) for end in ends])
        return self._relative(found - ends[:, nx:])

    def _run(
        self, flow: Flow, start: Mapping[str, float], epsilon: float, *, method: Method | None = None
    ) -> Trajectory | None:
        self.runs += 1
        try:
            return trajectory_of(
                flow,
                start=start,
                span=(0.0, self.piece),
                epsilon=epsilon,
                rtol=RTOL,
                atol=self.atol,
                options=RunOptions(method=method, max_steps=MAX_STEPS),
            )
        except GspError:
            return None

    def claims(self) -> dict[str, Claim]:
        """The measures with what is asked of them."""
        read_off = {
            NEWTON: ("distance from the sheet of what Newton's method finds from the scene's start", 1e-8),
            MANIFOLD: ("distance of a full run from the slow manifold it began on", self.tolerance),
            EXPLICIT: ("field calls of DOP853 to those of Radau IIA, order 9", WASTE),
            IMPLICIT: ("rejected steps to accepted ones, where the run reached its end", np.inf),
        }
        read_off |= {
            series_name(n): ("distance of the series from the slow manifold", self.tolerance)
            for n in self.orders
        }
        read_off |= {
            reduced_name(n): (
                "difference of the slow variables from the full run, over the axis' length",
                self.tolerance,
            )
            for n in self.orders
        }
        return {
            name: Claim(name, read_off[name][0], values, read_off[name][1])
            for name, values in self.measures.items()
        }


def no_slip_along(study: Study, survey: Survey) -> dict[str, Claim]:
    """For contacts with dry friction: whether none lets go along the piece of the sharp limit from each position."""
    if study.scene.contacts is None:
        return {}
    measure = np.full((survey.epsilons.size, len(survey.x)), np.nan)
    for j, x in enumerate(survey.x):
        try:
            found = no_slip_of(
                study, start=dict(zip(survey.slow, map(float, x))), span=(0.0, abs(survey.piece))
            )
        except GspError:
            continue
        assert found is not None
        if found.loss is not None:
            measure[:, j] = np.inf
        elif found.run.status.ok:
            measure[:, j] = found.shares.max()
    text = "largest share of what a contact bears that no-slip asks for, infinite where one lets go"
    return {NO_SLIP: Claim(NO_SLIP, text, measure, 1.0)}


def newton(sampler: Sampler, x: np.ndarray, y: np.ndarray, sizes: np.ndarray) -> np.ndarray | None:
    """Plain Newton's method for g(x, y, 0) = 0 in y from `y` (n_fast,) at fixed x; None when it does not converge.

    Fast variables are as large as `sizes` (n_fast,).
    """
    nx = x.size
    for _ in range(50):
        z = np.concatenate([x, y])[None, :]
        value, slope = sampler.equilibria(z)[0], sampler.equilibria_jacobian(z)[0][:, nx:]
        if not (np.isfinite(value).all() and np.isfinite(slope).all()):
            return None
        try:
            step = np.linalg.solve(slope, value)
        except np.linalg.LinAlgError:
            return None
        y = y - step
        if (np.abs(step) <= 1e-12 * np.maximum(sizes, np.abs(y))).all():
            return y
    return None


def demands_of(
    study: Study,
    epsilons: np.ndarray,
    tolerances: np.ndarray,
    orders: tuple[int, ...],
    progress: Callable[[float], object] = lambda share: None,
) -> Iterator[Claim]:
    """Over (epsilon, tolerance): reduced flows against the full one over the span, and explicit against implicit."""
    cells = (epsilons.size, tolerances.size)
    errors = {n: np.full(cells, np.nan) for n in orders}
    ratios = np.full(cells, np.nan)
    found, reasons = None, dict.fromkeys(orders, "")
    endings = {n: np.full(cells, NOT_REACHED, dtype=object) for n in orders}
    ended = np.full(cells, "", dtype=object)
    try:
        found = compare(
            study,
            orders=orders,
            epsilons=tuple(map(float, epsilons)),
            progress=lambda share: progress(0.5 * share),
        )
    except GspError as error:
        reasons = dict.fromkeys(orders, str(error))
    if found is not None:
        for n, statuses in found.statuses.items():
            reasons[n] = "; ".join(dict.fromkeys(status.meaning for status in statuses if not status.ok))
        for n in set(orders) - set(found.errors):
            reasons[n] = found.ending
        for n in found.errors:
            by_epsilon = dict(zip(found.epsilons, found.errors[n]))
            errors[n][:] = np.array([by_epsilon[float(e)] for e in epsilons])[:, None]
            status_at = dict(zip(found.epsilons, found.statuses[n]))
            endings[n][:] = np.array([status_at[float(e)].name for e in epsilons])[:, None]
    start, span = study.start, study.scene.span
    for i, epsilon in enumerate(epsilons):
        for j, tolerance in enumerate(tolerances):
            runs = [
                trajectory_of(
                    study.system,
                    start=start,
                    span=span,
                    epsilon=float(epsilon),
                    rtol=tolerance,
                    atol=absolute_tolerance(tolerance, study.region, start),
                    options=RunOptions(method=method, max_steps=MAX_STEPS),
                )
                for method in RIVALS
            ]
            implicit, explicit = (run.stats.field_calls if run.status.ok else np.inf for run in runs)
            ratios[i, j] = explicit / implicit if np.isfinite(implicit) else np.nan
            ended[i, j] = next((run.status for run in runs if not run.status.ok), Status.SUCCESS).name
        progress(0.5 + 0.5 * (i + 1) / epsilons.size)
    for n in orders:
        text = "largest relative error of the slow variables over the span"
        missing = reasons[n] if np.isnan(errors[n]).all() else ""
        yield Claim(reduced_name(n), text, errors[n], np.broadcast_to(tolerances, cells), missing, endings[n])
    yield Claim(EXPLICIT, "field calls of DOP853 to those of Radau IIA, order 9", ratios, WASTE, endings=ended)
