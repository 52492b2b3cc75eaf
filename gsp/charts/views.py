"""The views that a scene's author asks for, and units on axes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from gsp.analysis.analysis import Analysis
from gsp.charts.sampling import dense_run, reading
from gsp.charts.style import BLUE, GREY, at_epsilon, chart, legend, mathematics, name_axes, plain
from gsp.errors import unknown_name
from gsp.integration.trajectory import Trajectory
from gsp.scenes.scene import Scene
from gsp.scenes.view import TIME, View


class _Seen(NamedTuple):
    """An analysis, and the view that is drawn of it."""

    analysis: Analysis
    view: View

    @property
    def scene(self) -> Scene:
        """Whose units stand on the axes."""
        return self.analysis.scene


def view(analysis: Analysis, name: str) -> Axes:
    """The full run and the limit in the view called `name` of the scene.

    Raises `UnknownNameError` for a name that is none of the scene's views.
    """
    views = analysis.scene.views
    if name not in views:
        raise unknown_name(name, views)
    return _view(_Seen(analysis, views[name]))


@chart(solid=lambda seen: seen.view.z is not None)
def _view(seen: _Seen, axes: Axes) -> None:
    names = seen.view.names
    full, limit = dense_run(seen.analysis.full), dense_run(seen.analysis.limit)
    for run, colour, width, label in (
        (full, GREY, 2.6, at_epsilon(seen.scene.epsilon)),
        (limit, BLUE, 1.2, r"limit $\epsilon \to 0$"),
    ):
        axes.plot(*(_along(seen.analysis, run, name) for name in names), color=colour, lw=width, label=label)
    name_axes(axes, *names[:2])
    if len(names) == 3:
        axes.set_zlabel(mathematics(names[2]))  # pyright: ignore[reportAttributeAccessIssue]
    for axis, name in zip("xyz", names, strict=False):
        if name in seen.view.ranges:
            getattr(axes, f"set_{axis}lim")(*seen.view.ranges[name])
    if seen.view.title:
        axes.set_title(plain(seen.view.title, width=60), pad=24.0)
    legend(axes)


def _along(analysis: Analysis, run: Trajectory, name: str) -> np.ndarray:
    known = (s.name for s in (*run.flow.states, *run.flow.observables))
    return run.t if name == TIME and TIME not in known else reading(analysis, run, name)
