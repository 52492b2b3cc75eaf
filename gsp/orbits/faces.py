"""Charts and tables of the nouns of this package, and what a sweep records of its verbs."""

from __future__ import annotations

import math

import numpy as np

from gsp.errors import Status
from gsp.orbits.canard_orbits.folded_canards import CanardOrbits
from gsp.orbits.periodic.family import OrbitFamily
from gsp.orbits.periodic.finding import periodic_orbit
from gsp.orbits.periodic.orbit import PeriodicOrbit
from gsp.results.point_verbs import Record, records
from gsp.results.registry import Makers, charts, tables
from gsp.results.table import (
    Column,
    Table,
    complexes,
    constants_of,
    names_of,
    numbers,
    quantities_of,
    scalars,
    texts,
)
from gsp.scenes.study import Study


@tables.of(CanardOrbits)
def _table_of_canard_orbits(found: CanardOrbits) -> Table:
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
    coordinates |= scalars(constants_of(found.system, found.epsilon))
    section, value = found.section
    attributes = {
        "status": found.status.name, "message": found.message, "section": section, "section_value": value,
        "expected": found.expected, "unresolved": found.unresolved,
    }  # fmt: skip
    return Table("CanardOrbits", coordinates, variables, attributes, over)


@tables.of(PeriodicOrbit)
def _table_of_periodic_orbit(orbit: PeriodicOrbit) -> Table:
    """States and observables over the phase, and the multipliers."""
    names = names_of(orbit.flow)
    phase, which = names("phase"), names("multiplier")
    phases = orbit.phases
    coordinates = {
        phase: Column((phase,), phases),
        names("t"): Column((phase,), orbit.period * phases),
        **scalars(orbit.constants),
    }
    variables = {name: Column((phase,), orbit[name]) for name in quantities_of(orbit.flow)}
    variables |= complexes(which, (which,), orbit.multipliers)
    attributes = {
        "status": orbit.status.name, "period": orbit.period, "divergence": orbit.divergence, "error": orbit.error,
        "period_error": orbit.period_error, "residual": orbit.residual,
    }  # fmt: skip
    return Table("PeriodicOrbit", coordinates, variables, attributes, (phase,))


@tables.of(OrbitFamily)
def _table_of_orbit_family(family: OrbitFamily) -> Table:
    """A row for each orbit: the parameter, period, extent and multipliers."""
    names = names_of(family.flow)
    orbit, which = names("orbit"), names("multiplier")
    over = (orbit,)
    constants = family.orbits[0].constants
    coordinates = {
        orbit: Column(over, np.arange(len(family))),
        family.parameter: Column(over, family[family.parameter]),
    }
    coordinates |= scalars({name: value for name, value in constants.items() if name != family.parameter})
    variables = {names("period"): Column(over, family.period), names("unstable"): Column(over, family.unstable)}
    variables[names("arclength")] = Column(over, family.arclength)
    for symbol in family.flow.states:
        variables[names(f"minimum_{symbol.name}")] = Column(over, family.minimum(symbol.name))
        variables[names(f"maximum_{symbol.name}")] = Column(over, family.maximum(symbol.name))
    kinds = {special.row: str(special.kind) for special in family.special}
    variables[names("special")] = Column(over, texts(kinds.get(row, "") for row in range(len(family))))
    variables |= complexes(which, (orbit, which), np.array([o.multipliers for o in family.orbits]))
    attributes = {"status": family.status.name, "message": family.message, "parameter": family.parameter}
    return Table("OrbitFamily", coordinates, variables, attributes, (orbit,))


@records("periodic_orbit", codes={"ending": tuple(status.name for status in Status)}, needs_small=False)
def _record_of_periodic_orbit(
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


@charts.late
def _charts() -> Makers:
    from gsp import charts as drawn

    return {
        CanardOrbits: drawn.canard_section,
        OrbitFamily: drawn.canard_explosion,
        PeriodicOrbit: drawn.periodic_orbit,
    }
