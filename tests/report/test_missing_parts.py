"""What cannot be made of a report costs that part, with its reason in its place; never the page, never a traceback."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest

from gsp import analyse, charts, load
from gsp.analysis import analysis
from gsp.errors import DefectWarning, GspError, MissingPartError
from gsp.report import write_report
from gsp.report.sections import Page
from gsp.results.attempts import Missing, attempt, made
from gsp.scenes import study
from tests.cases import sampled

COMBINATIONS = """
parameters = { k = 0.5 }
states = { a = "-(a-k*b)/epsilon", b = "(a-k*b)/epsilon - b" }
region = { a = [0.1, 2], b = [0.1, 2] }
start = { a = 1, b = 1 }
scene = { span = [0, 2], epsilon = 0.01 }
"""
HINDMARSH_ROSE = """
parameters = { I = 2 }
slow = { z = "4*(x + 1.6) - z" }
fast = { x = "y - x^3 + 3*x^2 - z + I", y = "1 - 5*x^2 - y" }
region = { z = [1.83, 2.5], x = [-3, -1.35] }
start = { z = 1.83, x = -1.4, y = -9.5 }
scene = { span = [0, 1], epsilon = 0.02, tolerance = 1e-3 }
"""
MODULUS = """
slow = { s = "-s" }
fast = { c = "s - abs(c)" }
region = { s = [0.5, 2], c = [0, 3] }
start = { s = 1, c = 0.3 }
scene = { span = [0, 1], epsilon = 0.01 }
"""


def scene_of(text: str, folder):
    file = folder / "model.toml"
    file.write_text(text)
    return load(file)


def read(page):
    return page.read_text(encoding="utf-8"), json.loads(
        (page.parent / "report.json").read_text(encoding="utf-8")
    )


@pytest.fixture(scope="module")
def combined(tmp_path_factory):
    return analyse(scene_of(COMBINATIONS, tmp_path_factory.mktemp("model")))


@pytest.mark.exhaustive
def test_a_field_whose_slow_variables_are_all_new_is_drawn_in_them(combined, tmp_path):
    # p = a + b is no state of the field that the full runs integrate.
    portrait = charts.phase_portrait(combined)
    assert portrait.get_xlabel() == "$p$"
    run = combined.full
    (drawn,) = (line for line in portrait.lines if line.get_label() == "full run")
    x = np.asarray(drawn.get_xdata())
    assert x[[0, -1]] == pytest.approx((run["a"] + run["b"])[[0, -1]], rel=1e-12)
    text, content = read(write_report(combined, tmp_path / "report"))
    assert content["missing"] == {}
    assert "could not be made" not in text


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [HINDMARSH_ROSE, MODULUS])
def test_a_model_that_is_hyperbolic_has_a_report(model, tmp_path):
    found = analyse(scene_of(model, tmp_path))
    text, content = read(write_report(found, tmp_path / "report"))
    assert "Normal hyperbolicity" in text
    assert {f"{name}.png" for name in charts.applicable(found)} == {
        *content["figures"],
        *(name for name in content["missing"] if name.endswith(".png")),
    }
    for name, reason in content["missing"].items():
        assert reason
        assert "Traceback" not in reason, name


@pytest.mark.exhaustive
def test_a_run_that_ends_where_it_starts_is_drawn_as_its_start(combined):
    stopped = dataclasses.replace(combined, reduced=combined.reduced.sample(combined.reduced.t[:1]))
    assert stopped.reduced.t.size == 1
    for draw in charts.applicable(stopped).values():
        assert charts.png(draw(stopped)).startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "stage",
    sampled(
        ["boundary_of", "Expansion", "compare", "choose", "ladder_of", "landing_runs"],
        always=["Expansion"],
    ),
)
def test_a_stage_that_fails_costs_what_is_made_of_it(stage, combined, monkeypatch, tmp_path):
    def fail(*arguments, **keywords):
        raise GspError("the <stage> fails. Got this. Try that.")

    monkeypatch.setattr(study if stage == "Expansion" else analysis, stage, fail)
    found = analyse(combined.scene, order=1, orders=(0, 1))
    assert "the <stage> fails. Got this. Try that." in found.lost.values()
    assert "not made: " in str(found)
    assert ("no comparison" in repr(found)) == ("comparison" in found.lost)
    text, content = read(write_report(found, tmp_path / "report"))
    assert "Normal hyperbolicity" in text
    assert "the &lt;stage&gt; fails" in text
    assert "<stage>" not in text
    assert set(found.lost) <= set(content["missing"])
    name = next(iter(found.lost))
    with pytest.raises(MissingPartError, match="Try that"):
        getattr(found, name)
    for file in content["figures"]:
        assert (tmp_path / "report" / file).is_file()
    numbers = [int(n) for n in re.findall(r"<b>Figure (\d+)\.", text)]
    assert numbers == list(range(1, len(numbers) + 1))


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "error", [GspError("no <such> thing"), ZeroDivisionError(), np.linalg.LinAlgError("singular")]
)
def test_a_figure_or_a_section_that_fails_leaves_its_reason(error, combined, monkeypatch, tmp_path):
    def fail(*arguments, **keywords):
        raise error

    monkeypatch.setattr(Page, "series", fail)
    monkeypatch.setattr(Page, "verdict", fail)
    monkeypatch.setattr(
        charts, "applicable", lambda found: {"time_series": charts.time_series, "manifold": fail}
    )
    text, content = read(write_report(combined, tmp_path / "report"))
    assert content["figures"] == ["time_series.png"]
    assert set(content["missing"]) == {"manifold.png"}
    assert "No picture of the manifold: " in text
    assert text.count("This part could not be made") == 1
    assert "May I reduce? Unknown" in text
    assert not (tmp_path / "report" / "manifold.png").exists()


def test_a_reason_that_pictures_share_is_read_once(combined, monkeypatch, tmp_path):
    def fail(*arguments, **keywords):
        raise GspError("the series is too long. Rather use `solve_manifold`")

    monkeypatch.setattr(charts, "applicable", lambda found: {"time_series": fail, "manifold": fail})
    text, content = read(write_report(combined, tmp_path / "report"))
    assert set(content["missing"]) == {"manifold.png", "time_series.png"}
    assert text.count("the series is too long") == 1
    assert "<code>solve_manifold</code>" in text
    assert 'No picture of the manifold: <a href="#time_series">' in text or (
        'No picture of the time series: <a href="#manifold">' in text
    )


def test_a_defect_is_told_in_one_line_and_costs_its_part_only(combined, monkeypatch, tmp_path):
    def defective(*arguments, **keywords):
        raise KeyError("lost\nkey")

    monkeypatch.setattr(charts, "applicable", lambda found: {"time_series": defective})
    with pytest.warns(DefectWarning, match=r"a defect in gsp: the figure time_series .*KeyError") as told:
        text, _ = read(write_report(combined, tmp_path / "report"))
    assert all("\n" not in str(one.message) for one in told)
    assert "No picture of the time series: a defect in gsp (KeyError)" in text


def test_an_interrupt_is_no_failure_of_a_part(combined, monkeypatch, tmp_path):
    def interrupted(*arguments, **keywords):
        raise KeyboardInterrupt

    monkeypatch.setattr(charts, "applicable", lambda found: {"time_series": interrupted})
    with pytest.raises(KeyboardInterrupt):
        write_report(combined, tmp_path / "report")
    assert not (tmp_path / "report").exists()
    monkeypatch.setattr(analysis, "compare", interrupted)
    with pytest.raises(KeyboardInterrupt):
        analyse(combined.scene)


def test_an_attempt_gives_the_part_or_the_reason():
    assert attempt("a part", lambda: 3) == 3
    missing = attempt("a part", lambda: 1 // 0)
    assert isinstance(missing, Missing)
    with pytest.raises(MissingPartError, match="division"):
        made(missing)
    with pytest.raises(AttributeError):
        analysis.Analysis.nothing  # noqa: B018
