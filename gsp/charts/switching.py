"""The chart of a simulation: which model carried the solution where."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from gsp.charts.critical_lines import critical_lines
from gsp.charts.sampling import margins
from gsp.charts.style import AMBER, BLUE, GREY, INK, VERMILION, chart, legend, mathematics, name_axes
from gsp.choice.candidates import ModelKind
from gsp.choice.simulation import Simulation
from gsp.errors import DeclarationError, GspError

# The full system lies over the reduced flow: its pieces are short.
LOOKS = {
    ModelKind.REDUCED: (BLUE, 1.5, 3),
    ModelKind.SOLVED: (AMBER, 1.5, 3),
    ModelKind.FULL: (VERMILION, 1.9, 4),
}


@chart()
def switches(simulation: Simulation, axes: Axes, *, names: tuple[str, str] | None = None) -> None:
    """The pieces of a simulation coloured by model, with a dot at each change.

    `names` are the quantities of the two axes, "t" for time; by default the slow and the fast variable where there is
    one of each, over the critical manifold, else a fast one over time.
    """
    plane = _plane(simulation)
    if names is None:
        names = plane or ("t", simulation.names[-1])
    if len(names) != 2:
        raise DeclarationError(
            "names is a pair.", 'Give two names, "t" for time.', got=f"{names!r}", value=names
        )
    drawn: set[str] = set()
    corners: list[np.ndarray] = []
    for piece in simulation.pieces:
        # Beside the ends of its steps a piece is drawn at so many times.
        times = np.union1d(piece.times, np.linspace(piece.begin, piece.end, 120))
        # A time that belongs to two pieces is that of the one before: each piece is sampled from its own run.
        run = piece.run.sample(times)
        across, up = (times if name == "t" else run[name] for name in names)
        colour, width, order = LOOKS[piece.kind]
        label = "full system" if piece.kind is ModelKind.FULL else piece.label
        axes.plot(
            across, up, color=colour, lw=width, zorder=order, label=None if label in drawn else label
        )  # fmt: skip
        drawn.add(label)
        corners.append(np.stack([across, up]))
    places = [[s.time if name == "t" else s.state[name] for name in names] for s in simulation.switches]
    if places:
        x, y = np.array(places).T
        axes.plot(x, y, "o", color="white", mec=INK, mew=0.8, ms=4.2, zorder=6, label="change of model")
    everything = np.hstack(corners)
    axes.set_ylim(*margins(everything[1]))
    if names == plane:
        axes.set_xlim(*margins(everything[0]))
        _critical(simulation, axes)
    name_axes(axes, *names)
    if names[0] == "t":
        axes.set_xlabel("slow time $t$")
        axes.set_ylabel(mathematics(names[1]), rotation=0, labelpad=9.0)
    legend(axes, columns=4)


def _plane(simulation: Simulation) -> tuple[str, str] | None:
    """Names of the slow and the fast variable, if there is one of each."""
    try:
        system = simulation.choice.study.system
    except GspError:
        return None
    return (system.x[0].name, system.y[0].name) if len(system.x) == len(system.y) == 1 else None


def _critical(simulation: Simulation, axes: Axes) -> None:
    """M0 in the plane of one slow and one fast variable."""
    low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
    for line in critical_lines(simulation.choice.study.system, low, high):
        axes.plot(*line.T, color=GREY, lw=0.9, zorder=2)
    axes.plot([], [], color=GREY, lw=0.9, label="$M_0$")
