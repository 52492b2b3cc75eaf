"""What contacts are asked for, beside what they bear."""

from __future__ import annotations

from matplotlib.axes import Axes

from gsp.charts.style import INK, SERIES, VERMILION, chart, legend
from gsp.sliding.no_slip import NoSlip


@chart()
def no_slip(result: NoSlip, axes: Axes) -> None:
    """The share of what each contact bears that no-slip asks of it, over time; at 1 it lets go."""
    for k, (name, shares) in enumerate(zip(result.names, result.shares)):
        axes.plot(result.t, shares, color=SERIES[k % len(SERIES)], label=f"contact of {name}")
    axes.axhline(1.0, color=INK, lw=0.8, ls="--", label="all that it bears")
    if result.contact is not None:
        axes.plot(
            result.t[-1:],
            result.shares[result.contact, -1:],
            "o",
            color=VERMILION,
            label="it lets go",
            zorder=3,
        )
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("slow time $t$")
    axes.set_ylabel("share of the friction cone", rotation=90, labelpad=4.0)
    legend(axes)
