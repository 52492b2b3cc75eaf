"""Tables of the nouns of this package."""

from __future__ import annotations

from gsp.fibres.composite_solution import CompositeSolution
from gsp.results.registry import tables
from gsp.results.table import Column, Names, Table, constants_of, scalars


@tables.of(CompositeSolution)
def _table_of_composite_solution(found: CompositeSolution) -> Table:
    """States, what is reconstructed and observables over t."""
    system = found.inner.branch.system
    quantities = dict.fromkeys([*found.names, *(s.name for s in system.observables)])
    names = Names([*quantities, *(s.name for s in system.parameters), system.epsilon.name])
    time = names("t")
    variables = {name: Column((time,), found[name]) for name in quantities}
    coordinates = {time: Column((time,), found.t), **scalars(constants_of(system, found.epsilon))}
    attributes = {"status": found.status.name, "order": found.order, "layer_time": found.layer_time}
    return Table("CompositeSolution", coordinates, variables, attributes, (time,))
