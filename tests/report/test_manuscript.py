"""The manuscript: it compiles as it is, its numbers are those of report.json, and no text of a model is a command."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

import gsp
from gsp import charts
from gsp.report import write_report
from gsp.report.manuscript import FIRST, SECOND
from gsp.report.setting import Setting
from gsp.report.tex import escaped, tex
from gsp.results import mathml
from gsp.results.long_formulas import count_lines
from gsp.results.mathml import Typesetter
from gsp.systems.system import SlowFastSystem
from tests.analyses import analysis_of
from tests.cases import sampled
from tests.example_systems import saddle_scene

NUMBER = re.compile(r"\d+(?:\.\d+)?")
POWER = re.compile(r"(?:(\d+(?:\.\d+)?)\s*\\(?:\(\\times\\\)|times)\s*)?\{?\b10\}?(?:\\\()?\^\{(-?\d+)\}")
HOSTILE = "\\input{/etc/passwd} 50%_#1 $x^2$ & ~ {unbalanced \\end{document} ^^5c漢 -- ´"


def figures_of(text: str) -> Iterator[tuple[float, float]]:
    """(value, a unit of its last digit) of each number in the body of a manuscript."""
    body = text.partition(r"\begin{document}")[2].partition(r"\bibliographystyle")[0]
    # What sets widths, names files or cites is no number of the text.
    body = re.sub(r"\\(?:cite|includegraphics\[.*?\])\{.*?\}|\{[^{}]*\\linewidth\}", "", body)
    for mantissa, power in POWER.findall(body):
        scale = 10.0 ** int(power)
        yield float(mantissa or 1) * scale, scale * _unit(mantissa or "1")
    for number in NUMBER.findall(POWER.sub(" ", body)):
        yield float(number), _unit(number)


def _unit(number: str) -> float:
    return 10.0 ** -len(number.partition(".")[2])


def known_numbers(content: object) -> Iterator[float]:
    """The numbers of a report.json, those within its texts too, but for the cells of the failure map."""
    if isinstance(content, dict):
        for key, part in content.items():
            if key not in ("failures", "timings"):
                yield from known_numbers(part)
    elif isinstance(content, list):
        for part in content:
            yield from known_numbers(part)
    elif isinstance(content, str):
        yield from map(float, re.findall(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?", content))
    elif isinstance(content, (int, float)) and not isinstance(content, bool):
        yield abs(float(content))


def unknown(text: str, content: object) -> list[float]:
    """The numbers of a manuscript that are no rounding of a number of report.json."""
    known = sorted(set(known_numbers(content)))
    return [
        value
        for value, unit in figures_of(text)
        # A whole number stands as it is, and a bound may be rounded to either side.
        if not any(value == k or (unit < 1.0 and abs(value - k) < unit) for k in known)
    ]


@pytest.fixture(scope="module", autouse=True)
def few_figures() -> Iterator[None]:
    """Those that a manuscript sets; all the others are written in the same way."""
    every = charts.applicable
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            charts, "applicable", lambda found: {n: d for n, d in every(found).items() if n in (*FIRST, SECOND)}
        )
        yield


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    root = tmp_path_factory.mktemp("manuscripts")

    @cache
    def written(name: str) -> Path:
        return write_report(analysis_of(name), root / name, latex=True).parent

    return written


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model with the longest names and texts that are commands."""
    s, c, k, e = sp.symbols("s_free_2 ρ_été 量 epsilon")
    system = SlowFastSystem(
        slow={s: -k * s}, fast={c: s - (1 + s) * c}, epsilon=e, parameters={k: sp.Rational(1, 3)}
    )
    scene = gsp.Scene(
        system,
        region={"s_free_2": (0.1, 2), "ρ_été": (0, 1)},
        start={"s_free_2": 1, "ρ_été": 0},
        span=(0, 1),
        epsilon=0.02,
        title=HOSTILE,
        description=HOSTILE,
        source=HOSTILE,
    )
    return write_report(gsp.analyse(scene, order=1), tmp_path_factory.mktemp("hostile"), latex=True).parent


