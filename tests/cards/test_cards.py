"""Cards of every public noun: well-formed, inert, with the mathematics and the figure where there is one."""

from __future__ import annotations

import inspect
import re
from dataclasses import replace
from enum import Enum
from html.parser import HTMLParser

import pytest
import sympy as sp

import gsp
from gsp.results.card_html import html, latex
from gsp.results.drawn import Drawn
from tests.cases import sampled
from tests.test_transport import CASES, noun

x, y, a, epsilon = sp.symbols("x y a epsilon")
NOUNS = sorted(name for name in CASES if not issubclass(getattr(gsp, name), (Enum, BaseException)))
QUICK = ["Branch", "Scene", "SlowFastSystem", "Splitting", "VectorField"]
WITH_MATHEMATICS = {
    "Averaging", "BlowUp", "BlowUpChart", "Branch", "CanardValue", "CriticalManifold", "Nesting", "PiecewiseField",
    "ReducedFlow", "Scene", "SeriesManifold", "SlowFastSystem", "Splitting", "Study", "VectorField",
}  # fmt: skip


class Reader(HTMLParser):
    """Tags in balance, and what of them could run."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        assert tag not in ("script", "iframe", "object", "link")
        assert not any(name.startswith("on") for name, _ in attrs)
        if tag != "img":
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_every_public_noun_has_a_card() -> None:
    kinds = [getattr(gsp, name) for name in NOUNS]
    assert {
        kind for kind in kinds if not hasattr(kind, "_repr_html_") or not hasattr(kind, "_repr_latex_")
    } == set()
    public = {name for name in gsp.__all__ if inspect.isclass(getattr(gsp, name))}
    assert public == set(CASES)


@pytest.mark.parametrize("name", sampled(NOUNS, always=QUICK))
def test_a_card_is_well_formed_and_shows_what_there_is(name: str) -> None:
    value = noun(name)
    card = value._repr_html_()
    read = Reader(card)
    assert read.open == []
    assert ("math" in read.tags) == (name in WITH_MATHEMATICS)
    # An ensemble kept at one time alone has nothing to draw, and says so.
    assert ("img" in read.tags or "no figure: " in card) == isinstance(value, Drawn)
    assert ("no figure: " in card) == (name == "Ensemble")
    formula = value._repr_latex_()
    assert (formula is not None) == (name in WITH_MATHEMATICS)


def test_equations_stand_on_a_card_and_in_latex() -> None:
    system = gsp.SlowFastSystem(slow={y: -y}, fast={x: y - a * x}, epsilon=epsilon, parameters={a: 1})
    assert system._repr_latex_() == (
        r"$\displaystyle \begin{aligned}\dot{y} &= - y \\ \epsilon\,\dot{x} &= - a x + y\end{aligned}$"
    )
    series = gsp.expand(gsp.solve_critical(system).branches[0], order=2)
    formula = series._repr_latex_()
    assert formula is not None
    assert r"x &= \frac{y}{a} + \epsilon\left(\frac{y}{a^{2}}\right)" in formula
    assert "O(\\epsilon^{3})" in formula
    assert "<mfrac>" in html(series)


def test_what_a_scene_is_called_stays_text() -> None:
    scene = gsp.models.load("linear")
    hostile = replace(scene, title='<script>alert(1)</script><img src=x onerror="alert(2)">')
    Reader(html(hostile))
    assert "&lt;script&gt;" in html(hostile)


def test_equations_that_are_too_long_to_read_are_left_to_the_text() -> None:
    long = sum(sp.Rational(1, k) * x**k for k in range(1, 90))
    system = gsp.SlowFastSystem(slow={x: -x}, fast={y: long - y}, epsilon=epsilon)
    assert latex(system) is None
    assert "<math" not in html(system)


def test_a_card_is_legible_whatever_a_notebook_does_to_its_parts() -> None:
    card = noun("Scene")._repr_html_()
    (words,) = re.findall(r"<pre style=\"([^\"]*)\"", card)
    # Columns stand below one another, and a long sentence is not cut off.
    assert "font-family:monospace" in words
    assert "white-space:pre-wrap" in words
    # An equation stays beside its sign; the dot of a derivative stays above its letter without a font for mathematics.
    assert card.count("white-space:nowrap") == 2
    assert "accent" not in card
