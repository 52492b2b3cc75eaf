"""Charts of orbits: the phase portrait, the path, the convergence to the limit, states over time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import sympy as sp
from matplotlib.axes import Axes

from gsp.algebra.differentiation import derivative
from gsp.analysis.analysis import Analysis
from gsp.charts.critical_lines import draw_critical_lines
from gsp.charts.manifolds import slow_line
from gsp.charts.sampling import (
    LINE,
    chart_symbols,
    dense_run,
    during,
    evaluate,
    even_places,
    fast_range,
    frame,
    heading_of,
    limit_field,
    margins,
    mesh,
    path_names,
    reading,
    shape,
    slow_curve,
    widened,
)
from gsp.charts.streamlines import streamlines
from gsp.charts.style import (
    BLUE,
    FLOW,
    GREY,
    INK,
    LADDER,
    LINES,
    PALE,
    VERMILION,
    at_epsilon,
    chart,
    darts,
    legend,
    limits,
    looks,
    mathematics,
    name_axes,
    orbit,
    plane_axes,
)
from gsp.integration.trajectory import Trajectory
from gsp.systems.region import shown_within

# Grid points of a field along each axis: streamlines end within one cell of a line of equilibria.
FIELD = 161


@chart()
def phase_portrait(analysis: Analysis, axes: Axes) -> None:
    """The flow at a glance.

    Two slow variables: streamlines of the reduced field of order 0, in raw variables where there are any, and
    the scene's limit trajectory. One slow variable: the full field in the plane of the slow and the first fast
    one, every sheet of the critical manifold, the slow manifold and the full run. More: the limit projected.
    """
    if shape(analysis)[0] == 1:
        _sheets(analysis, axes)
        return
    names = [s.name for s in chart_symbols(analysis)]
    run = dense_run(analysis.limit)
    if len(names) == 2:
        low, high = frame(analysis, names, [run])
        u, v, points = mesh(low, high, FIELD)
        streamlines(axes, u, v, limit_field(analysis, points), distance=0.055, colour=FLOW)
        axes.axhline(0.0, color=PALE, lw=0.8, zorder=0)
        axes.axvline(0.0, color=PALE, lw=0.8, zorder=0)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        if 0.25 < (high[1] - low[1]) / (high[0] - low[0]) < 4.0:
            axes.set_aspect("equal")
    orbit(axes, run[names[0]], run[names[1]], VERMILION, "limit trajectory")
    name_axes(axes, *names[:2])
    legend(axes)


def _sheets(analysis: Analysis, axes: Axes) -> None:
    """The plane of the slow and the first fast variable: the full field, M0 by stability, M_epsilon."""
    system = analysis.study.system
    names = [system.x[0].name, system.y[0].name]
    on, leading = slow_curve(analysis)
    box = np.array([analysis.study.region[names[0]], fast_range(analysis, on)])
    if len(system.y) == 1:
        if not analysis.study.branch.is_explicit:
            box = _all_sheets(analysis, box)
        low, high = widened(box[:, 0], box[:, 1])
        u, v, points = mesh(low, high, FIELD)
        rates = evaluate(system.rates, system, analysis.scene.epsilon, points)
        streamlines(axes, u, v, rates, distance=0.07, colour=FLOW)
        draw_critical_lines(system, axes, low, high)
    else:
        low, high = widened(box[:, 0], box[:, 1])
        axes.plot(on[:, 0], leading[:, 0], color=INK, lw=1.1, label="critical manifold")
    slow_line(analysis, axes, on, leading)
    run = dense_run(analysis.full)
    orbit(axes, *(reading(analysis, run, name) for name in names), VERMILION, "full run")  # pyright: ignore[reportCallIssue]
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    name_axes(axes, *names)
    legend(axes, columns=3)


def _all_sheets(analysis: Analysis, box: np.ndarray) -> np.ndarray:
    """`box` made wide enough to show the other sheets of an implicit branch, and its folds."""
    branch = analysis.study.branch
    system, (width, height) = branch.system, np.ptp(box, axis=1)
    slow = np.array([box[0, 0] - 0.3 * width, box[0, 1] + 0.1 * width])
    bounds = {system.y[0].name: (box[1, 0] - 4.5 * height, box[1, 1] + 4.5 * height)}
    slope = derivative(system.g[0].xreplace({system.epsilon: sp.S.Zero}), system.y[0])
    heights = list(box[1])
    for x in np.linspace(slow[0], slow[1], 15):
        roots = np.sort(branch.roots(np.array([x]), bounds=bounds).ravel())
        places = np.column_stack([np.full(len(roots), x), roots])
        signs = np.sign(evaluate([slope], system, None, places)[:, 0]) if len(roots) else roots
        # Beside one another are sheets that attract and repel in turn; beyond a pole no orbit comes.
        parts = np.cumsum(np.append(0, signs[1:] == signs[:-1]))[: len(roots)]
        own = parts[(roots >= box[1, 0]) & (roots <= box[1, 1])]
        heights += roots[np.isin(parts, own)].tolist()
    return np.array([slow, [min(heights), max(heights)]])


@chart()
def path(analysis: Analysis, axes: Axes) -> None:
    """The path in the plane that the limit draws; darts show where its heading points, if it has one."""
    names = path_names(analysis)
    run = dense_run(analysis.limit)
    x, y = run[names[0]], run[names[1]]
    heading = heading_of(analysis)
    orbit(axes, x, y, BLUE, "limit", arrow=heading is None)
    if heading is not None:
        at = even_places(x, y, 11)
        darts(axes, x[at], y[at], run[heading][at], f"heading {mathematics(heading)}")
    plane_axes(axes, names)


def _from_limit(analysis: Analysis, run: Trajectory, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times, and by how much a full run is away from the limit, relative to its largest value."""
    size = float(np.abs(analysis.limit[name]).max()) or 1.0
    # The interval of time that both cover.
    start, end = max(run.t[0], analysis.limit.t[0]), min(run.t[-1], analysis.limit.t[-1])
    # Quadratic spacing: the initial layer is short.
    t = start + (end - start) * np.linspace(0.0, 1.0, LINE) ** 2
    return t, (reading(analysis, run.sample(t), name) - analysis.limit.sample(t)[name]) / size


