"""Values in the place of symbols: the expression where there is one, not a number where there is none."""

import pytest
import sympy as sp

from gsp.algebra.substitution import substituted

x, y = sp.symbols("x y")


@pytest.mark.parametrize(
    "expression",
    [x**2 + 3**y, sp.Max(x, sp.sin(y)), 3 ** (x + 100), sp.exp(x) / y, sp.Integer(2), x, sp.Abs(x - y)],
)
@pytest.mark.parametrize("values", [{}, {x: sp.Rational(1, 3)}, {x: y, y: x}, {y: x + 1}])
def test_what_has_a_value_is_replaced_as_sympy_does_it(expression: sp.Expr, values) -> None:
    assert substituted(expression, values) == expression.xreplace(values)


@pytest.mark.parametrize(
    ("expression", "values"),
    [
        (sp.Min(x, sp.acos(y)), {y: sp.Integer(1000)}),
        (1 + sp.Max(0, sp.acosh(y)) * x, {y: sp.Rational(1, 2)}),
        (sp.Min(x, 1 / y), {y: sp.Integer(0)}),
        (sp.Rational(1, 10) ** (y + sp.Rational(1, 3)), {y: sp.Integer(10) ** 300}),
        (sp.sin(3**y), {y: sp.Integer(10) ** 8 + x}),
        (3 ** (2**y), {y: sp.Integer(60)}),
    ],
)
def test_what_has_no_value_or_one_of_many_digits_is_not_a_number(expression: sp.Expr, values) -> None:
    assert substituted(expression, values) is sp.nan
