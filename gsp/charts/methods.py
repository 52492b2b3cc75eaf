"""Charts of approximations side by side: methods for the slow manifold, and a composite expansion."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from gsp.charts.sampling import LINE, margins
from gsp.charts.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    LINES,
    MARKERS,
    SERIES,
    VERMILION,
    chart,
    legend,
    mathematics,
)
from gsp.comparison.method_table import MethodTable
from gsp.fibres.composite_solution import CompositeSolution
from gsp.integration.trajectory import Trajectory
from gsp.systems.arguments import check_among

# A colour a family of methods, in the order of the table.
FAMILIES = (*SERIES, INK, GREY)


@chart(height=4.4)
def method_errors(table: MethodTable, axes: Axes) -> None:
    """Largest error of every method against epsilon; one colour a method, one line style an order.

    The fitted power of epsilon stands in the legend.
    """
    families: dict[str, list] = {}
    for row in table.rows:
        families.setdefault(row.method, []).append(row)
    for i, rows in enumerate(families.values()):
        for j, row in enumerate(rows):
            fitted = f", {row.fitted:.2f}" if np.isfinite(row.fitted) else ""
            axes.loglog(
                table.epsilons,
                np.maximum(row.errors, 1e-17),
                color=FAMILIES[i % len(FAMILIES)],
                ls=LINES[j % len(LINES)],
                marker=MARKERS[i % len(MARKERS)],
                ms=4,
                lw=1.2,
                label=row.label + fitted,
            )
    axes.set_xticks(table.epsilons, [f"{epsilon:.3g}" for epsilon in table.epsilons])
    axes.minorticks_off()
    axes.set_xlabel(mathematics(str(table.scene.system.epsilon)))
    axes.set_ylabel(r"largest error of $h_\epsilon$")
    legend(axes, columns=3)


@chart()
def composite(solution: CompositeSolution, axes: Axes, *, name: str, full: Trajectory | None = None) -> None:
    """One variable of a composite expansion with its inner and outer parts, against the full run, log time."""
    check_among(name, solution.names, "name is that of a variable of the expansion.", "They are")
    t0, t1 = float(solution.t[0]), float(solution.t[-1])
    layer = min(solution.layer_time, t1 - t0)
    t = t0 + np.geomspace(1e-3 * layer, t1 - t0, LINE)
    sampled = solution.sample(t)
    if full is not None:
        axes.semilogx(t - t0, full.sample(t)[name], color=INK, lw=3.5, alpha=0.25, label="full run")
    row = solution.names.index(name)
    axes.semilogx(t - t0, solution.outer_at(t)[row], color=BLUE, lw=1.1, ls="--", label="outer: slow flow")
    axes.semilogx(t - t0, solution.inner_at(t)[row], color=GREEN, lw=1.4, ls=":", label="inner: layer")
    axes.semilogx(t - t0, sampled[name], color=VERMILION, lw=1.4, label="composite")
    # The inner expansion leaves the picture once its time is over.
    axes.set_ylim(*margins(np.append(sampled[name], solution.outer_at(t)[row])))
    axes.set_xlabel("slow time $t$ since the start, logarithmic")
    axes.set_ylabel(mathematics(name))
    legend(axes, columns=4)
