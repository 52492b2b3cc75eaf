"""The chart of an ensemble: where its members are, over time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from gsp.charts.style import BLUE, INK, chart, legend, mathematics
from gsp.errors import DeclarationError
from gsp.integration.ensemble import Ensemble

# Members drawn one by one, spread evenly over their indices.
DRAWN = 24
# Opaque, so that the legend shows the colours that are seen.
BANDS = ((5, 95, "#DBEAF4"), (25, 75, "#A8CDE5"))


@chart()
def spread(ensemble: Ensemble, axes: Axes, *, name: str) -> None:
    """A state or an observable over time: median, the middle half and nine tenths of the members, and some of them.

    At each time the members count that reached it. Raises `DeclarationError` when fewer than two times were reached.
    """
    values = ensemble[name]
    reached = ~np.isnan(values).all(axis=0)
    t, values = ensemble.t[reached], values[:, reached]
    if t.size < 2:
        raise DeclarationError(
            "a spread over time needs two times or more that a member reached.",
            "Integrate with at=[...].",
            got=t.size,
        )
    for low, high, colour in BANDS:
        bottom, top = np.nanpercentile(values, [low, high], axis=0)
        axes.fill_between(t, bottom, top, color=colour, lw=0, label=f"{low} to {high} %", zorder=1)
    chosen = np.unique(np.linspace(0, len(ensemble) - 1, DRAWN).round().astype(int))
    for k, i in enumerate(chosen):
        label = f"{chosen.size} of {len(ensemble)} members" if k == 0 else None
        axes.plot(t, values[i], color=INK, lw=0.4, alpha=0.55, label=label, zorder=2)
    axes.plot(t, np.nanmedian(values, axis=0), color=BLUE, lw=1.8, label="median", zorder=3)
    axes.set_xlabel("slow time $t$")
    axes.set_ylabel(mathematics(name))
    axes.set_xlim(min(t[0], t[-1]), max(t[0], t[-1]))
    legend(axes, columns=4)
