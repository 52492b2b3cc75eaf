"""Chart of the fast eigenvalues over the region: how far normal hyperbolicity is from being lost."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from gsp.analysis.analysis import Analysis
from gsp.charts.sampling import GRID, LINE, box_points, margins, on_branch
from gsp.charts.style import BLUE, INK, PALE, SERIES, VERMILION, chart, colour_bar, legend, name_axes
from gsp.systems.arguments import check_noun

# Points per axis where more than two slow variables are sampled.
COARSE = 7


def has_constant_eigenvalues(analysis: Analysis) -> bool:
    """Whether the fast eigenvalues are the same all over the region, so that there is nothing to draw over it."""
    check_noun(analysis, Analysis, verb="charts.has_constant_eigenvalues")
    values = np.sort_complex(sampled_eigenvalues(analysis, COARSE)[1])
    values = values[np.isfinite(values).all(axis=1)]
    # Less is no variation at all.
    return bool(
        np.ptp(np.real(values), axis=0).max() + np.ptp(np.imag(values), axis=0).max()
        < 1e-9 * np.abs(values).max()
    )


@chart()
def eigenvalues(analysis: Analysis, axes: Axes) -> None:
    """Fast eigenvalues over the region, in fast time, with the gap marked, and with a ring where a condition fails.

    Real parts along a line for one slow variable; the real part nearest to the axis in colour for two; points in
    the complex plane for more, and where they do not change.
    """
    slow = [x.name for x in analysis.study.system.x]
    still = has_constant_eigenvalues(analysis) and not analysis.hyperbolicity.failing
    if len(slow) > 2 or still:
        _plane(analysis, axes)
    elif len(slow) == 1:
        _line(analysis, axes, slow[0])
    else:
        _map(analysis, axes, slow)


def sampled_eigenvalues(analysis: Analysis, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Grid points (m, n_slow) of the region and the eigenvalues (m, n_fast) there, nan where there is no point."""
    x = box_points(analysis, n)
    y = on_branch(analysis, x)
    good = np.isfinite(y).all(axis=1)
    values = np.full(y.shape, complex(np.nan, np.nan))
    near = None if analysis.study.branch.is_explicit else y[good]
    values[good] = analysis.hyperbolicity.eigenvalues(x[good], near=near)
    return x, values


def _line(analysis: Analysis, axes: Axes, name: str) -> None:
    x, values = sampled_eigenvalues(analysis, LINE)
    real = np.sort(np.real(values), axis=1)
    for i in range(real.shape[1]):
        label = r"$\mathrm{Re}\,\lambda$" if real.shape[1] == 1 else rf"$\mathrm{{Re}}\,\lambda_{{{i + 1}}}$"
        axes.plot(x[:, 0], real[:, i], color=SERIES[i % len(SERIES)], label=label)
    gap = analysis.hyperbolicity.gap
    axes.axhline(0.0, color=INK, lw=0.8)
    axes.axhspan(-gap, gap, color=PALE, lw=0, zorder=0, label=f"gap {analysis.hyperbolicity.shown_gap(4)}")
    nearest = np.min(np.abs(real), axis=1) * np.sign(
        real[np.arange(len(real)), np.argmin(np.abs(real), axis=1)]
    )
    # Beyond a fold the branch has no point, and no eigenvalue.
    known = np.isfinite(nearest)
    lost = {loss.point[name]: loss.eigenvalue.real for loss in analysis.hyperbolicity.losses}

    def height(at: float) -> float:
        return lost[at] if at in lost else float(np.interp(at, x[known, 0], nearest[known]))

    _ring(axes, [(at, height(at)) for (at,) in _failing(analysis, [name])])
    axes.set_xlim(x[0, 0], x[-1, 0])
    low, high = margins(np.append(real.ravel(), 0.0), 0.08)
    axes.set_ylim(low, high)
    name_axes(axes, name)
    axes.set_ylabel(r"$\mathrm{Re}\,\lambda$ in fast time")
    legend(axes)


def _map(analysis: Analysis, axes: Axes, names: list[str]) -> None:
    x, values = sampled_eigenvalues(analysis, GRID)
    real = np.real(values)
    finite = np.isfinite(real).all(axis=1)
    nearest = np.where(finite, np.argmin(np.where(np.isfinite(real), np.abs(real), np.inf), axis=1), 0)
    shown = np.where(finite, real[np.arange(len(real)), nearest], np.nan)
    u, v = (np.unique(x[:, i]) for i in range(2))
    picture = axes.pcolormesh(u, v, shown.reshape(len(u), len(v)).T, cmap="cividis", shading="gouraud")
    colour_bar(axes, picture, r"$\mathrm{Re}\,\lambda$ nearest to 0, in fast time")
    worst = int(np.nanargmin(np.abs(shown)))
    failing = _failing(analysis, names)
    label = "fails here" if failing else f"least of the samples: {analysis.hyperbolicity.sampled_gap:.4g}"
    _ring(axes, failing or [tuple(x[worst])], label)
    name_axes(axes, *names)
    legend(axes)


def _failing(analysis: Analysis, names: list[str]) -> list[tuple[float, ...]]:
    """Points of the region at which a condition fails, in the coordinates `names`."""
    return [tuple(point[name] for name in names) for point in analysis.hyperbolicity.failing]


def _ring(axes: Axes, points: list[tuple[float, ...]], label: str = "fails here") -> None:
    """A ring around each point, and one line for all of them in the legend."""
    if points:
        ring = {"mfc": "none", "color": VERMILION, "ms": 9, "mew": 1.8, "ls": "none", "clip_on": False}
        axes.plot(*np.transpose(points), "o", label=label, zorder=5, **ring)


def _plane(analysis: Analysis, axes: Axes) -> None:
    values = sampled_eigenvalues(analysis, COARSE)[1].ravel()
    values = values[np.isfinite(values)]
    real, imaginary = np.real(values), np.imag(values)
    gap = analysis.hyperbolicity.gap
    axes.axvline(0.0, color=INK, lw=0.8)
    axes.axvspan(-gap, gap, color=PALE, lw=0, zorder=0, label=f"gap {analysis.hyperbolicity.shown_gap(4)}")
    axes.plot(real, imaginary, ".", color=BLUE, ms=5, ls="none", label=r"$\lambda$ over the region")
    if analysis.hyperbolicity.failing and not analysis.hyperbolicity.shortfall:
        worst = int(np.argmin(np.abs(real)))
        _ring(axes, [(real[worst], imaginary[worst])])
    axes.set_xlim(*margins(np.append(real, [0.0, 0.2 * gap]), 0.08))
    axes.set_ylim(*margins(np.append(imaginary, [-gap, gap]), 0.08))
    axes.set_xlabel(r"$\mathrm{Re}\,\lambda$ in fast time")
    axes.set_ylabel(r"$\mathrm{Im}\,\lambda$")
    legend(axes)
