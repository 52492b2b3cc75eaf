"""The work-precision diagram: error against seconds, full systems and reduced models on the same axes."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from gsp.charts.style import BLUE, GREY, INK, LADDER, MARKERS, PALE, SKY, chart
from gsp.comparison.work_precision import WorkPrecision
from gsp.comparison.work_runs import WorkCurve, WorkKind

# Errors beyond this say that a run is useless; errors below what doubles resolve are drawn there.
LARGEST, SMALLEST = 10.0, 1e-15


@chart(height=5.0)
def work_precision(result: WorkPrecision, axes: Axes) -> None:
    """Error against time per run, both falling towards the origin; a model is better the nearer it comes to it.

    Our own methods in blue, peers in grey, reduced models in orange, darker with the order, each with the floor that
    its own error sets.
    """
    peers = [c for c in result.curves if c.kind is WorkKind.PEER and c.points]
    full = [c for c in result.curves if c.kind is WorkKind.FULL and c.points]
    reduced = [c for c in result.curves if c.kind is WorkKind.REDUCED and c.points]
    for i, curve in enumerate(peers):
        # Each lap of the markers begins with another dash, so that no two peers look alike.
        dash = ("--", ":", "-.")[(i + i // len(MARKERS)) % 3]
        _draw(axes, curve, GREY, MARKERS[i % len(MARKERS)], dash, filled=False)
    for i, curve in enumerate(full):
        chosen = curve.label == "default"
        line = "-" if chosen or i < len(MARKERS) else "--"
        colour, width = (BLUE, 2.2) if chosen else (SKY, 1.0)
        _draw(axes, curve, colour, MARKERS[i % len(MARKERS)], line, width=width)
    for i, curve in enumerate(reduced):
        colour = LADDER[min(i, len(LADDER) - 1)]
        _draw(axes, curve, colour, MARKERS[i % len(MARKERS)], "-")
        if SMALLEST < curve.floor < LARGEST:
            axes.axvline(curve.floor, color=colour, lw=5, alpha=0.13, zorder=0)
    axes.set_xscale("log")
    axes.set_yscale("log")
    seen = [p for c in result.curves for p in c.points if p.error < LARGEST]
    if seen:
        times = [p.seconds for p in seen]
        axes.set_ylim(min(times) / 1.6, max(times) * 1.8)
        least = max(min(p.error for p in seen), SMALLEST)
        axes.set_xlim(min(max(p.error for p in seen) * 2.0, LARGEST), least / 2.0)
    axes.axvspan(max(result.reference_error, SMALLEST), SMALLEST / 10, color=PALE, alpha=0.5, lw=0, zorder=0)
    axes.xaxis.set_minor_locator(LogLocator(subs=()))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("largest relative error of the slow variables")
    axes.set_ylabel("seconds per run")
    axes.text(
        0.99, 0.02, rf"$\epsilon = {result.epsilon:.3g}$", transform=axes.transAxes, ha="right", color=INK
    )
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(
        handles, labels, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, columnspacing=1.2,
        handletextpad=0.5, labelspacing=0.35,
    )  # fmt: skip


def _draw(
    axes: Axes,
    curve: WorkCurve,
    colour: str,
    marker: str,
    line: str,
    *,
    width: float = 1.2,
    filled: bool = True,
) -> None:
    errors = np.clip([p.error for p in curve.points], SMALLEST, None)
    seconds = np.array([p.seconds for p in curve.points])
    shown = errors < LARGEST
    axes.plot(
        errors[shown], seconds[shown], color=colour, marker=marker, ls=line, lw=width, ms=4,
        mfc=colour if filled else "white", label=_name(curve), zorder=3 if filled else 2,
    )  # fmt: skip


def _name(curve: WorkCurve) -> str:
    names = {
        "radau9": "Radau 9",
        "radau13": "Radau 13",
        "dop853": "DOP853",
    }
    return names.get(curve.label, curve.label)
