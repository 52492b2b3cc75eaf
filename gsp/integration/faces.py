"""Charts, tables and equations of the nouns of this package, and what a sweep records of its verbs."""

from __future__ import annotations

import numpy as np

from gsp.errors import Status
from gsp.integration.ensemble import Ensemble
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.results.equations import Equation, rates_of
from gsp.results.point_verbs import Labels, Record, records
from gsp.results.registry import Makers, charts, equations, tables
from gsp.results.table import Column, Table, constants_of, names_of, quantities_of, scalars, texts
from gsp.scenes.study import Study
from gsp.systems.tolerances import absolute_tolerance


@tables.of(Trajectory)
def _table_of_trajectory(run: Trajectory) -> Table:
    """States and observables over t; with events the crossings, in the order of the events."""
    names, constants = names_of(run.flow), constants_of(run.flow, run.epsilon)
    time = names("t")
    variables = {name: Column((time,), run[name]) for name in quantities_of(run.flow)}
    coordinates = {time: Column((time,), run.t), **scalars(constants)}
    if run.events:
        along = names("crossing")
        met = list(run.events.items())
        event_names = texts(name for name, found in met for _ in found.times)
        coordinates[names("event")] = Column((along,), event_names)
        variables[names("event_t")] = Column((along,), np.concatenate([found.times for _, found in met]))
        for i, symbol in enumerate(run.flow.states):
            values = np.concatenate([found.states[i] for _, found in met])
            variables[names(f"event_{symbol.name}")] = Column((along,), values)
    attributes = {
        "status": run.status.name,
        "message": run.message,
        "method": run.stats.method.value,
        **_work(run),
    }
    return Table("Trajectory", coordinates, variables, attributes, (time,))


@tables.of(Ensemble)
def _table_of_ensemble(runs: Ensemble) -> Table:
    """States and observables over member and t, with what each member was given and how it ended."""
    names = names_of(runs.flow)
    member, time = names("member"), names("t")
    over = (member,)
    coordinates = {member: Column(over, np.arange(len(runs))), time: Column((time,), runs.t)}
    if runs.epsilon is not None:
        coordinates[str(runs.flow.epsilon)] = Column(over, runs.epsilon)
    coordinates |= {name: Column(over, values) for name, values in runs.parameters.items()}
    for i, symbol in enumerate(runs.flow.states):
        coordinates[names(f"start_{symbol.name}")] = Column(over, runs.starts[:, i])
    variables = {name: Column((member, time), runs[name]) for name in quantities_of(runs.flow)}
    variables[names("status")] = Column(over, texts(status.name for status in runs.statuses))
    variables[names("reached")] = Column(over, runs.reached)
    variables[names("steps")] = Column(over, runs.steps)
    attributes = {"message": runs.message, "method": runs.method.value}
    return Table("Ensemble", coordinates, variables, attributes, (member, time))


def _work(run: Trajectory) -> dict[str, int]:
    stats = run.stats
    return {"steps": stats.steps, "rejected": stats.rejected, "field_calls": stats.field_calls}


@equations.of(ReducedFlow)
def _equations_of_reduced_flow(value: ReducedFlow) -> list[Equation]:
    return rates_of(zip(value.states, value.rates))


def _final_states(study: Study, **_: object) -> Labels:
    return {"final": {"state": tuple(s.name for s in study.scene.full_flow.states)}}


@records(
    "integrate",
    labels=_final_states,
    codes={"ending": tuple(status.name for status in Status)},
    needs_small=False,
)
def _record_of_integrate(
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
        options=RunOptions(method=method, max_steps=max_steps, dense=False),
    )
    return {
        "ending": run.status,
        "steps": run.stats.steps,
        "field_calls": run.stats.field_calls,
        "end": run.t[-1],
        "final": run.y[:, -1],
    }


@charts.late
def _charts() -> Makers:
    from gsp import charts as drawn

    return {
        Ensemble: lambda runs, axes: drawn.spread(runs, axes, name=runs.flow.states[0].name),
        Trajectory: drawn.trajectory,
    }
