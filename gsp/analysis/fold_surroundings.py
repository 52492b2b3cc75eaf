"""Where the reduction of a scene ends: the folds around its region, what they lead to, and the orbit they close.

Everything here is read off the critical manifold; no full run is made. A stage that does not apply to what is there
leaves a reason instead of a result.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import sympy as sp

from gsp.critical.branch import Branch
from gsp.critical.continuation.critical_curve import CriticalCurve, uninterrupted
from gsp.critical.continuation.critical_sheet import CriticalSheet, critical_sheet
from gsp.critical.continuation.curve_continuation import continue_critical
from gsp.critical.continuation.special_points import SpecialPoint
from gsp.critical.sampling import Sampler
from gsp.cycles.cycle_certificate import CycleCertificate, certify_cycle
from gsp.cycles.passage_certificate import PassageCertificate, certify_passage
from gsp.errors import NO_REASON, GspError, Reason, UnsupportedFunctionError
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity, Kind
from gsp.hyperbolicity.losses.kinds import Contact, Loss
from gsp.scenes.image import IMAGE_POINTS
from gsp.scenes.study import Study
from gsp.singular.blow_up.blow_up import BlowUp, blow_up
from gsp.singular.passage.entry_exit import entry_exit
from gsp.singular.passage.failure import PassageError
from gsp.singular.passage.fold_passage import FoldPassage, passage_at
from gsp.singular.singular_orbit import SingularOrbit, singular_orbit
from gsp.singular.singularities.canard_points import CanardError
from gsp.singular.singularities.canard_value import CanardValue, canard_value
from gsp.singular.singularities.folded_singularities import FoldedSingularity, folded_singularities
from gsp.systems.region import Interval, state_sizes

# Functions that are smooth wherever they are finite: a graph of them has no folds.
SMOOTH = (sp.exp, sp.log, sp.sin, sp.cos, sp.tan, sp.sinh, sp.cosh, sp.tanh)


@dataclass(frozen=True, eq=False, repr=False)
class FoldBeyond:
    """A fold: its `point` by name and the `passage` through it, or None for the `reason`.

    Where the slow flow does not cross it, `canard` is the canard value of the system's parameter when there is just
    one and it has a canard point right here; else None.
    """

    point: Mapping[str, float]
    passage: FoldPassage | None
    canard: CanardValue | None
    reason: Reason

    def __repr__(self) -> str:
        place = ", ".join(f"{name} = {value:.6g}" for name, value in self.point.items())
        return (
            f"FoldBeyond({place}: {'passage' if self.passage else 'canard point' if self.canard else 'none'})"
        )


@dataclass(frozen=True, eq=False, repr=False)
class Boundary:
    """What is known of the end of a reduction.

    `surroundings` is the critical manifold through its folds in a box around the region, for branches that may fold
    over one or two slow variables, else None. `folds` are those of a curve, `folded` the folded singularities on a
    sheet (empty for the `folded_reason`, if any), `orbit` the singular orbit from the scene's start (None for the
    `orbit_reason`, or when there is no fold), and `period` the three coefficients of its period when it closes.
    In the plane `cycle` is then what is proved of the cycle near it for every epsilon up to that of the scene, and
    `passage` what is proved of the first loss of hyperbolicity that orbits from the start meet; None where they meet
    none.
    """

    surroundings: CriticalCurve | CriticalSheet | None
    folds: tuple[FoldBeyond, ...] = ()
    folded: tuple[FoldedSingularity, ...] = ()
    folded_reason: Reason = NO_REASON
    orbit: SingularOrbit | None = None
    orbit_reason: Reason = NO_REASON
    period: tuple[float, float, float] | None = None
    cycle: CycleCertificate | None = None
    passage: PassageCertificate | None = None

    @property
    def has_folds(self) -> bool:
        """Whether any fold was found around the region."""
        found = self.surroundings
        return bool(found.folds) if isinstance(found, CriticalSheet) else bool(self.folds)

    def __repr__(self) -> str:
        if not self.has_folds:
            return "Boundary(no folds)"
        found = self.surroundings
        count = len(found.folds) if isinstance(found, CriticalSheet) else len(self.folds)
        what = "fold curve" if isinstance(found, CriticalSheet) else "fold"
        return f"Boundary({count} {what}{'s' * (count > 1)}, {len(self.folded)} folded singularities, {self.orbit!r})"


def boundary_of(study: Study, hyperbolicity: Hyperbolicity) -> Boundary:
    """The boundary of a scene's reduction; raises what following the critical manifold raises.

    >>> from gsp.scenes.study import study_of
    >>> study = study_of(models.load("van_der_pol"))
    >>> boundary_of(study, classify(study.branch, region=study.region))
    Boundary(1 fold, 0 folded singularities, SingularOrbit(3 slow pieces, closed, 2 drops))
    """
    around = surroundings(study)
    found = Boundary(around)
    if isinstance(around, CriticalCurve):
        places = [point.point for point in around.special if point.kind.is_fold]
        found = Boundary(around, folds=tuple(_beyond(study, place) for place in places))
    if not found.has_folds:
        return replace(found, passage=_proved_passage(study, None))
    folded, folded_reason = folded_around(study)
    orbit, period, orbit_reason = _orbit(study, hyperbolicity)
    return Boundary(
        around, found.folds, folded, folded_reason, orbit, orbit_reason, period, _cycle(study, orbit),
        _proved_passage(study, orbit),
    )  # fmt: skip


def surroundings(study: Study) -> CriticalCurve | CriticalSheet | None:
    """M0 through its folds in a box around the region; None where `not_followed` has an error."""
    system = study.system
    if not_followed(study) is not None:
        return None
    bounds, start = _box(study), _on_branch(study)
    if len(system.x) == 1:
        return uninterrupted(continue_critical(system, start=start, bounds=bounds))
    return critical_sheet(system, start=start, bounds=bounds)


def not_followed(study: Study) -> GspError | None:
    """What a caller who wants M0 followed through folds around the region is told; None where it is."""
    system, branch = study.system, study.branch
    name = study.scene.name or "the scene"
    if never_folds(branch):
        return GspError(f"the branch of {name} is the graph {branch} without roots: it has no folds.")
    if len(system.x) > 2:
        return GspError(
            "folds are followed over one or two slow variables.",
            "Use gsp.continue_critical with free=... to follow them along one of the variables.",
            got=f"{len(system.x)} in {name}",
            value=len(system.x),
        )
    unbounded = [y.name for y in system.y if y.name not in _box(study)]
    if len(system.x) == 2 and unbounded:
        return GspError(
            "over two slow variables folds are followed in a box.",
            "Bound the fast variables there.",
            got=f"no bounds on {', '.join(unbounded)} in the region of {name}",
        )
    start = _on_branch(study)
    for key, (low, high) in _box(study).items():
        if not low <= start[key] <= high:
            return GspError(
                f"over the start's slow values the sheet of its run is at {key} = {start[key]:.6g}, outside the box "
                "around the region in which folds are followed.",
                f"Start over slow values at which the region holds a point of the branch, or bound {key} around it.",
                got=f"the box {key} in [{low:.6g}, {high:.6g}]",
                value=start[key],
                point=start,
            )
    return None


@dataclass(frozen=True, eq=False, repr=False)
class LocalScales:
    """The blow-up of a special point, or of a point half way along a curve of folds; None for the `reason`."""

    title: str
    point: Mapping[str, float]
    blow_up: BlowUp | None
    reason: Reason = NO_REASON

    def __str__(self) -> str:
        return f"{self.title}: {self.reason if self.blow_up is None else self.blow_up.line}"


def local_scales(study: Study, found: CriticalCurve | CriticalSheet) -> list[LocalScales]:
    """The weights and powers of epsilon at every special point of what `surroundings` has found, and on its folds.

    Outside the region only where there are any.
    """
    curves = [found] if isinstance(found, CriticalCurve) else [*found.folds]
    scales = []
    for curve in curves:
        if not isinstance(curve, CriticalCurve):
            bounds = [(curve[name], side) for name, side in study.region.items() if name in curve.names]
            inside = np.all([(low <= v) & (v <= high) for v, (low, high) in bounds], axis=0)
            rows = np.flatnonzero(inside) if inside.any() else np.arange(len(curve))
            place = {name: float(curve[name][rows[len(rows) // 2]]) for name in curve.names}
            scales.append((_local_scales(study, "along the curve of folds", place, place), inside.any()))
        for point in curve.special:
            shown = ", ".join(f"{name} = {value:.6g}" for name, value in point.point.items())
            told = _local_scales(study, f"{point.kind} at {shown}", point.point, point)
            scales.append((told, point.is_in(study.region)))
    return [each for each, is_inside in scales if is_inside or each.blow_up is not None]


def _local_scales(
    study: Study, title: str, point: Mapping[str, float], near: Mapping[str, float] | SpecialPoint
) -> LocalScales:
    try:
        return LocalScales(title, point, blow_up(study.system, near=near))
    except GspError as error:
        return LocalScales(title, point, None, error.reason)


def _on_branch(study: Study) -> dict[str, float]:
    """The point of the branch over the start's slow values."""
    x = np.array([[study.start[s.name] for s in study.system.x]])
    values = np.concatenate([x[0], study.branch.points(x)[0]])
    return {s.name: float(value) for s, value in zip(study.system.states, values)}


