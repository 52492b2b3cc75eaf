"""Charts, tables and equations of the nouns of this package."""

from __future__ import annotations

import numpy as np
import sympy as sp

from gsp.critical.continuation.critical_curve import CriticalCurve
from gsp.critical.continuation.critical_sheet import CriticalSheet
from gsp.critical.continuation.fold_curve import FoldCurve
from gsp.critical.critical_manifold import Branch, CriticalManifold
from gsp.results.equations import Equation
from gsp.results.registry import Makers, charts, equations, tables
from gsp.results.table import Column, Names, Table, complexes, texts


@tables.of(CriticalCurve, FoldCurve)
def _table_of_curve(found: CriticalCurve | FoldCurve) -> Table:
    """A row for each point: its columns, stability, and the kind of a special one."""
    names = Names(found.names)
    point, which = names("point"), names("eigenvalue")
    over = (point,)
    kinds = {special.row: str(special.kind) for special in found.special}
    own = (
        {"unstable": found.unstable}
        if isinstance(found, CriticalCurve)
        else {"coefficient": found.coefficient, "skew": found.skew}
    )
    variables = {name: Column(over, found[name]) for name in found.names}
    variables |= {names(name): Column(over, values) for name, values in own.items()}
    variables[names("special")] = Column(over, texts(kinds.get(row, "") for row in range(len(found))))
    variables |= complexes(which, (point, which), found.eigenvalues)
    coordinates = {
        point: Column(over, np.arange(len(found))),
        names("arclength"): Column(over, found.arclength),
    }
    attributes = {"status": found.status.name, "message": found.message, "free": ", ".join(found.free)}
    return Table(type(found).__name__, coordinates, variables, attributes, over)


@tables.of(CriticalSheet)
def _table_of_sheet(found: CriticalSheet) -> Table:
    """A row for each vertex; the triangles are rows of the vertices."""
    names = Names(found.names)
    point, which, triangle, corner = map(names, ("point", "eigenvalue", "triangle", "corner"))
    over = (point,)
    variables = {name: Column(over, found[name]) for name in found.names}
    variables[names("unstable")] = Column(over, found.unstable)
    variables[names("on_fold")] = Column(over, found.on_fold)
    variables[names("on_crossing")] = Column(over, found.on_crossing)
    variables |= complexes(which, (point, which), found.eigenvalues)
    variables[names("triangles")] = Column((triangle, corner), found.triangles)
    variables[names("triangle_unstable")] = Column((triangle,), found.triangle_unstable)
    coordinates = {point: Column(over, np.arange(len(found.points)))}
    attributes = {"status": found.status.name, "message": found.message, "residual": found.residual}
    return Table("CriticalSheet", coordinates, variables, attributes, over)


@equations.of(CriticalManifold)
def _equations_of_critical_manifold(value: CriticalManifold) -> list[Equation]:
    return [equation for branch in value.branches for equation in _branch(branch)]


@equations.of(Branch)
def _branch(value: Branch) -> list[Equation]:
    if value.graph is not None:
        return [Equation(symbol, (e,)) for symbol, e in value.graph.items()]
    return [Equation(e, (sp.Integer(0),)) for e in value.equations]


@charts.late
def _charts() -> Makers:
    from gsp import charts as drawn

    return {CriticalCurve: drawn.critical_curve, CriticalSheet: drawn.critical_sheet}
