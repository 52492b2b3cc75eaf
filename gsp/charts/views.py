"""The views that a scene's author asks for, and units on axes."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from matplotlib.axes import Axes

from gsp.analysis.analysis import Analysis
from gsp.charts.sampling import along, dense_run, reading
from gsp.charts.style import BLUE, GREY, at_epsilon, chart, legend, name_axes, plain, solid_axes
from gsp.scenes.scene import Scene
from gsp.scenes.view import View, view_named
from gsp.systems.arguments import check_noun


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
    check_noun(analysis, Analysis, verb="charts.view")
    return _view(_Seen(analysis, view_named(analysis.scene.views, name)))


@chart(solid=lambda seen: seen.view.z is not None)
def _view(seen: _Seen, axes: Axes) -> None:
    names = seen.view.names
    full, limit = dense_run(seen.analysis.full), dense_run(seen.analysis.limit)
    read = partial(reading, seen.analysis)
    for run, colour, width, label in (
        (full, GREY, 2.6, at_epsilon(seen.scene.system.epsilon, seen.scene.epsilon)),
        (limit, BLUE, 1.2, r"limit $\epsilon \to 0$"),
    ):
        axes.plot(*(along(run, name, read) for name in names), color=colour, lw=width, label=label)
    if seen.view.z is None:
        name_axes(axes, *names)
    else:
        solid_axes(axes, names)
    for axis, name in zip("xyz", names, strict=False):
        if name in seen.view.ranges:
            getattr(axes, f"set_{axis}lim")(*seen.view.ranges[name])
    if seen.view.title:
        axes.set_title(plain(seen.view.title, width=60), pad=24.0)
    legend(axes)
