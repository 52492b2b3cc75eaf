"""Scenes whose field has a switch: the stages are those of the fast variable, the runs those of the field."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from click.testing import CliRunner

from gsp.cli import cli
from gsp.comparison.comparison import compare
from gsp.errors import DeclarationError
from gsp.integration.trajectory import integrate
from gsp.readers.toml import read_model
from gsp.scenes.study import study

TEXT = """
parameters = { V = 0.2 }
states = { x = "u", u = "-x + phi((V - u)/epsilon)/2" }
definitions = { "phi(w)" = "w/sqrt(1 + w^2)" }
reconstruction = { s = "u*x" }
region = { x = [-0.4, 0.4], u = [-1, 1] }
start = { x = -0.3, u = 0.2 }
scene = { span = [0, 2], epsilon = 0.01, path = ["x", "u"] }
[starts.slower]
u = 0.198
"""


@pytest.fixture(scope="module")
def scene():
    return read_model(TEXT, name="belt")


def test_a_model_file_with_a_switch_is_a_question_about_a_fast_variable(scene) -> None:
    ready = study(scene)
    assert [s.name for s in ready.system.x] == ["x"]
    assert [s.name for s in ready.system.y] == ["v"]
    assert dict(ready.start) == {"x": -0.3, "v": 0.0}
    assert ready.scene.starts["slower"]["v"] == pytest.approx(0.2)
    assert ready.scene.region == {"x": (-0.4, 0.4)}
    assert ready.scene.path == ("x", "u")
    epsilon, v, x, V = sp.symbols("epsilon v x V")
    assert ready.scene.reconstruction == {sp.Symbol("s"): x * (V - epsilon * v)}
    assert "v = (V - u)/epsilon is a fast variable" in ready.splitting.explain()


def test_the_run_in_the_fast_variable_is_the_run_of_the_field(scene) -> None:
    raw = integrate(scene, rtol=1e-11, atol=1e-13)
    ready = study(scene).scene
    new = integrate(ready, rtol=1e-11, atol=1e-13)
    for name in ("x", "u", "s"):
        assert np.abs(raw[name][-1] - new[name][-1]) < 1e-10


@pytest.mark.exhaustive
def test_the_slopes_of_a_switched_field_are_those_of_the_theory(scene) -> None:
    found = compare(scene, orders=(0, 1, 2))
    for order in (0, 1, 2):
        assert found.slopes[order] == pytest.approx(order + 1, abs=0.1)


@pytest.mark.parametrize("command", ["split", "expand", "check", "run"])
def test_commands_take_a_model_file_with_a_switch(command: str, tmp_path) -> None:
    path = tmp_path / "belt.toml"
    path.write_text(TEXT)
    result = CliRunner().invoke(cli, [command, str(path)])
    assert result.exit_code == 0, result.output
    assert ("v" if command != "run" else "u") in result.output


def test_bounds_on_nothing_but_what_a_fast_variable_replaces_are_refused_by_name() -> None:
    """x stands first, so v = (x + u)/epsilon takes its place: a region of x alone bounds nothing that is left."""
    text = """
    states = { x = "u", u = "-x - u/2 + 1 - 2*tanh((x + u)/epsilon)" }
    region = { x = [0.2, 0.8] }
    start = { x = 0.5, u = -0.5 }
    scene = { span = [0, 2], epsilon = 0.01 }
    """
    with pytest.raises(DeclarationError, match=r"bounds x alone: v = .* in place of x = .* Bound u"):
        study(read_model(text, name="relay"))
