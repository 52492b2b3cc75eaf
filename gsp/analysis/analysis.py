"""The whole pipeline on one scene: split, solve, classify, expand, compare, and the runs worth looking at."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from importlib.metadata import PackageNotFoundError, version
from types import MappingProxyType
from typing import Any

import numpy as np

from gsp.analysis.attempts import Missing, attempt, made
from gsp.analysis.fold_surroundings import Boundary, boundary_of
from gsp.choice.choice import Choice, choose
from gsp.comparison.comparison import Comparison, compare, on_manifold
from gsp.comparison.failures import BEYOND, LOOSEST, TIGHTEST, FailureMap, failure_map
from gsp.critical.continuation import CriticalCurve, CriticalSheet
from gsp.errors import (
    NO_REASON,
    BranchError,
    BudgetError,
    HyperbolicityError,
    MissingPartError,
    Reason,
    UnsupportedFunctionError,
)
from gsp.fibres.base_points import BasePoint
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity, Kind
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.trajectory import Trajectory, trajectory_of
from gsp.results.drawn import Drawn
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.singular.mixed_modes import MixedMode, mixed_mode
from gsp.slow.raw_series import RawManifold, carry_back
from gsp.slow.series import LONGEST, READABLE, SeriesManifold
from gsp.systems.arguments import check_progress
from gsp.systems.flow import check_order, check_orders

# Boxes that are tried for a proof: a fraction of a second.
PROOF_BOXES = 500
# Epsilons of the pictures, as multiples of the scene's: a ladder that an eye can tell apart.
PICTURED = (2.0, 1.0, 0.4)
# Runs for pictures: their error is far below the width of a line.
PICTURE_RTOL, PICTURE_ATOL = 1e-8, 1e-10
# Starts off the slow manifold: over which points of the limit run (as shares of its span), and how far off (as
# shares of the fast variable's range); each is followed for so many layer times epsilon/gap, or a share of the span.
LANDINGS = {0.0: (-1.0, -0.5, 0.5, 1.0), 0.35: (-1.0, 1.0), 0.7: (-1.0, 1.0)}
LAYER_TIMES = 12.0
FOLLOWED = 0.3
# The whole phenomenon: spans tried, as multiples of the scene's, until a run has swung over the folds so often.
LONGER = (4.0, 16.0, 64.0, 256.0)
SWINGS = 3
# The failure map of a report, coarser than its own: epsilons, positions, tolerances, and orders.
MAP = (11, 25, 8)
MAP_ORDERS = (0, 1, 2)
PACKAGES = ("gsp-toolkit", "numpy", "scipy", "sympy", "numba", "python-flint", "matplotlib")


@dataclass(frozen=True, eq=False)
class Analysis(Drawn):
    """Everything known about a scene.

    `shown` is what of the `series` can be printed, `raw` the same in the field's own variables (None where it
    cannot be carried back). `full` is the full run from the scene's start, reconstruction included, `limit` the
    reduced run of order 0 and `reduced` of the highest order, started at the `base` point of the fast fibre through
    the scene's start (or over the same slow variables when there is none, for the `base_reason`). `ladder` holds full
    runs at the pictured epsilons, `landing` runs that start off the slow manifold (empty unless it attracts).
    `boundary` holds the folds around the region and what follows from them. `choice` is the cheapest model that meets
    the scene's tolerance, `failures` a coarse failure map (None for the `failures_reason`). `timings` are seconds per
    stage, `versions` of what computed it.

    `phenomenon` goes on through the folds where there are any: a long run of the full system that swings over them
    again and again, over more than one slow variable with its swings counted; None where there is none.

    What a stage could not make is left out: reading it raises `MissingPartError`, and `lost` gives the reason by name.
    """

    study: Study
    hyperbolicity: Hyperbolicity
    series: SeriesManifold
    shown: SeriesManifold
    raw: RawManifold | None
    comparison: Comparison
    full: Trajectory
    limit: Trajectory
    reduced: Trajectory
    ladder: Mapping[float, Trajectory]
    landing: tuple[Trajectory, ...]
    base: BasePoint | None
    base_reason: str
    boundary: Boundary
    choice: Choice
    failures: FailureMap | None
    failures_reason: Reason
    timings: Mapping[str, float]
    versions: Mapping[str, str]
    phenomenon: Trajectory | MixedMode | None = None

    def __post_init__(self) -> None:
        parts = {field.name: self.__dict__[field.name] for field in fields(self)}
        lost = {name: part.reason for name, part in parts.items() if isinstance(part, Missing)}
        for name in lost:
            del self.__dict__[name]
        self.__dict__["_lost"] = MappingProxyType(lost)

    @property
    def lost(self) -> Mapping[str, str]:
        """What could not be made, by name, with the reason."""
        return self.__dict__["_lost"]

    def __getattr__(self, name: str) -> Any:
        # Asked for what is not there only.
        reason = self.__dict__.get("_lost", {}).get(name)
        if reason is None:
            raise AttributeError(f"an Analysis has no attribute {name!r}")
        raise MissingPartError(reason)

    @property
    def scene(self) -> Scene:
        """The scene that was analysed."""
        return self.study.scene

    @property
    def flow(self) -> ReducedFlow:
        """The reduced flow of order 0, in the coordinates of the critical manifold."""
        return self.study.reduced(0, reconstructed=False)

    @property
    def surroundings(self) -> CriticalCurve | CriticalSheet | None:
        """The critical manifold through its folds in a box around the region, where it was followed."""
        return self.boundary.surroundings

    @property
    def short_series(self) -> SeriesManifold:
        """The series with the parameters' values in, as far as it is short enough to be run."""
        return self.study.short_series(self.series.order)

    @property
    def cut(self) -> str:
        """Why the highest orders of the series are not run, as a sentence; empty where all of them are."""
        short, order = self.short_series, self.series.order
        if short.order == order:
            return ""
        longest = max(self.study.series(short.order + 1, symbolic=False).sizes)
        return (
            f"The series is run through order {short.order} only: at order {short.order + 1} it has coefficients "
            f"of {longest} terms, more than {LONGEST}."
        )

    def __repr__(self) -> str:
        found = "no comparison" if "comparison" in self.lost else repr(self.comparison)
        return f"Analysis({self.scene.name}: {self.hyperbolicity.kind}, {found})"

    def __str__(self) -> str:
        parts = [str(self.study.splitting)] if self.study.splitting else []
        if "choice" not in self.lost:
            parts.insert(0, str(self.choice.verdict))
        shown = [str(getattr(self, name)) for name in ("series", "comparison") if name not in self.lost]
        if "series" not in self.lost and self.cut:
            shown.append(self.cut)
        lost = [f"not made: {name}: {reason}" for name, reason in self.lost.items()]
        return "\n\n".join([*parts, str(self.hyperbolicity), *shown, *(["\n".join(lost)] if lost else [])])