# Differences below this are the tolerance of the pictured runs, not the limit's error.
UNSEEN = 1e-6


def differs_from_limit(analysis: Analysis) -> bool:
    """Whether some full run is further from the limit than both are known, relative to its largest value."""
    names = [s.name for s in chart_symbols(analysis)]
    runs = analysis.ladder.values()
    found = (_from_limit(analysis, run, name)[1] for run in runs for name in names)
    return any(np.abs(difference).max(initial=0.0) >= UNSEEN for difference in found)


def shrinks_in_proportion(analysis: Analysis) -> bool:
    """Whether full runs come nearer to the limit in proportion to epsilon, as far as the ladder shows it.

    Up to a fold, where the limit ends, they do not: there is a term in epsilon ln epsilon.
    """
    names = [s.name for s in chart_symbols(analysis)]
    ladder = sorted(analysis.ladder.items())
    if not all(run.status.ok for run in (analysis.limit, *analysis.ladder.values())):
        return False
    sizes = [max(np.abs(_from_limit(analysis, run, name)[1]).max() for name in names) for _, run in ladder]
    if len(ladder) < 2 or not (min(sizes) > 0.0 and max(sizes) >= UNSEEN):
        return False
    # To a quarter of the power.
    return abs(float(np.log(sizes[1] / sizes[0]) / np.log(ladder[1][0] / ladder[0][0])) - 1.0) < 0.25


@chart()
def convergence(analysis: Analysis, axes: Axes) -> None:
    """Full runs at a ladder of epsilons against the limit.

    The paths where the scene draws one; otherwise the differences of the slow variables from the limit over
    time, each relative to its largest value: they shrink in proportion to epsilon.
    """
    ladder, small = sorted(analysis.ladder.items(), reverse=True), analysis.scene.system.epsilon
    if analysis.scene.path is not None:
        names = path_names(analysis)
        limit = dense_run(analysis.limit)
        for colour, (epsilon, run) in zip(LADDER, ladder):
            dense = dense_run(run)
            axes.plot(dense[names[0]], dense[names[1]], color=colour, lw=1.3, label=at_epsilon(small, epsilon))
        label = rf"limit {mathematics(str(small))} $\to 0$"
        orbit(axes, limit[names[0]], limit[names[1]], BLUE, label, arrow=False)
        plane_axes(axes, names)
        return
    names = [s.name for s in chart_symbols(analysis)]
    [line] = axes.plot([], [], color=BLUE, lw=1.8, label=rf"limit {mathematics(str(small))} $\to 0$", zorder=1)
    seen, times = [], []
    for style, name in zip(LINES, names):
        for colour, (epsilon, run) in zip(LADDER, ladder):
            t, difference = _from_limit(analysis, run, name)
            label = at_epsilon(small, epsilon) if name == names[0] else None
            axes.plot(t, difference, color=colour, ls=style, label=label)
            seen.append(difference[np.abs(difference) < 1.0])
            times += [t[0], t[-1]]
    line.set_data([min(times), max(times)], [0.0, 0.0])
    if len(names) > 1:
        for style, name in zip(LINES, names):
            axes.plot([], [], color=GREY, ls=style, label=mathematics(name))
    axes.set_ylim(limits([np.concatenate([[0.0], *seen])], []))
    if not differs_from_limit(analysis):
        axes.set_ylim(-1.0, 1.0)
        axes.set_yticks([0.0])
        axes.text(0.5, 0.6, "no difference above the runs' tolerance", ha="center", transform=axes.transAxes)
    axes.set_xlim(margins(np.array(times), 0.02))
    axes.set_xlabel("slow time $t$")
    quantity = mathematics(names[0]) if len(names) == 1 else "slow variables"
    axes.set_ylabel(f"{quantity}: full run minus limit, relative")
    legend(axes, columns=4 if len(names) == 1 else 3)


