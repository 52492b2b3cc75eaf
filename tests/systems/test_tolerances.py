"""Runs of a scene whose states are small: the same run as in units in which they are of size one."""

from __future__ import annotations

import json

import numpy as np
import pytest
import sympy as sp
from click.testing import CliRunner

from gsp import VectorField, integrate, time_scales
from gsp.choice.candidates import run_model
from gsp.cli import cli
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of
from gsp.systems.system import SlowFastSystem
from gsp.systems.tolerances import SHARE, absolute_tolerance

s, c, eps = sp.symbols("s c epsilon")
NANO = sp.Rational(1, 10**9)


def enzyme(unit: sp.Rational) -> Scene:
    """Michaelis and Menten's enzyme with both amounts in this unit."""
    rates = (-s + (s + unit / 2) * c / unit, s - (s + unit) * c / unit)
    system = SlowFastSystem(slow={s: rates[0]}, fast={c: rates[1]}, epsilon=eps)
    one = float(unit)
    region = {"s": (0.05 * one, 2 * one)}
    return Scene(system, region, start={"s": one, "c": 0}, span=(0, 2), epsilon=0.01, tolerance=1e-6)


def test_the_smallest_state_sets_the_absolute_tolerance() -> None:
    assert absolute_tolerance(1e-8, {"x": (-2, 1)}, {"y": 0.5}) == pytest.approx(0.5 * SHARE * 1e-8)
    # A state is as large as it gets, and one that is nowhere but 0 is not asked.
    assert absolute_tolerance(1e-8, {"x": (-1, 1)}, {"x": 1e-6, "y": 0.0}) == SHARE * 1e-8
    assert absolute_tolerance(1e-8, {"x": (0, 1e-6)}, {"x": 0.0}, {"x": 2e-6}) == pytest.approx(
        2e-6 * SHARE * 1e-8
    )
    # In other units it is another number for the same run.
    assert absolute_tolerance(1e-8, {"x": (0, 2e6)}, {"y": 1e6}) == pytest.approx(1e6 * SHARE * 1e-8)


def test_a_run_is_as_exact_in_nanomoles() -> None:
    large, small = (study_of(enzyme(unit)).full(0.01) for unit in (sp.Integer(1), NANO))
    times = np.linspace(0.01, 2, 200)
    for name in ("s", "c"):
        expected = large.sample(times)[name]
        assert np.abs(1e9 * small.sample(times)[name] - expected).max() < 1e-6 * np.abs(expected).max()


def test_the_command_line_runs_a_small_model_exactly(tmp_path) -> None:
    text = """
    [slow]
    s = "-s + (s + 5e-10)*1e9*c"
    [fast]
    c = "s - (s + 1e-9)*1e9*c"
    [region]
    s = [5e-11, 2e-9]
    [start]
    s = 1e-9
    c = 0
    [scene]
    span = [0, 2]
    epsilon = 0.01
    """
    path = tmp_path / "nano.toml"
    path.write_text(text, encoding="utf-8")
    expected = study_of(enzyme(sp.Integer(1))).full(0.01)
    answer = CliRunner().invoke(cli, ["run", str(path), "--json"])
    assert answer.exit_code == 0
    run = {name: np.array(column["values"]) for name, column in json.loads(answer.stdout)["variables"].items()}
    times = json.loads(answer.stdout)["coordinates"]["t"]["values"]
    assert np.abs(1e9 * run["c"] - expected.sample(times)["c"]).max() < 1e-6


def test_a_run_of_a_choice_is_as_exact_in_nanomoles() -> None:
    times = np.linspace(0.002, 0.2, 100)
    large, small = (
        run_model(scene.system, scene.start, scene, (0.0, 0.2), 1e-7).sample(times)["c"]
        for scene in map(enzyme, (sp.Integer(1), NANO))
    )
    assert np.abs(1e9 * small - large).max() < 1e-5 * large.max()


def test_a_scene_that_is_integrated_is_as_exact_in_nanomoles() -> None:
    times = np.linspace(0.01, 2, 50)
    large, small = (integrate(enzyme(unit), at=times) for unit in (sp.Integer(1), NANO))
    assert small.y * 1e9 == pytest.approx(large.y, rel=1e-6)


@pytest.mark.exhaustive
@pytest.mark.parametrize("power", [-9, 9])
def test_time_scales_are_told_alike_in_all_units(power: int) -> None:
    """An enzyme without a small parameter: C + E is conserved, and one mode is exhausted from early on."""
    E, S, C = sp.symbols("E S C")

    def scales(unit):
        binding = E * S / unit - C / 10
        field = VectorField({S: -binding, E: -binding + C / 10, C: binding - C / 10})
        start = {"S": float(unit), "E": 0.01 * float(unit), "C": 0}
        return time_scales(field, start=start, span=(0, 2000), at=np.geomspace(1, 2000, 40))

    plain, other = scales(sp.Integer(1)), scales(sp.Integer(10) ** power)
    assert plain.exhausted[-1] == 1
    assert other.exhausted.tolist() == plain.exhausted.tolist()
    assert other.gap == pytest.approx(plain.gap, rel=1e-5)
