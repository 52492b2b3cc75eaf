"""What a report is like to read: long formulas whole, failures that lead to their place, a high panel."""

import pytest
import sympy as sp

import gsp
from gsp.report import write_report
from gsp.results.long_formulas import WIDTH, lines, width

# Seven parameters, and tight binding, whose critical manifold is a root of a root.
BINDING = """
[parameters]
E = 1
K = "1/2"
k_cat = 1
L = "1/3"
M = 2
k_on = 1
r = "1/5"
[slow]
s = "-k_cat*c - r*s"
[fast]
c = "k_on*((E + L*s - c)*(s + M*L - c) - K*c)"
[region]
s = [0.5, 2]
[start]
s = 1.5
c = 0.3
[scene]
span = [0, 2]
epsilon = 0.02
"""
# The slow differences grow as fast as the fast ones fall: the normal rate does not dominate at this epsilon.
SLOWER = """
[slow]
x = "x*(1 - x)*30"
[fast]
y = "(x - y)*(1 + x)"
[region]
x = [0.1, 1]
[start]
x = 0.2
y = 0.2
[scene]
span = [0, 0.1]
epsilon = 0.1
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    def write(text: str):
        folder = tmp_path_factory.mktemp("model")
        (folder / "model.toml").write_text(text, encoding="utf-8")
        return write_report(gsp.analyse(gsp.load(folder / "model.toml"), order=1), folder / "report")

    return write


def test_a_wide_formula_is_told_in_lines_that_give_it_back() -> None:
    a, b, c, d, e = sp.symbols("a b c d e")
    total = a + b * c + d * e + a * d
    root = sp.sqrt(
        total**4 - 4 * a * b * total + sp.sqrt(total + a * b * c * d * e + b**2 * c**3 * d + a * e**5)
    )
    wide = (total**3 - root) / (2 * a * (b + c + d * e + b**2 * c**2)) ** 3 + sp.expand((a + b + c + d) ** 4)
    assert width(wide) > WIDTH
    rows, parts = lines(wide)
    assert len(rows) > 1
    assert parts
    assert all(width(row) <= WIDTH for row in [*rows, *(row for _, named in parts for row in named)])
    again = sp.Add(*rows)
    for symbol, named in parts:
        again = again.subs(symbol, sp.Add(*named))
    at = {a: 1.3, b: 0.7, c: 2.1, d: 0.4, e: 1.9}
    assert complex(again.subs(at)) == pytest.approx(complex(wide.subs(at)), rel=1e-12)
    assert lines(a + b) == ([a + b], [])


@pytest.mark.exhaustive
@pytest.mark.parametrize("width_", [1280, 1000])
def test_no_formula_of_a_report_is_cut_and_the_panel_holds_its_sliders(written, width_: int, page) -> None:
    page.open(written(BINDING), width=width_)
    page.settle()
    cut = page.run(
        "return [...document.querySelectorAll('.display')].filter((e) => e.scrollWidth > e.clientWidth + 1)"
        ".map((e) => [e.scrollWidth, e.clientWidth]);"
    )
    assert cut == []
    page.driver.execute_async_script("setTimeout(arguments[0], 1500)")
    page.driver.switch_to.frame(page.driver.find_element("css selector", "iframe.panel"))
    try:
        high, seen, sliders = page.run(
            "return [document.documentElement.scrollHeight, innerHeight,"
            " document.querySelectorAll('.slider').length];"
        )
        assert sliders == 9
        assert high <= seen + 1
        page.run("document.querySelectorAll('details').forEach((part) => (part.open = true))")
        page.driver.execute_async_script("setTimeout(arguments[0], 500)")
        high, seen = page.run("return [document.documentElement.scrollHeight, innerHeight]")
        assert high <= seen + 1
    finally:
        page.driver.switch_to.default_content()


@pytest.mark.exhaustive
def test_a_condition_that_fails_leads_to_where_it_fails(written, page) -> None:
    page.open(written(SLOWER))
    place = page.run(
        "const link = [...document.querySelectorAll('td a')].find((a) => a.textContent.includes('normal rate'));"
        "link.click(); return document.querySelector(location.hash).tagName;"
    )
    assert place == "FIGURE"
