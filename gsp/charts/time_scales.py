"""Chart of the time scales of a flow along a run."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from gsp.charts.style import BLUE, INK, PALE, chart, legend
from gsp.scales.time_scales import TimeScales


@chart()
def time_scales(scales: TimeScales, axes: Axes) -> None:
    """Time scales over time, with the gap shaded between the exhausted ones and the next.

    Both logarithmic; time from the first step on. Exhausted modes are drawn in blue.
    """
    t, tau = np.abs(scales.t - scales.t[0]), scales.times
    # A logarithmic axis has no 0.
    shown = t > 0.0
    rows = np.flatnonzero(shown)
    finite = np.where(np.isfinite(tau), tau, np.nan)
    moving = np.flatnonzero(np.isfinite(finite).any(axis=0))
    for k, r in enumerate(moving):
        label = "time scales" if k == 0 else None
        axes.plot(t[shown], finite[shown, r], color=INK, lw=0.9, label=label, zorder=2)
        gone = np.where(r < scales.exhausted, finite[:, r], np.nan)
        axes.plot(t[shown], gone[shown], color=BLUE, lw=2.0, zorder=3)
    if (scales.exhausted[shown] > 0).any():
        axes.plot([], [], color=BLUE, lw=2.0, label="exhausted")
        m = scales.exhausted
        low = np.array([tau[i, m[i] - 1] if m[i] else np.nan for i in rows])
        high = np.array([tau[i, m[i]] if m[i] else np.nan for i in rows])
        axes.fill_between(t[shown], low, high, color=PALE, lw=0, label="gap", zorder=1)
    axes.set_xscale("log")
    axes.set_yscale("log")
    # How slow a mode is that stands still is rounding.
    bottom, top = axes.get_ylim()
    # A mode that is so many times as slow as the run is long stands still.
    if bottom < (still := 1000.0 * float(t.max())) < top:
        axes.set_ylim(bottom, still)
    axes.set_xlabel("time since the start")
    axes.set_ylabel(r"$1/|\lambda|$")
    legend(axes)
