"""What a page is like to use: fingers, phones, paper, files, and axes that show what there is to see."""

import csv
import io
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

import gsp
from gsp import models

# x blows up at t = 1.
BLOWING = """
[slow]
x = "x^2"
[fast]
y = "x - y"
[region]
x = [0, 2]
[start]
x = 1
y = 0
[scene]
span = [0, 2]
epsilon = 0.05
"""
# Seven parameters, of which five do nothing worth speaking of, and y = x is exact at every order but 0.
MANY = """
[parameters]
little = "1/1000"
none = 1
strong = 1
less = "1/50"
least = "1/10000"
also = "1/300"
weak = "1/100"
[states]
x = "-strong*x + little*x^2 + least*x^3 + also*x^4 + weak*x^5 + less + 0*none"
y = "(x - y)/epsilon"
[region]
x = [0, 2]
y = [0, 2]
[start]
x = 1
y = 0
[scene]
span = [0, 3]
epsilon = 0.02
[units]
x = "mol"
t = "s"
strong = "1/s"
"""
# The fast variable does not act on the slow one: every order of x is the run itself.
EXACT = """
[slow]
x = "-x"
[fast]
y = "x - y"
[region]
x = [0, 2]
[start]
x = 1
y = 1
[scene]
span = [0, 3]
epsilon = 0.02
"""
# x falls by a tenth of a percent and y stays below 1e-4, over times of seven digits.
TIGHT = """
[slow]
x = "-x/10^9"
[fast]
y = "x/10^9 - y"
[region]
x = [90000, 110000]
[start]
x = 100000
y = 0
[scene]
span = [1000000, 2000000]
epsilon = 0.02
"""
# x = cos t, and no small parameter.
UNREDUCED = """
[states]
x = "y"
y = "-x"
[start]
x = 1
y = 0
[scene]
span = [0, 1]
"""


@pytest.fixture
def opened(page, tmp_path):
    def open_(model: str, **options):
        if "\n" in model:
            (tmp_path / "model.toml").write_text(model, encoding="utf-8")
        scene = gsp.load(tmp_path / "model.toml") if "\n" in model else models.load(model)
        page.open(gsp.write_demo(scene, tmp_path / "demo.html"), **options)
        page.settle()
        return page

    return open_


@pytest.mark.exhaustive
@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("name", models.names())
def test_whatever_is_pressed_is_as_large_as_a_finger(name: str, width: int, opened) -> None:
    page = opened(name, width=width, height=844)
    small = page.run(
        "document.querySelectorAll('details').forEach((part) => (part.open = true));"
        "const pressed = [...document.querySelectorAll('button, select, summary, input, .order')];"
        "return pressed.filter((e) => e.offsetParent && !e.closest('label')).map((e) => [e.id || e.textContent,"
        " e.getBoundingClientRect().width, e.getBoundingClientRect().height]).filter((e) => e[1] < 44 || e[2] < 44);"
    )
    assert small == []
    assert page.run("return document.documentElement.scrollWidth") <= width


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["chaplygin_sleigh", "linear"])
def test_on_a_phone_a_picture_stays_in_sight_beside_its_sliders(name: str, opened) -> None:
    page = opened(name, width=390, height=844)
    assert page.run("return byId('sliders').closest('figure') !== null")
    sliders = page.run(
        "return [...document.querySelectorAll('#sliders > .slider input[type=range]')].map((e) => e.id)"
    )
    assert {"epsilon", "length"} <= set(sliders)
    for slider in sliders:
        page.run("document.getElementById(arguments[0]).scrollIntoView({ block: 'center' })", slider)
        page.settle()
        top, bottom, at, high = page.run(
            "const frame = byId('sliders').closest('figure').querySelector('.frame').getBoundingClientRect();"
            "const box = byId(arguments[0]).getBoundingClientRect();"
            "return [frame.top, frame.bottom, box.top, innerHeight];",
            slider,
        )
        assert top > -1
        assert bottom < at < high
    page.window(1280, 900)
    page.settle()
    page.driver.execute_async_script("setTimeout(arguments[0], 100)")
    assert page.run("return byId('sliders').parentElement.id") == "controls"


