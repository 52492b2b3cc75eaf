"""Charts and tables of the nouns of this package."""

from __future__ import annotations

from gsp.results.registry import Makers, charts, tables
from gsp.results.table import Column, Table, complexes, constants_of, names_of, scalars, texts
from gsp.scales.time_scales import TimeScales


@tables.of(TimeScales)
def _table_of_time_scales(scales: TimeScales) -> Table:
    """Rates, groups and pointers over t and mode, fastest first; states, exhausted modes and the gap over t."""
    names, flow = names_of(scales.flow), scales.flow
    time, mode, state = names("t"), names("mode"), names("state")
    over = (time, mode)
    coordinates = {
        time: Column((time,), scales.t),
        state: Column((state,), texts(s.name for s in flow.states)),
        **scalars(constants_of(flow, scales.run.epsilon)),
    }
    variables = {s.name: Column((time,), scales.states[:, i]) for i, s in enumerate(flow.states)}
    variables |= {
        names("exhausted"): Column((time,), scales.exhausted),
        names("separated"): Column((time,), scales.separated),
        names("gap"): Column((time,), scales.gap),
        names("group"): Column(over, scales.groups),
        names("time_scale"): Column(over, scales.times),
        names("pointer"): Column((time, mode, state), scales.pointers),
    }
    variables |= complexes(names("rate"), over, scales.rates)
    attributes = {"status": scales.status.name, "message": scales.message}
    return Table("TimeScales", coordinates, variables, attributes, over)


@charts.late
def _charts() -> Makers:
    from gsp import charts as drawn

    return {TimeScales: drawn.time_scales}
