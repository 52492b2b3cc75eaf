"""Charts and equations of the nouns of this package."""

from __future__ import annotations

from gsp.nested.nesting import Nesting
from gsp.results.equations import Equation, all_equations_of
from gsp.results.registry import Makers, charts, equations


@equations.of(Nesting)
def _equations_of_nesting(value: Nesting) -> list[Equation]:
    """Both critical manifolds, then the series in sigma."""
    graphs = [branch.graph or {} for branch in (value.first.branch, value.second.branch)]
    return [*(Equation(s, (e,)) for graph in graphs for s, e in graph.items()), *all_equations_of(value.series)]


@charts.late
def _charts() -> Makers:
    from gsp import charts as drawn

    return {Nesting: drawn.nesting}
