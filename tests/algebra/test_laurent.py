"""Laurent series in epsilon against SymPy's, on random rational functions, and poles that cancel."""

from __future__ import annotations

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gsp.algebra.laurent import laurent, misplaced_epsilon, pole_order
from gsp.errors import DeclarationError

x, y, eps = sp.symbols("x y epsilon")

# Makes every power of epsilon that occurs positive.
SHIFT = 20

small = st.integers(-3, 3)
coefficients = st.sampled_from([sp.Integer(0), sp.Integer(1), sp.Integer(-2), x, y, x + y, x * y - 1])
polynomials = st.lists(coefficients, min_size=1, max_size=3).map(
    lambda row: sp.Add(*[c * eps**k for k, c in enumerate(row)])
)


def nonzero(expression: sp.Expr) -> bool:
    return expression.expand() != 0


quotients = st.builds(lambda n, d, k: n / d * eps**k, polynomials, polynomials.filter(nonzero), small)


@pytest.mark.exhaustive
@given(quotients, quotients, st.integers(-2, 3))
@settings(max_examples=10)
def test_the_coefficients_are_those_of_sympy(left: sp.Expr, right: sp.Expr, order: int) -> None:
    expression = left * right + left - 3 * right
    found = laurent(expression, eps, order=order)
    assert all(k <= order and not c.has(eps) and sp.cancel(c) != 0 for k, c in found.items())
    # At rational x and y it is a question about polynomials in epsilon: d sum c_k eps^k - n has no low term.
    point = {x: sp.Rational(3, 7), y: sp.Rational(-11, 5)}
    numerator, denominator = sp.fraction(sp.cancel(expression.subs(point)))
    valuation = min(m[0] for m in sp.Poly(denominator, eps).monoms())
    partial = sp.Add(*[c.subs(point) * eps ** (k + SHIFT) for k, c in found.items()])
    defect = sp.Poly(denominator * partial - numerator * eps**SHIFT, eps)
    assert all(defect.coeff_monomial(eps**k) == 0 for k in range(order + 1 + valuation + SHIFT))


@pytest.mark.exhaustive
@given(quotients)
@settings(max_examples=40)
def test_the_pole_order_is_that_of_the_reduced_fraction(expression: sp.Expr) -> None:
    numerator, denominator = sp.fraction(sp.cancel(expression))
    lowest = [min((m[0] for m in sp.Poly(p, eps).monoms()), default=0) for p in (numerator, denominator)]
    expected = 0 if numerator == 0 else max(0, lowest[1] - lowest[0])
    assert pole_order(expression, eps) == expected


@pytest.mark.parametrize("expression", [(1 + x * eps) ** -2, 1 / (2 - eps * sp.sin(x)), (x + 1 / eps) ** 3])
def test_the_coefficients_are_those_of_sympys_series(expression: sp.Expr) -> None:
    found = laurent(expression, eps, order=4)
    series = sp.series(expression, eps, 0, 5).removeO()
    assert sp.simplify(series - sp.Add(*[c * eps**k for k, c in found.items()])) == 0


def test_poles_that_cancel_are_no_poles() -> None:
    assert pole_order(1 / eps - 1 / (eps + eps**2), eps) == 0
    assert laurent(1 / eps - 1 / (eps + eps**2), eps, order=1) == {0: 1, 1: -1}
    assert pole_order((x + y / eps) * eps - y, eps) == 0
    assert laurent(x / eps - x / eps * (1 + eps), eps, order=3) == {0: -x}


def test_poles_that_hide_in_products_are_found() -> None:
    assert pole_order((x + y / eps) * (1 + eps * x), eps) == 1
    assert laurent((x + y / eps) * (1 + eps * x), eps, order=0) == {-1: y, 0: x + x * y}
    assert pole_order(1 / (eps + eps**2), eps) == 1
    assert pole_order((x + 1 / eps) ** 2 / (1 + 1 / eps), eps) == 1


def test_what_is_zero_identically_has_no_terms() -> None:
    nothing = (x + 1) / eps - x / eps - 1 / eps
    assert laurent(nothing, eps, order=3) == {}
    assert laurent(nothing * (y + 1 / eps), eps, order=3) == {}
    assert laurent(nothing**2 + x, eps, order=3) == {0: x}
    assert pole_order(nothing / eps**2, eps) == 0
    with pytest.raises(DeclarationError, match="divides by zero"):
        laurent(1 / nothing, eps, order=1)


def test_an_expression_without_epsilon_is_its_own_series() -> None:
    assert laurent(sp.sin(x), eps, order=2) == {0: sp.sin(x)}
    assert laurent(sp.sin(x), eps, order=-1) == {}
    assert laurent(eps, eps, order=0) == {}


@pytest.mark.parametrize(
    "wrong", [sp.sin(eps), sp.sqrt(eps), 2**eps, eps**x, sp.Abs(eps), (1 + eps) ** sp.Rational(1, 3)]
)
def test_epsilon_where_it_has_no_laurent_series_is_named(wrong: sp.Expr) -> None:
    assert misplaced_epsilon(x + y * wrong, eps) == wrong
    with pytest.raises(DeclarationError, match="no pole or power"):
        laurent(x + y * wrong, eps, order=1)
    with pytest.raises(DeclarationError, match="no pole or power"):
        pole_order(x + y * wrong, eps)


def test_epsilon_in_poles_and_powers_is_in_its_place() -> None:
    assert misplaced_epsilon(x / eps**3 + (1 + eps * sp.sin(y)) ** -2, eps) is None


def test_deeply_nested_quotients_stay_cheap() -> None:
    expression = eps
    for k in range(1, 12):
        expression = 1 / (k + x * expression)
    assert set(laurent(expression, eps, order=1)) == {0, 1}
