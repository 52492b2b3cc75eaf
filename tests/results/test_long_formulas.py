"""Formulas in several lines: they add up to what was broken, and each line has the sign of its first term."""

from __future__ import annotations

import re
from itertools import pairwise

import sympy as sp

from gsp.results.long_formulas import NamedParts, lines
from gsp.results.mathml import Typesetter, operator

a, b, c = sp.symbols("a b c")


def test_a_line_goes_on_with_one_sign() -> None:
    """SymPy prints the terms of a line in an order of its own, which need not begin with its first argument."""
    polynomial = sp.expand((3 * a - 2 * b + c - 1) ** 5)
    text = Typesetter([c, b, a]).broken(polynomial, sign=operator("="))
    rows = re.findall(r"<mtr>(.*?)</mtr>", text)
    assert len(rows) > 5
    for before, row in pairwise(rows):
        plain = re.sub(r"<[^>]+>", "", row)
        assert plain[0] in "+−", (before, plain)
        assert plain[1] not in "+−", plain


def test_the_lines_add_up() -> None:
    polynomial = sp.expand((3 * a - 2 * b + c - 1) ** 5)
    rows, parts = lines(polynomial)
    assert parts == []
    assert sp.expand(sp.Add(*rows) - polynomial) == 0


def test_a_part_has_one_name_on_a_page_and_no_other_symbol_has_it() -> None:
    """Numerators of a slow manifold's coefficient and of the reduced flow's are often the same sum."""
    part = sp.expand((3 * a - 2 * b + c - 1) ** 3)
    taken = sp.Symbol("S_1")
    named = NamedParts([taken.name])
    (first,), parts = lines(part / (part + a**2) / taken, named)
    (again,), none = lines(taken * part**2, named)
    assert none == []
    assert taken not in dict(parts)
    name = {sp.Add(*rows): symbol for symbol, rows in parts}[part]
    assert again == taken * name**2
    assert first.has(name)


def test_a_page_shows_the_name_of_a_part_that_it_has_shown_before() -> None:
    part = sp.expand((3 * a - 2 * b + c - 1) ** 3)
    page = Typesetter([c, b, a])
    first, again = (page.broken(expression, sign=operator("=")) for expression in (a / part, c / part))
    assert "where" in first
    assert len(again) < len(first) / 4
