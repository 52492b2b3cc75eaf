"""Charts of the slow manifold: itself, and the distance to it of runs that fall onto it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from gsp.analysis.analysis import Analysis
from gsp.charts.sampling import (
    GRID,
    LINE,
    chart_symbols,
    dense_run,
    distances,
    ends_of,
    frame,
    graph,
    margins,
    mesh,
    shape,
    slow_curve,
)
from gsp.charts.style import (
    BLUE,
    GREY,
    INK,
    PALE,
    SERIES,
    SKY,
    VERMILION,
    chart,
    legend,
    manifold_label,
    mathematics,
    name_axes,
    solid_axes,
)
from gsp.errors import DeclarationError
from gsp.integration.trajectory import Trajectory

# Runs that start off the manifold are drawn for this many times 1/gap of fast time: e^-20 is 2e-9.
LAYER = 20.0


@chart(height=3.7, solid=lambda analysis: shape(analysis) == (2, 1))
def manifold(analysis: Analysis, axes: Axes) -> None:
    """The slow manifold at the scene's epsilon, with runs that start off it and fall onto it.

    A curve for one slow and one fast variable; a surface for two slow and one fast, in raw variables where
    there are any; and the distance to it against fast time otherwise.
    """
    if shape(analysis) == (2, 1):
        _surface(analysis, axes)
    elif shape(analysis) == (1, 1):
        _curve(analysis, axes)
    else:
        _distance(analysis, axes)


def _curve(analysis: Analysis, axes: Axes) -> None:
    system = analysis.study.system
    names = [system.x[0].name, system.y[0].name]
    on, leading = slow_curve(analysis)
    axes.plot(on[:, 0], leading[:, 0], color=INK, lw=1.0, ls="--", label="critical manifold")
    slow_line(analysis, axes, on, leading)
    for i, run in enumerate(analysis.landing):
        dense = dense_run(run)
        axes.plot(
            dense[names[0]], dense[names[1]], color=VERMILION, lw=1.0, zorder=2,
            label="runs from off the manifold" if i == 0 else None,
        )  # fmt: skip
        axes.plot(dense[names[0]][:1], dense[names[1]][:1], "o", color=VERMILION, ms=4, zorder=4)
    heights = np.concatenate([on[:, 1], leading[:, 0], *(run[names[1]] for run in analysis.landing)])
    axes.set_xlim(margins(on[:, 0]))
    axes.set_ylim(margins(heights))
    name_axes(axes, *names)
    legend(axes, columns=2)


def slow_line(analysis: Analysis, axes: Axes, on: np.ndarray, leading: np.ndarray) -> None:
    """The slow manifold `on` (m, 1 + n_fast) as a line, marked where its terms stop falling on the branch `leading`."""
    if not np.isfinite(on[:, 1]).any():
        return
    label = manifold_label(analysis.scene.system.epsilon, analysis.scene.epsilon)
    axes.plot(on[:, 0], on[:, 1], color=BLUE, lw=2.2, label=label, zorder=3)
    ends = on[ends_of(on, leading)]
    if len(ends):
        axes.plot(
            ends[:, 0], ends[:, 1], "o", color=BLUE, mfc="white", ms=5, zorder=4, label="its terms stop falling"
        )


def _surface(analysis: Analysis, axes: Any) -> None:
    symbols = chart_symbols(analysis)
    names = [s.name for s in symbols]
    fast = analysis.study.system.y[0].name
    landing = [dense_run(run) for run in analysis.landing]
    low, high = frame(analysis, names, landing if analysis.raw else [])
    u, v, points = mesh(low, high)
    height = graph(analysis, points).reshape(GRID, GRID)
    U, V = np.meshgrid(u, v)
    axes.plot_surface(U, V, height, color=SKY, alpha=0.45, lw=0, rstride=1, cstride=1, shade=False)
    axes.plot_wireframe(
        U,
        V,
        height,
        color=BLUE,
        lw=0.35,
        alpha=0.6,
        rstride=5,
        cstride=5,
    )
    label = manifold_label(analysis.scene.system.epsilon, analysis.scene.epsilon)
    axes.plot([], [], [], color=SKY, lw=5, alpha=0.6, label=label)
    for i, run in enumerate(landing):
        x, y, z = run[names[0]], run[names[1]], run[fast]
        axes.plot(
            x, y, z, color=VERMILION, lw=1.3, label="runs from off the manifold" if i == 0 else None, zorder=10
        )
        axes.plot(x[:1], y[:1], z[:1], "o", color=VERMILION, ms=3.5, zorder=11)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.view_init(elev=24, azim=-58)
    axes.set_box_aspect((1.25, 1.25, 0.8), zoom=1.02)
    solid_axes(axes, (*names, fast))
    legend(axes, columns=2)


@chart()
def distance(analysis: Analysis, axes: Axes) -> None:
    """Distance |y - h_epsilon(x)| to the slow manifold against fast time, of runs that start off it.

    The guide e^(-gap tau) is the slowest approach that the gap allows.

    Raises `DeclarationError` when there are no such runs, because the manifold does not attract.
    """
    if not analysis.landing:
        raise DeclarationError(
            f"no run lands on a manifold that is {analysis.hyperbolicity.kind.adjective}.",
            "Draw `manifold` instead.",
            got="an analysis without landing runs",
        )
    _distance(analysis, axes)


@dataclass(frozen=True, eq=False)
class Approach:
    """The distance to the slow manifold (m,) over fast time `tau` (m,) of a run that starts off it in `name`.

    `is_whole` says whether it is known all through the layer, and not up to a fold only.
    """

    name: str
    tau: np.ndarray
    gaps: np.ndarray
    is_whole: bool

    @property
    def tail(self) -> float:
        """How far off the run ends, in its last quarter."""
        return float(np.quantile(self.gaps[-1 - len(self.gaps) // 4 :], 0.9))

    @property
    def lands(self) -> bool:
        """Whether it has landed: one that ends farther off is on its way still, or to another sheet."""
        return self.tail <= 0.1 * self.gaps[0]


def approaches(analysis: Analysis) -> list[Approach]:
    """How the landing runs approach the slow manifold, as far as each is over what is known of it."""
    epsilon, gap = analysis.scene.epsilon, analysis.hyperbolicity.gap
    found = []
    for run in analysis.landing:
        tau = np.linspace(0.0, min(LAYER / gap, (run.t[-1] - run.t[0]) / epsilon), LINE)
        # Rounding may put the last time behind the run's end.
        dense = run.sample(np.minimum(run.t[0] + epsilon * tau, run.t[-1]))
        gaps = distances(analysis, dense)
        if len(gaps) > 1 and gaps[0] > 0.0:
            found.append(Approach(_displaced(analysis, run), tau[: len(gaps)], gaps, len(gaps) == LINE))
    return found


def _distance(analysis: Analysis, axes: Axes) -> None:
    gap, curves = analysis.hyperbolicity.gap, approaches(analysis)
    if not curves:
        raise DeclarationError(
            "no run starts where the slow manifold is known: the terms of its series do not fall there.",
            "Take a smaller epsilon, or a smaller region.",
            got="distances that are not known",
        )
    axes.set_xlabel(rf"fast time $\tau = t$/{mathematics(str(analysis.study.system.epsilon))}")
    fast = ", ".join(mathematics(y.name) for y in analysis.study.system.y)
    axes.set_ylabel(r"distance to $M_\epsilon$ in " + fast)
    # Where the runs stop falling, the series and the runs themselves are known no better.
    level = 2.0 * max((each.tail for each in curves if each.lands and each.is_whole), default=0.0)
    tallest = max(float(each.gaps[0]) for each in curves)
    lowest = level / 6 if level else min(float(each.gaps.min()) for each in curves) / 2
    end = 0.0
    seen: dict[str, str] = {}
    for each in curves:
        name, tau, gaps = each.name, each.tau, each.gaps
        if each.lands:
            label = None if name in seen else f"runs that start off in {mathematics(name)}"
            colour = seen.setdefault(name, SERIES[sum(map(bool, seen)) % len(SERIES)])
            axes.semilogy(tau, np.maximum(gaps, 1e-300), color=colour, lw=1.2, alpha=0.8, label=label)
            below = np.flatnonzero(gaps < level)
            end = max(end, float(tau[below[0]] if below.size else tau[-1]))
        else:
            label = None if "" in seen else "runs that have not landed on it"
            seen[""] = GREY
            axes.semilogy(tau, np.maximum(gaps, 1e-300), color=GREY, lw=1.0, ls=":", label=label)
    # Without one that lands, all of what was run is shown.
    end = end or max(float(each.tau[-1]) for each in curves) / 1.4
    tau = np.array([0.0, LAYER / gap])
    guide = r"$e^{-\mathrm{gap}\,\tau}$, the slowest"
    axes.semilogy(tau, 1.6 * tallest * np.exp(-gap * tau), color=INK, lw=1.0, ls="--", label=guide)
    if level:
        axes.axhspan(level / 100, level, color=PALE, lw=0, zorder=4, label="known no better")
    axes.set_ylim(lowest, 4 * tallest)
    axes.set_xlim(0.0, min(1.4 * end, LAYER / gap))
    legend(axes, columns=3)


def _displaced(analysis: Analysis, run: Trajectory) -> str:
    """The fast variable in which a landing run starts off the manifold."""
    names = [y.name for y in analysis.study.system.y]
    first = run.sample(run.t[:1])
    typical = {name: np.median([other[name][0] for other in analysis.landing]) for name in names}
    return max(names, key=lambda name: abs(first[name][0] - typical[name]))