def test_the_parameters_that_matter_come_first_and_the_others_fold(opened) -> None:
    page = opened(MANY)
    shown = page.run(
        "return [...document.querySelectorAll('#sliders > .slider label')].map((label) => label.textContent)"
    )
    assert shown[1] == "strong (1/s)"
    assert shown[-1] == "length of the run (s)"
    folded = page.run("return [...document.querySelectorAll('#more .slider label')].map((l) => l.textContent)")
    assert folded[-1] == "none"
    assert "least" in folded
    assert len(shown) + len(folded) == 9
    assert page.run("return byId('more').open") is False
    told = page.run("return byId('parameter-2').parentElement.title")
    # d/dk exp(-k t) is largest at t = 1/k: 1 % of k moves x by 1 %/e.
    moved = re.fullmatch(r"1 % more moves the run by (.*) %", told)
    assert moved is not None
    assert float(moved[1]) == pytest.approx(np.exp(-1), rel=0.15)


def test_the_numbers_of_an_axis_are_told_apart(opened) -> None:
    page = opened(EXACT)
    say = "const {values, step} = ticks(...arguments, 5); return tickTexts({values, step}, (text) => text.length < 7);"
    for low, high in [(100000, 100030), (1, 1.0004), (0, 4e-5), (-3e-7, 3e-7), (2020.25, 2020.75), (0, 3e9)]:
        texts = page.run(say, low, high)
        assert len(texts) == len(set(texts)) > 1, texts
        read = [float(text.replace("−", "-")) for text in texts]
        assert np.allclose(
            read, page.run("return ticks(...arguments, 5).values", low, high), rtol=1e-12, atol=0
        )
    assert page.run(say, 0, 4e-5)[1] == "1e−5"
    assert page.run(say, 2020.25, 2020.75)[0] == "2020.3"
    for low, high in [(-2.9, -2.2), (0.31, 0.69), (-0.5, 0.5), (-3, 1)]:
        texts = page.run("return decades(...arguments).texts", low, high)
        assert len(set(texts)) > 1, texts
    page.run("views.scales.box = [0, 1, -4, 3]; views.scales.Y = (v) => 22 + (80 * (3 - v)) / 7")
    heights = page.run(
        "const got = []; views.scales.context.fillText = (text, x, y) => text.startsWith('10') && got.push(y);"
        "views.scales.axes('', '', { yLog: true }); delete views.scales.context.fillText; return got;"
    )
    # Twelve pixels are the height of the letters.
    assert np.all(np.abs(np.diff(heights)) > 12)


def test_the_length_of_a_late_run_is_told_to_the_digits_that_it_has(opened) -> None:
    page = opened(TIGHT.replace("1000000, 2000000", "2026.4, 2027"))
    assert page.run("return document.getElementById('length-number').value") == "0.6"
    assert page.run("return [difference(3, 1), difference(1e6 + 0.25, 1e6), difference(1, 0)]") == [2, 0.25, 1]


@pytest.mark.parametrize("width", [390, 1280])
def test_no_number_of_an_axis_is_cut(width: int, opened) -> None:
    page = opened(TIGHT, width=width)
    written = page.run(
        "const got = []; const { fillText } = CanvasRenderingContext2D.prototype;"
        "CanvasRenderingContext2D.prototype.fillText = function (text, x, y, most = Infinity) {"
        "  const width = Math.min(most, this.measureText(text).width);"
        "  const left = x - width * { left: 0, center: 0.5, right: 1 }[this.textAlign];"
        "  got.push([text, left, this.canvas.clientWidth - left - width]);"
        "};"
        "draw(); CanvasRenderingContext2D.prototype.fillText = fillText; return got;"
    )
    assert len(written) > 10
    assert [row for row in written if min(row[1:]) < 0] == []


def test_the_full_run_is_made_finely_also_where_nothing_is_reduced(opened) -> None:
    page = opened(UNREDUCED)
    page.driver.execute_async_script(
        "const look = () => (current.rtol < 1e-10 ? arguments[0]() : setTimeout(look, 20)); look();"
    )
    end, drawn = page.run("return [current.result.full.states.at(-1)[0], current.curves.full.q[0].at(-1)]")
    assert drawn == end == pytest.approx(np.cos(1.0), abs=1e-9)
    assert "at 1e-11" in page.run("return document.getElementById('orders').innerText")
    assert page.complaints() == []


