"""Plan files and the command `gsp sweep`: what they say is done, and what they cannot mean is refused by name."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gsp import cli
from gsp.errors import ModelFileError
from gsp.sweeps.plan_file import read_plan_file
from gsp.sweeps.sweep import Sweep, sweep
from tests.sweeps.work import wave

PLAN = """
task = "integrate"
model = "michaelis_menten"
[options]
max_steps = 5000
[over]
kappa = [1, "1/3"]
epsilon = { from = 1e-3, to = 0.1, count = 3, spacing = "log" }
"""


def run(*arguments: str | Path):
    """The command in this process: its exit status and what it printed."""
    result = CliRunner().invoke(cli.cli, ["sweep", *map(str, arguments)])
    return result


def test_a_plan_gives_the_arguments_of_a_sweep(tmp_path: Path) -> None:
    file = tmp_path / "plan.toml"
    file.write_text(PLAN)
    found = read_plan_file(file)
    assert found["task"] == "integrate"
    assert found["options"] == {"max_steps": 5000}
    assert found["over"]["kappa"] == [1.0, 1 / 3]
    assert np.allclose(found["over"]["epsilon"], [1e-3, 1e-2, 1e-1], rtol=1e-15)


def test_a_model_file_stands_beside_its_plan(tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(PLAN.replace("michaelis_menten", "mine.toml"))
    (tmp_path / "mine.toml").write_text("")
    assert read_plan_file(tmp_path / "plan.toml")["model"] == tmp_path / "mine.toml"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('task = "integrate"', 'task = "os:system"', "task is a verb"),
        ('task = "integrate"', 'task = "intergate"', "integrate"),
        ('model = "michaelis_menten"', "", "model is a built-in name"),
        ("[options]", "[optoins]", "optoins is no key of a plan"),
        ('kappa = [1, "1/3"]', "kappa = 3", r"over\.kappa is a list"),
        ('kappa = [1, "1/3"]', 'kappa = ["__import__(1)"]', r"over\.kappa"),
        ("count = 3", "count = 0", "count is a whole number"),
        ("count = 3", "count = 100000000", "count is a whole number"),
        ("count = 3,", "", "lacks count"),
        ("from = 1e-3", "from = -1", "positive ends"),
        ('spacing = "log"', 'spacing = "even"', '"linear" or "log"'),
        ('spacing = "log"', "step = 1", "over.epsilon.step is unknown"),
        (PLAN, 'task = "integrate"\nmodel = "linear"', r"\[over\] gives each axis"),
        (PLAN, "task = ", "not valid TOML"),
    ],
)
def test_what_a_plan_cannot_mean_is_refused_with_the_name_of_the_file(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    file = tmp_path / "plan.toml"
    assert old in PLAN
    file.write_text(PLAN.replace(old, new))
    with pytest.raises(ModelFileError, match=words) as caught:
        read_plan_file(file)
    assert str(caught.value).startswith("plan.toml: ")


def test_the_command_starts_goes_on_and_tells_how_far_it_is(tmp_path: Path) -> None:
    file, folder = tmp_path / "plan.toml", tmp_path / "runs"
    file.write_text(PLAN)
    assert run(file, "-o", folder, "--status").exit_code != 0
    assert "no plan file and no folder" in str(run(folder, "--status").exception)
    begun = run(file, "-o", folder, "--workers", 1)
    assert begun.exit_code == 0, begun.output
    assert "6 of 6 points" in begun.output
    told = json.loads(run(folder, "--status", "--json").stdout)
    assert (told["points"], told["computed"], told["failed"]) == (6, 6, 0)
    again = run(folder, "--workers", 1)
    assert "6 of 6 points" in again.output
    assert run(folder, "--anew").exit_code != 0
    found = Sweep(folder).to_xarray()
    assert found.sizes["kappa"] == 2


def test_a_folder_names_no_function_that_the_command_would_run(tmp_path: Path) -> None:
    sweep(wave, over={"x": (1.0,), "k": (1.0,)}, into=tmp_path / "runs", workers=1)
    refused = run(tmp_path / "runs")
    assert refused.exit_code != 0
    assert "runs no code" in str(refused.exception)


@pytest.mark.parametrize(("low", "high"), [(0, 1), (-1, 1), (1, 0), (1, -1), (0, 0)])
def test_a_logarithm_has_positive_ends(low: float, high: float, tmp_path: Path) -> None:
    file = tmp_path / "plan.toml"
    file.write_text(PLAN.replace("from = 1e-3, to = 0.1", f"from = {low}, to = {high}"))
    with pytest.raises(ModelFileError, match="positive ends"):
        read_plan_file(file)
