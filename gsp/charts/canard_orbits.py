"""Charts of a folded node: the two sheets' curves in the section with their crossings, and canards in space."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from gsp.charts.style import BLUE, INK, SERIES, VERMILION, chart, legend, mathematics, name_axes, solid_axes
from gsp.orbits.canard_orbits.canard import CanardKind
from gsp.orbits.canard_orbits.folded_canards import CanardOrbits

# Points of each orbit that is drawn in space.
POINTS = 300
# How far about the node is drawn in space, in local units along the section's variable.
REACH = 9.0


@chart(height=4.2)
def canard_section(orbits: CanardOrbits, axes: Axes, *, shown: int = 6) -> None:
    """The curves of the attracting and the repelling sheet in the section, and the canards where they cross.

    The first `shown` canards are labelled; the plot holds them and the weak canard that the curves turn about.
    """
    plane = orbits.attracting.section
    others = [i for i in range(3) if i != plane.index]
    names = [orbits.system.states[i].name for i in others]
    places = np.array([[c.point[name] for name in names] for c in orbits.canards]).reshape(-1, 2)
    for sheet, colour, label in (
        (orbits.attracting, BLUE, "attracting sheet"),
        (orbits.repelling, VERMILION, "repelling sheet"),
    ):
        curve = sheet.curve()
        axes.plot(curve[:, 0], curve[:, 1], color=colour, lw=1.3, label=label)
    turning = [k for k, c in enumerate(orbits.canards) if c.kind is not CanardKind.WEAK]
    axes.plot(
        places[turning, 0], places[turning, 1], "o", color=INK, ms=4.5, ls="none", label="canards", zorder=5
    )
    for k, canard in enumerate(orbits.canards):
        if canard.kind is CanardKind.WEAK:
            axes.plot(*places[k], "D", color="white", mec=INK, ms=4, label=r"$\gamma_w$", zorder=6, ls="none")
    drawn = places[turning[:shown]] if turning else orbits.frame.point[None, others]
    centre = places[-1] if turning else drawn[0]
    for place, k in zip(drawn, turning[:shown]):
        away = (place - centre) / (np.ptp(drawn, axis=0) + 1e-300)
        # Nearer to the weak canard than this share of the picture no label is legible.
        if np.linalg.norm(away) < 0.03:
            continue
        away = away / (np.linalg.norm(away) or 1.0)
        axes.annotate(
            mathematics(orbits.canards[k].name), place, xytext=13.0 * away, textcoords="offset points",
            ha="center", va="center", fontsize=10,
        )  # fmt: skip
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    margin = 0.22 * np.maximum(high - low, [orbits.frame.depth, orbits.frame.width])
    axes.set_xlim(low[0] - margin[0], high[0] + margin[0])
    axes.set_ylim(low[1] - margin[1], high[1] + margin[1])
    name_axes(axes, *names)
    legend(axes, columns=4)


@chart(height=4.2, solid=lambda result: True)
def canard_orbits(orbits: CanardOrbits, axes: Any, *, shown: int = 4) -> None:
    """Canards near a folded node in space, over orbits of the two sheets, with the fold point."""
    frame, plane = orbits.frame, orbits.attracting.section
    other = 1 - plane.index
    order = [plane.index, other, 2]
    for sheet, colour in ((orbits.attracting, BLUE), (orbits.repelling, VERMILION)):
        # Sixty orbits of each sheet are drawn.
        rows = np.unique(np.linspace(0, len(sheet.segments) - 1, 60).astype(int))
        for row in rows:
            states = _near(sheet.segments[row].at(np.linspace(0.0, 1.0, 6 * POINTS)), orbits)
            axes.plot(*states[:, order].T, color=colour, lw=0.6, alpha=0.4)
    turning = [c for c in orbits.canards if c.kind is not CanardKind.WEAK][:shown]
    for canard, colour in zip(turning, cycle(SERIES[1:2] + SERIES[3:] + SERIES[:1])):
        states = _near(canard.orbit.at(np.linspace(0.0, 1.0, 6 * POINTS)), orbits)
        axes.plot(*states[:, order].T, color=colour, lw=1.8, label=mathematics(canard.name), zorder=6)
    axes.plot(*frame.point[order][:, None], "o", color=INK, ms=5, label="folded node", zorder=9)
    for colour, label in ((BLUE, "attracting"), (VERMILION, "repelling")):
        axes.plot([], [], color=colour, lw=1.0, label=label)
    axes.view_init(elev=20, azim=-65)
    axes.set_box_aspect((1.7, 1.0, 1.0))
    solid_axes(axes, [orbits.system.states[i].name for i in order])
    legend(axes, columns=4)


def _near(states: np.ndarray, orbits: CanardOrbits) -> np.ndarray:
    """The part of an orbit near the folded node, NaN elsewhere."""
    frame, plane = orbits.frame, orbits.attracting.section
    scale = np.array([frame.unit, frame.unit, frame.width])
    off = np.abs(states - frame.point) / scale
    inside = (off[:, plane.index] < REACH) & (off[:, 2] < 0.8 * REACH)
    return np.where(inside[:, None], states, np.nan)
