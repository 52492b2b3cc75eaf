"""Another question about the same scene, in Python and by the options that every verb shares."""

from __future__ import annotations

import json
import sys

import pytest
import sympy as sp
from click.testing import CliRunner

from gsp import models
from gsp.cli import cli, main
from gsp.errors import DeclarationError, GspError
from gsp.scenes.settings import ask_again

# Options that each verb takes beside its model.
ASKED = {
    "split": {"--set"},
    "expand": {"--set", "--order"},
    "check": {"--set", "--epsilon", "--region"},
    "folds": {"--set", "--region"},
    "methods": {"--set", "--epsilon", "--region", "--order"},
    "chart": {"--set", "--epsilon", "--region", "--order"},
    "choose": {"--set", "--epsilon", "--region", "--order"},
    "report": {"--set", "--epsilon", "--region", "--order"},
}


def run(*arguments: str):
    return CliRunner().invoke(cli, list(arguments), catch_exceptions=False)


@pytest.mark.parametrize("verb", ASKED)
def test_every_verb_takes_the_options_that_make_sense(verb):
    known = {option for parameter in cli.commands[verb].params for option in parameter.opts}
    assert ASKED[verb] <= known


def test_values_are_exact_and_the_ladder_moves_along():
    scene = models.load("michaelis_menten")
    other = ask_again(scene, parameters={"kappa": sp.Rational(1, 3)}, epsilon=scene.epsilon / 2)
    values = {s.name: value for s, value in other.system.parameters.items()}
    assert values["kappa"] == sp.Rational(1, 3)
    assert other.epsilons == pytest.approx([value / 2 for value in scene.epsilons])
    assert other.region == scene.region
    assert ask_again(scene) == scene


def test_a_decimal_on_the_command_line_is_that_decimal():
    text = run("expand", "michaelis_menten", "--set", "kappa=0.1", "--values", "--order", "0").output
    assert "h_0  c = 10*s/(10*s + 1)" in text
    thirds = run("expand", "michaelis_menten", "--set", "kappa=1/3", "--values", "--order", "0").output
    assert "h_0  c = 3*s/(3*s + 1)" in thirds


@pytest.mark.exhaustive
def test_a_region_on_the_command_line_is_the_one_that_is_checked():
    # The fold of the cubic at x = 1 lies outside the scene's region and inside the wide one.
    verdict = json.loads(run("check", "van_der_pol", "--region", "y=-9:9", "--json").stdout)
    assert verdict["holds"] is False


@pytest.mark.exhaustive
def test_epsilon_and_order_reach_the_choice():
    found = json.loads(run("choose", "michaelis_menten", "--epsilon", "1/100", "--order", "1", "--json").stdout)
    assert found["coordinates"]["epsilon"]["values"] == 0.01
    assert [order for order in found["variables"]["order"]["values"] if order is not None] == [0, 1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("check", "van_der_pol", "--set", "nothing=1"), 'no parameter "nothing"'),
        (("check", "van_der_pol", "--set", "a"), "--set is given as NAME=VALUE"),
        (("check", "van_der_pol", "--set", "a=__import__('os')"), "--set a: "),
        (("check", "van_der_pol", "--epsilon", "small"), "--epsilon: "),
        (("check", "van_der_pol", "--epsilon", "0"), "finite and positive"),
        (("check", "van_der_pol", "--region", "q=0:1"), "which is no state"),
        (("check", "van_der_pol", "--region", "y=1"), "NAME=LOW:HIGH"),
        (("choose", "linear", "--order", "-1"), "non-negative"),
        (("chart", "linear", "-o", "x.jpeg"), ".png, .pdf or .svg"),
    ],
)
def test_wrong_values_are_refused_by_name(arguments, words, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["gsp", *arguments])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    told = capsys.readouterr().err
    assert words in told
    assert "Traceback" not in told


def test_a_region_of_something_else_is_refused():
    with pytest.raises(DeclarationError, match="which is no state"):
        ask_again(models.load("linear"), region={"nothing": (0, 1)})


def test_conserved_quantities_are_named(tmp_path):
    file = tmp_path / "enzyme.toml"
    file.write_text(
        '[states]\ne = "(c - e*s)/epsilon"\nc = "(e*s - c)/epsilon"\ns = "c - e*s"\n'
        "[region]\ne = [0.1, 1]\nc = [0, 1]\ns = [0.1, 2]\n[start]\ne = 1\nc = 0\ns = 1\n"
        "[scene]\nspan = [0, 1]\nepsilon = 0.01\n"
    )
    text = run("split", str(file)).output
    assert "Conserved: p = c + e, for p' = 0." in text
    assert json.loads(run("split", str(file), "--json").stdout)["conserved"] == ["p"]
    assert json.loads(run("split", "van_der_pol", "--json").stdout)["conserved"] == []


def test_folds_as_json_have_the_curve():
    found = json.loads(run("folds", "van_der_pol", "--json").stdout)
    (curve,) = found["curves"]
    x, y = curve["points"]["x"], curve["points"]["y"]
    assert len(x) == len(y) > 50
    assert max(abs(b - (a**3 / 3 - a)) for a, b in zip(x, y)) < 1e-9
    assert found["special"][0]["point"]["x"] in x


def test_ln_is_log_unless_a_model_names_it():
    from gsp.readers.expressions import parse_expression

    x, ln = sp.symbols("x ln")
    assert parse_expression("ln(x)", symbols={"x": x}) == sp.log(x)
    assert parse_expression("2*ln*x", symbols={"x": x, "ln": ln}) == 2 * ln * x
    with pytest.raises(GspError, match="function"):
        parse_expression("ln", symbols={"x": x})