STAGES = ("split", "hyperbolicity", "boundary", "series", "comparison", "choice", "failures", "trajectories")


def analyse(
    scene: Scene | Study,
    *,
    order: int = 3,
    orders: Sequence[int] = (0, 1, 2, 3),
    progress: Callable[[str, float], None] | None = None,
) -> Analysis:
    """The whole pipeline for one scene, through `order` in epsilon, compared at `orders`.

    `progress(stage, share)` is called as the work goes on. Raises `HyperbolicityError`, saying where, when the
    fast Jacobian is singular in the scene's region, and whatever the stages raise.
    """
    study = study_of(scene, verb="analyse")
    scene = study.scene
    check_order(order)
    check_orders(orders)
    check_progress(progress)
    report = progress or (lambda stage, share: None)
    timings: dict[str, float] = {}

    @contextmanager
    def stage(name: str) -> Iterator[None]:
        report(name, 0.0)
        begun = time.perf_counter()
        yield
        timings[name] = time.perf_counter() - begun
        report(name, 1.0)

    with stage("split"):
        _ = study.region, study.branch
    with stage("hyperbolicity"):
        hyperbolicity = _with_proof(study.hyperbolicity)
        _require_hyperbolic(hyperbolicity)
    parts: dict[str, Any] = {}

    def part(name: str, make: Callable[[], Any]) -> Any:
        parts[name] = attempt(name, make)
        return parts[name]

    with stage("boundary"):
        part("boundary", lambda: boundary_of(study, hyperbolicity))
    with stage("series"):
        series = part("series", lambda: _series(study, order))
        shown = part("shown", lambda: made(series).readable(READABLE))
        splitting = study.splitting
        part("raw", lambda: None if splitting is None else carry_back(made(shown), splitting))
    with stage("comparison"):
        part(
            "comparison",
            lambda: compare(
                study, orders=_short(study, orders), progress=lambda share: report("comparison", share)
            ),
        )
    with stage("choice"):
        part("choice", lambda: choose(study, orders=orders))
    with stage("failures"):
        failures, failures_reason = _failures(study, lambda share: report("failures", share))
    with stage("trajectories"):
        base, base_reason = _base_point(study, order, hyperbolicity)
        ladder = part("ladder", lambda: _ladder(study))
        part("full", lambda: made(ladder)[scene.epsilon])
        start = {**study.start, **scene.reconstruction_start}
        limit = part("limit", lambda: _reduced(study, 0, start))
        part("reduced", lambda: _reduced(study, study.short_series(made(series).order).order, base or start))
        part("phenomenon", lambda: _phenomenon(study, parts["boundary"]))
        part("landing", lambda: _landing(study, series, hyperbolicity, limit))
    return Analysis(
        study=study,
        hyperbolicity=hyperbolicity,
        base=base,
        base_reason=base_reason,
        failures=failures,
        failures_reason=failures_reason,
        timings=MappingProxyType(timings),
        versions=MappingProxyType(_versions()),
        **parts,
    )


