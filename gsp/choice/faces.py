"""Charts and tables of the nouns of this package, and what a sweep records of its verbs."""

from __future__ import annotations

import math

import numpy as np

from gsp.choice.candidates import ModelKind
from gsp.choice.choice import Choice, choose
from gsp.choice.simulation import Simulation
from gsp.results.point_verbs import Labels, Record, records
from gsp.results.registry import Makers, charts, tables
from gsp.results.table import Column, Names, Table, constants_of, numbers, scalars, texts
from gsp.scenes.study import Study
from gsp.systems.flow import check_orders


@tables.of(Choice)
def _table_of_choice(found: Choice) -> Table:
    """A row for each candidate; what was decided is in the attributes."""
    over = ("model",)
    candidates = found.candidates
    variables = {
        name: Column(over, numbers(getattr(c, name) for c in candidates))
        for name in ("order", "predicted", "holds_until", "seconds", "preparation", "steps", "field_calls")
    }
    variables["kind"] = Column(over, texts(c.kind for c in candidates))
    variables["chosen"] = Column(over, np.array([c is found.model for c in candidates]))
    variables["valid"] = Column(over, np.array([c.valid for c in candidates]))
    variables["why_not"] = Column(over, texts(c.why_not for c in candidates))
    coordinates = {
        "model": Column(over, texts(c.label for c in candidates)),
        "epsilon": Column((), np.array(found.epsilon)),
        "tolerance": Column((), np.array(found.tolerance)),
    }
    attributes = {
        "scene": found.scene.name, "answer": str(found.verdict.answer), "reason": found.reason,
        "quantities": ", ".join(found.names), "layer": found.layer, "piece_begins": found.piece[0],
        "piece_ends": found.piece[1], "predicted_on_piece": found.predicted_on_piece, "measured": found.measured,
        "speed_up": found.speed_up, "ending": found.ending, "accuracy": found.verdict.accuracy,
        "speed": found.verdict.speed, "remedy": found.verdict.remedy, "predicted": found.predicted,
        "partial": None if found.partial is None else found.partial.label, "fast_error": found.fast_error,
        "layer_error": found.layer_error,
    }  # fmt: skip
    return Table("Choice", coordinates, variables, attributes, over)


@tables.of(Simulation)
def _table_of_simulation(run: Simulation) -> Table:
    """States over t, and which model was run there."""
    flow = run.pieces[0].run.flow
    names = Names(
        [*run.names, *(s.name for s in flow.observables), *(s.name for s in flow.parameters), str(flow.epsilon)]
    )
    time = names("t")
    quantities = dict.fromkeys([*run.names, *(s.name for s in flow.observables)])
    variables = {name: Column((time,), run[name]) for name in quantities}
    variables[names("model")] = Column((time,), texts(run.model_at(run.t)))
    coordinates = {time: Column((time,), run.t), **scalars(constants_of(flow, run.choice.epsilon))}
    attributes = {
        "status": run.status.name, "message": run.message, "layer": run.layer, "steps": run.steps,
        "field_calls": run.field_calls, "reduced_share": run.reduced_share,
    }  # fmt: skip
    return Table("Simulation", coordinates, variables, attributes, (time,))


def _each_order(study: Study, *, orders: tuple[int, ...] = (0, 1, 2, 3), **_: object) -> Labels:
    return {name: {"order": check_orders(orders)} for name in ("predicted", "holds_until", "serves")}


@records("choose", labels=_each_order)
def _record_of_choose(
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


@charts.late
def _charts() -> Makers:
    from gsp import charts as drawn

    return {Simulation: drawn.switches}