def never_folds(branch: Branch) -> bool:
    """Whether h_0 is an expression that is smooth wherever it is finite: without roots and inverse functions."""
    if branch.graph is None:
        return False
    for h in branch.graph.values():
        for part in sp.preorder_traversal(h):
            if part.is_Pow and part.base is not sp.E and part.free_symbols and not part.exp.is_integer:
                return False
            if part.is_Function and not isinstance(part, SMOOTH):
                return False
    return True


def _box(study: Study) -> dict[str, Interval]:
    """The region widened, with what v of a switch is on the branch over it where the scene has no bounds on v."""
    system, region = study.system, dict(study.region)
    open_switches = {switch.fast.name for switch in study.switches} - region.keys()
    if open_switches:
        axes = [np.linspace(*study.region[x.name], IMAGE_POINTS) for x in system.x]
        heights, good = Sampler(study.branch).over(np.array(list(itertools.product(*axes))), None)
        for y, values in zip(system.y, heights[good].T) if good.any() else ():
            if y.name in open_switches:
                region[y.name] = (float(values.min()), float(values.max()))
    # The critical manifold is followed in a box wider than the region by so many of its widths on every side.
    widths = {name: 1.5 * (high - low) for name, (low, high) in region.items()}
    box = {name: (low - widths[name], high + widths[name]) for name, (low, high) in region.items()}
    # An edge at zero, where a rate may have its pole, is at zero in any units.
    rounding = {name: 4.0 * np.finfo(float).eps * width for name, width in widths.items()}
    return {
        name: (low if abs(low) > rounding[name] else 0.0, high if abs(high) > rounding[name] else 0.0)
        for name, (low, high) in box.items()
    }


