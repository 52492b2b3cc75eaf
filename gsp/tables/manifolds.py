"""Curves, sheets and points of critical and slow manifolds as tables."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsp.critical.continuation.critical_curve import CriticalCurve
from gsp.critical.continuation.critical_sheet import CriticalSheet
from gsp.critical.continuation.fold_curve import FoldCurve
from gsp.slow.sampled_manifold import SampledManifold
from gsp.slow.slow_points import SlowPoints
from gsp.tables.table import Column, Names, Table, complexes, texts

_Curve = CriticalCurve | FoldCurve


def curve(found: _Curve) -> Table:
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
    told = {"status": found.status.name, "message": found.message, "free": ", ".join(found.free)}
    return Table(type(found).__name__, coordinates, variables, told, over)


def sheet(found: CriticalSheet) -> Table:
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
    told = {"status": found.status.name, "message": found.message, "residual": found.residual}
    return Table("CriticalSheet", coordinates, variables, told, over)


def slow_points(found: SlowPoints) -> Table:
    """A row for each point of the slow manifold."""
    x, y = np.atleast_2d(found.x), np.atleast_2d(found.y)
    own = {"order": np.atleast_1d(found.order), "error": np.atleast_1d(found.error)}
    return _over_slow("point", found, x, y, own, {})


def sampled_manifold(found: SampledManifold) -> Table:
    """A row for each node that was solved for."""
    told = {"kind": str(found.kind), "gap": found.gap, "error_estimate": found.error_estimate}
    return _over_slow("node", found, found.nodes, found.values, {"error": found.node_errors}, told)


def _over_slow(
    row: str,
    found: SlowPoints | SampledManifold,
    x: np.ndarray,
    y: np.ndarray,
    own: Mapping[str, np.ndarray],
    told: Mapping[str, str | float | int | None],
) -> Table:
    """Slow variables (m, slow) and epsilon as coordinates; fast ones (m, fast) and its `own` arrays as variables."""
    system = found.branch.system
    names = Names([s.name for s in (*system.x, *system.y, system.epsilon)])
    over = (names(row),)
    coordinates = {s.name: Column(over, x[:, i]) for i, s in enumerate(system.x)}
    coordinates[system.epsilon.name] = Column((), np.array(found.epsilon))
    variables = {s.name: Column(over, y[:, i]) for i, s in enumerate(system.y)}
    variables |= {names(name): Column(over, values) for name, values in own.items()}
    ending = {"status": found.status.name, "message": found.message, "tolerance": found.tolerance}
    return Table(type(found).__name__, coordinates, variables, {**ending, **told}, over)
