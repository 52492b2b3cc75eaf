"""Chart of an averaging: a state of the whole system, and what of it moves slowly."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from gsp.averaging.averaging import Averaging
from gsp.charts.style import BLUE, GREY, VERMILION, chart, legend, mathematics
from gsp.errors import DeclarationError
from gsp.integration.trajectory import trajectory_of
from gsp.systems.arguments import check_among
from gsp.systems.tolerances import RTOL, absolute_tolerance


@chart(height=3.9)
def averaging(found: Averaging, axes: Axes, *, name: str | None = None) -> None:
    """A slow variable along the full run from the scene's start, and along the averaged run, over slow time.

    `name` is a slow variable, the first unless given. Where it is the amplitude of a pair, the pair's first state is
    drawn behind it.
    """
    scene = found.scene
    if scene is None:
        raise DeclarationError("an averaging of a scene is drawn, which says from where.", got=repr(found))
    slow = [s.name for s in found.form.rates]
    shown = slow[0] if name is None else name
    check_among(shown, slow, "name is that of a slow variable.", "They are")
    # Times at which runs are drawn: the phase turns some hundred times at most where a turn can be seen.
    times = np.linspace(*scene.span, 4000)
    atol = absolute_tolerance(RTOL, scene.region, scene.full_start)
    full = trajectory_of(found.watched, scene.start, scene.span, scene.epsilon, atol=atol, at=times)
    base = found.base_point(scene.start, epsilon=scene.epsilon)
    run = trajectory_of(found.with_phase(), base, scene.span, scene.epsilon, atol=atol, at=times)
    symbol = next(s for s in found.form.rates if s.name == shown)
    hidden = [z.name for z in found.system.states if z not in found.form.coordinates]
    if hidden and found.form.phase not in found.system.states:
        axes.plot(full.t, full[hidden[0]], color=GREY, lw=0.6, zorder=1, label=mathematics(hidden[0]))
    values = full[found.named_in_full[symbol].name]
    axes.plot(full.t, values, color=BLUE, lw=1.0, zorder=2, label=f"{mathematics(shown)}, full")
    label = f"{mathematics(shown)}, averaged through order {found.order}"
    axes.plot(run.t, run[shown], color=VERMILION, lw=1.8, zorder=3, label=label)
    axes.set_xlabel("slow time")
    axes.set_ylabel(mathematics(shown))
    legend(axes, columns=3)
