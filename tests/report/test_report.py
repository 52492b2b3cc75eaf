"""The report: complete, strict, escaped, self-contained, and all or nothing."""

from __future__ import annotations

import dataclasses
import html
import json
import os
import re
from html.parser import HTMLParser
from types import SimpleNamespace
from typing import Any, cast

import pytest
import sympy as sp

import gsp
from gsp import SlowFastSystem, analyse, charts
from gsp.demos.page import frame_script
from gsp.errors import OutputError, Reason
from gsp.hyperbolicity.exclusion import Exclusion
from gsp.readers.expressions import parse_expression
from gsp.readers.writing import as_toml
from gsp.report import as_json, check_folder, write_report
from gsp.report import folder as report_folder
from gsp.report.sections import Page as Sections
from gsp.report.wording import number, scientific, signed, words
from gsp.results.mathml import Typesetter
from gsp.scenes.scene import Scene
from tests.analyses import analysis_of
from tests.example_systems import saddle_scene

HOSTILE = "</script><img src=x onerror=alert(1)><math><mtext>&amp;"
VOID = {"meta", "img", "br", "link", "input", "hr"}


class Page(HTMLParser):
    """Tags and attributes of a page; complains when a tag is not closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in {"dt", "dd", "td", "tr", "th"}:
            while self.open and self.open[-1] in {"dt", "dd", "td", "tr", "th"} and self.open[-1] != tag:
                self.open.pop()
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def sleigh():
    return analysis_of("chaplygin_sleigh")


@pytest.fixture(scope="module")
def written(sleigh, tmp_path_factory):
    return write_report(sleigh, tmp_path_factory.mktemp("reports") / "sleigh").parent


@pytest.fixture(scope="module")
def saddle():
    return analyse(saddle_scene(title=HOSTILE, description=HOSTILE, source=HOSTILE))


@pytest.fixture
def quick(monkeypatch):
    """One figure instead of all."""
    monkeypatch.setattr(charts, "applicable", lambda analysis: {"time_series": charts.time_series})


def _strict(text: str):
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.mark.exhaustive
def test_json_is_strict_and_complete(written, sleigh):
    content = _strict((written / "report.json").read_text(encoding="utf-8"))
    assert content["slow"] == ["v", "p"]
    assert content["fast"] == ["w"]
    assert content["hyperbolicity"]["kind"] == "attracting"
    assert content["hyperbolicity"]["gap"] == pytest.approx(1.04)
    assert {"name", "statement", "value", "requirement", "holds", "is_proved"} == set(
        content["hyperbolicity"]["conditions"][0]
    )
    assert content["comparison"] == sleigh.comparison.as_json()
    assert content["comparison"]["coordinates"]["order"]["values"] == [0, 1, 2, 3]
    assert content["comparison"]["variables"]["slope"]["values"][1] == pytest.approx(2, abs=0.1)
    assert content["comparison"]["coordinates"]["claim"]["values"] == list(sleigh.scene.claims)
    assert {"split", "comparison", "report", "total"} <= set(content["timings"])
    assert content["timings"]["total"] >= content["timings"]["report"]
    assert content["stats"]["full"]["steps"] > 0
    keys = [
        "name",
        "coordinates",
        "raw",
        "parameters",
        "epsilon",
        "span",
        "start",
        "region",
        "versions",
        "figures",
    ]
    assert set(keys) <= set(content)
    assert content["raw"]["chart"] == ["v", "omega"]
    for name in content["figures"]:
        assert (written / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.exhaustive
def test_series_parse_back_to_themselves(sleigh):
    content = as_json(sleigh)
    system = sleigh.study.system
    symbols = {s.name: s for s in (*system.states, *system.parameters)}
    for key, table in (("h", sleigh.series.coefficients), ("reduced_field", sleigh.series.reduced_field)):
        for texts, row in zip(content[key], table):
            for text, expression in zip(texts, row):
                assert sp.cancel(parse_expression(text, symbols=symbols) - expression) == 0


@pytest.mark.exhaustive
def test_exact_slopes_are_null_and_standard_coordinates_the_identity():
    content = as_json(analysis_of("davis_skodje"))
    assert content["comparison"]["variables"]["slope"]["values"] == [None] * 4
    assert content["comparison"]["variables"]["exact"]["values"][0] is True
    assert content["coordinates"] == {"y1": "y1", "y2": "y2"}
    assert content["raw"] is None
    json.dumps(content, allow_nan=False)


def test_page_is_well_formed_and_fetches_nothing(written):
    page = Page((written / "report.html").read_text(encoding="utf-8"))
    for tag, attributes in page.tags:
        assert tag not in {"link", "object"}
        # The panel stands in the page itself.
        assert tag != "iframe" or attributes["sandbox"] == "allow-scripts allow-downloads"
        for name in ("src", "href", "action", "data"):
            assert (attributes.get(name) or "data:").startswith("data:")
    # One script, which makes the panel's frame as high as the panel, and which the policy lets run by its hash.
    text = (written / "report.html").read_text(encoding="utf-8")
    script, script_hash = frame_script()
    assert [tag for tag, _ in page.tags].count("script") == 1
    assert f"<script>{script}</script>" in text
    assert f"'{script_hash}'" in text
    text = re.sub(r"data:[^\"]*", "", text)
    assert "http://" not in text
    assert "https://" not in text
    assert "url(" not in text


@pytest.mark.exhaustive
def test_the_panel_at_the_top_runs_the_model(written, page):
    page.open(written / "report.html")
    page.driver.switch_to.frame(page.driver.find_element("css selector", "iframe.panel"))
    before = page.picture()
    page.slide("epsilon", -3.0)
    assert page.run("return state.epsilon") == pytest.approx(1e-3)
    assert page.picture() != before
    assert page.inked() > 1000
    page.driver.switch_to.default_content()
    assert page.complaints() == []
    assert page.requests() == []


@pytest.mark.exhaustive
@pytest.mark.parametrize("width", [360, 1280])
def test_nothing_is_scrolled_within_the_panel(width, written, page):
    page.open(written / "report.html", width=width, height=800)
    frame = page.driver.find_element("css selector", "iframe.panel")
    page.run("arguments[0].scrollIntoView()", frame)
    page.driver.execute_async_script(
        "const done = arguments[1]; const frame = arguments[0];"
        "const look = () => (frame.style.height ? done() : setTimeout(look, 20)); look();",
        frame,
    )
    page.settle()
    shown = page.run("return arguments[0].clientHeight", frame)
    assert page.run("return document.documentElement.scrollWidth") <= width
    page.driver.switch_to.frame(frame)
    assert page.run("return document.body.getBoundingClientRect().height") <= shown
    assert page.run("return document.documentElement.scrollWidth <= window.innerWidth")
    page.driver.switch_to.default_content()
    assert page.complaints() == []


def test_page_says_what_the_numbers_say(written, sleigh):
    text = (written / "report.html").read_text(encoding="utf-8")
    assert "May I reduce?" in text
    assert "proved on" in text
    assert "wrong at first order" in text
    assert "right through order 1" in text
    for name in sleigh.scene.claims:
        assert name in text
    assert text.count("<figure") == len(as_json(sleigh)["figures"])
    numbers = [int(n) for n in re.findall(r"<b>Figure (\d+)\.", text)]
    assert numbers == list(range(1, len(numbers) + 1))


@pytest.mark.exhaustive
def test_every_figure_has_the_python_that_draws_it_again(written, sleigh, monkeypatch):
    text = (written / "report.html").read_text(encoding="utf-8")
    codes = [html.unescape(code) for code in re.findall(r"<pre>(import gsp.*?)</pre>", text, re.DOTALL)]
    names = [name.removesuffix(".png") for name in as_json(sleigh)["figures"]]
    assert len(codes) == len(names) > 5
    monkeypatch.chdir(written)
    asked = []
    # The analysis itself is another test's: here it is that of the scene which the code loads.
    monkeypatch.setattr(gsp, "analyse", lambda scene, *, order: asked.append((scene, order)) or sleigh)
    for code in codes[:2]:
        exec(compile(code, "report", "exec"), {})
    assert {order for _, order in asked} == {sleigh.series.order}
    assert all(as_toml(scene) == as_toml(sleigh.scene) for scene, _ in asked)
    assert sorted(path.stem for path in written.glob("*.svg")) == sorted(names[:2])


@pytest.mark.exhaustive
def test_text_from_a_model_is_escaped_and_a_saddle_has_a_report(saddle, tmp_path):
    folder = write_report(saddle, tmp_path / "saddle").parent
    text = (folder / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert "<img src=x" not in text
    assert "&lt;/script&gt;&lt;img src=x" in text
    assert all("onerror" not in attributes for _, attributes in page.tags)
    assert "May I reduce? No:" in text
    assert "orbits next to it leave it in some fast directions" in text
    assert not (folder / "distance.png").exists()
    _strict((folder / "report.json").read_text(encoding="utf-8"))


@pytest.mark.exhaustive
def test_a_claim_with_a_hostile_name_is_escaped(sleigh, quick, tmp_path):
    claims = {HOSTILE: next(iter(sleigh.scene.claims.values()))}
    scene = dataclasses.replace(sleigh.scene, claims=claims)
    comparison = dataclasses.replace(
        sleigh.comparison, claims={HOSTILE: (0.1, 0.05, 0.025, 0.0125)}, claim_slopes={HOSTILE: 1.0}
    )
    hostile = dataclasses.replace(
        sleigh, study=dataclasses.replace(sleigh.study, scene=scene), comparison=comparison
    )
    text = write_report(hostile, tmp_path / "r").read_text(encoding="utf-8")
    assert "<img src=x" not in text
    charts.png(charts.error_against_epsilon(comparison))


@pytest.mark.exhaustive
def test_failure_midway_leaves_nothing_new_and_the_old_report_intact(sleigh, quick, monkeypatch, tmp_path):
    target = write_report(sleigh, tmp_path / "report").parent
    (target / "notes.txt").write_text("mine")
    before = {path.name: path.read_bytes() for path in target.iterdir()}

    def fail(*arguments, **keywords):
        raise RuntimeError("midway")

    monkeypatch.setattr(report_folder, "render", fail)
    with pytest.raises(RuntimeError, match="midway"):
        write_report(sleigh, target)
    assert {path.name: path.read_bytes() for path in target.iterdir()} == before
    with pytest.raises(RuntimeError):
        write_report(sleigh, tmp_path / "deep" / "new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report"]


@pytest.mark.exhaustive
def test_an_older_report_is_replaced_and_other_files_stay(sleigh, quick, tmp_path):
    target = tmp_path / "report"
    target.mkdir()
    (target / "notes.txt").write_text("mine")
    (target / "path.png").write_text("also mine: no report lists it")
    (target / "manifold.png").write_text("of an older report")
    (target / "report.json").write_text('{"figures": ["manifold.png", "../escape.png", "notes.txt"]}')
    write_report(sleigh, target)
    found = {path.name for path in target.iterdir()}
    assert found == {"notes.txt", "path.png", "report.html", "report.json", "report.toml", "time_series.png"}
    assert _strict((target / "report.json").read_text(encoding="utf-8"))["figures"] == ["time_series.png"]


@pytest.mark.exhaustive
def test_folders_are_made_readable_and_with_their_parents(sleigh, quick, tmp_path):
    page = write_report(sleigh, tmp_path / "a" / "b")
    assert page == tmp_path / "a" / "b" / "report.html"
    mask = os.umask(0)
    os.umask(mask)
    assert page.parent.stat().st_mode & 0o777 == 0o777 & ~mask
    assert page.is_file()


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(OutputError, match="is a file"):
        check_folder(file)
    with pytest.raises(OutputError, match="cannot be written"):
        check_folder(file / "below")
    with pytest.raises(OutputError, match="cannot be written"):
        check_folder("/proc/nowhere")
    (tmp_path / "report" / "report.html").mkdir(parents=True)
    with pytest.raises(OutputError, match="which is a folder"):
        check_folder(tmp_path / "report")
    assert check_folder(tmp_path / "fresh") == tmp_path / "fresh"
    assert not (tmp_path / "fresh").exists()


def test_a_full_disk_is_an_output_error(sleigh, quick, monkeypatch, tmp_path):
    def full(files, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(report_folder, "_install", full)
    with pytest.raises(OutputError, match="No space left"):
        write_report(sleigh, tmp_path / "report")


@pytest.mark.exhaustive
def test_progress_rises_to_one(sleigh, quick, tmp_path):
    shares: list[float] = []
    write_report(sleigh, tmp_path / "report", progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_numbers_and_words_are_set():
    assert number(1e-5) == "10<sup>−5</sup>"
    assert number(0.00011, 2) == "1.1×10<sup>−4</sup>"
    assert number(-0.0123) == "−0.0123"
    assert number(float("nan")) == "–"
    assert scientific(1.234e-7) == "1.23×10<sup>−7</sup>"
    assert words("at y = 0.9, b = 2.38e-10") == "at <i>y</i> = 0.9, <i>b</i> = 2.38×10<sup>−10</sup>"
    assert words("x = -1: a b = -0.5 < 0") == "<i>x</i> = −1: <i>a b</i> = −0.5 &lt; 0"
    assert signed(-0.5) == "− 0.5"
    assert (
        words("off by 7.1e-05, 21e-5, 1e-5.")
        == "off by 7.1×10<sup>−5</sup>, 21×10<sup>−5</sup>, 10<sup>−5</sup>."
    )
    assert words("p = V1*c1 + k12**2") == (
        "p = <i>V</i><sub>1</sub>·<i>c</i><sub>1</sub> + <i>k</i><sub>12</sub><sup>2</sup>"
    )
    assert words("DOP853, 1e3 and x_0") == "DOP853, 1e3 and <i>x</i><sub>0</sub>"
    assert words("6.1e+01 within the layer") == "6.1×10<sup>1</sup> within the layer"
    assert words("w in [-0.4, -0.2], from -1 to -2") == "w in [−0.4, −0.2], from −1 to −2"
    assert words("like (T - t)^-0.5.") == "like (T - t)<sup>−0.5</sup>."
    assert words("3.2 epsilon^(2/3) or t^(-1/2)") == "3.2 ε<sup>2/3</sup> or t<sup>−1/2</sup>"
    assert words("g_y(x, 0) < 1e-09") == "<i>g</i><sub>y</sub>(<i>x</i>, 0) &lt; 10<sup>−9</sup>"


def test_mathematics_keeps_the_order_given_and_signs_are_signs():
    v, m, epsilon = sp.symbols("v m epsilon")
    setter = Typesetter([epsilon, m, v])
    assert setter.row(m * v).index("<mi>m</mi>") < setter.row(m * v).index("<mi>v</mi>")
    assert "<mo>−</mo>" in setter.row(-v)
    series = setter.power_series([v, -m * v, sp.Integer(0)], epsilon)
    assert series.index("<mi>v</mi>") < series.index("−") < series.index("<mi>O</mi>")
    assert "<mn>3</mn>" in series
    assert "<mn>0</mn>" in setter.power_series([sp.Integer(0)], epsilon)


def test_a_product_of_words_is_not_set_as_one_word():
    Ke, Kt, m, sigma, Cdk1 = sp.symbols("Ke Kt m sigma Cdk1")
    setter = Typesetter([sigma, Ke, Kt, Cdk1, m])
    for product in (Ke * Kt, Ke * m, sigma * Kt, Cdk1 * Ke**2, m * sp.tanh(sigma) ** 2, m * sp.cos(sigma)):
        assert setter.row(product).count('<mspace width="0.17em">') == 1
    assert "mspace" not in setter.row(2 * sigma * m)


@pytest.mark.exhaustive
def test_page_and_json_say_where_the_reduction_ends(monkeypatch, tmp_path):
    drawn = {"failure_map": lambda analysis: charts.failure_map(analysis.failures)}
    monkeypatch.setattr(charts, "applicable", lambda _: drawn)
    analysis = analysis_of("van_der_pol")
    folder = write_report(analysis, tmp_path).parent
    text = (folder / "report.html").read_text(encoding="utf-8")
    Page(text)
    assert "Where the reduction ends" in text
    assert "<i>T</i> = 1.61371 + 7.01432" in text
    assert "2 drops a period" in text
    assert "gsp chart" in text
    assert "for runs over the whole span, both begun on the slow manifold" in text
    assert "reduced runs begin on the slow manifold" in text
    content = _strict((folder / "report.json").read_text(encoding="utf-8"))
    (fold,) = content["boundary"]["folds"]
    assert fold["passage"]["exit"] == pytest.approx(analysis.boundary.folds[0].passage.exit(0.01))
    assert fold["passage"]["variables"]["landing"]["values"] == pytest.approx([-2])
    assert content["boundary"]["orbit"]["period_coefficients"][0] == pytest.approx(1.613705639)
    assert content["boundary"]["orbit"]["period"] == pytest.approx(analysis.boundary.orbit.period(0.01))
    failures = content["failures"]["variables"]
    assert len(failures["least_order"]["values"]) == 11
    assert failures["holds_over_span"]["values"][2] > failures["holds_over_span"]["values"][1]
    assert "failure_map.png" in content["figures"]


@pytest.mark.exhaustive
def test_a_page_without_folds_or_map_says_why_and_nothing_more(sleigh, quick, tmp_path):
    bare = dataclasses.replace(
        sleigh, failures=None, failures_reason=Reason.of("the <runs> failed", "Try again.")
    )
    folder = write_report(bare, tmp_path / "bare").parent
    text = (folder / "report.html").read_text(encoding="utf-8")
    Page(text)
    assert "No failure map: the &lt;runs&gt; failed.</p>" in text
    assert "singular orbit" not in text
    assert "folded" not in text.lower().split("where the reduction ends")[1]
    content = _strict((folder / "report.json").read_text(encoding="utf-8"))
    assert content["failures"] == {"reason": "the <runs> failed. Try again."}
    assert content["boundary"]["folds"] == []


def test_a_canard_point_is_named_with_its_series(quick, tmp_path):
    x, y, a, epsilon = sp.symbols("x y a epsilon")
    system = SlowFastSystem(slow={y: a - x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon, parameters={a: 1})
    region = {"y": (-0.6, 1.2), "x": (1.1, 2.2)}
    scene = Scene(system, region, {"y": 0.6, "x": 2}, (0, 0.2), 0.01, (0.02, 0.01), 1e-4)
    text = write_report(analyse(scene, orders=(0, 1)), tmp_path).read_text(encoding="utf-8")
    Page(text)
    assert "The maximal canard is at <math>" in text
    assert "what happens there" in text
    assert "does not close" in text


def test_captions_set_powers_of_ten(written):
    page = (written / "report.html").read_text(encoding="utf-8")
    assert "&lt;sup&gt;" not in page
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", page, re.DOTALL)
    assert any("10<sup>" in caption for caption in captions)


@pytest.mark.exhaustive
def test_conditions_are_met_over_the_whole_region_only_where_no_loss_is_left_between_samples() -> None:
    analysis = analysis_of("michaelis_menten")
    page = Sections(analysis)
    assert page.conditions() == "met over the whole region"
    left = Exclusion(tried=2, left=({"s": (0.0, 1.0)},), share=0.5)
    sampled = dataclasses.replace(analysis.hyperbolicity, exclusion=left, certificate=None)
    told = Sections(dataclasses.replace(analysis, hyperbolicity=sampled)).conditions()
    assert told.startswith("met at every sample; between them a loss is not excluded over a share of 0.5")


def test_errors_below_those_of_the_reference_are_at_rounding_and_not_called_exact() -> None:
    """Of order 1 the series goes on, and what it leaves out is less than doubles tell; of one epsilon it is 0."""
    s, c, epsilon = sp.symbols("s c epsilon")
    system = gsp.SlowFastSystem(slow={s: -s - c / 10**8}, fast={c: s**2 - c}, epsilon=epsilon)
    scene = gsp.Scene(system, {s: (0.1, 2)}, start={s: 1, c: 1}, span=(0, 1), epsilon=1e-3)
    compared = gsp.compare(scene, orders=(0, 1))
    errors = {**compared.errors, 1: (1e-16, 0.0, 1e-16, 0.0)}
    compared = dataclasses.replace(compared, errors=errors)
    page = Sections(cast(Any, SimpleNamespace(scene=scene, study=gsp.study(scene), comparison=compared)))
    assert gsp.expand(gsp.solve_critical(system).branches[0], order=1).coefficients[1][c] != 0
    assert page.error_at(1) == (0.0, "")
    assert "1.00, at rounding at orders 0 and 1" in page._slopes()
    compared = dataclasses.replace(compared, errors={1: errors[1]})
    page = Sections(cast(Any, SimpleNamespace(scene=scene, study=gsp.study(scene), comparison=compared)))
    assert (
        page.measured().striptags().startswith("within rounding at order 1 from the slow manifold on, at every")
    )


def test_a_long_implicit_branch_is_broken_into_lines() -> None:
    gate, voltage, epsilon = sp.symbols("activation_gate membrane_potential epsilon")
    conductances = sp.symbols("conductance_one conductance_two conductance_three")
    currents = [k * gate * (voltage**5 + k * voltage) for k in conductances]
    system = gsp.SlowFastSystem(
        slow={gate: -gate}, fast={voltage: sum(currents) - voltage}, epsilon=epsilon,
        parameters=dict.fromkeys(conductances, 1),
    )  # fmt: skip
    scene = gsp.Scene(system, {gate: (0.1, 0.2)}, start={gate: 0.1, voltage: 0}, span=(0, 1), epsilon=0.01)
    page = Sections(cast(Any, SimpleNamespace(scene=scene, study=gsp.study(scene))))
    implicit = [row for branch in page.branches() if not branch["explicit"] for row in branch["rows"]]
    assert implicit
    for left, right in implicit:
        assert "<mn>0</mn>" in left
        assert "broken" in right
