"""Runs and closed orbits as tables."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsp.choice.simulation import Simulation
from gsp.fibres.composite_solution import CompositeSolution
from gsp.integration.ensemble import Ensemble
from gsp.integration.trajectory import Trajectory
from gsp.orbits.canard_orbits.folded_canards import CanardOrbits
from gsp.orbits.periodic.family import OrbitFamily
from gsp.orbits.periodic.orbit import PeriodicOrbit
from gsp.systems.flow import Flow
from gsp.tables.table import Column, Names, Table, complexes, names_of, numbers, texts


def trajectory(run: Trajectory) -> Table:
    """States and observables over t; with events the crossings, in the order of the events."""
    names, constants = names_of(run.flow), _constants(run.flow, run.epsilon)
    time = names("t")
    variables = {name: Column((time,), run[name]) for name in _quantities(run.flow)}
    coordinates = {time: Column((time,), run.t), **_scalars(constants)}
    if run.events:
        along = names("crossing")
        met = list(run.events.items())
        told = texts(name for name, found in met for _ in found.times)
        coordinates[names("event")] = Column((along,), told)
        variables[names("event_t")] = Column((along,), np.concatenate([found.times for _, found in met]))
        for i, symbol in enumerate(run.flow.states):
            values = np.concatenate([found.states[i] for _, found in met])
            variables[names(f"event_{symbol.name}")] = Column((along,), values)
    told = {"status": run.status.name, "message": run.message, "method": run.stats.method.value, **_work(run)}
    return Table("Trajectory", coordinates, variables, told, (time,))


def ensemble(runs: Ensemble) -> Table:
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
    variables = {name: Column((member, time), runs[name]) for name in _quantities(runs.flow)}
    variables[names("status")] = Column(over, texts(status.name for status in runs.statuses))
    variables[names("reached")] = Column(over, runs.reached)
    variables[names("steps")] = Column(over, runs.steps)
    told = {"message": runs.message, "method": runs.method.value}
    return Table("Ensemble", coordinates, variables, told, (member, time))


def simulation(run: Simulation) -> Table:
    """States over t, and which model was run there."""
    flow = run.pieces[0].run.flow
    names = Names(
        [*run.names, *(s.name for s in flow.observables), *(s.name for s in flow.parameters), str(flow.epsilon)]
    )
    time = names("t")
    quantities = dict.fromkeys([*run.names, *(s.name for s in flow.observables)])
    variables = {name: Column((time,), run[name]) for name in quantities}
    variables[names("model")] = Column((time,), texts(run.model_at(run.t)))
    coordinates = {time: Column((time,), run.t), **_scalars(_constants(flow, run.choice.epsilon))}
    told = {
        "status": run.status.name, "message": run.message, "layer": run.layer, "steps": run.steps,
        "field_calls": run.field_calls, "reduced_share": run.reduced_share,
    }  # fmt: skip
    return Table("Simulation", coordinates, variables, told, (time,))


def composite_solution(found: CompositeSolution) -> Table:
    """States, what is reconstructed and observables over t."""
    system = found.inner.branch.system
    quantities = dict.fromkeys([*found.names, *(s.name for s in system.observables)])
    names = Names([*quantities, *(s.name for s in system.parameters), system.epsilon.name])
    time = names("t")
    variables = {name: Column((time,), found[name]) for name in quantities}
    coordinates = {time: Column((time,), found.t), **_scalars(_constants(system, found.epsilon))}
    told = {"status": found.status.name, "order": found.order, "layer_time": found.layer_time}
    return Table("CompositeSolution", coordinates, variables, told, (time,))


def canard_orbits(found: CanardOrbits) -> Table:
    """A row for each canard: which one it is, where it crosses the section, and how well it is known."""
    names = names_of(found.system)
    canard = names("canard")
    over = (canard,)
    canards = found.canards
    variables = {
        s.name: Column(over, np.array([c.point[s.name] for c in canards])) for s in found.system.states
    }
    variables[names("kind")] = Column(over, texts(c.kind for c in canards))
    for label in ("half_turns", "time_before", "time_after", "crossing_gap", "residual", "error"):
        variables[names(label)] = Column(over, numbers(getattr(c, label) for c in canards))
    coordinates = {canard: Column(over, texts(c.name for c in canards))}
    coordinates |= _scalars(_constants(found.system, found.epsilon))
    section, value = found.section
    told = {
        "status": found.status.name, "message": found.message, "section": section, "section_value": value,
        "expected": found.expected, "unresolved": found.unresolved,
    }  # fmt: skip
    return Table("CanardOrbits", coordinates, variables, told, over)


def periodic_orbit(orbit: PeriodicOrbit) -> Table:
    """States and observables over the phase, and the multipliers."""
    names = names_of(orbit.flow)
    phase, which = names("phase"), names("multiplier")
    phases = orbit.phases
    coordinates = {
        phase: Column((phase,), phases),
        names("t"): Column((phase,), orbit.period * phases),
        **_scalars(orbit.constants),
    }
    variables = {name: Column((phase,), orbit[name]) for name in _quantities(orbit.flow)}
    variables |= complexes(which, (which,), orbit.multipliers)
    told = {
        "status": orbit.status.name, "period": orbit.period, "divergence": orbit.divergence, "error": orbit.error,
        "period_error": orbit.period_error, "residual": orbit.residual,
    }  # fmt: skip
    return Table("PeriodicOrbit", coordinates, variables, told, (phase,))


def orbit_family(family: OrbitFamily) -> Table:
    """A row for each orbit: the parameter, period, extent and multipliers."""
    names = names_of(family.flow)
    orbit, which = names("orbit"), names("multiplier")
    over = (orbit,)
    constants = family.orbits[0].constants
    coordinates = {
        orbit: Column(over, np.arange(len(family))),
        family.parameter: Column(over, family[family.parameter]),
    }
    coordinates |= _scalars({name: value for name, value in constants.items() if name != family.parameter})
    variables = {names("period"): Column(over, family.period), names("unstable"): Column(over, family.unstable)}
    variables[names("arclength")] = Column(over, family.arclength)
    for symbol in family.flow.states:
        variables[names(f"minimum_{symbol.name}")] = Column(over, family.minimum(symbol.name))
        variables[names(f"maximum_{symbol.name}")] = Column(over, family.maximum(symbol.name))
    kinds = {special.row: str(special.kind) for special in family.special}
    variables[names("special")] = Column(over, texts(kinds.get(row, "") for row in range(len(family))))
    variables |= complexes(which, (orbit, which), np.array([o.multipliers for o in family.orbits]))
    told = {"status": family.status.name, "message": family.message, "parameter": family.parameter}
    return Table("OrbitFamily", coordinates, variables, told, (orbit,))


def _quantities(flow: Flow) -> list[str]:
    return [symbol.name for symbol in (*flow.states, *flow.observables)]


def _constants(flow: Flow, epsilon: float | None) -> dict[str, float]:
    given = {} if flow.epsilon is None or epsilon is None else {str(flow.epsilon): float(epsilon)}
    return given | {symbol.name: float(value) for symbol, value in flow.parameters.items()}


def _scalars(constants: Mapping[str, float]) -> dict[str, Column]:
    return {name: Column((), np.array(value)) for name, value in constants.items()}


def _work(run: Trajectory) -> dict[str, int]:
    stats = run.stats
    return {"steps": stats.steps, "rejected": stats.rejected, "field_calls": stats.field_calls}