def text_of(folder: Path) -> str:
    return (folder / "report.tex").read_text(encoding="utf-8")


def compiled(folder: Path) -> str:
    """The text of the PDF that latexmk makes of a manuscript."""
    if shutil.which("latexmk") is None or shutil.which("pdftotext") is None:
        pytest.skip(
            "there is no latexmk or pdftotext: apt-get install latexmk texlive-latex-recommended poppler-utils"
        )
    run = subprocess.run(
        ["latexmk", "-pdf", "-interaction=nonstopmode", "report.tex"],
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stdout[-3000:]
    log = (folder / "report.log").read_text(encoding="latin-1")
    assert "Overfull" not in log
    assert "undefined" not in log
    return text_in(folder / "report.pdf")


def text_in(pdf: Path) -> str:
    return subprocess.run(["pdftotext", "-layout", pdf, "-"], capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize(
    "name", sampled(["van_der_pol", "michaelis_menten", "chaplygin_sleigh"], always=["van_der_pol"])
)
def test_every_number_is_one_of_report_json(folders, name) -> None:
    content = json.loads((folders(name) / "report.json").read_text(encoding="utf-8"))
    text = text_of(folders(name))
    assert len(list(figures_of(text))) > 60
    assert unknown(text, content) == []
    assert text.count("& yes") == len(content["hyperbolicity"]["conditions"])


@pytest.mark.exhaustive
def test_what_is_lost_stands_beside_the_conditions(tmp_path) -> None:
    x, y, epsilon = sp.symbols("x y epsilon")
    system = SlowFastSystem(slow={x: sp.Integer(-1)}, fast={y: x - y**2}, epsilon=epsilon)
    scene = gsp.Scene(system, {"x": (-0.5, 1)}, {"x": 1, "y": 1}, (0, 0.9), 0.01, tolerance=1e-3)
    folder = write_report(gsp.analyse(scene, order=1), tmp_path, latex=True).parent
    content = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    text = text_of(folder)
    (loss,) = content["hyperbolicity"]["losses"]
    assert loss["kind"] == "fold"
    assert "what is lost, and where" in text
    assert "It ends here: " in text
    assert "The conditions hold for" in text
    assert unknown(text, content) == []
    assert "nothing: it escapes, and y goes to -infinity" in json.dumps(content)
    assert "what is lost" in compiled(folder)


def test_a_number_that_is_off_is_seen() -> None:
    text = r"\begin{document}1.98, 6.83\(\times\)10\(^{-3}\), 10\(^{-6}\), \(3 x^{2}\)"
    content = {"slope": [1.9836, -0.006829], "tolerance": "at most 1e-06", "h": "3*x**2"}
    assert unknown(text, content) == []
    for right, wrong, value in (
        ("1.98", "2.03", 2.03),
        ("6.83", "6.85", 6.85e-3),
        ("-6}", "-7}", 1e-7),
        ("3 x", "5 x", 5),
    ):
        assert unknown(text.replace(right, wrong), content) == pytest.approx([value])


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["van_der_pol", "michaelis_menten"])
def test_a_small_model_takes_two_pages_as_it_is(folders, name) -> None:
    printed = compiled(folders(name))
    assert printed.count("\f") == 2
    assert ("Where the reduction ends" in printed) == (name == "van_der_pol")
    content = json.loads((folders(name) / "report.json").read_text(encoding="utf-8"))
    body = printed.partition("References")[0]
    decimals = re.findall(r"(?<![\d.])\d+\.\d+(?![\d.×])", body)
    # The ticks of axes are the figures' own.
    figures = " ".join(text_in(figure) for figure in folders(name).glob("*.pdf") if figure.name != "report.pdf")
    known = [*known_numbers(content), *map(float, re.findall(r"\d+\.\d+", figures))]
    assert len(decimals) > 20
    assert [d for d in decimals if not any(abs(float(d) - k) < _unit(d) for k in known)] == []


@pytest.mark.exhaustive
def test_what_a_model_says_is_printed_and_never_read(hostile) -> None:
    assert r"\input{" not in text_of(hostile)
    printed = " ".join(compiled(hostile).split())
    assert r"\input{/etc/passwd} 50%_#1 $x" in printed
    assert "root:" not in printed
    assert "References" in printed


@pytest.mark.exhaustive
def test_the_command_that_makes_it_again_makes_the_same(folders, tmp_path) -> None:
    folder = folders("michaelis_menten")
    assert "gsp report report.toml --latex --order 3 -o ." in text_of(folder)
    again = gsp.analyse(gsp.load(folder / "report.toml"), order=3)
    write_report(again, tmp_path, latex=True)
    assert text_of(tmp_path) == text_of(folder)


@pytest.mark.exhaustive
def test_files_are_listed_and_go_with_the_report_that_has_none(tmp_path) -> None:
    analysis = gsp.analyse(saddle_scene(), order=1)
    write_report(analysis, tmp_path, latex=True)
    written = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["manuscript"]
    assert {"report.tex", "report.bib", "error_against_epsilon.pdf"} <= set(written)
    assert all((tmp_path / name).read_bytes().startswith(b"%PDF") for name in written if name.endswith(".pdf"))
    (tmp_path / "mine.pdf").write_bytes(b"")
    write_report(analysis, tmp_path)
    assert [path.name for path in sorted(tmp_path.iterdir()) if path.suffix in (".tex", ".bib", ".pdf")] == [
        "mine.pdf"
    ]


COMMANDS = re.compile(
    r"\\(?:text(?:backslash|brace(?:left|right)|asciicircum|asciitilde|less|greater|bar|quotedbl|asciigrave|degree)"
    r"|dots|ss|ae|AE|oe|OE|[oOlLi])\{\}|\\[$&#%_]|\\[`'^~=u.\"rHvck]\{[A-Za-z]\}|\\texttt\{U\+[0-9A-F]{4,6}\}"
    r"|\\\((?:[\^_]\{\d\}|\^\{-\}|-|\\[A-Za-z]+)\\\)|\{\}|\{[\[*]\}|~"
)


@given(st.text() | st.text(alphabet="\\{}$&#^_%~[]*-'`\n\r\t\x00aé"))
def test_escaped_text_has_no_character_that_tex_acts_on(text: str) -> None:
    assert re.search(r"[\\{}$&#^_%~\n\r\t\x00-\x1f\x7f-\U0010ffff]", COMMANDS.sub("", escaped(text))) is None


def test_formulas_are_set_as_the_page_has_them() -> None:
    x, k = sp.symbols("x k_cat")
    set_ = Typesetter([k, x])
    made = {
        sp.exp(-x / k): r"\(e^{-\frac{x}{k_{\mathrm{cat}}}}\)",
        sp.sqrt(x + 1): r"\(\sqrt{x+1}\)",
        x ** sp.Rational(1, 3): r"\(\sqrt[3]{x}\)",
        sp.tanh(x / 2) ** 2: r"\({\tanh \left(\frac{x}{2}\right)}^{2}\)",
        sp.Symbol("epsilon"): r"\(\epsilon \)",
    }
    assert {e: tex(set_.inline(e)) for e in made} == made


def test_a_coefficient_that_nobody_would_read_says_where_it_stands() -> None:
    """A sum of 200 terms is a line of text on the page and in the manuscript; a short one is set."""
    x = sp.Symbol("x")
    setting = Setting([x])
    name = mathml.row("<mi>h</mi>")
    long = sp.Add(*(sp.Integer(k + 1) * sp.sin(k * x) ** 2 for k in range(200)))
    _, right = setting.formula(name, long)
    assert f"a formula of {count_lines(long)} lines, in report.json" in tex(right)
    assert setting.formula(name, x**2 + 1) == setting.block(name, x**2 + 1)
    ((_, rate),) = setting.rates([(x, long)])
    assert rate == right
