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

from gsp.analysis.fold_surroundings import Boundary, boundary_of
from gsp.analysis.pictured_runs import ladder_of, landing_runs, phenomenon_of, reduced_run
from gsp.choice.choice import Choice, choose
from gsp.comparison.comparison import Comparison, compare
from gsp.comparison.failure_map import BEYOND, LOOSEST, TIGHTEST, FailureMap, failure_map
from gsp.critical.continuation.critical_curve import CriticalCurve
from gsp.critical.continuation.critical_sheet import CriticalSheet
from gsp.errors import (
    NO_REASON,
    BranchError,
    BudgetError,
    MissingPartError,
    Reason,
    UnsupportedFunctionError,
)
from gsp.fibres.base_points import BasePoint
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity, Kind
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.trajectory import Trajectory
from gsp.results.attempts import Missing, attempt, made
from gsp.results.drawn import Drawn
from gsp.scenes.bearing import no_slip_of
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.singular.mixed_modes import MixedMode
from gsp.sliding.no_slip import NoSlip
from gsp.slow.raw_series import RawManifold, carry_back
from gsp.slow.series import READABLE, SeriesManifold
from gsp.systems.arguments import check_flag, check_progress
from gsp.systems.flow import check_order, check_orders

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
    again and again, over more than one slow variable with its swings counted; None where there is none. `no_slip`
    says whether contacts with dry friction stick along the run; None without any. `ending` says why the series has
    not all the orders asked for, where the exact algebra did not reach them.

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
    no_slip: NoSlip | None = None
    ending: str = ""

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
        """Why the highest orders are not there or not run, as sentences; empty where all of them are."""
        return " ".join(dict.fromkeys(filter(None, (self.study.why_shorter(self.series.order), self.ending))))

    def __repr__(self) -> str:
        found = "no comparison" if "comparison" in self.lost else repr(self.comparison)
        return f"Analysis({self.scene.name}: {self.hyperbolicity.kind}, {found})"

    def __str__(self) -> str:
        parts = [str(self.study.splitting)] if self.study.splitting else []
        if "choice" not in self.lost:
            parts.insert(0, str(self.choice.verdict))
        if "no_slip" not in self.lost and self.no_slip is not None:
            parts.insert(1, str(self.no_slip))
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
    fast: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> Analysis:
    """The whole pipeline for one scene, through `order` in epsilon, compared at `orders`.

    With `fast` the errors of the fast variables count in the choice, as they do in `choose`.
    `progress(stage, share)` is called as the work goes on. Where normal hyperbolicity is lost in the scene's region,
    `hyperbolicity` says so, and of the rest there is what can be made. Raises what splitting and solving raise.
    """
    study = study_of(scene, verb="analyse")
    scene = study.scene
    check_order(order)
    check_orders(orders)
    check_flag(fast, what="fast")
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
        # What all the others stand on: the splitting, the critical manifold, and the branch of it that the scene means.
        _ = study.region, study.branch
    with stage("hyperbolicity"):
        hyperbolicity = _with_proof(study.hyperbolicity)
    parts: dict[str, Any] = {}

    def part(name: str, make: Callable[[], Any]) -> Any:
        parts[name] = attempt(name, make)
        return parts[name]

    with stage("boundary"):
        part("boundary", lambda: boundary_of(study, hyperbolicity))
        part("no_slip", lambda: no_slip_of(study))
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
        part("choice", lambda: choose(study, orders=orders, fast=fast))
    with stage("failures"):
        failures, failures_reason = _failures(study, lambda share: report("failures", share))
    with stage("trajectories"):
        base, base_reason = _base_point(study, order, hyperbolicity)
        ladder = part("ladder", lambda: ladder_of(study))
        part("full", lambda: made(ladder)[scene.epsilon])
        start = {**study.start, **scene.reconstruction_start}
        limit = part("limit", lambda: reduced_run(study, 0, start))
        part("reduced", lambda: reduced_run(study, study.short_series(made(series).order).order, base or start))
        part("phenomenon", lambda: phenomenon_of(study, parts["boundary"]))
        part("landing", lambda: landing_runs(study, series, hyperbolicity, limit))
    return Analysis(
        study=study,
        hyperbolicity=hyperbolicity,
        base=base,
        base_reason=base_reason,
        failures=failures,
        failures_reason=failures_reason,
        ending=""
        if isinstance(series, Missing) or series.order == order
        else study.series_within_budget(order)[1],
        timings=MappingProxyType(timings),
        versions=MappingProxyType(_versions()),
        **parts,
    )


def _series(study: Study, order: int) -> SeriesManifold:
    """The series with symbolic parameters; with their values put in, and as far as that goes, where it is too long."""
    try:
        return study.series(order)
    except BudgetError:
        return study.series_within_budget(order)[0]


def _short(study: Study, orders: Sequence[int]) -> tuple[int, ...]:
    """Those of `orders` whose series is short enough to be run, and the least of them."""
    highest = study.short_series(max(orders), at_least=min(orders)).order
    return tuple(order for order in orders if order <= highest)


def _with_proof(hyperbolicity: Hyperbolicity) -> Hyperbolicity:
    """With a certificate where a small budget gives one; what has no enclosure stays sampled."""
    try:
        # Boxes that are tried for a proof: a fraction of a second.
        return hyperbolicity.with_proof(most_boxes=500)
    except (BranchError, UnsupportedFunctionError):
        return hyperbolicity


def _failures(study: Study, progress: Callable[[float], object]) -> tuple[FailureMap | None, Reason]:
    """A failure map over the region, or None and why there is none."""
    scene = study.scene
    axis = next((s.name for s in study.system.x if s.name in study.region), None)
    if axis is None:
        return None, Reason("the region bounds no slow variable")
    low, high = study.region[axis]
    # The failure map of a report, coarser than its own: epsilons, positions, tolerances, and orders.
    epsilons, positions, tolerances = 11, 25, 8
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
            orders=_short(study, (0, 1, 2)),
            progress=progress,
        ),
    )
    return (None, found.reason) if isinstance(found, Missing) else (found, NO_REASON)


def _base_point(study: Study, order: int, hyperbolicity: Hyperbolicity) -> tuple[BasePoint | None, str]:
    """Base point of the fast fibre through the scene's start, or None and why there is none."""
    if hyperbolicity.kind not in (Kind.ATTRACTING, Kind.LOST):
        return None, f"the branch is {hyperbolicity.kind.adjective}, so the start does not land on it"
    found = attempt("the base point", lambda: study.base_point(order))
    return (None, found.reason) if isinstance(found, Missing) else (found, NO_REASON)


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed as a distribution"
    return found
