"""Times at which a run is looked at: as many evenly spaced as there are by equal parts of the way of its states."""

from __future__ import annotations

import numpy as np

from gsp.integration.trajectory import Trajectory


def spread_times(run: Trajectory, first: float, last: float, count: int) -> np.ndarray:
    """`count` times from `first` to `last`, ascending, and as many of the run between at which its states have gone
    equal parts of their way, in units of their largest sizes: what passes early in a long span lies there.
    """
    forward = slice(None, None, 1 if run.t[-1] >= run.t[0] else -1)
    t, y = run.t[forward], run.y[:, forward]
    sizes = np.abs(y).max(axis=1, keepdims=True)
    gone = np.abs(np.diff(y / np.where(sizes > 0.0, sizes, 1.0), axis=1)).sum(axis=0)
    way = np.append(0.0, np.cumsum(gone))
    begin, end = np.interp([first, last], t, way)
    times = np.interp(np.linspace(begin, end, count), way, t)
    return np.union1d(np.linspace(first, last, count), times[(times > first) & (times < last)])


def within_steps(times: np.ndarray) -> np.ndarray:
    """`times` (m,) and places between them: a quantity is greatest within a step, not at its end."""
    # Parts into which a step is cut where a run's range is looked for.
    finer = np.linspace(0.0, len(times) - 1.0, 8 * (len(times) - 1) + 1)
    return np.interp(finer, np.arange(len(times)), times)
