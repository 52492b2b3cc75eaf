"""Charts of single runs: the states of a trajectory over time, and a closed orbit over one period."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from gsp.charts.sampling import dense_run
from gsp.charts.style import INK, SERIES, chart, legend, mathematics
from gsp.integration.trajectory import Trajectory
from gsp.orbits.periodic.orbit import PeriodicOrbit

# Points of a closed orbit, as dense as its mesh.
POINTS = 1500
STYLES = ("-", "--", ":", "-.")


@chart()
def trajectory(run: Trajectory, axes: Axes) -> None:
    """Every state of a run over time."""
    dense = dense_run(run) if run._record.dense.size else run
    _lines(axes, dense.t, {s.name: dense[s.name] for s in run.flow.states})
    axes.set_xlabel("$t$")


@chart()
def periodic_orbit(orbit: PeriodicOrbit, axes: Axes) -> None:
    """Every state of a closed orbit over one period."""
    phases = np.linspace(0.0, 1.0, POINTS)
    dense = np.interp(phases, np.linspace(0.0, 1.0, len(orbit.phases)), orbit.phases)
    _lines(axes, orbit.period * dense, {s.name: orbit.values(s.name, dense) for s in orbit.flow.states})
    axes.set_xlabel("$t$, over one period")


def _lines(axes: Axes, t: np.ndarray, states: dict[str, np.ndarray]) -> None:
    colours = (*SERIES, INK)
    for i, (name, values) in enumerate(states.items()):
        style = STYLES[i // len(colours) % len(STYLES)]
        axes.plot(t, values, color=colours[i % len(colours)], ls=style, label=mathematics(name))
    axes.margins(x=0.01)
    axes.set_ylabel("states")
    legend(axes, columns=6)
