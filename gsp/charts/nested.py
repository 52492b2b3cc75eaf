"""Chart of a nested reduction: the whole system beside the flow on the manifold within the manifold."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from gsp.charts.style import INK, chart, legend, looks, mathematics
from gsp.integration.trajectory import trajectory_of
from gsp.nested.nesting import Nesting
from gsp.systems.tolerances import RTOL, absolute_tolerance


@chart()
def nesting(found: Nesting, axes: Axes) -> None:
    """The states from the scene's start, over logarithmic time, and dashed the flow on C2 through first order.

    One after the other the states come to C1, to C2 and move along it; vertical lines end the first two of these.
    """
    scene, second = found.scene, found.second
    first, last = scene.span
    gaps = found.first.hyperbolicity.gap / scene.epsilon, second.hyperbolicity.gap
    layers = [1.0 / gap for gap in gaps]
    # Times, spread over the decades from the fastest time scale on.
    late = np.geomspace(min(layers) / 10.0, abs(last - first), 400)
    times = first + np.sign(last - first) * np.concatenate([[0.0], late])
    times[-1] = last
    atol = absolute_tolerance(RTOL, scene.region, scene.full_start)
    full = trajectory_of(found.ray, scene.start, scene.span, 1.0, atol=atol, at=times)
    flow, base = second.reduced(min(1, found.order)), second.base_point(min(1, found.order))
    reduced = trajectory_of(flow, base, scene.span, 1.0, atol=atol, at=times)
    known = {s.name for s in (*flow.states, *flow.observables)}
    names = [s.name for s in found.ray.states if s.name in known]
    for name, look in zip(names, looks()):
        axes.plot(late[: len(full.t) - 1], full[name][1:], **look, label=mathematics(name))
        axes.plot(late[: len(reduced.t) - 1], reduced[name][1:], "--", color=look["color"])
    for end in layers:
        axes.axvline(end, color=INK, lw=0.6, ls=":")
    axes.set_xscale("log")
    axes.set_xlabel("time since the start")
    axes.set_ylabel("states")
    legend(axes, columns=6)
