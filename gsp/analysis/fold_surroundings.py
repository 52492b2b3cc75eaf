"""Where the reduction of a scene ends: the folds around its region, what they lead to, and the orbit they close.

Everything here is read off the critical manifold; no full run is made. A stage that does not apply to what is there
leaves a reason instead of a result.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sympy as sp

from gsp.critical.branch import Branch
from gsp.critical.continuation.critical_curve import CriticalCurve, uninterrupted
from gsp.critical.continuation.critical_sheet import CriticalSheet, critical_sheet
from gsp.critical.continuation.curve_continuation import continue_critical
from gsp.critical.loss_kind import LossKind
from gsp.errors import NO_REASON, GspError, Reason
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity, Kind
from gsp.scenes.study import Study
from gsp.singular.passage.failure import PassageError
from gsp.singular.passage.fold_passage import FoldPassage, fold_passage
from gsp.singular.singular_orbit import SingularOrbit, singular_orbit
from gsp.singular.singularities.canard_points import CanardError
from gsp.singular.singularities.canard_value import CanardValue, canard_value
from gsp.singular.singularities.folded_singularities import FoldedSingularity, folded_singularities
from gsp.systems.region import Interval

# The critical manifold is followed in a box wider than the region by so many of its widths on every side.
WIDENED = 1.5
# Slow pieces of a singular orbit: orbits that close do so within a few, or creep to it like a contraction.
PIECES = 60
# A canard point is that of the scene when it lies this near to the fold and to the declared parameter.
HERE = 1e-6
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
            f"FoldOutlook({place}: {'passage' if self.passage else 'canard point' if self.canard else 'none'})"
        )


@dataclass(frozen=True, eq=False, repr=False)
class Boundary:
    """What is known of the end of a reduction.

    `surroundings` is the critical manifold through its folds in a box around the region, for branches that may fold
    over one or two slow variables, else None. `folds` are those of a curve, `folded` the folded singularities on a
    sheet (empty for the `folded_reason`, if any), `orbit` the singular orbit from the scene's start (None for the
    `orbit_reason`, or when there is no fold), and `period` the three coefficients of its period when it closes.
    """

    surroundings: CriticalCurve | CriticalSheet | None
    folds: tuple[FoldBeyond, ...] = ()
    folded: tuple[FoldedSingularity, ...] = ()
    folded_reason: Reason = NO_REASON
    orbit: SingularOrbit | None = None
    orbit_reason: Reason = NO_REASON
    period: tuple[float, float, float] | None = None

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
    box = _box(study)
    around = surroundings(study)
    found = Boundary(around)
    if isinstance(around, CriticalCurve):
        places = [point.point for point in around.special if point.kind is LossKind.FOLD]
        found = Boundary(around, folds=tuple(_beyond(study, place) for place in places))
    if not found.has_folds:
        return found
    folded, folded_reason = _folded(study, box)
    orbit, period, orbit_reason = _orbit(study, hyperbolicity)
    return Boundary(around, found.folds, folded, folded_reason, orbit, orbit_reason, period)


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
    unbounded = [y.name for y in system.y if y.name not in study.region]
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
                f"over the start's slow values the sheet nearest to the start is at {key} = {start[key]:.6g}, outside "
                "the box around the region in which folds are followed.",
                f"Start over slow values at which the region holds a point of the branch, or bound {key} around it.",
                got=f"the box {key} in [{low:.6g}, {high:.6g}]",
                value=start[key],
                point=start,
            )
    return None


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
    return {
        name: (low - WIDENED * (high - low), high + WIDENED * (high - low))
        for name, (low, high) in study.region.items()
    }


def _beyond(study: Study, fold: Mapping[str, float]) -> FoldBeyond:
    try:
        return FoldBeyond(fold, fold_passage(study.system, fold), None, NO_REASON)
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
    near = all(
        abs(float(found.point[name]) - value) <= HERE * (1.0 + abs(value)) for name, value in here.items()
    )
    return found if near else None


def _folded(study: Study, box: Mapping[str, Interval]) -> tuple[tuple[FoldedSingularity, ...], Reason]:
    if len(study.system.x) != 2 or len(study.system.y) != 1:
        return (), NO_REASON
    try:
        return folded_singularities(study.system, region=box), NO_REASON
    except GspError as error:
        return (), error.reason


def _orbit(
    study: Study, hyperbolicity: Hyperbolicity
) -> tuple[SingularOrbit | None, tuple[float, float, float] | None, Reason]:
    if hyperbolicity.kind is not Kind.ATTRACTING:
        return None, None, Reason(f"the branch is {hyperbolicity.kind}, so no singular orbit starts on it")
    try:
        orbit = singular_orbit(study.branch, study.start, max_pieces=PIECES)
        return orbit, orbit.coefficients, NO_REASON
    except GspError as error:
        return None, None, error.reason
