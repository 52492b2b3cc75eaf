"""`gsp run` and `gsp compare`: what they print and write is what the library gives."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import gsp
from gsp import models
from gsp.cli import cli
from gsp.errors import GspError


def run(*arguments: str):
    return CliRunner().invoke(cli, list(arguments), catch_exceptions=False)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_a_run_is_written_as_rows_that_hold_every_digit(tmp_path: Path) -> None:
    target = tmp_path / "run.csv"
    shown = run("run", "michaelis_menten", "-o", str(target))
    assert shown.exit_code == 0
    assert f"values: {target}" in shown.stdout
    expected = gsp.integrate(models.load("michaelis_menten"))
    rows = rows_of(target)
    assert [float(row["t"]) for row in rows] == expected.t.tolist()
    assert [float(row["c"]) for row in rows] == expected["c"].tolist()


def test_a_reduced_run_begins_at_the_base_point() -> None:
    content = json.loads(run("run", "michaelis_menten", "--order", "2", "--epsilon", "0.02", "--json").stdout)
    study = gsp.study(models.load("michaelis_menten")).asking(epsilon=0.02)
    assert content["variables"]["s"]["values"][0] == study.base_point(2)["s"]
    assert content["coordinates"]["epsilon"]["values"] == 0.02


def test_a_comparison_is_written_as_json(tmp_path: Path) -> None:
    target = tmp_path / "errors.json"
    words = ("compare", "michaelis_menten", "--order", "1", "-o", str(target))
    assert "slope" in run(*words).stdout
    expected = gsp.compare(models.load("michaelis_menten"), orders=(0, 1))
    assert json.loads(target.read_text(encoding="utf-8")) == expected.as_json()
    assert json.loads(run(*words, "--json").stdout) == {"file": str(target)}


@pytest.mark.parametrize(("name", "words"), [("run.txt", r"\.csv or \.json"), ("no/run.csv", "no folder")])
def test_a_target_is_refused_before_the_run(name: str, words: str, tmp_path: Path) -> None:
    for command in ("run", "compare"):
        with pytest.raises(GspError, match=words):
            run(command, "michaelis_menten", "-o", str(tmp_path / name))
    assert list(tmp_path.iterdir()) == []
