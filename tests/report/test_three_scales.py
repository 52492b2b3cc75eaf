"""The section of a report on three time scales, and what it says of scaled variables."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
import sympy as sp
from markupsafe import Markup

import gsp
from gsp.report.manuscript import TEX, manuscript
from gsp.report.sections import Page
from gsp.report.three_scales import ThreeScales
from tests.nested.test_nesting import published
from tests.report.test_manuscript import unknown

HEAD = "<h2>Three time scales</h2>"


def test_a_scene_with_two_small_parameters_has_the_section(tmp_path) -> None:
    scene = replace(published(), second="delta", name="three")
    analysis = gsp.analyse(scene)
    page = gsp.write_report(analysis, tmp_path / "report").read_text(encoding="utf-8")
    section = page[page.index(HEAD) : page.index("<h2>What this scene needs</h2>")]
    assert "This part could not be made" not in section
    assert "<code>y = 2*(1 - sqrt(1 - z))</code>" in section
    for name in ("C1", "C2, within C1", "attracting"):
        assert name in section
    # Four powers each of y, x and the rate of z; slopes in both parameters and in each alone.
    assert section.count("<tr>") == 1 + 2 + 1 + 12 + 1 + 3
    content = json.loads((tmp_path / "report" / "report.json").read_text(encoding="utf-8"))
    assert content["three_scales"]["C2"] == "y = 2*(1 - sqrt(1 - z))"
    assert "three_scales.png" in content["figures"]
    three = ThreeScales.of(scene)
    assert three is not None
    found = Page(analysis).three_scales(three)
    for row in found["slopes"]:
        assert [round(float(slope.striptags())) for slope in map(Markup, row["slopes"])] == [1, 2]
    text = manuscript(analysis, pictures={}, model=None, three=three)[TEX].decode()
    assert r"\section{Three time scales}" in text
    assert text.count("at the power") == 1
    assert unknown(text, content) == []


@pytest.mark.exhaustive
def test_a_degenerate_nesting_costs_its_section_alone(tmp_path) -> None:
    """On y + x = 0, where x is at rest, the rate of y has no 1/delta left: delta y' = y + x."""
    z, y, x, epsilon, delta = sp.symbols("z y x epsilon delta")
    field = gsp.VectorField(
        {z: -z, y: (y + x) / delta - y, x: -(y + x) / (epsilon * delta)},
        epsilon=epsilon,
        parameters={delta: 0.01},
    )
    region = {"z": (0.1, 1), "y": (-2, 2)}
    scene = gsp.Scene(field, region, {"z": 1, "y": 1, "x": -1}, (0, 1), 0.05, second="delta", name="hidden")
    page = gsp.write_report(gsp.analyse(scene), tmp_path / "report").read_text(encoding="utf-8")
    assert "a time scale is hidden" in page[page.index(HEAD) :]
    content = json.loads((tmp_path / "report" / "report.json").read_text(encoding="utf-8"))
    assert content["three_scales"] is None
    assert "a time scale is hidden" in content["missing"]["three_scales"]


@pytest.mark.exhaustive
def test_a_report_says_in_which_variables_a_pole_is_simple(tmp_path) -> None:
    x, v, mu = sp.symbols("x v mu")
    field = gsp.VectorField({x: v, v: -(x + v) / mu**2}, epsilon=mu)
    scene = gsp.Scene(field, {"x": (0.1, 1)}, {"x": 1, "v": 0}, (0, 1), 0.1, name="squared")
    page = gsp.write_report(gsp.analyse(scene), tmp_path / "report").read_text(encoding="utf-8")
    assert "In scaled variables the pole is simple: <code>mu_2 = mu**2; fast: v</code>" in page
    assert HEAD not in page