def _series(study: Study, order: int) -> SeriesManifold:
    """The series with symbolic parameters; with their values put in where that is too long."""
    try:
        return study.series(order)
    except BudgetError:
        if not study.system.parameters:
            raise
        return study.series(order, symbolic=False)


def _short(study: Study, orders: Sequence[int]) -> tuple[int, ...]:
    """Those of `orders` whose series is short enough to be run, and the least of them."""
    highest = study.short_series(max(orders), at_least=min(orders)).order
    return tuple(order for order in orders if order <= highest)


def _with_proof(hyperbolicity: Hyperbolicity) -> Hyperbolicity:
    """With a certificate where a small budget gives one; what has no enclosure stays sampled."""
    try:
        return hyperbolicity.with_proof(most_boxes=PROOF_BOXES)
    except (BranchError, UnsupportedFunctionError):
        return hyperbolicity


def _require_hyperbolic(hyperbolicity: Hyperbolicity) -> None:
    if hyperbolicity.kind is not Kind.LOST:
        return
    failed = [str(condition) for condition in hyperbolicity.conditions if not condition.holds]
    where = "; ".join(loss.headline for loss in hyperbolicity.losses[:3]) or "; ".join(failed)
    where = where or hyperbolicity.evidence
    part = hyperbolicity.sub_region
    shrink = f"The conditions hold {part}. " if part is not None else ""
    raise HyperbolicityError(
        f"the branch {hyperbolicity.branch} is not normally hyperbolic over the region: {where}. {shrink}"
        "Shrink the region to one side of it; nothing can be reduced across."
    )


def _failures(study: Study, progress: Callable[[float], object]) -> tuple[FailureMap | None, Reason]:
    """A failure map over the region, or None and why there is none."""
    scene = study.scene
    axis = next((s.name for s in study.system.x if s.name in study.region), None)
    if axis is None:
        return None, Reason("the region bounds no slow variable")
    low, high = study.region[axis]
    epsilons, positions, tolerances = MAP
    found = attempt(
        "the failure map",
        lambda: failure_map(
            study,
            axis=axis,
            positions=np.linspace(low, high, positions).tolist(),
            epsilons=np.geomspace(
                min(scene.epsilons) / BEYOND, max(scene.epsilons) * BEYOND, epsilons
            ).tolist(),
            tolerances=np.geomspace(LOOSEST, TIGHTEST, tolerances).tolist(),
            orders=_short(study, MAP_ORDERS),
            progress=progress,
        ),
    )
    return (None, found.reason) if isinstance(found, Missing) else (found, NO_REASON)


