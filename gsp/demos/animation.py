"""`animate`: a scene as a moving picture for slides, as a GIF or, where ffmpeg is installed, as an MP4."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from gsp.charts.critical_lines import critical_lines
from gsp.charts.motion import Body, Motion, check_motion_name, write_motion
from gsp.charts.sampling import widened
from gsp.charts.style import at_epsilon, plain
from gsp.demos.demo import body_of, looks_of
from gsp.errors import DeclarationError, GspError
from gsp.integration.trajectory import Trajectory, trajectory_of
from gsp.scenes.scene import Scene
from gsp.scenes.study import RTOL, Study, study_of
from gsp.scenes.view import TIME, View, view_named
from gsp.systems.arguments import check_number, check_progress
from gsp.systems.tolerances import absolute_tolerance

# A longer one has more frames than a file for slides should.
LONGEST = 120.0


def animate(
    scene: Scene | Study,
    path: str | Path,
    *,
    view: str | None = None,
    seconds: float = 5.0,
    progress: Callable[[float], object] | None = None,
) -> Path:
    """Write a moving picture of the scene's full run at its epsilon, beside the limit, to `path` (.gif or .mp4).

    It shows the `view` of this name. Without one a scene with a path shows it, with the body if its demo has one; any
    other the plane with which its demo begins, in the same ranges, with the critical manifold where that is a curve.
    A run that goes round and round is shown over whole cycles, so that the film begins where it ends. It lasts
    `seconds`, and time runs evenly. Raises `UnknownNameError` for a name
    that is none of the scene's views, `DeclarationError` for a view in space, `OutputError` for another ending, or when
    the file cannot be written, and what a study raises for a scene that cannot be split.
    """
    study = study_of(scene, verb="animate")
    target = check_motion_name(path)
    check_progress(progress)
    seen = _view(study.scene, view)
    length = check_number(
        seconds,
        what="seconds",
        be=f"a number above 0 and at most {LONGEST:g}",
        above=0.0,
        below=LONGEST * (1 + 1e-12),
    )
    return write_motion(_motion(study, seen), target, seconds=length, progress=progress)


def _view(scene: Scene, name: str | None) -> View | None:
    """The view that is asked for; without a name the first plane one, if the scene has no path."""
    if name is None:
        flat = (view for view in scene.views.values() if view.z is None)
        return None if scene.path is not None else next(flat, None)
    found = view_named(scene.views, name)
    if found.z is not None:
        raise DeclarationError(
            f"the view {name} is in space, and a moving picture shows a plane.",
            f"Draw it standing still: gsp.charts.view(analysis, {name!r}).",
            got=", ".join(found.names),
            value=name,
        )
    return found


def _motion(study: Study, view: View | None = None) -> Motion:
    scene = study.scene
    at = at_epsilon(scene.system.epsilon, scene.epsilon)
    title = f"{_plain_title(scene.title or scene.name or 'a run')}, {at}"
    fast = study.system.y[0].name
    raw = [s.name for s in (*scene.full_flow.states, *scene.full_flow.observables)]
    if view is not None:
        title = _plain_title(view.title) if view.title else title
    elif scene.path is not None:
        body = body_of(scene)
        shown = None
        if body is not None:
            # A film shows outlines; what is named at them, and what states deform, is for the page.
            drawn = [part for part in body["parts"] if part["kind"] == "points" and not part["fixed"]]
            parts = tuple((_outline(part), part["strong"]) for part in drawn)
            shown = Body(body["angle"], parts)
        against = fast if fast in raw else raw[0]
        full = study.full(scene.epsilon)
        return Motion(
            full, _limit(study), scene.path, against, title, body=shown, is_path=True, units=scene.units
        )
    looks = looks_of(scene) if view is None else {}
    plane = (study.system.x[0].name, fast) if view is None else (view.x, view.y)
    plane = tuple(looks.get("axes", plane))
    against = fast if view is None else next((name for name in plane[::-1] if name != TIME), fast)
    against = looks.get("trace", against)
    own = {s.name for s in (*study.system.states, *study.system.observables)}
    if {*plane, against} <= {TIME, *own}:
        # In slow and fast variables, so that the critical manifold is a graph.
        atol = absolute_tolerance(RTOL, study.region, study.start)
        full = trajectory_of(
            study.system, start=study.start, span=scene.span, epsilon=scene.epsilon, rtol=RTOL, atol=atol
        )
    else:
        full = study.full(scene.epsilon)
    is_graph = {*plane} == {s.name for s in study.system.states}
    curve = _critical_curve(study, full, looks.get("ranges", {})) if is_graph else None
    if curve is not None and plane[0] != study.system.states[0].name:
        curve = curve[::-1]
    return Motion(
        full,
        _limit(study),
        plane,
        against,
        title,
        curve=curve,
        ranges=looks.get("ranges", {}) if view is None else view.ranges,
        units=scene.units,
    )


def _plain_title(text: str) -> str:
    return plain(text.replace("_", " "), width=80)


def _limit(study: Study) -> Trajectory | None:
    """The run of order 0, where there is one from this start."""
    scene = study.scene
    start = {**study.start, **scene.reconstruction_start}
    atol = absolute_tolerance(RTOL, study.region, start)
    try:
        return trajectory_of(
            study.reduced(0), start=start, span=scene.span, epsilon=scene.epsilon, rtol=RTOL, atol=atol
        )
    except GspError:
        # The picture of the full run is true without it.
        return None


def _critical_curve(
    study: Study, full: Trajectory, ranges: Mapping[str, tuple[float, float]]
) -> np.ndarray | None:
    """Points (2, k) of the critical manifold around the run, with gaps; None where there is no real one."""
    run = [np.append(full[s.name], ranges.get(s.name, ())) for s in study.system.states]
    # The critical manifold is drawn so far beside the run, in terms of its width.
    low, high = widened(np.array([min(r) for r in run]), np.array([max(r) for r in run]), 0.15)
    lines = critical_lines(study.system, low, high)
    return np.concatenate([np.insert(line, 0, np.nan, axis=0) for line in lines]).T if lines else None


def _outline(part: dict) -> np.ndarray:
    points = np.array(part["points"], dtype=float)
    return np.vstack([points, points[:1]]) if part["closed"] else points
