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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsp.comparison.compared_runs import layer_time, on_manifold, sense
from gsp.comparison.peers import PEERS, Peer
from gsp.comparison.work_runs import (
    WorkCurve,
    WorkKind,
    full_tasks,
    largest_errors,
    measure,
    peer_tasks,
    reduced_tasks,
    slow_values,
)
from gsp.errors import BranchError, DeclarationError, HyperbolicityError, unknown_name
from gsp.fibres.base_points import project
from gsp.fibres.inner_expansion import expand_inner
from gsp.integration.methods import Method, check_method
from gsp.integration.trajectory import RunOptions, trajectory_of
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.slow.series import SeriesManifold
from gsp.systems.arguments import check_each, check_number, check_positive, check_progress, shown
from gsp.systems.flow import check_epsilon, check_orders
from gsp.systems.tolerances import SHARE

# The reference, and what its error is estimated from: two methods of different order.
REFERENCE = (Method.RADAU13, Method.RADAU9)
REFERENCE_RTOL = 1e-13


@dataclass(frozen=True, eq=False, repr=False)
class WorkPrecision(Drawn, Tabular):
    """Error against seconds for one scene at one epsilon.

    `curves` in the order full, peers, reduced; `reference_error` is how far the two references differ; `start` says
    from where the runs begin; `omitted` names what is not installed or cannot take the flow, with the reason;
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

    def fastest(self, error: float, *, kind: WorkKind | None = None) -> WorkCurve | None:
        """The curve that reaches `error` in the least time, among those of a `kind` or all; None when none does."""
        fitting = [c for c in self.curves if kind in (None, c.kind) and np.isfinite(c.seconds_at(error))]
        return min(fitting, key=lambda c: c.seconds_at(error), default=None)

    @property
    def saving(self) -> float:
        """How many times as long as a reduced run the fastest full run of its error takes, where that is most.

        At most 1 says that reducing saves nothing here; nan where there is no reduced run, or nothing beside it.
        """
        full = [curve for curve in self.curves if curve.kind is not WorkKind.REDUCED]
        ratios = [
            seconds / point.seconds
            for curve in self.curves
            if curve.kind is WorkKind.REDUCED
            for point in curve.points
            if np.isfinite(
                seconds := min((c.seconds_at(point.error) for c in full if c.points), default=np.nan)
            )
        ]
        return max(ratios, default=float("nan"))

    def saving_told(self) -> str:
        """What reducing saves, as a sentence; empty where nothing can be compared."""
        if np.isnan(self.saving):
            return ""
        if self.saving <= 1.0:
            return "reducing saves nothing here: some full run is as exact and as fast"
        return f"reducing saves a factor of {self.saving:.1f} at most, at equal error"

    def __repr__(self) -> str:
        runs = sum(len(curve.points) for curve in self.curves)
        return f"WorkPrecision({self.scene.name}, epsilon={self.epsilon:g}: {len(self.curves)} curves, {runs} runs)"

    def __str__(self) -> str:
        width = max(len(curve.label) for curve in self.curves)
        # Errors at which curves are compared in tables.
        targets = [t for t in (1e-3, 1e-5, 1e-7, 1e-9) if self.fastest(t) is not None]
        lines = [
            f"microseconds to reach an error of the slow variables, "
            f"{self.scene.system.epsilon} = {self.epsilon:g}, {self.start}",
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
        if told := self.saving_told():
            lines.append(f"  {told}")
        lines += [f"  without {name}: {reason}" for name, reason in self.omitted.items()]
        return "\n".join(lines)


def work_precision(
    scene: Scene | Study,
    *,
    epsilon: float | None = None,
    rtols: Sequence[float] = tuple(10.0**-k for k in range(2, 13)),
    orders: Sequence[int] = (0, 1, 2, 3, 4),
    methods: Sequence[Method] | None = None,
    peers: Sequence[Peer] | None = None,
    limit: float = 2.0,
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
    >>> from gsp.comparison.work_precision import work_precision
    >>> found = work_precision(models.load("michaelis_menten"), orders=(0, 1), rtols=(1e-4, 1e-8), peers=())
    >>> found["reduced 0"].floor > 10 * found["reduced 1"].floor > 100 * found["radau9"].floor
    True
    """
    study = study_of(scene, verb="work_precision")
    scene = study.scene
    value = scene.epsilon if epsilon is None else check_epsilon(epsilon)
    ladder = _ladder(rtols)
    tried = list(Method) if methods is None else _methods(methods)
    rivals = PEERS if peers is None else _peers(peers)
    check_progress(progress)
    check_positive(limit, what="limit", remedy="It is in seconds.")
    valid_orders = tuple(dict.fromkeys(check_orders(orders, empty=True)))
    series = study.series(max(valid_orders, default=0) + 1, symbolic=False)
    expanded = study.spent("numeric series")
    start, slow_start, first, origin = _start(study, series, value, max(valid_orders, default=0))
    direction = sense(study)
    last = scene.span[0] + direction * (scene.span[1] - scene.span[0])
    # Times at which every run is compared, and asked for its values.
    grid = np.linspace(first, last, 26)[1:]
    omitted: dict[str, str] = {}
    reference, disagreement = _reference(study, start, value, grid)
    tasks = [
        *full_tasks(study, start, value, grid, tried, omitted),
        *peer_tasks(study, start, value, grid, rivals, omitted),
        *reduced_tasks(series, slow_start, value, grid, scene.span[0], valid_orders, expanded),
    ]
    curves = measure(tasks, ladder, reference, limit, progress)
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
    remedy = "Try (1e-3, 1e-6, 1e-9)."
    be = "a number from 1e-13 to below 1"
    values = check_each(
        rtols,
        lambda r: check_number(r, what="every one of rtols", be=be, least=1e-13, below=1.0, remedy=remedy),
        what="rtols",
        be="a sequence of numbers from 1e-13 to below 1",
        remedy=remedy,
    )
    if not values:
        raise DeclarationError("rtols has no value.", remedy)
    return tuple(sorted(set(values), reverse=True))


