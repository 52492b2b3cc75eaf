"""Charts of the critical manifold as continuation finds it: curves through folds, and sheets."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from gsp.charts.style import (
    AMBER,
    BLUE,
    GREEN,
    INK,
    PURPLE,
    VERMILION,
    chart,
    legend,
    limits,
    name_axes,
    solid_axes,
)
from gsp.critical.continuation.critical_curve import CriticalCurve
from gsp.critical.continuation.critical_sheet import CriticalSheet
from gsp.critical.loss_kind import LossKind
from gsp.errors import Status

# Colour and line by stability: attracting, repelling, saddle.
STABILITY = {"attracting": (BLUE, "-"), "repelling": (VERMILION, "--"), "saddle": (PURPLE, "-.")}
MARKERS: dict[LossKind, Any] = {
    LossKind.FOLD: {"marker": "o", "mfc": INK},
    LossKind.SLIP_ONSET: {"marker": "o", "mfc": INK},
    LossKind.CUSP: {"marker": "D", "mfc": INK},
    LossKind.HOPF: {"marker": "s", "mfc": GREEN},
    LossKind.BOGDANOV_TAKENS: {"marker": "p", "mfc": AMBER},
    LossKind.TRANSCRITICAL: {"marker": "X", "mfc": INK},
    LossKind.PITCHFORK: {"marker": "P", "mfc": INK},
    LossKind.BRANCH_POINT: {"marker": "*", "mfc": INK},
    LossKind.DEGENERATE: {"marker": "H", "mfc": INK},
}


@chart()
def critical_curve(curve: CriticalCurve, axes: Axes, *, names: tuple[str, str] | None = None) -> None:
    """A curve of M0 by stability, with its special points, and the branches switched to beside it.

    `names` are the variables of the two axes; the free variable and the first fast one unless given. A Hopf point
    is filled when it is supercritical.
    """
    across, up = names or (curve.free[0], next(n for n in curve.names if n not in curve.free))
    for each in (curve, *curve.others):
        for segment in each.segments:
            colour, line = STABILITY[segment.kind]
            axes.plot(each[across][segment.rows], each[up][segment.rows], color=colour, ls=line, lw=1.7)
        for point in each.special:
            if point.kind in MARKERS:
                style = dict(MARKERS[point.kind])
                if point.kind is LossKind.HOPF and point.coefficients.get("l1", -1.0) > 0:
                    style["mfc"] = "white"
                axes.plot(point[across], point[up], color=INK, mec=INK, ms=6, ls="none", zorder=5, **style)
    kinds = {s.kind for each in (curve, *curve.others) for s in each.segments}
    handles = [
        Line2D([], [], color=STABILITY[kind][0], ls=STABILITY[kind][1], label=kind)
        for kind in STABILITY
        if kind in kinds
    ]
    special = dict.fromkeys(
        p.kind for each in (curve, *curve.others) for p in each.special if p.kind in MARKERS
    )
    handles += [
        Line2D([], [], color=INK, mec=INK, ls="none", ms=6, label=str(kind), **MARKERS[kind])
        for kind in special
    ]
    curves = (curve, *curve.others)
    for name, set_limits in ((across, axes.set_xlim), (up, axes.set_ylim)):
        near = [_near(each, name) for each in curves]
        some = [part for part in near if part.size and part.min() < part.max()]
        if some and sum(map(len, near)) < sum(map(len, curves)):
            set_limits(limits(some, [each[name] for each in curves]))
    name_axes(axes, across, up)
    for handle in handles:
        axes.add_line(handle)
    legend(axes, columns=4)


def _near(curve: CriticalCurve, name: str) -> np.ndarray:
    """A variable along a curve without the ends on which the curve leaves for infinity: from behind the last special
    point there, or where the variable turned last; empty where there is neither.
    """
    values = curve[name]
    ways = np.sign(np.diff(values))
    turns = 1 + np.flatnonzero(ways[1:] * ways[:-1] < 0.0)
    marks = np.union1d(turns, [point.row for point in curve.special]).astype(int)
    away = [stop.point[name] for stop in curve.stops if stop.ending is Status.RUNS_AWAY]
    if away and not marks.size:
        return values[:0]
    first = marks[0] if values[0] in away else 0
    last = marks[-1] if values[-1] in away else len(values) - 1
    return values[first : last + 1]


@chart(height=3.9, solid=lambda result: True)
def critical_sheet(sheet: CriticalSheet, axes: Any, *, name: str | None = None) -> None:
    """A sheet of M0 over its two free variables, coloured by stability, with its fold curves.

    `name` is the variable drawn upwards; the first fast one unless given.
    """
    across, along = sheet.free
    up = name or next(n for n in sheet.names if n not in sheet.free)
    points = np.stack([sheet[across], sheet[along], sheet[up]], axis=1)
    fast = sheet.eigenvalues.shape[1]
    for unstable in np.unique(sheet.triangle_unstable):
        kind = "attracting" if unstable == 0 else ("repelling" if unstable == fast else "saddle")
        chosen = sheet.triangles[sheet.triangle_unstable == unstable]
        colour = STABILITY[kind][0]
        axes.add_collection3d(Poly3DCollection(points[chosen], facecolor=colour, edgecolor="none", alpha=0.45))
        axes.plot([], [], [], color=colour, lw=5, alpha=0.5, label=kind)
    for i, fold in enumerate(sheet.folds):
        label = "folds" if i == 0 else None
        axes.plot(fold[across], fold[along], fold[up], color=INK, lw=1.8, label=label, zorder=8)
    special = [point for fold in sheet.folds for point in fold.special]
    first = {point.kind: point for point in reversed(special)}
    for point in special:
        place = ([point[each]] for each in (across, along, up))
        label = str(point.kind) if point is first[point.kind] else None
        axes.plot(*place, color=INK, mec=INK, ms=5, ls="none", zorder=9, label=label, **MARKERS[point.kind])
    for values, setter in zip(points.T, (axes.set_xlim, axes.set_ylim, axes.set_zlim)):
        setter(values.min(), values.max())
    axes.view_init(elev=22, azim=-62)
    axes.set_box_aspect((1.25, 1.25, 0.9))
    solid_axes(axes, (across, along, up))
    legend(axes, columns=4)
