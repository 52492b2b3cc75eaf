"""The report of a model with a fast phase."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

import gsp
from gsp.cli import cli
from gsp.errors import DeclarationError
from tests.averaging.public import oscillator


@pytest.mark.parametrize(
    ("tolerance", "told"),
    [(1e-2, "Yes:</b> At <math><mi>&#949;</mi></math> = 0.05 the error of order 1"), (1e-9, "No:</b>")],
)
def test_the_page_says_whether_and_how_well(tmp_path: Path, tolerance: float, told: str) -> None:
    asked = gsp.Scene(**{**given(oscillator()), "tolerance": tolerance})
    page = gsp.write_report(gsp.average(asked, order=2), tmp_path / "out").read_text(encoding="utf-8")
    assert told in page
    assert "</math> before averaging</td>" in page
    assert "&lt;m" not in page
    assert len(re.findall("<figure", page)) == 2
    written = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    assert written["missing"] == {}
    assert written["averaging"]["averaged_field"][0] == {"r": "-r*(r - 2)*(r + 2)/8"}
    assert written["comparison"]["variables"]["slope"]["values"] == pytest.approx([1, 2, 3], abs=0.1)
    assert all((tmp_path / "out" / name).stat().st_size for name in written["figures"])
    again = gsp.load(tmp_path / "out" / "report.toml")
    assert (again.phase, dict(again.system.equations)) == (asked.phase, dict(asked.system.equations))


def given(scene: gsp.Scene) -> dict:
    names = ("system", "region", "start", "span", "epsilon", "name", "phase")
    return {name: getattr(scene, name) for name in names}


def test_an_averaging_of_no_scene_has_no_report(tmp_path: Path) -> None:
    scene = oscillator()
    with pytest.raises(DeclarationError, match="a report is of an averaging of a scene"):
        gsp.write_report(gsp.average(scene.system, pair=("u", "v"), order=1), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.exhaustive
def test_the_command_averages_what_has_a_phase(tmp_path: Path) -> None:
    path = gsp.save(oscillator(), tmp_path / "model.toml")
    out = tmp_path / "out"
    asked = ["report", str(path), "-o", str(out), "--order", "1", "--json"]
    told = CliRunner().invoke(cli, asked, catch_exceptions=False)
    assert json.loads(told.output)["averaging"]["phase"] == "theta"
    assert (out / "report.html").exists()
