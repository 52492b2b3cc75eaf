"""Models without a small parameter on the command line and in every verb that needs none."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from click.testing import CliRunner

import gsp
from gsp.cli import cli
from gsp.errors import GspError
from tests.scenes.test_small_parameter import MOTOR


@pytest.fixture
def motor(tmp_path: Path) -> Path:
    path = tmp_path / "motor.toml"
    path.write_text(MOTOR)
    return path


def run(*arguments: object):
    return CliRunner().invoke(cli, list(map(str, arguments)), catch_exceptions=False)


def test_it_is_run(motor: Path) -> None:
    found = json.loads(run("run", motor, "--json").stdout)
    again = json.loads(run("run", motor, "--json", "--set", "L=0.02").stdout)
    assert found != again


def test_the_parameter_that_is_small_is_named(motor: Path) -> None:
    found = run("split", motor, "--small", "L", "--json")
    assert json.loads(found.stdout)["fast"] == {"i": "-R*i - k*w + 1"}
    assert "small parameter: L = 0.01, which divides the rates of i" in found.stderr
    assert run("check", motor, "--small", "L").exit_code == 0
    # What is set is set before the parameter is taken, and --epsilon is its value.
    for options in (("--set", "L=0.02"), ("--epsilon", "0.02")):
        assert "L = 0.02" in run("run", motor, "--small", "L", *options).stdout


def test_variables_that_are_fast_are_named(motor: Path) -> None:
    found = run("expand", motor, "--fast", "i", "--order", "0")
    assert "i = -(k*w - 1)/R" in found.stdout
    assert "fast variables: i" in found.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--small", "L", "--fast", "i"), "one of them"),
        (("--small", "i"), "parameter is 'i', and no parameter has this name"),
        (("--fast", "i,,q"), "variables names 'q', which is no state"),
    ],
)
def test_what_cannot_be_meant_is_refused(motor: Path, options: tuple[str, ...], words: str) -> None:
    with pytest.raises(GspError, match=words):
        run("check", motor, *options)


def test_a_value_of_epsilon_needs_one(motor: Path) -> None:
    with pytest.raises(GspError, match="has no small parameter"):
        run("run", motor, "--epsilon", "0.1")


@pytest.mark.exhaustive
def test_what_is_fast_is_looked_for_and_told(motor: Path) -> None:
    found = run("split", motor, "--json")
    assert json.loads(found.stdout)["fast"] == {"i": "-R*i - k*w + 1"}
    assert "quasi-steady state of i" in found.stderr
    assert "->quasi-steady state of i" in run("choose", motor, "--tolerance", "0.05").stdout
    # A linear model has a slow manifold that no series reaches: it is solved.
    fine = run("choose", motor, "--tolerance", "1e-10").stdout
    assert "on its solved manifold" in fine
    assert "May I reduce? Yes" in fine
    rough = json.loads(run("choose", motor, "--set", "L=1", "--json").stdout)
    assert rough["recommended"] is None
    assert rough["reason"].startswith("Do not reduce")


def test_reduced_runs_and_comparisons_look_for_it_too(motor: Path, tmp_path: Path) -> None:
    found, named = (run("compare", motor, "--order", "1", *of) for of in ((), ("--fast", "i")))
    assert "quasi-steady state of i" in found.stderr
    # Along L, and with a bookkeeping epsilon: halves of either have the same errors.
    first, second = (
        [line.split()[1] for line in each.stdout.splitlines() if line[:7].strip() in ("0", "1")]
        for each in (found, named)
    )
    assert first == second == ["1.00", "2.00"]
    ends = []
    for options in ((), ("--fast", "i")):
        target = tmp_path / "run.csv"
        run("run", motor, "--order", "1", "-o", target, *options)
        head, *_, last = target.read_text(encoding="utf-8").splitlines()
        ends.append(float(dict(zip(head.split(","), last.split(",")))["w"]))
    assert ends[0] == pytest.approx(ends[1], rel=1e-6)
    assert "quasi-steady state" not in run("run", motor).stderr


def test_its_demo_shows_the_full_system(motor: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    assert run("demo", motor, "--no-open", "-o", page).exit_code == 0
    assert '"epsilon":null' in page.read_text(encoding="utf-8")
    assert run("demo", motor, "--no-open", "-o", page, "--small", "L").exit_code == 0
    assert '"epsilon":"L"' in page.read_text(encoding="utf-8")


def test_a_parameter_called_epsilon_is_one_like_others(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text(MOTOR.replace("L", "epsilon"))
    assert gsp.load(path).epsilon is None
    path.write_text(MOTOR.replace("L = 0.01, ", "").replace("L", "epsilon"))
    with pytest.raises(GspError, match=r"scene\.epsilon is missing"):
        gsp.load(path)


def test_ensembles_closed_orbits_and_sweeps_need_none(tmp_path: Path) -> None:
    x, y, mu = sp.symbols("x y mu")
    field = gsp.VectorField({x: y, y: mu * (1 - x**2) * y - x}, parameters={mu: 1})
    scene = gsp.Scene(field, {}, {"x": 2, "y": 0}, (0, 30))
    members = gsp.integrate_many(field, starts={"x": np.array([1.0, 2.0]), "y": np.zeros(2)}, span=(0.0, 1.0))
    assert len(members) == 2
    # Period of van der Pol's oscillator at mu = 1.
    assert gsp.periodic_orbit(field, start={"x": 2.0, "y": 0.0}).period == pytest.approx(6.6632868593, rel=1e-8)
    path = gsp.save(scene, tmp_path / "oscillator.toml")
    swept = gsp.sweep("integrate", over={"mu": (0.5, 1.0)}, into=tmp_path / "sweep", model=str(path), workers=1)
    assert (swept.failed, swept.computed) == (0, 2)
    swept = gsp.sweep(
        "periodic_orbit", over={"mu": (1.0,)}, into=tmp_path / "orbits", model=str(path), workers=1
    )
    assert swept.failed == 0
