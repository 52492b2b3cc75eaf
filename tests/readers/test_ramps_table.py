"""Tables [ramps.NAME]: what they say, what is refused, and that they are kept."""

from __future__ import annotations

import copy
import json
import pickle
from dataclasses import replace
from importlib.resources import files

import jsonschema
import pytest
import sympy as sp
from click.testing import CliRunner

from gsp.cli import cli  # pyright: ignore[reportAttributeAccessIssue]
from gsp.errors import GspError
from gsp.readers.toml import parsed, read_model
from gsp.readers.writing import as_toml
from gsp.systems.ramp import PHASE, Ramp

l, mu = sp.symbols("l mu")  # noqa: E741
MODEL = """
[parameters]
mu = 1
l = 0

[states]
x = "(x + l)^2 - mu"

[start]
x = -1

[scene]
span = [0, 5]
"""
RAMPS = """
[ramps.steep]
profile = "tanh"
parameters = {l = [0, 3]}
edge = {x = -2}

[ramps.issue]
profile = "logistic"
parameters = {l = [0, "5/2"]}
edge = {x = -1.5}

[ramps.endless]
profile = "linear"
parameters = {l = 0}

[ramps.falling]
profile = "linear"
parameters = {l = [0, -2]}
start = {x = -1.1}

[ramps.stops]
profile = "linear with ends"
parameters = {l = [0, 3]}
edge = {x = -2}

[ramps.back]
profile = "there and back"
parameters = {l = [0, 5], mu = [1, 2]}
edge = {x = 1}

[ramps.own]
profile = "sin(phase)*mu"
ends = [0, "pi/2"]
parameters = {l = "3*sin(phase)"}
edge = {x = -2}
"""


def test_profiles_are_those_of_ramps() -> None:
    scene = read_model(MODEL + RAMPS, name="m")
    ramps = {name: asked.ramp for name, asked in scene.ramps.items()}
    assert ramps == {
        "steep": Ramp.tanh({l: (0, 3)}),
        "issue": Ramp.logistic({l: (0, sp.Rational(5, 2))}),
        "endless": Ramp.linear({l: 0}),
        "falling": Ramp.linear({l: (0, -2)}),
        "stops": Ramp.linear_with_ends({l: (0, 3)}),
        "back": Ramp.there_and_back({l: (0, 5), mu: (1, 2)}),
        "own": Ramp({l: 3 * sp.sin(PHASE)}, mu * sp.sin(PHASE), (0, sp.pi / 2)),
    }
    assert dict(scene.ramps["falling"].start) == {"x": -1.1}
    assert dict(scene.ramps["steep"].edge) == {"x": -2.0}


def test_an_edge_that_names_one_state_of_several_is_a_level() -> None:
    two = MODEL.replace("[states]", '[states]\nw = "-w"').replace("[start]", "[start]\nw = 0")
    table = '[ramps.up]\nprofile = "tanh"\nparameters = {l = [0, 1]}\nedge = {x = 5}\n'
    scene = read_model(f"{two}\n{table}", name="m")
    assert dict(scene.ramps["up"].edge) == {"x": 5.0}
    assert read_model(as_toml(scene), name="m") == scene


def test_ramps_are_kept() -> None:
    scene = read_model(MODEL + RAMPS, name="m")
    assert read_model(as_toml(scene), name="m") == scene
    assert scene != replace(scene, ramps={})
    for arrived in (pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene)):
        assert (arrived, hash(arrived)) == (scene, hash(scene))
    assert "ramp steep" in str(scene)
    schema = json.loads(files("gsp.readers").joinpath("model.schema.json").read_text(encoding="utf-8"))
    jsonschema.validate(json.loads(json.dumps(parsed(MODEL + RAMPS), default=float)), schema)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('profile = "tanh"\nparameters = {l = 3}', "ramp has two values"),
        (
            'profile = "tanh"\nparameters = {q = [0, 3]}',
            "ramps.a.parameters.q is unknown. A ramp moves parameters",
        ),
        ('profile = "tanh"\nparameters = {x = [0, 3]}', "moves x, which is no parameter"),
        ('profile = "tanh"\nparameters = {l = [0, 3]}\nends = [0, 1]', "ends belongs to"),
        ("parameters = {l = [0, 3]}", "profile is missing"),
        ('profile = "phase"\nparameters = {l = "phase"}', "ends are two phases"),
        ('profile = "tanh"\nparameters = {l = [0, 3]}\nedge = {y = 1}', 'edge of the ramp a names "y"'),
        ('profile = "tanh"\nparameters = {l = [0, 3]}\nrate = 1', "rate is unknown"),
        ('profile = "__import__(1)"\nends = [0, 1]\nparameters = {l = "phase"}', "ramps.a.profile"),
    ],
)
def test_what_is_no_ramp_is_refused_by_name(table: str, said: str) -> None:
    with pytest.raises(GspError, match=said):
        read_model(f"{MODEL}\n[ramps.a]\n{table}\n", name="m")


def test_a_ramp_that_is_refused_takes_no_other_one_along(tmp_path) -> None:
    model = tmp_path / "m.toml"
    bad = '[ramps.bad]\nprofile = "tanh"\nparameters = {l = [0, 3]}\nedge = {x = -50}\n'
    model.write_text(MODEL + bad + RAMPS)
    told = CliRunner().invoke(cli, ["ramp", str(model)])
    assert "steep: tips above the rate" in told.stdout
    assert told.exit_code == 1
    assert str(told.exception).startswith("ramp bad: edge is no repelling rest point")
    alone = CliRunner().invoke(cli, ["ramp", str(model), "--ramp", "bad"])
    assert (alone.exit_code, alone.stdout) == (1, "")


@pytest.mark.exhaustive
def test_the_command_tells_the_rates(tmp_path) -> None:
    model, chart = tmp_path / "m.toml", tmp_path / "m.svg"
    model.write_text(MODEL + RAMPS)
    told = CliRunner().invoke(cli, ["ramp", str(model), "--ramp", "issue", "--json", "-o", str(chart)])
    assert told.exit_code == 0
    answer = json.loads(told.stdout)["issue"]
    assert answer["variables"]["rate"]["values"] == [pytest.approx(3.2, rel=1e-12)]
    assert chart.read_text().startswith("<?xml")
    whole = CliRunner().invoke(cli, ["ramp", str(model)])
    assert whole.exit_code == 0
    for words in (
        "steep: tips above the rate",
        "falling: never tips",
        "back: tips in windows of rates",
        "rate 3.2,",
    ):
        assert words in whole.output
    diagram = CliRunner().invoke(cli, ["ramp", str(model), "--ramp", "steep", "--amplitudes", "0.5:1.5"])
    assert "never tips" in diagram.output
    assert "1  tips above the rate: 2\n" in diagram.output


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--ramp", "stee"], "no ramp 'stee'"),
        (["--amplitudes", "1"], "LOW:HIGH"),
        (["--ramp", "endless", "--amplitudes", "1:2"], "no amplitude"),
        (["-o", "x.pig"], "pig"),
    ],
)
def test_the_command_refuses_by_name(arguments: list[str], said: str, tmp_path) -> None:
    model = tmp_path / "m.toml"
    model.write_text(MODEL + RAMPS)
    told = CliRunner().invoke(cli, ["ramp", str(model), *arguments])
    assert isinstance(told.exception, GspError)
    assert said in str(told.exception)
