"""What a candidate for a reduction costs and is off by, measured against the full run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import sympy as sp

from gsp.algebra.laurent import misplaced_epsilon, pole_order
from gsp.choice.candidates import (
    INTEGRATION,
    ModelKind,
    Trial,
    full_candidate,
    left_to_model,
    limit_passed,
    run_model,
)
from gsp.choice.choice import Choice, choose
from gsp.choice.costs import timed
from gsp.choice.forecast import LAYER_LEFT
from gsp.choice.measured_errors import RTOL, measured_errors
from gsp.choice.prediction import Failure
from gsp.errors import GspError
from gsp.integration.trajectory import Trajectory
from gsp.reductions.fast_parts import FastPart
from gsp.reductions.reduction import Reduction
from gsp.reductions.special_parts import SpecialPart
from gsp.scenes.scene import Scene
from gsp.scenes.small_parameter import are_fast_by_themselves, take_fast, take_small, with_bookkeeping
from gsp.scenes.study import Study
from gsp.systems.system import VectorField

# Orders of the reduced flows that are measured, those of `choose`: the reduction, and its corrections.
ORDERS = (0, 1, 2, 3)
# The error of order 0 is about the ratio of the time scales: above a tenth that is not small. What the layer leaves
# behind, as the few that an infection begins with, is there from order 1 on.
LEADING, LARGEST = (0, 1), 0.1


def field_of(scene: Scene) -> VectorField:
    """The field of a scene without a small parameter, which no system in slow and fast variables is."""
    assert isinstance(scene.system, VectorField)
    return scene.system


def needed_gap(accuracy: float) -> float:
    """The gap with which a fast mode falls below its share of the accuracy within the time scale of the next."""
    return float(np.log(1.0 / (LAYER_LEFT * accuracy)))


def measure(scene: Scene, part: FastPart | SpecialPart, gaps: np.ndarray) -> dict[Reduction, Study]:
    """The candidate with its errors against the full run, an entry for each order, and the study that they come from.

    None where it cannot be reduced.
    """
    try:
        counted, shown = _scenes(scene, part)
        study = Study(counted)
        counts_fast = _counts_fast(study)
        choice, errors = _looked_at(study, LEADING[:1], counts_fast)
        if _may_be_stiff(choice, errors):
            # What is left may have fast modes of its own, on which an explicit method takes small steps.
            stiff = replace(study, is_stiff=True)
            other, its_errors = _looked_at(stiff, LEADING[:1], counts_fast)
            if not errors or other.candidates[0].steps < choice.candidates[0].steps:
                study, choice, errors = stiff, other, its_errors
        if choice.candidates[0].order is not None and choice.candidates[0].follows:
            if not _is_separated(errors):
                choice, errors = _looked_at(study, LEADING, counts_fast)
            # Only where something is separated are corrections of use; elsewhere they may run for minutes.
            if _is_separated(errors):
                choice, errors = _looked_at(study, ORDERS, counts_fast)
    except (GspError, NotImplementedError, np.linalg.LinAlgError):
        return {}
    full = choice.candidates[-1]
    found = {}
    for c in choice.candidates[:-1]:
        # One that was not looked at has neither a cost nor a failure.
        if c.order is None or (np.isnan(c.seconds) and c.failure is None):
            continue
        why_not = "" if c.follows else c.why_not
        error = errors.get(c.order, float("nan"))
        if not why_not and c.order not in errors:
            why_not = c.ended or "its run takes more steps than the full run calls its field"
        if not why_not and not _is_separated(errors):
            why_not = "to leading orders the error is more than a tenth: nothing is separated"
        if not why_not and not error <= left_to_model(scene.tolerance):
            why_not = f"the error passes {limit_passed(error, scene.tolerance)}"
        if not why_not and c.failure is Failure.REGION:
            why_not = c.why_not
        gap = gaps[part.count - 1]
        # What is predicted to serve as well does so by no chance.
        is_foretold = c.valid and not c.is_measured
        if not why_not and not is_foretold and gap < needed_gap(scene.tolerance):
            why_not = (
                f"the tolerance needs time scales {needed_gap(scene.tolerance):.1f} times apart: {gap:.1f}"
            )
        reduction = Reduction(
            name=part.name, scene=shown, order=c.order, error=error,
            measured=(scene.span[0] + choice.layer, scene.span[1]),
            full_seconds=full.seconds, candidate=c, why_not=why_not, counts_fast=counts_fast,
            is_stiff=study.is_stiff,
        )  # fmt: skip
        found[reduction] = study
    return found


def _looked_at(study: Study, orders: Sequence[int], counts_fast: bool) -> tuple[Choice, dict[int, float]]:
    """The choice among the full system and the reduced flows of these orders, and what each is off by."""
    choice = choose(study, orders=orders, fast=counts_fast, solve=False)
    return choice, measured_errors(study, choice.candidates, choice.names, choice.layer)


def _may_be_stiff(choice: Choice, errors: Mapping[int, float]) -> bool:
    """Whether an explicit method took more steps on the reduced flow of leading order than the full system takes."""
    reduced, full = choice.candidates[0], choice.candidates[-1]
    if reduced.order is None:
        return False
    ends = reduced.failure in (Failure.END, Failure.ORDER)
    return (reduced.follows and not errors) or (
        (reduced.follows or ends) and reduced.steps > full.steps * reduced.share
    )


def _is_separated(errors: Mapping[int, float]) -> bool:
    return any(errors.get(order, float("nan")) <= LARGEST for order in LEADING)


def is_solved(study: Study) -> bool:
    """Whether the flow on the solved manifold serves."""
    try:
        choice = choose(study, orders=ORDERS, fast=_counts_fast(study))
    except GspError:
        return False
    return any(c.kind is ModelKind.SOLVED and c.valid for c in choice.candidates)


def timed_together(scene: Scene, found: Mapping[Reduction, Study]) -> list[Reduction]:
    """The same, those that serve and the full system timed in turn: measured apart, their costs cannot be compared."""
    serving = [each for each in found if not each.why_not]
    if not serving:
        return list(found)
    rtol = INTEGRATION * scene.tolerance
    layer = max(each.measured[0] - scene.span[0] for each in serving)
    whole, _ = full_candidate(scene.system, scene.start, scene, layer, rtol)
    *own, full = timed([*(_trial(each, found[each], rtol) for each in serving), whole])
    costs = iter(own)
    return [
        each if each.why_not else replace(each, candidate=next(costs), full_seconds=full.seconds)
        for each in found
    ]


def _trial(reduction: Reduction, study: Study, rtol: float) -> Trial:
    """A run of the reduced flow over the span, to be timed; one is made here, so that its code is built."""
    flow, start = study.reduced(reduction.order, reconstructed=False), study.slow_start(reduction.order)

    def again() -> Trajectory:
        return run_model(flow, start, study.scene, study.scene.span, rtol)

    again()
    return Trial(reduction.candidate, (again,))


def _scenes(scene: Scene, part: FastPart | SpecialPart) -> tuple[Scene, Scene]:
    """The scene with a bookkeeping epsilon, and with a parameter in its place where one divides the fast rates.

    One that stands elsewhere too, as R in (I - u/R)/C, would make other orders of the same rates.
    """
    fast = part.states
    if fast is None:
        made = with_bookkeeping(scene, part.field(field_of(scene)), ())
        return made, made
    made = take_fast(scene, variables=[s.name for s in fast])
    rates = dict(zip(scene.system.states, scene.system.rates))
    for parameter, value in sorted(scene.system.parameters.items(), key=lambda pair: pair[1]):
        if (
            value > 0
            and all(
                misplaced_epsilon(rate, parameter) is None
                and pole_order(rate, parameter) == (state in fast)
                and not (sp.expand_mul(rate * parameter) if state in fast else rate).has(parameter)
                for state, rate in rates.items()
            )
            and are_fast_by_themselves(rates, parameter, fast)
        ):
            return made, take_small(scene, parameter=parameter.name)
    return made, made


def _counts_fast(study: Study) -> bool:
    """Whether the errors of the fast variables count, for those of the slow ones say nothing.

    Where no slow variable takes notice of the fast ones, as where a clock drives, and where none moves by a tenth of
    its value: that a sum which is all but conserved stays where it is tells nothing of a reduction.
    """
    if not any(rate.has(*study.system.y) for rate in study.system.f):
        return True
    run = run_model(study.system, study.start, study.scene, study.scene.span, RTOL)
    names = [s.name for s in study.system.x]
    return all(np.ptp(run[name]) <= LARGEST * np.abs(run[name]).max() for name in names)
