"""Work and precision: error against seconds, for the full system by many methods and for reduced models of any order.

Every run yields the slow variables on one grid of times, by its dense output. Its error is the largest over the grid
and the variables, each relative to its largest value, against a reference that two methods agree on; its seconds are
the least of several calls, interleaved over all runs, so that a disturbance of the machine meets everybody. A reduced
model starts at the base point of the fast fibre through the start, and the grid begins when the initial layer is
over: what is left is the model's own error, O(epsilon^(N+1)) at order N.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np

from gsp.comparison import layer_time, on_manifold, sense
from gsp.errors import BranchError, DeclarationError, GspError, HyperbolicityError, Status, unknown_name
from gsp.fibres import project
from gsp.flow import Flow, check_epsilon, check_orders
from gsp.inner import expand_inner
from gsp.integrators import Method
from gsp.lowering import parameter_vector
from gsp.peers import PEERS, Peer
from gsp.placement import Placement, place
from gsp.reduced import restrict
from gsp.scene import Scene
from gsp.series import SeriesManifold, expand
from gsp.tables import write_rows
from gsp.trajectory import integrate

# Times at which every run is compared, and asked for its values.
GRID_POINTS = 25
# The reference, and what its error is estimated from: two methods of different order.
REFERENCE = (Method.RADAU13, Method.RADAU9)
REFERENCE_RTOL = 1e-13
RTOLS = tuple(10.0**-k for k in range(2, 13))
ORDERS = (0, 1, 2, 3, 4)
# atol is this share of rtol in every run: slow variables of size 1 are then controlled by rtol.
ATOL_SHARE = 1e-2
# A curve ends with the first run that takes longer than this (seconds); tighter tolerances would take longer still.
LIMIT = 2.0
MAX_STEPS = 200_000
# One measurement lasts at least so long (seconds); the least of ROUNDS counts. Runs above SLOW are timed once.
MEASURED, ROUNDS, SLOW = 2e-3, 5, 0.2
# Characters of a failing peer's message that are kept.
REASON = 120
# Errors at which curves are compared in tables.
TARGETS = (1e-3, 1e-5, 1e-7, 1e-9)


class ModelKind(StrEnum):
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
    kind: ModelKind
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
        best = float("inf")
        for a in self.points:
            if a.error <= error:
                best = min(best, a.seconds)
        for a, b in zip(self.points, self.points[1:]):
            if b.error < error < a.error:
                share = np.log(error / a.error) / np.log(b.error / a.error)
                best = min(best, float(np.exp((1 - share) * np.log(a.seconds) + share * np.log(b.seconds))))
        return best if np.isfinite(best) else float("nan")


@dataclass(frozen=True, eq=False, repr=False)
class WorkPrecision:
    """Error against seconds for one scene at one epsilon.

    `curves` in the order full, peers, reduced; `reference_error` is how far the two references differ; `start` says
    from where the runs begin; `omitted` names peers that are not installed or cannot take the flow, with the reason;
    `machine` holds what it ran on.
    """

    scene: Scene
    epsilon: float
    grid: np.ndarray
    curves: tuple[WorkCurve, ...]
    reference_error: float
    start: str
    omitted: Mapping[str, str]
    machine: Mapping[str, str]

    def __getitem__(self, label: str) -> WorkCurve:
        for curve in self.curves:
            if curve.label == label:
                return curve
        raise unknown_name(label, (curve.label for curve in self.curves))

    def fastest(self, error: float, *, kind: ModelKind | None = None) -> WorkCurve | None:
        """The curve that reaches `error` in the least time, among those of a `kind` or all; None when none does."""
        fitting = [c for c in self.curves if kind in (None, c.kind) and np.isfinite(c.seconds_at(error))]
        return min(fitting, key=lambda c: c.seconds_at(error), default=None)

    def as_rows(self) -> list[dict[str, object]]:
        """One dictionary per run, of numbers and text, for JSON or CSV."""
        return [
            {"label": c.label, "kind": str(c.kind), "order": c.order, "version": c.version, **asdict(point)}
            for c in self.curves
            for point in c.points
        ]

    def write_csv(self, path: str | Path) -> Path:
        """Write the rows to `path`; raises `OutputError` when that cannot be done."""
        return write_rows(self.as_rows(), path)

    def __repr__(self) -> str:
        runs = sum(len(curve.points) for curve in self.curves)
        return f"WorkPrecision({self.scene.name}, epsilon={self.epsilon:g}: {len(self.curves)} curves, {runs} runs)"

    def __str__(self) -> str:
        width = max(len(curve.label) for curve in self.curves)
        targets = [t for t in TARGETS if self.fastest(t) is not None]
        lines = [
            f"microseconds to reach an error of the slow variables, epsilon = {self.epsilon:g}, {self.start}",
            f"  {'':<{width}}  least error  " + "  ".join(f"{t:>9.0e}" for t in targets),
        ]
        for curve in self.curves:
            shown = [1e6 * curve.seconds_at(t) for t in targets]
            lines.append(
                f"  {curve.label:<{width}}  {curve.floor:11.1e}  "
                + "  ".join(f"{value:9.4g}" if np.isfinite(value) else f"{'-':>9}" for value in shown)
                + (f"  {curve.ended}" if curve.ended else "")
            )
        lines.append(
            f"  reference: {REFERENCE[0].value}, within {self.reference_error:.1e} of {REFERENCE[1].value}"
        )
        lines += [f"  without {name}: {reason}" for name, reason in self.omitted.items()]
        return "\n".join(lines)


@dataclass(frozen=True)
class _Task:
    """One curve to be measured: `run(rtol)` gives slow values (n_slow, m) on the grid, steps and calls.

    A run that fails gives nan; `failures` then holds the reason.
    """

    label: str
    kind: ModelKind
    run: Callable[[float], tuple[np.ndarray, int | None, int | None]]
    order: int | None = None
    version: str | None = None
    preparation: float = 0.0
    failures: dict[float, str] = field(default_factory=dict)


def work_precision(
    scene: Scene,
    *,
    epsilon: float | None = None,
    rtols: Sequence[float] = RTOLS,
    orders: Sequence[int] = ORDERS,
    methods: Sequence[Method] | None = None,
    peers: Sequence[Peer] | None = None,
    limit: float = LIMIT,
    progress: Callable[[float], object] | None = None,
) -> WorkPrecision:
    """Error against seconds for `scene`: the full system by our `methods` and by `peers`, reduced models of `orders`.

    At `epsilon` (the scene's own by default), with every tolerance of `rtols`, each run at most about `limit` seconds.
    All methods and all peers that are installed take part by default. Where the branch repels everything runs
    backward in time; a start without a base point is moved on to the slow manifold. `progress` is called with the
    fraction done.

    Raises `DeclarationError` for arguments that are not well formed or a layer longer than half the span, and what the
    stages raise for a scene that cannot be split, solved or expanded.

    >>> from gsp import models
    >>> from gsp.work_curves import work_precision
    >>> found = work_precision(models.load("michaelis_menten"), orders=(0, 1), rtols=(1e-4, 1e-8), peers=())
    >>> found["reduced 0"].floor > 10 * found["reduced 1"].floor > 100 * found["radau9"].floor
    True
    """
    if not isinstance(scene, Scene):
        raise DeclarationError(
            f"work_precision takes a Scene. Got {type(scene).__name__}. Use gsp.models.load(name)."
        )
    value = scene.epsilon if epsilon is None else check_epsilon(epsilon)
    ladder = _ladder(rtols)
    wanted = tuple(dict.fromkeys(check_orders(orders, empty=True)))
    placement = place(scene)
    begun = time.perf_counter()
    series = expand(placement.branch, order=max(wanted, default=0) + 1, symbolic=False)
    expanded = time.perf_counter() - begun
    start, slow_start, first, origin = _start(placement, series, value, max(wanted, default=0))
    direction = sense(placement)
    last = scene.span[0] + direction * (scene.span[1] - scene.span[0])
    grid = np.linspace(first, last, GRID_POINTS + 1)[1:]
    omitted: dict[str, str] = {}
    reference, disagreement = _reference(placement, start, value, grid)
    tasks = [
        *_full_tasks(placement, start, value, grid, list(Method) if methods is None else methods),
        *_peer_tasks(placement, start, value, grid, PEERS if peers is None else peers, omitted),
        *_reduced_tasks(series, slow_start, value, grid, scene.span[0], wanted, expanded),
    ]
    curves = _measure(tasks, ladder, reference, limit, progress)
    return WorkPrecision(
        scene=scene,
        epsilon=value,
        grid=grid,
        curves=tuple(curves),
        reference_error=disagreement,
        start=origin,
        omitted=omitted,
        machine=machine(),
    )


def machine() -> dict[str, str]:
    """What the figures were measured on: processor, cores, Python and the packages that matter."""
    from importlib.metadata import version

    found = {"processor": _processor(), "cores": str(os.cpu_count()), "python": platform.python_version()}
    return found | {name: version(name) for name in ("numpy", "scipy", "numba", "llvmlite")}


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def _ladder(rtols: Sequence[float]) -> tuple[float, ...]:
    try:
        values = tuple(sorted({float(r) for r in rtols}, reverse=True))
    except (TypeError, ValueError):
        raise DeclarationError(f"rtols are numbers. Got {rtols!r}. Try (1e-3, 1e-6, 1e-9).") from None
    if not values or not all(1e-13 <= r < 1.0 for r in values):
        raise DeclarationError(f"rtols lie from 1e-13 to below 1. Got {rtols!r}. Try (1e-3, 1e-6, 1e-9).")
    return values


def _start(
    placement: Placement, series: SeriesManifold, epsilon: float, order: int
) -> tuple[dict[str, float], dict[str, float], float, str]:
    """The full start, the reduced one, where the grid begins, and in words."""
    scene = placement.scene
    try:
        if sense(placement) < 0:
            raise HyperbolicityError("the branch repels")
        base = project(series, placement.start, epsilon=epsilon)
        inner = expand_inner(placement.branch, placement.start, order=0)
    except (BranchError, HyperbolicityError):
        moved = on_manifold(series, placement.start, epsilon)
        slow = {s.name: moved[s.name] for s in placement.system.x}
        return moved, slow, scene.span[0], "from the slow manifold over the scene's start"
    layer = layer_time(inner, scene, epsilon, order)
    text = f"from the scene's start, after the initial layer of {layer:.3g}"
    return dict(placement.start), dict(base), scene.span[0] + layer, text


def _reference(
    placement: Placement, start: Mapping[str, float], epsilon: float, grid: np.ndarray
) -> tuple[np.ndarray, float]:
    runs = []
    for method in REFERENCE:
        run = integrate(
            placement.system,
            start=start,
            span=(placement.scene.span[0], float(grid[-1])),
            epsilon=epsilon,
            rtol=REFERENCE_RTOL,
            atol=REFERENCE_RTOL * ATOL_SHARE,
            at=grid,
            method=method,
        )
        if not run.status.ok:
            raise DeclarationError(
                f"there is no reference for {placement.scene.name} at epsilon = {epsilon:g}: {run.message}. "
                "Shorten the span, move the start or take another epsilon."
            )
        runs.append(_slow(run.y, placement.system, placement))
    error, _ = _errors(runs[1], runs[0])
    return runs[0], error


def _slow(states: np.ndarray, flow: Flow, placement: Placement) -> np.ndarray:
    return states[[flow.states.index(s) for s in placement.system.x]]


def _errors(values: np.ndarray, reference: np.ndarray) -> tuple[float, float]:
    """Largest error over the grid and at its end, each variable relative to its largest value."""
    sizes = np.abs(reference).max(axis=1)
    scaled = np.abs(values - reference) / np.where(sizes > 0.0, sizes, 1.0)[:, None]
    return float(scaled.max()), float(scaled[:, -1].max())


def _full_tasks(
    placement: Placement,
    start: Mapping[str, float],
    epsilon: float,
    grid: np.ndarray,
    methods: Sequence[Method],
) -> Iterator[_Task]:
    system = placement.system
    span = (placement.scene.span[0], float(grid[-1]))

    def run(rtol: float, method: Method | None) -> tuple[np.ndarray, int | None, int | None]:
        found = integrate(
            system,
            start=start,
            span=span,
            epsilon=epsilon,
            rtol=rtol,
            atol=ATOL_SHARE * rtol,
            method=method,
            max_steps=MAX_STEPS,
        )
        if found.status is Status.SUCCESS:
            return _slow(found.at(grid), system, placement), found.stats.steps, found.stats.field_calls
        return np.full((len(system.x), grid.size), np.nan), found.stats.steps, found.stats.field_calls

    for method in methods:
        yield _Task(method.value, ModelKind.FULL, lambda rtol, method=method: run(rtol, method))
    yield _Task("default", ModelKind.FULL, lambda rtol: run(rtol, None))


def _peer_tasks(
    placement: Placement,
    start: Mapping[str, float],
    epsilon: float,
    grid: np.ndarray,
    peers: Sequence[Peer],
    omitted: dict[str, str],
) -> Iterator[_Task]:
    system = placement.system
    p = parameter_vector(system, epsilon)
    y = np.array(system.initial(start))
    for peer in peers:
        if peer.version is None:
            omitted[peer.name] = f"{peer.package} is not installed"
            continue
        begun = time.perf_counter()
        try:
            solve = peer.prepare(system, p, y, placement.scene.span[0], grid)
        # Whatever somebody else's package raises is a reason, and no more.
        except Exception as error:
            omitted[peer.name] = _reason(error)
            continue
        failures: dict[float, str] = {}

        def run(rtol: float, solve=solve, failures=failures) -> tuple[np.ndarray, int | None, int | None]:
            try:
                found = solve(rtol, ATOL_SHARE * rtol)
            except Exception as error:
                failures[rtol] = _reason(error)
                return np.full((len(system.x), grid.size), np.nan), None, None
            return _slow(found.states, system, placement), found.steps, found.field_calls

        prepared = time.perf_counter() - begun
        yield _Task(
            peer.name, ModelKind.PEER, run, version=peer.version, preparation=prepared, failures=failures
        )


def _reason(error: Exception) -> str:
    """What an exception says, in one line."""
    text = " ".join(str(error).split())
    if isinstance(error, GspError):
        return text
    return f"{type(error).__name__}: {text}"[:REASON]


def _reduced_tasks(
    series: SeriesManifold,
    start: Mapping[str, float],
    epsilon: float,
    grid: np.ndarray,
    begin: float,
    orders: Sequence[int],
    expanded: float,
) -> Iterator[_Task]:
    names = [s.name for s in series.branch.system.x]
    for order in orders:
        begun = time.perf_counter()
        flow = restrict(series, order=order)
        prepared = expanded + time.perf_counter() - begun

        def run(rtol: float, flow=flow) -> tuple[np.ndarray, int | None, int | None]:
            found = integrate(
                flow,
                start=start,
                span=(begin, float(grid[-1])),
                epsilon=epsilon,
                rtol=rtol,
                atol=ATOL_SHARE * rtol,
                max_steps=MAX_STEPS,
            )
            if found.status is Status.SUCCESS:
                sampled = found.sample(grid)
                return np.array([sampled[name] for name in names]), found.stats.steps, found.stats.field_calls
            return np.full((len(names), grid.size), np.nan), found.stats.steps, found.stats.field_calls

        yield _Task(f"reduced {order}", ModelKind.REDUCED, run, order=order, preparation=prepared)


def _measure(
    tasks: Sequence[_Task],
    ladder: Sequence[float],
    reference: np.ndarray,
    limit: float,
    progress: Callable[[float], object] | None,
) -> Iterator[WorkCurve]:
    points: dict[str, dict[float, WorkPoint]] = {task.label: {} for task in tasks}
    ended: dict[str, str] = {}
    for i, rtol in enumerate(ladder):
        # All runs of one tolerance are interleaved: first once each for the errors, then round by round for the time.
        counts: dict[str, int] = {}
        for task in tasks:
            if task.label in ended:
                continue
            task.run(rtol)
            begun = time.perf_counter()
            values, steps, calls = task.run(rtol)
            seconds = time.perf_counter() - begun
            if np.isfinite(values).all():
                points[task.label][rtol] = WorkPoint(rtol, *_errors(values, reference), seconds, steps, calls)
                if seconds < SLOW:
                    counts[task.label] = max(1, int(MEASURED / seconds))
            if seconds > limit:
                ended[task.label] = f"beyond {limit:g} s at rtol {rtol:.0e}"
            elif not np.isfinite(values).all() and steps is not None and steps >= MAX_STEPS // 2:
                ended[task.label] = f"out of steps at rtol {rtol:.0e}"
            elif not np.isfinite(values).all() and rtol == ladder[-1]:
                why = task.failures.get(rtol, "did not reach the end")
                ended[task.label] = f"{why} at rtol {rtol:.0e}"
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
            old = points[label][rtol]
            points[label][rtol] = WorkPoint(rtol, old.error, old.end_error, seconds, old.steps, old.field_calls)
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
            ended=ended.get(task.label, ""),
        )
