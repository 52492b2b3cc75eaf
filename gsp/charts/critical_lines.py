"""The critical manifold in the plane of one slow and one fast variable, as lines."""

from __future__ import annotations

import numpy as np
import sympy as sp
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gsp.algebra.differentiation import derivative
from gsp.charts.continuity import are_joined
from gsp.charts.sampling import LINE, at_zero, evaluate, mesh
from gsp.charts.style import INK
from gsp.systems.system import SlowFastSystem


def critical_lines(system: SlowFastSystem, low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """Lines (k, 2) of g(x, y, 0) = 0 in a box of one slow and one fast variable, without poles and jumps of g."""
    g = at_zero(system.fast[system.y[0]], system)

    def value(points: np.ndarray) -> np.ndarray:
        return evaluate([g], system, None, points)[:, 0]

    u, v, points = mesh(low, high, LINE)
    values, places = value(points).reshape(LINE, LINE), points.reshape(LINE, LINE, 2)
    shown = values.copy()
    for start, end in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        changed = np.sign(values[start]) * np.sign(values[end]) < 0
        changed[changed] = ~are_joined(value, places[start][changed], places[end][changed])
        shown[start][changed] = shown[end][changed] = np.nan
    if not ((shown <= 0).any() and (shown >= 0).any()):
        return []
    contours = Figure().add_subplot().contour(u, v, np.ma.masked_invalid(shown), levels=[0.0])
    return [_on_zero(g, system, np.asarray(line), (high - low) / LINE) for line in contours.allsegs[0]]


def draw_critical_lines(
    system: SlowFastSystem,
    axes: Axes,
    low: np.ndarray,
    high: np.ndarray,
    *,
    colour: str = INK,
    width: float = 1.2,
) -> None:
    """g(x, y, 0) = 0 in a box of one slow and one fast variable, x across, solid where it attracts."""
    y = system.y[0]
    g_y = derivative(at_zero(system.fast[y], system), y)
    labelled: set[str] = set()
    for line in critical_lines(system, low, high):
        slope = evaluate([g_y], system, None, line)[:, 0]
        for stable, kind, style in ((True, "attracting", "-"), (False, "repelling", (0, (4, 2)))):
            here = slope < 0 if stable else slope >= 0
            if here.any():
                # One vertex more, so that the two kinds meet at a fold.
                wide = here if stable else here | np.roll(here, 1) | np.roll(here, -1)
                drawn = np.where(wide[:, None], line, np.nan)
                label = None if kind in labelled else f"$M_0$, {kind}"
                axes.plot(*drawn.T, color=colour, lw=width, ls=style, label=label, zorder=2)
                labelled.add(kind)


def _on_zero(g: sp.Expr, system: SlowFastSystem, line: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """Points (k, 2) of a contour of g, known to a `cell` of the mesh, by Newton's method across the line."""
    equation = [g, *(derivative(g, state) for state in system.states)]
    for _ in range(3):
        value, *slope = evaluate(equation, system, None, line).T[..., None]
        slope = np.hstack(slope)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = value * slope / (slope**2).sum(axis=1, keepdims=True)
        line = np.where((np.abs(step) < cell).all(axis=1, keepdims=True), line - step, line)
    return line
