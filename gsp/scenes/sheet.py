"""The sheet of the critical manifold to which a scene is reduced."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.critical_manifold import CriticalManifold
from gsp.critical.sheet_points import place
from gsp.critical.sheet_roots import fast_bounds, within
from gsp.fibres.layer_end import end_of_layer
from gsp.fibres.layer_flow import LayerFlow
from gsp.systems.flow import in_words
from gsp.systems.region import Interval, shown_region


def sheet_of(
    critical: CriticalManifold, start: Mapping[str, float], region: Mapping[str, Interval], *, off: float
) -> Branch:
    """The sheet nearest to the start, within the region's bounds on fast variables.

    Where the start is further from it than a share `off` of its size, and its layer settles on another sheet within
    these bounds, it is that one. Nearer than epsilon a start is on the slow manifold to leading order, and a sheet that
    repels is meant.
    """
    system = critical.system
    nearest = critical.nearest(start, region=region)
    if nearest.is_explicit and len(critical.branches) == 1:
        return nearest
    x, y = place(system, start)
    point = nearest.points(x[None, :])[0]
    layer = LayerFlow.within(system, x, y, point)
    if np.abs((y - point) / layer.units).max() <= off:
        return nearest
    end = end_of_layer(layer, y)
    if end is None:
        return nearest
    near, settled = within(np.stack([point, end]), system.y, fast_bounds(system, region))
    if near and not settled:
        return nearest
    return critical.nearest({**start, **dict(zip((s.name for s in system.y), map(float, end)))}, region=region)


def explain_sheet(
    critical: CriticalManifold, branch: Branch, start: Mapping[str, float], region: Mapping[str, Interval]
) -> list[str]:
    """Sentences that say which of several branches the start has led to, and that it is outside the region there."""
    said = []
    if len(critical.branches) > 1:
        said.append(
            f"of {len(critical.branches)} branches this is about {branch}, to which the run from the start belongs"
        )
    system = branch.system
    x, _ = place(system, start)
    bounds = fast_bounds(system, region)
    point = branch.points(x[None, :])
    if not within(point, system.y, bounds)[0]:
        said.append(
            f"the start is over no sheet in the region: over {system.place(zip(system.x, x))} the one to which its run "
            f"belongs is at {in_words(zip(system.y, point[0]))}, outside {shown_region(bounds)}"
        )
    return said
