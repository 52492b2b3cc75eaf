"""Charts of runs: the states of a trajectory over time, a closed orbit over one period, an ensemble's members."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from gsp.charts.sampling import dense_run
from gsp.charts.style import BLUE, INK, chart, legend, looks, mathematics
from gsp.errors import DeclarationError
from gsp.integration.ensemble import Ensemble
from gsp.integration.trajectory import Trajectory
from gsp.orbits.periodic.orbit import PeriodicOrbit

# Points of a closed orbit.
POINTS = 1500


@chart()
def trajectory(run: Trajectory, axes: Axes) -> None:
    """Every state of a run over time."""
    dense = dense_run(run) if run._record.dense.size else run
    _lines(axes, dense.t, {s.name: dense[s.name] for s in run.flow.states})
    axes.set_xlabel("$t$")


@chart()
def periodic_orbit(orbit: PeriodicOrbit, axes: Axes) -> None:
    """Every state of a closed orbit over one period."""
    dense = dense_phases(orbit)
    _lines(axes, orbit.period * dense, {s.name: orbit.values(s.name, dense) for s in orbit.flow.states})
    axes.set_xlabel("$t$, over one period")


@chart()
def spread(ensemble: Ensemble, axes: Axes, *, name: str) -> None:
    """A state or an observable over time: median, the middle half and nine tenths of the members, and some of them.

    At each time the members count that reached it. Raises `DeclarationError` when fewer than two times were reached.
    """
    values = ensemble[name]
    reached = ~np.isnan(values).all(axis=0)
    t, values = ensemble.t[reached], values[:, reached]
    if t.size < 2:
        raise DeclarationError(
            "a spread over time needs two times or more that a member reached.",
            "Integrate with at=[...].",
            got=t.size,
        )
    # Opaque, so that the legend shows the colours that are seen.
    for low, high, colour in ((5, 95, "#DBEAF4"), (25, 75, "#A8CDE5")):
        bottom, top = np.nanpercentile(values, [low, high], axis=0)
        axes.fill_between(t, bottom, top, color=colour, lw=0, label=f"{low} to {high} %", zorder=1)
    # Members drawn one by one, spread evenly over their indices.
    chosen = np.unique(np.linspace(0, len(ensemble) - 1, 24).round().astype(int))
    for k, i in enumerate(chosen):
        label = f"{chosen.size} of {len(ensemble)} members" if k == 0 else None
        axes.plot(t, values[i], color=INK, lw=0.4, alpha=0.55, label=label, zorder=2)
    axes.plot(t, np.nanmedian(values, axis=0), color=BLUE, lw=1.8, label="median", zorder=3)
    axes.set_xlabel("slow time $t$")
    axes.set_ylabel(mathematics(name))
    axes.set_xlim(min(t[0], t[-1]), max(t[0], t[-1]))
    legend(axes, columns=4)


def dense_phases(orbit: PeriodicOrbit) -> np.ndarray:
    """Phases of a closed orbit, as dense as its mesh, which is dense where it is fast."""
    mesh = np.linspace(0.0, 1.0, len(orbit.phases))
    return np.interp(np.linspace(0.0, 1.0, POINTS), mesh, orbit.phases)


def _lines(axes: Axes, t: np.ndarray, states: dict[str, np.ndarray]) -> None:
    for look, (name, values) in zip(looks(), states.items()):
        # A run of one point is no line.
        axes.plot(t, values, **look, marker="o" if len(t) == 1 else None, label=mathematics(name))
    axes.margins(x=0.01)
    axes.set_ylabel("states")
    legend(axes, columns=6)