def _methods(methods: Sequence[Method]) -> list[Method]:
    """The methods asked for, each as `integrate` takes it."""
    found = check_each(methods, check_method, what="methods", be="a sequence of methods")
    if None in found:
        raise DeclarationError("methods is a sequence of methods.", got=shown(methods), value=methods)
    return [method for method in found if method is not None]


def _peers(peers: Sequence[Peer]) -> tuple[Peer, ...]:
    found = check_each(peers, lambda peer: peer, what="peers", be="a sequence of gsp.comparison.peers.Peer")
    for peer in found:
        if not isinstance(peer, Peer):
            raise DeclarationError(
                "peers is a sequence of gsp.comparison.peers.Peer.", got=f"{shown(peer)} in it", value=peer
            )
    return found


def _start(
    study: Study, series: SeriesManifold, epsilon: float, order: int
) -> tuple[dict[str, float], dict[str, float], float, str]:
    """The full start, the reduced one, where the grid begins, and in words."""
    scene = study.scene
    try:
        if sense(study) < 0:
            raise HyperbolicityError("the branch repels")
        base = project(series, study.start, epsilon=epsilon)
        inner = expand_inner(study.branch, study.start, order=0)
    except (BranchError, HyperbolicityError):
        moved = on_manifold(series, study.start, epsilon)
        slow = {s.name: moved[s.name] for s in study.system.x}
        return moved, slow, scene.span[0], "from the slow manifold over the scene's start"
    layer = layer_time(inner, scene, epsilon, order)
    text = f"from the scene's start, after the initial layer of {layer:.3g}"
    return dict(study.start), dict(base), scene.span[0] + layer, text


def _reference(
    study: Study, start: Mapping[str, float], epsilon: float, grid: np.ndarray
) -> tuple[np.ndarray, float]:
    runs = []
    for method in REFERENCE:
        run = trajectory_of(
            study.system,
            start=start,
            span=(study.scene.span[0], float(grid[-1])),
            epsilon=epsilon,
            rtol=REFERENCE_RTOL,
            atol=REFERENCE_RTOL * SHARE,
            at=grid,
            options=RunOptions(method=method),
        )
        if not run.status.ok:
            raise DeclarationError(
                f"there is no reference for {study.scene.name} at {study.system.epsilon} = {epsilon:g}: {run.message}.",
                "Shorten the span, move the start or take another value of it.",
            )
        runs.append(slow_values(run.y, study.system, study))
    error, _ = largest_errors(runs[1], runs[0])
    return runs[0], error