def _base_point(study: Study, order: int, hyperbolicity: Hyperbolicity) -> tuple[BasePoint | None, str]:
    """Base point of the fast fibre through the scene's start, or None and why there is none."""
    if hyperbolicity.kind is not Kind.ATTRACTING:
        return None, f"the branch is {hyperbolicity.kind}, so the start does not land on it"
    found = attempt("the base point", lambda: study.base_point(order))
    return (None, found.reason) if isinstance(found, Missing) else (found, NO_REASON)


def _ladder(study: Study) -> Mapping[float, Trajectory]:
    epsilons = [multiple * study.scene.epsilon for multiple in PICTURED]
    return MappingProxyType({e: study.full(e) for e in epsilons})


def _phenomenon(study: Study, ends: Boundary | Missing) -> Trajectory | MixedMode | None:
    """What the full system does beyond the folds: a run that swings over them `SWINGS` times, or None."""
    if isinstance(ends, Missing) or not ends.has_folds:
        return None
    scene, system = study.scene, study.system
    name = system.y[0].name
    t0, t1 = scene.span
    for longer in LONGER:
        span = (t0, t0 + longer * (t1 - t0))
        run = trajectory_of(
            system,
            start=study.start,
            span=span,
            epsilon=scene.epsilon,
            rtol=PICTURE_RTOL,
            atol=PICTURE_ATOL,
        )
        if not run.status.ok:
            return None
        if _swings(run[name]) < SWINGS:
            continue
        if len(system.x) == 1:
            return run
        return mixed_mode(system, name, start=study.start, span=span, epsilon=scene.epsilon)
    return None


def _swings(values: np.ndarray) -> int:
    """How often `values` rise from the lowest to the highest quarter of their range."""
    low, high = float(values.min()), float(values.max())
    sides = np.sign(values[np.abs(values - 0.5 * (low + high)) > 0.25 * (high - low)] - 0.5 * (low + high))
    return int((np.diff(sides) > 0).sum())


def _reduced(study: Study, order: int, start) -> Trajectory:
    return _picture(study.reduced(order), start, study.scene, study.scene.epsilon)


def _picture(flow, start, scene: Scene, epsilon: float, *, end: float | None = None) -> Trajectory:
    span = (scene.span[0], scene.span[1] if end is None else end)
    return trajectory_of(flow, start=start, span=span, epsilon=epsilon, rtol=PICTURE_RTOL, atol=PICTURE_ATOL)


def _landing(
    study: Study,
    series: SeriesManifold | Missing,
    hyperbolicity: Hyperbolicity,
    limit: Trajectory | Missing,
) -> tuple[Trajectory, ...]:
    """Runs of the standard form that start off M_epsilon in each fast direction, through the layer and beyond."""
    if hyperbolicity.kind is not Kind.ATTRACTING:
        return ()
    scene, series, limit = study.scene, study.short_series(made(series).order), made(limit)
    t0, t1 = scene.span
    layer = LAYER_TIMES * scene.epsilon / hyperbolicity.gap
    end = t0 + min(t1 - t0, max(layer, FOLLOWED * (t1 - t0)))
    runs = []
    for share, offsets in LANDINGS.items():
        there = limit.sample(limit.t[0] + share * (limit.t[-1] - limit.t[0]))
        x = {s.name: float(there[s.name][0]) for s in study.system.x}
        on = on_manifold(series, {**study.start, **x}, scene.epsilon)
        for y in study.system.y:
            low, high = study.region.get(y.name, (on[y.name] - 1.0, on[y.name] + 1.0))
            for offset in offsets:
                room = (high if offset > 0 else low) - on[y.name]
                start = {**on, y.name: on[y.name] + abs(offset) * room}
                runs.append(_picture(study.system, start, scene, scene.epsilon, end=end))
    return tuple(run for run in runs if run.status.ok and np.isfinite(run.y).all())


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed as a distribution"
    return found
