"""Times at which a run is looked at: as many evenly spaced as there are by equal parts of the way of its states."""

from __future__ import annotations

import numpy as np

from gsp.integration.trajectory import Trajectory


def spread_times(run: Trajectory, first: float, last: float, count: int) -> np.ndarray:
    """`count` times from `first` to `last`, ascending, and as many of the run between at which its states have gone
    equal parts of their way, in units of their largest sizes: what passes early in a long span lies there.
    """
    sizes = np.abs(run.y).max(axis=1, keepdims=True)
    gone = np.abs(np.diff(run.y / np.where(sizes > 0.0, sizes, 1.0), axis=1)).sum(axis=0)
    way, t = np.append(0.0, np.cumsum(gone)), run.t
    if t[-1] < t[0]:
        way, t = way[::-1], t[::-1]
    begin, end = np.interp([first, last], t, way)
    order = np.argsort(way, kind="stable")
    times = np.interp(np.linspace(begin, end, count), way[order], t[order])
    return np.union1d(np.linspace(first, last, count), times[(times > first) & (times < last)])
