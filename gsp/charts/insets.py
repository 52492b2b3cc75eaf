"""Where a picture within a picture covers least."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from gsp.charts.style import PALE

Place = tuple[float, float, float, float]


def emptiest(axes: Axes, places: Sequence[Place]) -> tuple[Place, int]:
    """Of `places`, (left, bottom, width, height) in shares of the axes, the one where an inset and its labels cover
    least of what is drawn, and how much."""
    drawn = np.concatenate([_even(axes, line) for line in axes.lines if line.get_color() != PALE])

    def covered(place: Place) -> int:
        corner, size = np.reshape(place, (2, 2))
        inside = (drawn > corner - (0.1, 0.08)) & (drawn < corner + size + (0.02, 0.08))
        return int(inside.all(axis=1).sum())

    found = min(places, key=covered)
    return found, covered(found)


def _even(axes: Axes, line: Line2D) -> np.ndarray:
    """Points (m, 2) of a line in shares of the axes, evenly along it: steps of an integrator weigh alike."""
    given = np.column_stack([line.get_xdata(), line.get_ydata()]).astype(float)
    points = axes.transAxes.inverted().transform(line.get_transform().transform(given))
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 2:
        return points
    length = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    even = np.arange(0.0, length[-1], 0.01)
    return np.column_stack([np.interp(even, length, points[:, i]) for i in (0, 1)])