def switch_ends(study: Study) -> tuple[Loss, ...]:
    """Where the sheet of a switch ends in the region, at folds of the fields on its sides; empty without a switch."""
    if not study.switches:
        return ()
    return tuple(loss for loss in study.hyperbolicity.losses if loss.crossing is Contact.SATURATION)


def _beyond(study: Study, fold: Mapping[str, float]) -> FoldBeyond:
    try:
        return FoldBeyond(fold, passage_at(study.system, fold, sizes=study.branch.units), None, NO_REASON)
    except PassageError as error:
        return FoldBeyond(fold, None, _canard(study, fold), error.reason)


def _canard(study: Study, fold: Mapping[str, float]) -> CanardValue | None:
    """The canard value when the fold is a canard point as declared, and only one parameter can be meant."""
    system = study.system
    if len(system.y) != 1 or len(system.parameters) != 1:
        return None
    ((parameter, declared),) = system.parameters.items()
    here = {**fold, parameter.name: float(declared)}
    try:
        found = canard_value(system, parameter=parameter, order=1, near=here)
    except CanardError:
        return None
    sizes = state_sizes(study.region, here)
    # A canard point is that of the scene when it lies this near to the fold and to the declared parameter.
    near = all(abs(float(found.point[name]) - value) <= 1e-6 * sizes[name] for name, value in here.items())
    return found if near else None


def folded_around(study: Study) -> tuple[tuple[FoldedSingularity, ...], Reason]:
    """The folded singularities of one fast and two slow variables in the box of `surroundings`, or why none is told."""
    if len(study.system.x) != 2 or len(study.system.y) != 1:
        return (), NO_REASON
    try:
        return folded_singularities(study.system, region=_box(study)), NO_REASON
    except GspError as error:
        return (), error.reason


def _cycle(study: Study, orbit: SingularOrbit | None) -> CycleCertificate | None:
    if orbit is None or not is_planar(study):
        return None
    try:
        return certify_cycle(orbit, epsilon=study.scene.epsilon)
    except UnsupportedFunctionError:
        return None


def is_planar(study: Study) -> bool:
    """Whether there are one slow and one fast variable."""
    return len(study.system.x) == len(study.system.y) == 1


def proved_passage(
    study: Study, fold: FoldPassage | None, progress: Callable[[float], object] | None = None
) -> PassageCertificate:
    """What is proved of orbits from the start through the `fold` in which their slow piece ends, or past what the
    branch meets where there is none; raises what `entry_exit` and `certify_passage` raise.
    """
    slow = {x.name: study.start[x.name] for x in study.system.x}
    if fold is not None:
        return certify_passage(fold, start=slow, epsilon=study.scene.epsilon, progress=progress)
    left = entry_exit(study.branch, start=slow)
    return certify_passage(left, epsilon=study.scene.epsilon, progress=progress)


def _proved_passage(study: Study, orbit: SingularOrbit | None) -> PassageCertificate | None:
    if not is_planar(study):
        return None
    try:
        found = proved_passage(study, None if orbit is None else orbit.pieces[0].fold)
    except GspError:
        return None
    return found if isinstance(found.passage, FoldPassage) or found.passage.losses else None


def _orbit(
    study: Study, hyperbolicity: Hyperbolicity
) -> tuple[SingularOrbit | None, tuple[float, float, float] | None, Reason]:
    if hyperbolicity.kind not in (Kind.ATTRACTING, Kind.LOST):
        return (
            None,
            None,
            Reason(f"the branch is {hyperbolicity.kind.adjective}, so no singular orbit starts on it"),
        )
    try:
        # Slow pieces of a singular orbit: orbits that close do so within a few, or creep to it like a
        # contraction.
        orbit = singular_orbit(study.branch, _on_branch(study), max_pieces=60)
        return orbit, orbit.coefficients, NO_REASON
    except GspError as error:
        return None, None, error.reason
