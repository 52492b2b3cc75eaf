"""The chart of a comparison: error against epsilon."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter, NullLocator

from gsp.charts.style import INK, MARKERS, PALE, SERIES, chart, legend, mathematics, plain
from gsp.comparison.comparison import CLEARANCE, Comparison


@chart(height=4.3)
def error_against_epsilon(comparison: Comparison, axes: Axes) -> None:
    """Largest relative error of each order's reduced run against epsilon, with measured and expected slopes."""
    epsilons = np.array(comparison.epsilons)
    smallest = np.finfo(float).eps / 4
    floor = np.array(comparison.floor)
    seen: list[np.ndarray] = []
    guided = False
    for i, (order, values) in enumerate(comparison.errors.items()):
        errors = np.maximum(values, smallest)
        colour, marker = SERIES[i % len(SERIES)], MARKERS[i % len(MARKERS)]
        exact = comparison.is_exact(order)
        if exact:
            # Said in the legend: what is left is rounding, and no curve.
            errors = np.full_like(errors, np.nan)
            label = f"order {order}: exact to rounding"
        elif np.isfinite(comparison.slopes[order]):
            label = f"order {order}: slope {comparison.slopes[order]:.2f}"
            if comparison.expected[order] is not None:
                label += f", expected {comparison.expected[order]}"
        else:
            label = f"order {order}: not measured"
        axes.plot(epsilons, errors, color=colour, marker=marker, ms=5, lw=1.2, label=label, zorder=3)
        clear = np.isfinite(errors) & (errors > CLEARANCE * floor)
        power = comparison.expected[order]
        if clear.any() and power is not None:
            anchor = np.flatnonzero(clear)[-1]
            guide = errors[anchor] * (epsilons / epsilons[anchor]) ** power
            axes.plot(epsilons, guide, color=colour, lw=6, alpha=0.16, solid_capstyle="butt", zorder=1)
            guided = True
        seen.append(errors)
    for i, (name, values) in enumerate(comparison.claims.items()):
        measured = comparison.claim_slopes[name]
        slope = f"slope {measured:.2f}" if np.isfinite(measured) else "no slope"
        axes.plot(
            epsilons, np.maximum(values, smallest), color=INK, marker=("x", "+", "1", "2")[i % 4], lw=1.0,
            ls=((0, (5, 2)), (0, (1, 1.5)))[i % 2], label=f"{plain(name)}: {slope}", zorder=2,
        )  # fmt: skip
        seen.append(np.asarray(values, dtype=float))
    everything = np.concatenate([*seen, floor])
    everything = everything[np.isfinite(everything) & (everything > 0)]
    if not everything.size:
        axes.text(0.5, 0.5, "no errors: runs ended early", ha="center", transform=axes.transAxes)
        everything = np.array([1e-15, 1.0])
    if guided:
        axes.plot(
            [], [], color=SERIES[0], lw=6, alpha=0.16, solid_capstyle="butt", label="bands: expected slopes"
        )
    # An error above 1 says that a run is lost, however large it is: relative errors above 10 are not told apart.
    bottom, top = everything.min() / 10, max(min(everything.max(), 10.0) * 10, 1e-11)
    axes.fill_between(
        epsilons, bottom, floor, color=PALE, lw=0, label="error of the reference itself", zorder=0
    )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(bottom, top)
    axes.set_xlim(epsilons.min() / 1.15, epsilons.max() * 1.15)
    axes.set_xticks(epsilons, [f"{e:.3g}" for e in epsilons])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel(mathematics(str(comparison.scene.system.epsilon)))
    axes.set_ylabel("largest relative error")
    legend(axes, columns=2)
