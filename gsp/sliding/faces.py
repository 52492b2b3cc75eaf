"""Tables and equations of the nouns of this package."""

from __future__ import annotations

import numpy as np

from gsp.results.equations import Equation
from gsp.results.registry import Makers, charts, equations, tables
from gsp.results.table import Column, Table, texts
from gsp.sliding.no_slip import NoSlip
from gsp.sliding.piecewise_field import PiecewiseField
from gsp.sliding.piecewise_run import PiecewiseRun


@tables.of(PiecewiseRun)
def _table_of_piecewise_run(run: PiecewiseRun) -> Table:
    """A row for each point; for each piece its side, when it begins and ends, and the loss that ended sliding."""
    over, each = ("point",), ("piece",)
    names = [s.name for s in run.field.states]
    lengths = [piece.run.t.size for piece in run.pieces]
    coordinates = {
        "point": Column(over, np.arange(sum(lengths))),
        "number": Column(over, np.repeat(np.arange(len(lengths)), lengths)),
        "t": Column(over, run.t),
        "piece": Column(each, np.arange(len(lengths))),
    }
    variables = {name: Column(over, run[name]) for name in names}
    variables["side"] = Column(each, texts(" ".join(side.name for side in piece.sides) for piece in run.pieces))
    variables["begins"] = Column(each, np.array([piece.run.t[0] for piece in run.pieces]))
    variables["ends"] = Column(each, np.array([piece.run.t[-1] for piece in run.pieces]))
    variables["loss"] = Column(
        each, texts("" if piece.loss is None else piece.loss.name for piece in run.pieces)
    )
    return Table("PiecewiseRun", coordinates, variables, {"message": run.message, "law": repr(run.law)}, over)


@tables.of(NoSlip)
def _table_of_no_slip(found: NoSlip) -> Table:
    """A row for each time and contact: the share of what it bears that is asked of it."""
    over = ("contact", "time")
    coordinates = {
        "contact": Column(over[:1], texts(found.names)),
        "time": Column(over[1:], found.t),
    }
    attributes = {"message": str(found), "holds": found.holds, "law": repr(found.law)}
    return Table("NoSlip", coordinates, {"share": Column(over, found.shares)}, attributes, over)


@charts.late
def _charts() -> Makers:
    from gsp import charts as drawn

    return {NoSlip: drawn.no_slip}


@equations.of(PiecewiseField)
def _equations_of_piecewise_field(field: PiecewiseField) -> list[Equation]:
    return [Equation(state, (rate,)) for state, rate in field.sliding.equations.items()]
