"""The runs behind a work-precision diagram: the full system by our methods and by peers, and reduced models, timed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from gsp.comparison.peers import Peer
from gsp.errors import GspError, Status, one_line
from gsp.integration.methods import SOLVERS, Method
from gsp.integration.restriction import restrict
from gsp.integration.trajectory import RunOptions, trajectory_of
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.scenes.study import Study
from gsp.slow.series import SeriesManifold
from gsp.systems.flow import Flow
from gsp.systems.tolerances import SHARE

MAX_STEPS = 200_000
# One measurement lasts at least so long (seconds); the least of ROUNDS counts. Runs above SLOW are timed once.
MEASURED, ROUNDS, SLOW = 2e-3, 5, 0.2


class WorkKind(StrEnum):
    """What is integrated, and by whom."""

    FULL = "full"
    PEER = "full, peer"
    REDUCED = "reduced"


@dataclass(frozen=True)
class WorkPoint:
    """One run: tolerance asked for, errors over the grid and at its end, seconds a call, and counters."""

    rtol: float
    error: float
    end_error: float
    seconds: float
    steps: int | None
    field_calls: int | None


@dataclass(frozen=True)
class WorkCurve:
    """One method or model over the ladder of tolerances; `preparation` seconds were spent once, before all runs.

    `ended` says why the ladder was not finished, if it was not. `order` is that of a reduced model.
    """

    label: str
    kind: WorkKind
    points: tuple[WorkPoint, ...]
    order: int | None = None
    version: str | None = None
    preparation: float = 0.0
    ended: str = ""

    @property
    def floor(self) -> float:
        """The least error of any tolerance; nan for a curve without points."""
        return min((point.error for point in self.points), default=float("nan"))

    def seconds_at(self, error: float) -> float:
        """The least seconds for an error of `error` or less, interpolated between runs; nan where it is not reached.

        Between two neighbouring tolerances log seconds is linear in log error.
        """
        best = min((point.seconds for point in self.points if point.error <= error), default=float("inf"))
        for a, b in zip(self.points, self.points[1:]):
            if b.error < error < a.error:
                share = np.log(error / a.error) / np.log(b.error / a.error)
                best = min(best, float(np.exp((1 - share) * np.log(a.seconds) + share * np.log(b.seconds))))
        return best if np.isfinite(best) else float("nan")


@dataclass(frozen=True)
class Task:
    """One curve to be measured: `run(rtol)` gives slow values (n_slow, m) on the grid, steps and calls.

    A run that fails gives nan; `failures` then holds the reason.
    """

    label: str
    kind: WorkKind
    run: Callable[[float], tuple[np.ndarray, int | None, int | None]]
    order: int | None = None
    version: str | None = None
    preparation: float = 0.0
    failures: dict[float, str] = field(default_factory=dict)


def slow_values(states: np.ndarray, flow: Flow, study: Study) -> np.ndarray:
    return states[[flow.states.index(s) for s in study.system.x]]


def largest_errors(values: np.ndarray, reference: np.ndarray) -> tuple[float, float]:
    """Largest error over the grid and at its end, each variable relative to its largest value."""
    sizes = np.abs(reference).max(axis=1)
    scaled = np.abs(values - reference) / np.where(sizes > 0.0, sizes, 1.0)[:, None]
    return float(scaled.max()), float(scaled[:, -1].max())


def full_tasks(
    study: Study,
    start: Mapping[str, float],
    epsilon: float,
    grid: np.ndarray,
    methods: Sequence[Method],
    omitted: dict[str, str],
) -> Iterator[Task]:
    system = study.system
    span = (study.scene.span[0], float(grid[-1]))

    def run(rtol: float, method: Method | None) -> tuple[np.ndarray, int | None, int | None]:
        found = trajectory_of(
            system,
            start=start,
            span=span,
            epsilon=epsilon,
            rtol=rtol,
            atol=SHARE * rtol,
            options=RunOptions(method=method, max_steps=MAX_STEPS),
        )
        if found.status is Status.SUCCESS:
            return slow_values(found.at(grid), system, study), found.stats.steps, found.stats.field_calls
        return np.full((len(system.x), grid.size), np.nan), found.stats.steps, found.stats.field_calls

    for method in methods:
        try:
            SOLVERS[method].program(compile_flow(system))
        except GspError as error:
            omitted[method.value] = _reason(error)
            continue
        yield Task(method.value, WorkKind.FULL, lambda rtol, method=method: run(rtol, method))
    yield Task("default", WorkKind.FULL, lambda rtol: run(rtol, None))


def peer_tasks(
    study: Study,
    start: Mapping[str, float],
    epsilon: float,
    grid: np.ndarray,
    peers: Sequence[Peer],
    omitted: dict[str, str],
) -> Iterator[Task]:
    system = study.system
    p = parameter_vector(system, epsilon)
    y = np.array(system.initial(start))
    for peer in peers:
        if peer.version is None:
            omitted[peer.name] = f"{peer.package} is not installed"
            continue
        begun = time.perf_counter()
        try:
            solve = peer.prepare(system, p, y, study.scene.span[0], grid)
        # Whatever somebody else's package raises is a reason, and no more.
        except Exception as error:
            omitted[peer.name] = _reason(error)
            continue
        failures: dict[float, str] = {}

        def run(rtol: float, solve=solve, failures=failures) -> tuple[np.ndarray, int | None, int | None]:
            try:
                found = solve(rtol, SHARE * rtol)
            except Exception as error:
                failures[rtol] = _reason(error)
                return np.full((len(system.x), grid.size), np.nan), None, None
            return slow_values(found.states, system, study), found.steps, found.field_calls

        prepared = time.perf_counter() - begun
        yield Task(peer.name, WorkKind.PEER, run, version=peer.version, preparation=prepared, failures=failures)


def _reason(error: Exception) -> str:
    """What an exception says, in one line."""
    # Characters of a failing peer's message that are kept.
    return one_line(error, None if isinstance(error, GspError) else 120)


def reduced_tasks(
    series: SeriesManifold,
    start: Mapping[str, float],
    epsilon: float,
    grid: np.ndarray,
    begin: float,
    orders: Sequence[int],
    expanded: float,
) -> Iterator[Task]:
    names = [s.name for s in series.branch.system.x]
    for order in orders:
        begun = time.perf_counter()
        flow = restrict(series, order=order)
        prepared = expanded + time.perf_counter() - begun

        def run(rtol: float, flow=flow) -> tuple[np.ndarray, int | None, int | None]:
            found = trajectory_of(
                flow,
                start=start,
                span=(begin, float(grid[-1])),
                epsilon=epsilon,
                rtol=rtol,
                atol=SHARE * rtol,
                options=RunOptions(max_steps=MAX_STEPS),
            )
            if found.status is Status.SUCCESS:
                sampled = found.sample(grid)
                return np.array([sampled[name] for name in names]), found.stats.steps, found.stats.field_calls
            return np.full((len(names), grid.size), np.nan), found.stats.steps, found.stats.field_calls

        yield Task(f"reduced {order}", WorkKind.REDUCED, run, order=order, preparation=prepared)


def measure(
    tasks: Sequence[Task],
    ladder: Sequence[float],
    reference: np.ndarray,
    limit: float,
    progress: Callable[[float], object] | None,
) -> Iterator[WorkCurve]:
    points: dict[str, dict[float, WorkPoint]] = {task.label: {} for task in tasks}
    given_up: dict[str, str] = {}
    for i, rtol in enumerate(ladder):
        # All runs of one tolerance are interleaved: first once each for the errors, then round by round for the time.
        counts: dict[str, int] = {}
        for task in tasks:
            if task.label in given_up:
                continue
            task.run(rtol)
            begun = time.perf_counter()
            values, steps, calls = task.run(rtol)
            seconds = time.perf_counter() - begun
            if np.isfinite(values).all():
                points[task.label][rtol] = WorkPoint(
                    rtol, *largest_errors(values, reference), seconds, steps, calls
                )
                if seconds < SLOW:
                    counts[task.label] = max(1, int(MEASURED / seconds))
            if seconds > limit:
                given_up[task.label] = f"beyond {limit:g} s at rtol {rtol:.0e}"
            elif not np.isfinite(values).all() and steps is not None and steps >= MAX_STEPS // 2:
                given_up[task.label] = f"out of steps at rtol {rtol:.0e}"
            elif not np.isfinite(values).all() and rtol == ladder[-1]:
                why = task.failures.get(rtol, "did not reach the end")
                given_up[task.label] = f"{why} at rtol {rtol:.0e}"
        best = {label: points[label][rtol].seconds for label in counts}
        for _ in range(ROUNDS):
            for task in tasks:
                count = counts.get(task.label, 0)
                if count == 0:
                    continue
                begun = time.perf_counter()
                for _ in range(count):
                    task.run(rtol)
                best[task.label] = min(best[task.label], (time.perf_counter() - begun) / count)
        for label, seconds in best.items():
            points[label][rtol] = replace(points[label][rtol], seconds=seconds)
        if progress is not None:
            progress((i + 1) / len(ladder))
    for task in tasks:
        yield WorkCurve(
            label=task.label,
            kind=task.kind,
            points=tuple(points[task.label].values()),
            order=task.order,
            version=task.version,
            preparation=task.preparation,
            ended=given_up.get(task.label, ""),
        )
