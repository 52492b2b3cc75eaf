"""The verbs that a sweep can do at a point, and what each records there.

They record what does not depend on the machine or its load, so that the same point gives the same numbers anywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gsp.choice.candidates import ModelKind
from gsp.choice.choice import choose
from gsp.comparison.comparison import compare
from gsp.comparison.survey import EXPLICIT, demands_of, reduced_name
from gsp.errors import Status
from gsp.hyperbolicity.hyperbolicity import Kind, classify
from gsp.integration.trajectory import trajectory_of
from gsp.orbits.periodic.finding import periodic_orbit
from gsp.proofs.verdict import ProofVerdict
from gsp.scenes.study import Study
from gsp.scenes.tolerances import absolute_tolerance
from gsp.singular.singularities.canard_value import canard_value
from gsp.slow_tubes.certify import certify
from gsp.sweeps.plan import Record
from gsp.systems.flow import check_orders


@dataclass(frozen=True)
class Verb:
    """A verb of the package at one point: `record` gives the numbers, `labels` the labels of their axes by variable.

    `record` takes the study at the parameters and the start of the point, and its epsilon and tolerance besides.
    """

    record: Callable[..., Record]
    labels: Callable[..., Mapping[str, Mapping[str, tuple[str | int, ...]]]] = lambda study, **_: {}
    codes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def _by_order(*names: str):
    def labels(study: Study, *, orders: tuple[int, ...] = (0, 1, 2, 3), **_: object):
        return {name: {"order": check_orders(orders)} for name in names}

    return labels


def _integrate(
    study: Study, epsilon: float, tolerance: float, *, method: str | None = None, max_steps: int = 1_000_000
) -> Record:
    scene = study.scene
    run = trajectory_of(
        scene.full_flow,
        start=scene.full_start,
        span=scene.span,
        epsilon=epsilon,
        rtol=tolerance,
        atol=absolute_tolerance(tolerance, scene.region, scene.full_start),
        method=method,
        max_steps=max_steps,
        dense=False,
    )
    return {
        "ending": run.status,
        "steps": run.stats.steps,
        "field_calls": run.stats.field_calls,
        "end": run.t[-1],
        "final": run.y[:, -1],
    }


def _of_states(study: Study, **_: object):
    return {"final": {"state": tuple(s.name for s in study.scene.full_flow.states)}}


def _classify(study: Study, epsilon: float, tolerance: float) -> Record:
    verdict = classify(study.branch, region=study.region, epsilon=epsilon)
    return {"kind": verdict.kind, "gap": verdict.gap, "holds": verdict.holds, "losses": len(verdict.losses)}


def _certify(study: Study, epsilon: float, tolerance: float, *, most_boxes: int = 20_000) -> Record:
    proof = certify(study.branch, region=study.region, epsilon=epsilon, most_boxes=most_boxes)
    if proof.is_interrupted:
        raise KeyboardInterrupt
    return {
        "verdict": proof.verdict,
        "gap": proof.gap,
        "boxes": proof.tried,
        "undecided_volume": proof.undecided_volume,
    }


def _compare(
    study: Study,
    epsilon: float,
    tolerance: float,
    *,
    orders: tuple[int, ...] = (0, 1, 2, 3),
    correction: int | None = None,
) -> Record:
    found = compare(study, orders=orders, epsilons=(epsilon,), correction=correction)
    # An order that the exact algebra does not reach has no error.
    errors = [found.errors[n][0] if n in found.errors else math.nan for n in check_orders(orders)]
    return {"error": errors, "floor": found.floor[0]}


def _choose(
    study: Study, epsilon: float, tolerance: float, *, orders: tuple[int, ...] = (0, 1, 2, 3)
) -> Record:
    found = choose(study, orders=orders, epsilon=epsilon, tolerance=tolerance, solve=False)
    reduced = {c.order: c for c in found.candidates if c.kind is ModelKind.REDUCED}
    in_order = [reduced.get(n) for n in check_orders(orders)]
    return {
        "predicted": [math.nan if c is None else c.predicted for c in in_order],
        "holds_until": [math.nan if c is None else c.holds_until for c in in_order],
        "serves": [math.nan if c is None else c.valid for c in in_order],
        "layer": found.layer,
    }


def _failure_map(
    study: Study, epsilon: float, tolerance: float, *, orders: tuple[int, ...] = (0, 1, 2, 3)
) -> Record:
    claims = list(demands_of(study, np.array([epsilon]), np.array([tolerance]), check_orders(orders)))
    return {
        "measure": [claim.measure[0, 0] for claim in claims],
        "holds": [claim.holds[0, 0] for claim in claims],
    }


def _of_methods(study: Study, *, orders: tuple[int, ...] = (0, 1, 2, 3), **_: object):
    names = (*(reduced_name(n) for n in check_orders(orders)), EXPLICIT)
    return {"measure": {"method": names}, "holds": {"method": names}}


def _canard_value(
    study: Study, epsilon: float, tolerance: float, *, parameter: str, order: int = 4, digits: int = 10
) -> Record:
    found = canard_value(study.system, parameter=parameter, order=order)
    return {
        "value": found.value(epsilon, digits=digits),
        "coefficients": found.coefficients,
        "is_exact": found.is_exact,
    }


def _of_coefficients(study: Study, *, order: int = 4, **_: object):
    return {"coefficients": {"power": tuple(range(order + 1))}}


def _periodic_orbit(
    study: Study, epsilon: float, tolerance: float, *, period: float | None = None, backward: bool = False
) -> Record:
    scene = study.scene
    system, start = (study.system, study.start) if scene.has_small else (scene.system, scene.start)
    orbit = periodic_orbit(system, start=start, epsilon=epsilon, period=period, backward=backward)
    return {
        "ending": orbit.status,
        "period": orbit.period,
        "period_error": orbit.period_error,
        "largest_multiplier": max(map(abs, orbit.multipliers[1:]), default=math.nan),
        "divergence": orbit.divergence,
    }


_ENDINGS = {"ending": tuple(status.name for status in Status)}

VERBS: Mapping[str, Verb] = {
    "integrate": Verb(_integrate, _of_states, _ENDINGS),
    "classify": Verb(_classify, codes={"kind": tuple(Kind)}),
    "certify": Verb(_certify, codes={"verdict": tuple(ProofVerdict)}),
    "compare": Verb(_compare, _by_order("error")),
    "choose": Verb(_choose, _by_order("predicted", "holds_until", "serves")),
    "failure_map": Verb(_failure_map, _of_methods),
    "canard_value": Verb(_canard_value, _of_coefficients),
    "periodic_orbit": Verb(_periodic_orbit, codes=_ENDINGS),
}
