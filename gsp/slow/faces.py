"""Tables and equations of the nouns of this package."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsp.results.equations import TERMS, Equation
from gsp.results.registry import equations, tables
from gsp.results.table import Column, Names, Table
from gsp.slow.sampled_manifold import SampledManifold
from gsp.slow.series import SeriesManifold
from gsp.slow.slow_points import SlowPoints


@tables.of(SlowPoints)
def _table_of_slow_points(found: SlowPoints) -> Table:
    """A row for each point of the slow manifold."""
    x, y = np.atleast_2d(found.x), np.atleast_2d(found.y)
    own = {"order": np.atleast_1d(found.order), "error": np.atleast_1d(found.error)}
    return _over_slow("point", found, x, y, own, {})


@tables.of(SampledManifold)
def _table_of_sampled_manifold(found: SampledManifold) -> Table:
    """A row for each node that was solved for."""
    attributes = {"kind": str(found.kind), "gap": found.gap, "error_estimate": found.error_estimate}
    return _over_slow("node", found, found.nodes, found.values, {"error": found.node_errors}, attributes)


def _over_slow(
    row: str,
    found: SlowPoints | SampledManifold,
    x: np.ndarray,
    y: np.ndarray,
    own: Mapping[str, np.ndarray],
    attributes: Mapping[str, str | float | int | None],
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
    return Table(type(found).__name__, coordinates, variables, {**ending, **attributes}, over)


@equations.of(SeriesManifold)
def _equations_of_series_manifold(value: SeriesManifold) -> list[Equation]:
    series = value.readable(TERMS)
    system = series.branch.system
    manifold = [Equation(y, tuple(h[y] for h in series.coefficients), epsilon=system.epsilon) for y in system.y]
    flow = [
        Equation(x, tuple(f[x] for f in series.reduced_field), dotted=True, epsilon=system.epsilon)
        for x in system.x
    ]
    return [*manifold, *flow]
