"""Further starts by name, and units as text: in scenes, in model files, from XPPAUT's files and on the command line."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

import gsp
from gsp.cli import cli
from gsp.errors import DeclarationError, ModelFileError, UnknownNameError
from gsp.readers.loading import import_model
from gsp.readers.toml import read_model
from gsp.scenes.settings import ask_again

MODEL = """
[parameters]
k = 2
[slow]
x = "-k*x"
[fast]
y = "x - y"
[reconstruction]
s = "x"
[region]
x = [0, 2]
[start]
x = 1
y = 1
[scene]
span = [0, 1]
epsilon = 0.01
[starts.low]
x = "1/4"
[starts.far]
x = 5
s = 3
[units]
x = "mM"
k = "1/s"
t = "s"
epsilon = "-"
"""


def scene() -> gsp.Scene:
    return read_model(MODEL, name="enzyme")


def test_a_start_has_what_differs_and_the_rest_of_the_scene() -> None:
    low = scene().starting("low")
    assert dict(low.full_start) == {"x": 0.25, "y": 1.0, "s": 0.0}
    assert low.starts == scene().starts
    assert gsp.integrate(low).y[0, 0] == 0.25
    with pytest.raises(UnknownNameError, match="low, far"):
        scene().starting("lo")


def test_a_start_outside_the_region_is_refused_when_it_is_asked_for() -> None:
    with pytest.raises(DeclarationError, match="outside the region: x = 5"):
        scene().starting("far")
    wide = ask_again(scene(), start="far", region={"x": (0.0, 9.0)})
    assert dict(wide.full_start) == {"x": 5.0, "y": 1.0, "s": 3.0}
    with pytest.raises(UnknownNameError):
        ask_again(scene(), start="near")


def test_units_are_shown_and_kept() -> None:
    shown = str(scene())
    assert "x = 1 mM, y = 1" in shown
    assert "start low  x = 0.25 mM" in shown
    assert "x in mM, k in 1/s, t in s, epsilon in -" in shown


def test_no_unit_is_written_behind_a_number() -> None:
    plain = replace(scene(), units={"x": "mM", "k": "1", "t": " 1 "})
    assert plain.units == {"x": "mM"}
    assert plain == replace(scene(), units={"x": "mM"})


def test_they_are_saved_and_travel(tmp_path: Path) -> None:
    path = gsp.save(scene(), tmp_path / "enzyme.toml")
    assert gsp.load(path) == scene()
    assert pickle.loads(pickle.dumps(scene())) == scene()
    assert replace(scene(), units={}) != scene()
    assert replace(scene(), starts={}) != scene()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"starts": {"low": {"z": 1.0}}}, 'the start low names "z", which is no state'),
        ({"starts": {"a b": {"x": 1.0}}}, "the name of a start is a plain word"),
        ({"starts": {"low": {"x": float("nan")}}}, "the start low"),
        ({"starts": [1]}, "starts maps names"),
        ({"units": {"z": "mM"}}, "units names 'z'"),
        ({"units": {"x": ""}}, "the unit of x is text of 1 to 40"),
        ({"units": {"x": "m\nM"}}, "the unit of x"),
        ({"units": {"x": "m" * 41}}, "the unit of x"),
        ({"units": {"x": "m\u202eM"}}, "the unit of x"),
        ({"units": {"x": 1}}, "the unit of x"),
        ({"units": "mM"}, "units maps names to text"),
    ],
)
def test_what_is_no_start_and_no_unit_is_refused(change: dict, words: str) -> None:
    with pytest.raises(DeclarationError) as caught:
        replace(scene(), **change)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("[starts]\nlow = 1", "starts.low is a table of numbers"),
        ("[starts.low]\nx = true", "starts.low.x"),
        ("[units]\nx = 1", "units.x is text"),
        ("\n".join(f"[starts.s{i}]\nx = 1" for i in range(65)), "starts holds 65 tables; 64 are allowed"),
    ],
)
def test_a_file_says_where_it_is_wrong(line: str, words: str) -> None:
    with pytest.raises((ModelFileError, DeclarationError)) as caught:
        read_model(MODEL.partition("[starts.low]")[0] + line, name="wrong")
    assert words in str(caught.value)


def test_sets_of_initial_values_in_an_ode_file_are_starts(tmp_path: Path) -> None:
    path = tmp_path / "model.ode"
    path.write_text(
        "par eps=.01,a=1\nx'=(y-x)/eps\ny'=-a*y\ninit x=1,y=1\nset calm {x=.5,Y=.25}\nset loud {x=1,a=3}\ndone\n"
    )
    found = import_model(path)
    made = gsp.load(path)
    assert {name: dict(start) for name, start in made.starts.items()} == {"calm": {"x": 0.5, "y": 0.25}}
    assert any("set loud (line 6)" in note for note in found.notes)
    assert "set calm" not in " ".join(found.notes)


def test_the_command_line_asks_from_another_start(tmp_path: Path) -> None:
    path = tmp_path / "enzyme.toml"
    path.write_text(MODEL)
    shown = CliRunner().invoke(cli, ["run", str(path), "--start", "low", "--json"], catch_exceptions=False)
    assert json.loads(shown.stdout)["variables"]["x"]["values"][0] == 0.25
    with pytest.raises(UnknownNameError):
        CliRunner().invoke(cli, ["choose", str(path), "--start", "nowhere"], catch_exceptions=False)