def test_axes_do_not_follow_a_run_that_blows_up(opened) -> None:
    page = opened(BLOWING)
    assert page.run("return current.result.full.status") != "reached"
    assert max(page.run("return [...views.plane.box, ...views.trace.box]")) < 100


@pytest.mark.exhaustive
def test_a_note_of_an_ending_leads_to_its_moment(opened) -> None:
    page = opened("van_der_pol", fragment="#end=4&epsilon=0.01&orders=0&s.x=2&s.y=0.66667")
    ended = page.run(
        "const note = [...document.querySelectorAll('#notes button')].find((b) => b.textContent.includes('order 0'));"
        "note.click(); return [now, current.result.pieces[0].runs[0].ended];"
    )
    assert ended[0] == pytest.approx(ended[1], rel=1e-3)


@pytest.mark.exhaustive
def test_what_is_exact_is_said_and_not_drawn_as_noise(opened) -> None:
    page = opened(EXACT, fragment="#orders=0.1")
    page.measured()
    drawn, said = page.run(
        "let dots = 0; const said = []; const view = views.errors; const { dot, word } = view;"
        "view.dot = function (...a) { dots += 1; dot.apply(this, a); };"
        "view.word = function (text, ...a) { said.push(text); word.call(this, text, ...a); };"
        "draw(); delete view.dot; delete view.word; return [dots, said];"
    )
    assert drawn == 0
    assert "exact to rounding: order 0, 1" in said


@pytest.mark.exhaustive
def test_a_picture_is_saved_as_it_stands_and_its_numbers_with_it(opened) -> None:
    page = opened("chaplygin_sleigh", fragment="#step=6")
    page.measured()
    for name in page.run("return Object.keys(views)"):
        root = ET.fromstring(page.run("return svgOf(views[arguments[0]])", name))
        kinds = [part.tag.rpartition("}")[2] for part in root.iter()]
        assert kinds.count("path") > 3, name
        assert kinds.count("text") > 3, name
        rows = list(csv.reader(io.StringIO(page.run("return csvOf(arguments[0])", name))))
        assert len({len(row) for row in rows}) == 1
        assert len(rows) > 3
    rows = list(csv.DictReader(io.StringIO(page.run("return csvOf('path')"))))
    assert {row["run"] for row in rows} == {"full", "(18) as printed", "(18) with its sign corrected"}
    last = [row for row in rows if row["run"] == "full"][-1]
    expected = gsp.study(models.load("chaplygin_sleigh")).full(0.05)
    assert float(last["x"]) == pytest.approx(expected["x"][-1], abs=1e-6)
    saved = page.run(
        "const got = []; offer = (blob, name) => got.push([name, blob.type, blob.size]);"
        "for (const button of views.plane.figure.querySelectorAll('.save button')) button.click(); return got;"
    )
    page.driver.execute_async_script("setTimeout(arguments[0], 200)")
    assert [name for name, *_ in saved][:2] == ["plane.svg", "plane.csv"] or len(saved) == 2
    assert page.complaints() == []


def test_nothing_plays_by_itself_where_motion_is_not_wanted(opened) -> None:
    page = opened("chaplygin_sleigh")
    assert page.run("return playing !== null")
    wanted = {"features": [{"name": "prefers-reduced-motion", "value": "reduce"}]}
    page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", wanted)
    try:
        page.run("turnTo(1)")
        assert page.run("return playing") is None
        page.run("byId('play').click()")
        assert page.run("return playing !== null")
    finally:
        page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_paper_has_the_pictures_and_not_what_is_pressed(opened) -> None:
    page = opened("chaplygin_sleigh")
    page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        seen = "return [...document.querySelectorAll(arguments[0])].filter((e) => e.offsetParent).length"
        assert page.run(seen, "nav button, .save button, input[type=range]") == 0
        assert page.run(seen, "canvas") > 0
        assert page.run(seen, "#tale") == 1
        # A picture keeps the shape in which it was drawn, and a run that is not drawn has no line.
        shapes = (
            "return [...document.querySelectorAll('canvas')].filter((e) => e.offsetParent)"
            ".map((e) => (e.clientWidth * e.height) / (e.clientHeight * e.width))"
        )
        assert page.run(shapes) == pytest.approx([1] * len(page.run(shapes)), abs=0.02)
        checked = page.run("return document.querySelectorAll('.order input:checked').length")
        assert page.run(seen, ".order:not(.full)") == checked
    finally:
        page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
