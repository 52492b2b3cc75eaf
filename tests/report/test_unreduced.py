"""The report of a model in which nothing is fast."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner

import gsp
from gsp.cli import cli
from gsp.errors import DeclarationError

LORENZ = """
parameters = { sigma = 10, rho = 28, beta = "8/3" }
states = { x = "sigma*(y - x)", y = "x*(rho - z) - y", z = "x*y - beta*z" }
start = { x = 1, y = 1, z = 1 }
scene = { span = [0, 10], tolerance = 0.01 }
"""
RAMP = """
parameters = { l = 0, mu = 1 }
states = { x = "(x + l)^2 - mu" }
start = { x = -1 }
scene = { span = [0, 20] }
ramps = { up = { profile = "logistic", parameters = { l = [0, 3] }, edge = { x = -2 } } }
"""


def reported(text: str, folder: Path) -> tuple[str, dict]:
    model = folder / "model.toml"
    model.write_text(text, encoding="utf-8")
    asked = ["report", str(model), "-o", str(folder / "out"), "--json"]
    told = CliRunner().invoke(cli, asked, catch_exceptions=False)
    assert told.exit_code == 0
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    return page, json.loads((folder / "out" / "report.json").read_text(encoding="utf-8"))


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("text", "figures", "reason"),
    [
        (LORENZ, ["time_series.png", "time_scales.png"], "nothing is separated"),
        (RAMP, ["ramp.png", "time_series.png", "time_scales.png"], "there is one state only"),
    ],
)
def test_the_page_says_why_nothing_is_reduced(text: str, figures: list, reason: str, tmp_path: Path) -> None:
    page, written = reported(text, tmp_path)
    assert written["figures"] == figures
    assert written["missing"] == {}
    assert reason in written["reductions"]["reason"]
    assert reason in page
    # Figures are counted as they stand on the page.
    assert re.findall(r"Figure (\d)\.", page) == [str(k + 1) for k in range(len(figures))]
    assert all((tmp_path / "out" / name).stat().st_size for name in figures)
    again = gsp.load(tmp_path / "out" / "report.toml")
    assert not again.has_small
    assert list(again.ramps) == list(written["ramps"])


def test_its_ramps_are_answered(tmp_path: Path) -> None:
    page, written = reported(RAMP, tmp_path)
    # Closed form: 4 mu/(l (l - 2 sqrt(mu))).
    assert written["ramps"]["up"]["rates"] == pytest.approx([4 / 3], rel=1e-12)
    assert "1.33333" in page


def test_it_has_no_manuscript(tmp_path: Path) -> None:
    model = tmp_path / "model.toml"
    model.write_text(LORENZ, encoding="utf-8")
    with pytest.raises(DeclarationError, match="has no manuscript"):
        gsp.write_report(gsp.find_reductions(gsp.load(model)), tmp_path / "out", latex=True)
    assert not (tmp_path / "out").exists()


@pytest.mark.exhaustive
def test_a_model_in_which_something_is_small_is_analysed(tmp_path: Path) -> None:
    model = tmp_path / "model.toml"
    model.write_text(
        'states = { x = "-x", y = "1000*(x - y)" }\nstart = { x = 1, y = 0 }\n'
        "scene = { span = [0, 5], tolerance = 0.01 }\n",
        encoding="utf-8",
    )
    with pytest.raises(DeclarationError, match=r"something is small in model.*Report write_report\(analyse"):
        gsp.write_report(gsp.find_reductions(gsp.load(model)), tmp_path / "out")
    assert not (tmp_path / "out").exists()
