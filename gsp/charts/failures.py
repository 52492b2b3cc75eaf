"""The failure map: which reduced model is good enough where, and what fails beyond."""

from __future__ import annotations

from functools import partial
from textwrap import wrap

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from gsp.charts.style import BLUE, INK, PALE, SKY, STYLE, VERMILION, WIDTH, chart, name_axes, png
from gsp.comparison.failure_map import FailureMap
from gsp.comparison.survey import EXPLICIT, MANIFOLD, NEWTON, NO_SLIP
from gsp.systems.arguments import check_noun

# Light to dark as more orders are needed.
ORDER_COLOURS = ("#FBE3C8", "#F2B27A", "#E07B39", "#B4501B", "#7A2E00", "#4A1C00")

# Cells without a reduced flow that holds.
FULL, NOTHING = -1, -2


@chart(height=4.4)
def failures_along(result: FailureMap, axes: Axes) -> None:
    """Over (position, epsilon): the lowest order whose reduced flow meets the tolerance, what fails beyond it, and why.

    Hatched: explicit steps are held back by stability. Dots: the series is past its optimal order. Crosses: Newton's
    method from the scene's start does not reach this sheet. Hatched the other way: a contact lets go.
    """
    _colour(axes, result, result.positions, _cells_along(result))
    _hatch(axes, result, result.positions, _held_back_along(result))
    _hatch(axes, result, result.positions, _lets_go(result), hatch="\\\\\\\\", colour=VERMILION)
    _mark(axes, result, _past(result), ".", 3.0)
    _mark(axes, result, _astray(result), "x", 3.0)
    name_axes(axes, result.axis, str(result.scene.system.epsilon))
    axes.set_title(f"tolerance {result.tolerance:g}", fontsize=10, loc="right", color=INK)


@chart(height=4.4)
def failures_by_tolerance(result: FailureMap, axes: Axes) -> None:
    """Over (tolerance, epsilon): the lowest order whose reduced flow meets the tolerance over the scene's span."""
    _colour(axes, result, result.tolerances, _cells_demanded(result))
    _hatch(axes, result, result.tolerances, _held_back_demanded(result))
    axes.set_xscale("log")
    axes.invert_xaxis()
    if result.unmeasured:
        text = "\n".join(["no reduced flow reaches the end of the span:", *wrap(result.unmeasured, 44)])
        axes.text(
            0.5, 0.5, text, ha="center", va="center", fontsize=9, color=INK, transform=axes.transAxes, zorder=5,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 5.0},
        )  # fmt: skip
    name_axes(axes, "", str(result.scene.system.epsilon))
    axes.set_xlabel("tolerance over the span")


def failure_map(result: FailureMap, *, stacked: bool = False) -> Axes:
    """Both maps with one legend, side by side or `stacked` in a column of a page; the Axes of the first one."""
    check_noun(result, FailureMap, verb="charts.failure_map")
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, 7.2) if stacked else (9.0, 4.6), layout="constrained")
        FigureCanvasAgg(figure)
        first, second = figure.subplots(2, 1) if stacked else figure.subplots(1, 2, sharey=True)
        failures_along(result, first)
        failures_by_tolerance(result, second)
        if not stacked:
            second.set_ylabel("")
        columns = 2 if stacked else 3
        figure.legend(
            handles=_key(result), loc="outside upper center", ncols=columns, frameon=False, fontsize=9
        )
    # What a notebook shows, and a card.
    first._repr_png_ = partial(png, first)  # pyright: ignore[reportAttributeAccessIssue]
    return first


def _cells(least: np.ndarray, manifold: np.ndarray) -> np.ndarray:
    """0.. for orders; -1 for full only; -2 for no slow manifold."""
    return np.where(least >= 0, least, np.where(manifold, FULL, NOTHING))


def _cells_along(result: FailureMap) -> np.ndarray:
    return _cells(result.least_order, result.places[MANIFOLD].holds)


def _cells_demanded(result: FailureMap) -> np.ndarray:
    return _cells(result.least_order_demanded, np.ones(result.least_order_demanded.shape, dtype=bool))


def _held_back_along(result: FailureMap) -> np.ndarray:
    return ~result.places[EXPLICIT].holds & result.places[MANIFOLD].holds


