"""The work-precision diagram: error against seconds, full systems and reduced models on the same axes."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from gsp.charts.style import BLUE, GREY, INK, LADDER, MARKERS, PALE, SKY, at_epsilon, chart
from gsp.comparison.work_precision import WorkPrecision
from gsp.comparison.work_runs import WorkCurve, WorkKind

# Errors beyond this say that a run is useless; errors below what doubles resolve are drawn there.
LARGEST, SMALLEST = 10.0, 1e-15
# Two markers this close, in decades, cover one another.
MARK = 0.08


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
        _draw(axes, curve, GREY, MARKERS[i % len(MARKERS)], dash)
    for i, curve in enumerate(full):
        chosen = curve.label == "default"
        line = "-" if chosen or i < len(MARKERS) else "--"
        colour, width = (BLUE, 2.2) if chosen else (SKY, 1.0)
        _draw(axes, curve, colour, MARKERS[i % len(MARKERS)], line, width=width)
    for i, curve in enumerate(reduced):
        colour = LADDER[min(i, len(LADDER) - 1)]
        below = [other for other in reduced[:i] if _touch(other, curve)]
        _draw(
            axes, curve, colour, MARKERS[i % len(MARKERS)], "-", around=len(below), equal=_equals(below, curve)
        )
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
    axes.text(0.01, 0.02, result.saving_told(), transform=axes.transAxes, color=INK, fontsize="small")
    axes.text(
        0.99,
        0.02,
        at_epsilon(result.scene.system.epsilon, result.epsilon),
        transform=axes.transAxes,
        ha="right",
        color=INK,
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
    around: int = 0,
    equal: str = "",
) -> None:
    """A curve, a peer's in open markers; it goes in open ones `around` those of so many others, on which it lies."""
    filled = colour != GREY and not around
    errors = np.clip([p.error for p in curve.points], SMALLEST, None)
    seconds = np.array([p.seconds for p in curve.points])
    shown = errors < LARGEST
    axes.plot(
        errors[shown], seconds[shown], color=colour, marker=marker, ls=line, lw=width, ms=4 + 4 * around,
        mfc=colour if filled else "none" if around else "white", label=_name(curve) + equal,
        zorder=3 if filled else 2,
    )  # fmt: skip


def _touch(one: WorkCurve, other: WorkCurve) -> bool:
    """Whether a point of one lies on a point of the other, as far as a marker tells."""
    return any(
        abs(np.log10(max(a.error, SMALLEST) / max(b.error, SMALLEST))) < MARK
        and abs(np.log10(a.seconds / b.seconds)) < MARK
        for a in one.points
        for b in other.points
    )


def _equals(others: list[WorkCurve], curve: WorkCurve) -> str:
    """The words for the legend, where a curve lies on another with every point."""
    mine = [max(p.error, SMALLEST) for p in curve.points]
    for other in others:
        theirs = [max(p.error, SMALLEST) for p in other.points]
        if len(theirs) == len(mine) and np.allclose(np.log10(theirs), np.log10(mine), rtol=0.0, atol=MARK):
            return f", as exact as {_name(other)}"
    return ""


def _name(curve: WorkCurve) -> str:
    names = {
        "radau9": "Radau 9",
        "radau13": "Radau 13",
        "dop853": "DOP853",
    }
    return names.get(curve.label, curve.label)
