"""Expressions as JavaScript: what is printed, and that it computes what Python does."""

import json
import math

import numpy as np
import pytest
import sympy as sp

from gsp.demos.javascript import function
from gsp.demos.page import source
from gsp.errors import BudgetError, UnsupportedFunctionError

x, y, k = sp.symbols("x y k")
HARD = {
    "reserved names": sp.Symbol("in") * sp.Symbol("var") + sp.Symbol("π") ** 2,
    "powers": x**2 / y**3 - (x + y) ** 7 / (x - y) ** 4 + x**-1 + k / x**2,
    "a power of a negative": (-x) ** 3 + (-x) ** 2 + (x * y) ** 2,
    "roots": sp.sqrt(x + 3) + 1 / sp.sqrt(y + 3) + (x + 3) ** sp.Rational(2, 3),
    "a power that varies": (x + 3) ** k + 2**y,
    "thirds": sp.Rational(1, 3) * x - sp.Rational(-5, 7) / y,
    "long numbers": sp.Integer(3) ** 60 * x + sp.Rational(10**30 + 1, 10**29) * y,
    "extremes": sp.Max(x, y, k) - sp.Min(x, y, k) * sp.Max(0, x),
    "signs": sp.sign(x - y) * sp.Abs(x * y) + sp.Heaviside(x) + sp.Heaviside(y, 1),
    "pieces": 2 * sp.Piecewise((x, x < y), (k, y < 0), (x * y, True)),
    "elementary": sp.exp(-x) * sp.sin(y) + sp.cos(x) * sp.tan(y / 9) + sp.tanh(x) + sp.sinh(y) - sp.cosh(k),
    "inverse": sp.atan(x) + sp.asinh(y) + sp.log(x**2 + 1) + sp.asin(x / 9) + sp.acos(y / 9) + sp.atanh(x / 9),
    "constants": sp.pi * x + sp.E * y + sp.exp(2),
    "sums that overflow": (x + 3 * sp.exp(900 * y)) / (1 + sp.exp(900 * y)) + sp.log(1 + sp.exp(900 * x)),
    "the error function": sp.erf(x) + sp.erf(9 * y),
}


def symbols_of(expression: sp.Expr) -> list[sp.Symbol]:
    return sorted(expression.free_symbols, key=lambda s: s.name)  # pyright: ignore[reportAttributeAccessIssue]


def test_every_kind_of_expression_computes_what_python_does(page) -> None:
    points = np.random.default_rng(7).uniform(-2, 2, (6, 3))
    code, expected = [source("functions.js")], []
    for i, expression in enumerate(HARD.values()):
        names = symbols_of(expression)
        code.append(function(f"f{i}", [expression], {"z": names}))
        for point in points:
            # In fifty digits, so that the comparison is with the exact value.
            value = expression.evalf(50, subs=dict(zip(names, map(sp.Float, point))))
            expected.append(float(value) if value.is_real else math.nan)
    calls = (
        f"const found = []; for (const f of [{', '.join(f'f{i}' for i in range(len(HARD)))}]) "
        "for (const z of arguments[0]) { const out = [0]; f(z, out); found.push(String(out[0])); } return found;"
    )
    found = [
        float(text.replace("Infinity", "inf")) for text in page.run("\n".join([*code, calls]), points.tolist())
    ]
    wrong = {}
    for i, name in enumerate(HARD):
        rows = slice(i * len(points), (i + 1) * len(points))
        if not np.allclose(found[rows], expected[rows], rtol=2e-14, atol=1e-15, equal_nan=True):
            wrong[name] = (found[rows], expected[rows])
    assert wrong == {}


def test_no_name_of_a_model_stands_in_code() -> None:
    state = sp.Symbol('x"];alert(1)//')
    assert function("f", [state**2], {"z": [state]}) == "function f(z, out) {\n  out[0] = (z[0]*z[0]);\n}\n"


def test_shared_parts_are_computed_once() -> None:
    text = function("f", [sp.sin(x * y) + 1, sp.sin(x * y) ** 2], {"z": [x, y]})
    assert text.count("Math.sin") == 1


def test_numbers_are_printed_exactly() -> None:
    text = function("f", [sp.Rational(1, 10) * x, sp.Rational(2**60 + 1, 2**61)], {"z": [x]})
    assert "1/10" in text
    assert repr((2**60 + 1) / 2**61) in text
    assert json.loads(repr(0.1)) == 1 / 10


def test_what_javascript_lacks_is_refused_by_name() -> None:
    with pytest.raises(UnsupportedFunctionError, match="besselj"):
        function("f", [sp.besselj(0, x)], {"z": [x]})
    with pytest.raises(UnsupportedFunctionError, match="stands for no argument"):
        function("f", [x * y], {"z": [x]})
    with pytest.raises(BudgetError, match="double precision"):
        function("f", [sp.Integer(10) ** 400 * x], {"z": [x]})
