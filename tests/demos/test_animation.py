"""A scene as a moving picture: what moves is the run, and what cannot be written is refused before any work."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from matplotlib.animation import FuncAnimation
from PIL import Image

import gsp
from gsp import models
from gsp.charts import motion as moving
from gsp.demos import animation
from gsp.demos.demo import body_of
from gsp.errors import DeclarationError, OutputError, UnknownNameError


def frames(path: Path) -> list[np.ndarray]:
    with Image.open(path) as image:
        found = []
        for k in range(image.n_frames):
            image.seek(k)
            found.append(np.asarray(image.convert("RGB")).astype(int))
        return found


def still(motion: moving.Motion) -> FuncAnimation:
    """The last of five frames."""
    figure = moving._animation(motion, 5)
    figure._draw_frame(4)
    # Else matplotlib warns that it was never shown.
    figure._draw_was_started = True
    return figure


@pytest.mark.exhaustive
def test_the_sleigh_moves_and_takes_its_body_along(tmp_path: Path) -> None:
    shares: list[float] = []
    file = gsp.animate(
        models.load("chaplygin_sleigh"), tmp_path / "sleigh.gif", seconds=0.3, progress=shares.append
    )
    found = frames(file)
    assert len(found) == 6
    assert shares[-1] == 1.0
    assert all(np.abs(a - b).max() > 100 for a, b in pairwise(found))


def test_a_body_goes_where_the_run_goes() -> None:
    shown = animation._motion(gsp.study(models.load("chaplygin_sleigh")))
    assert shown.body is not None
    assert shown.plane == ("x", "y")
    figure = still(shown)
    panel = figure._fig.axes[0]
    run = shown.full.sample(np.array([shown.full.t[-1]]))
    place = np.array([run["x"][0], run["y"][0]])
    outlines = [line for line in panel.lines if line.get_zorder() == 4]
    assert len(outlines) == len(shown.body.parts)
    for line, (points, _) in zip(outlines, shown.body.parts):
        drawn = np.column_stack(line.get_data())
        # A turn about the place keeps lengths, and takes the first axis to the heading.
        np.testing.assert_allclose(
            np.linalg.norm(drawn - place, axis=1), np.linalg.norm(points, axis=1), atol=1e-12
        )
    heading = run["phi"][0]
    tip = np.column_stack(outlines[1].get_data())[1] - place
    assert np.arctan2(tip[1], tip[0]) == pytest.approx(np.arctan2(np.sin(heading), np.cos(heading)), abs=1e-12)


def test_the_critical_manifold_is_drawn_where_it_is(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(
        '[slow]\ny = "-x"\n[fast]\nx = "y - x^3/3 + x"\n[region]\ny = [-0.5, 0.5]\nx = [1.2, 2.5]\n'
        "[start]\ny = 0\nx = 1.9\n[scene]\nspan = [0, 4]\nepsilon = 0.01\n"
    )
    shown = animation._motion(gsp.study(gsp.load(tmp_path / "m.toml")))
    assert shown.curve is not None
    y, x = shown.curve
    known = np.isfinite(x)
    np.testing.assert_allclose(y[known], x[known] ** 3 / 3 - x[known], atol=1e-9)
    # The cubic through both folds, not the sheet of the start alone.
    assert x[known].min() < -1.5
    assert x[known].max() > 1.5
    steps = np.abs(np.diff(x))
    assert np.nanmax(steps) < 0.3


@pytest.mark.exhaustive
def test_a_scene_of_three_variables_is_shown_in_a_plane_of_two(tmp_path: Path) -> None:
    shown = animation._motion(gsp.study(models.load("koper")))
    assert shown.curve is None
    assert shown.plane == ("x", "y")
    assert len(frames(gsp.animate(models.load("koper"), tmp_path / "k.gif", seconds=0.1))) == 2


def test_a_changed_sleigh_keeps_its_body_and_another_model_has_none() -> None:
    changed = gsp.study(models.load("chaplygin_sleigh")).asking(epsilon=0.2).scene
    assert body_of(changed) is not None
    assert body_of(models.load("linear")) is None


def test_what_cannot_be_written_is_refused_before_any_work(tmp_path: Path, monkeypatch) -> None:
    def worked(*arguments, **keywords):
        raise AssertionError("work was done")

    monkeypatch.setattr(animation, "_motion", worked)
    scene = models.load("linear")
    with pytest.raises(OutputError, match=r"ends in \.gif or \.mp4"):
        gsp.animate(scene, tmp_path / "film.avi")
    monkeypatch.setattr(moving.FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    with pytest.raises(OutputError, match="ffmpeg, which is not installed"):
        gsp.animate(scene, tmp_path / "film.mp4")
    for seconds in (0.0, -1.0, float("nan"), 121.0):
        with pytest.raises(DeclarationError, match="seconds is a number above 0"):
            gsp.animate(scene, tmp_path / "film.gif", seconds=seconds)
    assert list(tmp_path.iterdir()) == []


SEEN = """
title = "Two tanks"
slow = { s = "-s*c" }
fast = { c = "s - c" }
observables = { total = "s + 2*c" }
region = { s = [0.1, 2], c = [0, 2] }
start = { s = 1, c = 0.2 }
scene = { span = [0, 2], epsilon = 0.05 }
units = { s = "mol", t = "min" }
[views.space]
x = "s"
y = "c"
z = "total"
[views.first]
x = "total"
y = "c"
title = "what there is"
ranges = { c = [0, 1.5] }
[views.later]
x = "t"
y = "s"
"""


def seen(tmp_path: Path) -> gsp.Scene:
    path = tmp_path / "tanks.toml"
    path.write_text(SEEN)
    return gsp.load(path)


def test_a_view_by_name_is_what_moves(tmp_path: Path) -> None:
    study = gsp.study(seen(tmp_path))
    # Without a name the first that is plane, as a demo begins.
    first = animation._motion(study, animation._view(study.scene, None))
    assert (first.plane, first.against_time, first.curve) == (("total", "c"), "c", None)
    left, right = still(first)._fig.axes
    assert first.title == "what there is"
    assert left.get_ylim() == (0.0, 1.5)
    assert right.get_xlabel() == "slow time $t$ (min)"
    later = animation._motion(study, animation._view(study.scene, "later"))
    assert (later.plane, later.against_time) == (("t", "s"), "s")
    left = still(later)._fig.axes[0]
    assert left.get_ylabel() == "$s$ (mol)"
    trail = next(line for line in left.lines if line.get_label() == "full")
    np.testing.assert_allclose(trail.get_xdata()[[0, -1]], [0.0, 2.0])
    np.testing.assert_allclose(trail.get_ydata()[0], 1.0)
    assert len(frames(gsp.animate(study, tmp_path / "later.gif", view="later", seconds=0.1))) == 2


def test_a_view_that_no_film_can_show_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        DeclarationError, match="the view space is in space, and a moving picture shows a plane"
    ):
        gsp.animate(seen(tmp_path), tmp_path / "film.gif", view="space")
    with pytest.raises(UnknownNameError, match="space, first, later"):
        gsp.animate(seen(tmp_path), tmp_path / "film.gif", view="last")
    assert not (tmp_path / "film.gif").exists()


def test_a_demo_has_the_units_for_its_axes(tmp_path: Path) -> None:
    page = gsp.demo(seen(tmp_path)).html
    assert '"units":{"s":"mol","t":"min"}' in page.replace(" ", "")


def test_a_title_is_text_and_no_mathematics(tmp_path: Path) -> None:
    scene = replace(seen(tmp_path), title=r"what $\frac{ costs", views={})
    title = still(animation._motion(gsp.study(scene)))._fig._suptitle.get_text()
    assert title.startswith(r"what \$\frac{ costs, $\epsilon")


def test_the_critical_manifold_is_not_drawn_through_a_pole_beside_the_run() -> None:
    x, y, epsilon = sp.symbols("x y epsilon")
    height = x - sp.Rational(1, 100) / (x - 1)
    system = gsp.SlowFastSystem(slow={x: sp.Integer(-1)}, fast={y: height - y}, epsilon=epsilon)
    scene = gsp.Scene(system, {"x": (1.05, 2)}, {"x": 2, "y": 1}, (0, 0.9), 0.02)
    curve = animation._motion(gsp.study(scene)).curve
    assert curve is not None
    known = np.isfinite(curve).all(axis=0)
    assert set(curve[0][known] > 1) == {True, False}
    np.testing.assert_allclose(curve[1][known], sp.lambdify(x, height)(curve[0][known]), atol=1e-9)
    down = known[:-1] & known[1:]
    assert not (down & (np.diff(curve[0] > 1) != 0)).any()


def test_a_run_that_goes_round_is_shown_over_whole_cycles() -> None:
    scene = replace(models.load("fitzhugh_nagumo"), span=(0, 12))
    system = scene.system.with_parameters(I=0.8)
    run = gsp.integrate(system, start=scene.start, span=(0, 12), epsilon=0.02)
    begun, ended = moving.whole_cycles(run, ("w", "v"))
    assert 0 < begun < ended < 12
    at = run.sample(np.array([begun, ended]))
    for name in ("v", "w"):
        assert at[name][0] == pytest.approx(at[name][1], abs=0.02)
    # As many periods as there are, to a whole number.
    orbit = gsp.periodic_orbit(system, start={n: at[n][0] for n in ("v", "w")}, epsilon=0.02)
    turns = (ended - begun) / orbit.period
    assert turns == pytest.approx(round(turns), abs=0.01)
    assert round(turns) >= 3


def test_a_run_that_comes_to_rest_is_shown_whole() -> None:
    scene = models.load("michaelis_menten")
    full = gsp.study(scene).full(scene.epsilon)
    assert moving.whole_cycles(full, ("s", "c")) == (full.t[0], full.t[-1])


def test_a_film_has_the_axes_of_the_demo() -> None:
    shown = animation._motion(gsp.study(models.load("van_der_pol")))
    assert shown.plane == ("x", "y")
    assert shown.against_time == "x"
    left = still(shown)._fig.axes[0]
    assert (left.get_xlim(), left.get_ylim()) == ((-2.3, 2.5), (-1.1, 1.1))
    assert shown.curve is not None
    x, y = shown.curve
    known = np.isfinite(x)
    np.testing.assert_allclose(y[known], x[known] ** 3 / 3 - x[known], atol=1e-9)
