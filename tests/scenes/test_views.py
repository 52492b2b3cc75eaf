"""Views of a scene: declared, refused by name, kept in files, drawn in reports and demos; units on axes."""

from __future__ import annotations

import copy
import json
import pickle
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest

import gsp
from gsp import charts
from gsp.errors import DeclarationError, ModelFileError, UnknownNameError
from gsp.readers.foreign import imported
from gsp.readers.toml import parsed, read_model, scene_of
from gsp.readers.writing import as_toml
from gsp.readers.xppaut import read_ode
from gsp.scenes.view import View

MODEL = """
[parameters]
kappa = 1
[slow]
s = "-s + (s + kappa - 0.5)*c"
[fast]
c = "s - (s + kappa)*c"
[observables]
total = "s + c"
[region]
s = [0.05, 2]
[start]
s = 1
c = 0
[scene]
span = [0, 5]
epsilon = 0.05
"""
VIEWS = """
[units]
s = "mM"
t = "min"
[views.course]
x = "t"
y = "total"
title = "What is left"
ranges = { t = [0, 4] }
[views.room]
x = "s"
y = "c"
z = "t"
"""


def test_a_model_file_has_views_and_keeps_them() -> None:
    scene = read_model(MODEL + VIEWS, name="m")
    assert list(scene.views) == ["course", "room"]
    course = scene.views["course"]
    assert (course.names, course.title, dict(course.ranges)) == (
        ("t", "total"),
        "What is left",
        {"t": (0.0, 4.0)},
    )
    assert scene.views["room"].names == ("s", "c", "t")
    assert read_model(as_toml(scene), name="m") == scene
    assert scene != replace(scene, views={})
    for arrived in (pickle.loads(pickle.dumps(scene)), copy.copy(scene), copy.deepcopy(scene)):
        assert arrived == scene
        assert hash(arrived) == hash(scene)
    assert "view course  total against t" in str(scene)
    schema = json.loads((Path(gsp.__file__).parent / "readers/model.schema.json").read_text())
    jsonschema.validate(json.loads(json.dumps(parsed(MODEL + VIEWS), default=float)), schema)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[views.a]\nx = "t"\ny = "q"', "the view a shows 'q', which is no state"),
        ('[views.a]\nx = "t"\ny = "kappa"', "the view a shows 'kappa', which is no state"),
        ('[views.a]\nx = "s"\ny = "s"', "the view a shows a quantity twice"),
        ('[views.a]\nx = "s"', "views.a.y is missing"),
        ('[views.a]\nx = "s"\ny = "c"\nw = "t"', "views.a.w is unknown"),
        ('[views.a]\nx = 1\ny = "c"', "views.a.x is text"),
        ('[views.a]\nx = "s"\ny = "c"\nranges = {t = [0, 1]}', "has a range of 't', which it does not show"),
        ('[views.a]\nx = "s"\ny = "c"\nranges = {s = [1, 0]}', "the range of s in the view a"),
        ('[views.a]\nx = "s"\ny = "c"\nranges = {s = 1}', "views.a.ranges.s is a list of numbers"),
        ('[views."a b"]\nx = "s"\ny = "c"', "the name of a view is a plain word"),
        ('[views]\na = 1', "views.a is a table"),
        ('[views.a]\nx = "s"\ny = "c"\ntitle = "a\\u001bb"', "the title of the view a"),
        ("\n".join(f'[views.v{i}]\nx = "s"\ny = "c"' for i in range(17)), "views holds 17 tables"),
    ],
)  # fmt: skip
def test_a_bad_view_is_refused_by_name(text: str, words: str) -> None:
    with pytest.raises((ModelFileError, DeclarationError)) as caught:
        read_model(MODEL + text, name="m")
    assert words in str(caught.value), str(caught.value)


@pytest.mark.exhaustive
def test_the_report_and_the_demo_show_the_views() -> None:
    scene = read_model(
        MODEL + VIEWS.replace("[views.course]", '[views.plane]\nx = "c"\ny = "s"\n[views.course]'), name="m"
    )
    analysis = gsp.analyse(scene, order=1)
    drawn = gsp.charts.applicable(analysis)
    assert [name for name in drawn if name.startswith("view_")] == ["view_plane", "view_course", "view_room"]
    axes = drawn["view_course"](analysis)
    assert axes.get_xlim() == (0.0, 4.0)
    assert axes.get_title() == "What is left"
    assert axes.get_xlabel() == "$t$ (min)"
    # A long name lies along its axis, where it meets no number.
    assert axes.yaxis.label.get_rotation() == 90
    assert drawn["view_room"](analysis).name == "3d"
    assert drawn["view_plane"](analysis).get_ylabel() == "$s$ (mM)"
    assert drawn["phase_portrait"](analysis).get_xlabel() == "$s$ (mM)"
    with pytest.raises(UnknownNameError, match="corse"):
        gsp.charts.view(analysis, "corse")
    assert '"axes": ["c", "s"]' in gsp.demo(scene).html.replace('"axes":["c","s"]', '"axes": ["c", "s"]')


@pytest.mark.exhaustive
def test_a_report_keeps_no_view_of_an_older_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # One figure beside the views.
    drawn = charts.applicable
    kept = ("time_series", "view_course", "view_room")
    monkeypatch.setattr(
        charts, "applicable", lambda analysis: {name: d for name, d in drawn(analysis).items() if name in kept}
    )
    scene = read_model(MODEL + VIEWS, name="m")
    page = gsp.write_report(gsp.analyse(scene, order=1), tmp_path)
    assert "What is left" in page.read_text()
    assert (tmp_path / "view_course.png").is_file()
    gsp.write_report(gsp.analyse(replace(scene, views={}), order=1), tmp_path)
    assert not (tmp_path / "view_course.png").is_file()


def test_plot_settings_of_xppaut_are_a_view() -> None:
    text = "par eps=.1\nx'=(y-x)/eps\ny'=-y\ninit y=1\n@ {}\ndone\n"

    def views(settings: str, text: str = text) -> dict:
        model = read_ode(text.format(settings))
        return dict(imported(model, small=None, read=lambda d: scene_of(parsed(d), Path("m.ode")))[1].views)

    assert views("xp=t,yp=y,xlo=0,xhi=10,ylo=-1,yhi=1,total=10") == {
        "plot": View("t", "y", ranges={"t": (0.0, 10.0), "y": (-1.0, 1.0)})
    }
    assert views("xp=x, yp=y, zp=t, axes=3d") == {"plot": View("x", "y", "t")}
    assert views("yp=x") == {"plot": View("t", "x")}
    assert views("xp=nobody,yp=x") == {}
    assert views("total=10") == {}
