"""Formulas in several lines: they add up to what was broken, and each line has the sign of its first term."""

from __future__ import annotations

import re
from itertools import pairwise

import sympy as sp

from gsp.results.long_formulas import lines
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