def _held_back_demanded(result: FailureMap) -> np.ndarray:
    # Where implicit steps do not reach the end either, nothing is known.
    claim = result.demands[EXPLICIT]
    return ~claim.holds & ~np.isnan(claim.measure)


def _lets_go(result: FailureMap) -> np.ndarray:
    claim = result.places.get(NO_SLIP)
    return np.zeros_like(result.best_order, dtype=bool) if claim is None else np.isposinf(claim.measure)


def _past(result: FailureMap) -> np.ndarray:
    return (result.best_order >= 0) & (result.best_order < max(result.orders))


def _astray(result: FailureMap) -> np.ndarray:
    return np.isfinite(result.places[MANIFOLD].measure) & ~result.places[NEWTON].holds


def _edges(values: np.ndarray, logarithmic: bool) -> np.ndarray:
    v = np.log(values) if logarithmic else values
    inner = 0.5 * (v[1:] + v[:-1])
    edges = np.concatenate([[2 * v[0] - inner[0]], inner, [2 * v[-1] - inner[-1]]])
    return np.exp(edges) if logarithmic else edges


def _grid(result: FailureMap, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return _edges(columns, columns is result.tolerances), _edges(result.epsilons, True)


def _colour(axes: Axes, result: FailureMap, columns: np.ndarray, cells: np.ndarray) -> None:
    colours = ListedColormap([PALE, SKY, *ORDER_COLOURS])
    norm = BoundaryNorm(np.arange(-2.5, len(ORDER_COLOURS)), colours.N)
    axes.pcolormesh(*_grid(result, columns), np.minimum(cells, len(ORDER_COLOURS) - 1), cmap=colours, norm=norm)
    axes.set_yscale("log")


def _hatch(
    axes: Axes,
    result: FailureMap,
    columns: np.ndarray,
    where: np.ndarray,
    *,
    hatch: str = "////",
    colour: str = BLUE,
) -> None:
    x, y = _grid(result, columns)
    # Each cell as four points, so that the hatching ends where the cell does.
    fine_x, fine_y = (np.repeat(edges, 2)[1:-1] for edges in (x, y))
    fine = np.repeat(np.repeat(where, 2, axis=0), 2, axis=1).astype(float)
    with matplotlib.rc_context({"hatch.linewidth": 0.6}):
        drawn = axes.contourf(fine_x, fine_y, fine, levels=[0.5, 1.5], colors="none", hatches=[hatch])
        drawn.set_edgecolor(colour)
        drawn.set_linewidth(0.0)


def _mark(axes: Axes, result: FailureMap, where: np.ndarray, marker: str, size: float) -> None:
    rows, columns = np.nonzero(where)
    axes.plot(
        result.positions[columns],
        result.epsilons[rows],
        ls="",
        marker=marker,
        ms=size,
        mew=0.6,
        color=INK,
        zorder=3,
    )


def _key(result: FailureMap) -> list:
    """Handles of what either map shows, and of nothing else."""
    cells = np.unique(np.concatenate([_cells_along(result).ravel(), _cells_demanded(result).ravel()]))
    held_back = _held_back_along(result).any() or _held_back_demanded(result).any()
    hatched = Patch(facecolor="none", edgecolor=BLUE, hatch="////", label="stability holds explicit steps back")
    lets_go = Patch(
        facecolor="none", edgecolor=VERMILION, hatch="\\\\\\\\", label="no-slip fails: a contact lets go"
    )
    past = Line2D([], [], ls="", marker=".", color=INK, ms=4, label="series past its optimal order")
    astray = Line2D([], [], ls="", marker="x", color=INK, ms=4, label="Newton's method goes astray")
    handles = [
        *(
            Patch(facecolor=ORDER_COLOURS[min(n, len(ORDER_COLOURS) - 1)], label=f"reduced flow of order {n}")
            for n in result.orders
            if n in cells
        ),
        *([Patch(facecolor=SKY, label="full system only")] if FULL in cells else []),
        *([Patch(facecolor=PALE, label="no slow manifold here")] if NOTHING in cells else []),
        *([hatched] if held_back else []),
        *([lets_go] if _lets_go(result).any() else []),
        *([past] if _past(result).any() else []),
        *([astray] if _astray(result).any() else []),
    ]
    return handles