def _layer(analysis: Analysis) -> float:
    """The length of the initial layer, epsilon/gap; where normal hyperbolicity is lost, with the rate at the start."""
    found, study = analysis.hyperbolicity, analysis.study
    if found.gap > 0.0:
        return analysis.scene.epsilon / found.gap
    rates = np.abs(np.real(found.eigenvalues([study.start[x.name] for x in study.system.x])))
    return analysis.scene.epsilon / max(float(rates.min()), np.finfo(float).tiny)


@chart()
def time_series(analysis: Analysis, axes: Axes) -> None:
    """States of the full run at the scene's epsilon and the reduced run of the highest order over it.

    Each is drawn from its least to its largest value where one of them would be flat on an axis of all.
    Time is logarithmic, so that the initial layer, of length epsilon/gap, is seen as well as the slow motion.
    """
    start, length = analysis.scene.span[0], analysis.scene.span[1] - analysis.scene.span[0]
    layer = _layer(analysis)
    first = min(0.03 * layer, 0.01 * length)
    t = start + np.geomspace(first, length, LINE)
    full, reduced = (during(run, t) for run in (analysis.full, analysis.reduced))
    system = analysis.scene.system
    # A clock over time is the time again, and a year's number would press all else flat.
    moving = [s.name for s, rate in zip(system.states, system.rates) if rate != 1]
    names = moving or [s.name for s in system.states]
    ends = {name: (float(full[name].min()), float(full[name].max())) for name in names}
    flat = _pressed_flat(ends)

    def height(run: Trajectory, name: str) -> np.ndarray:
        low, high = ends[name]
        return (run[name] - low) / ((high - low) or 1.0) if flat else run[name]

    for look, name in zip(looks(), names):
        told = f" ({' to '.join(shown_within(end, ends[name]) for end in ends[name])})" if flat else ""
        label = f"{mathematics(name)}{told}, full"
        axes.plot(full.t - start, height(full, name), **look, lw=3.2, alpha=0.45, label=label)
    lines = [height(full, name) for name in names]
    # A run that ends where it starts is no line, and a series past its reach there says nothing of the size.
    if len(reduced.t) > 1:
        for name in names:
            label = f"reduced, order {analysis.short_series.order}" if name == names[-1] else None
            axes.plot(reduced.t - start, height(reduced, name), color=INK, lw=0.9, ls=(0, (5, 2)), label=label)
        axes.set_ylim(limits([height(reduced, name) for name in names], lines, headroom=0.1))
    else:
        axes.set_ylim(limits(lines, [], headroom=0.1))
    if analysis.hyperbolicity.gap > 0.0:
        axes.axvline(layer, color=GREY, lw=0.8, ls=":", zorder=0)
        axes.annotate(
            rf"{mathematics(str(analysis.study.system.epsilon))}/gap", (layer, 1.0), xycoords=("data", "axes fraction"),
            xytext=(3, -1), textcoords="offset points", va="top", color=GREY, fontsize="small",
        )  # fmt: skip
    axes.set_xscale("log")
    axes.set_xlim(first, length)
    since = "t" if start == 0.0 else f"t - {start:g}"
    axes.set_xlabel(f"slow time ${since}$, logarithmic")
    axes.set_ylabel("states, each over its range" if flat else "states")
    legend(axes, columns=2 if flat else 4)


def _pressed_flat(ends: Mapping[str, tuple[float, float]]) -> bool:
    """Whether some state that moves would be a flat line on an axis that holds all of them as they are."""
    whole = max(high for _, high in ends.values()) - min(low for low, _ in ends.values())
    # What is less than a line is wide is not seen.
    return any(0.0 < high - low < 0.02 * whole for low, high in ends.values())
