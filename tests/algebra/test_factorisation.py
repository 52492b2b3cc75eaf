"""Factors and lowest terms agree with the expression, whatever its atoms, and stop at their budget."""

from math import gcd

import flint
import pytest
import sympy as sp

from gsp.algebra import factorisation
from gsp.algebra.factorisation import (
    coefficients,
    coprime_numerators,
    degree,
    exponentials,
    factor_list,
    factored,
    factors,
    lowest_terms,
    numerator,
    quotient,
)

x, y, a, b = sp.symbols("x y a b")

EXPRESSIONS = [
    (x**2 - y**2) / (x - y) ** 3,
    1 / (1 + sp.exp(1 - x)) - y,
    1 / (1 + sp.exp(-x / b)) + sp.exp(2 * x / b) * y,
    sp.sqrt(x) * y + x ** sp.Rational(3, 2) - 1 / sp.sqrt(x),
    sp.exp(-x) + sp.exp(x / 2) * y**2,
    x**a * y + x ** (a + 1) - sp.Integer(1000) ** (1 - 2 * sp.pi) * y,
    sp.exp(6000 * x - 10000 * x**2) * y - y + sp.exp(x),
    sp.Piecewise((x, x > 0), (y, True)) * y + sp.Abs(x - y) / (2 + sp.tanh(x)),
    -(sp.Integer(3) ** (x**3)) * y / 7 + sp.E * sp.exp(x),
]


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=str)
def test_lowest_terms_and_factors_have_the_value_of_the_expression(expression: sp.Expr) -> None:
    point = {x: sp.Float("0.37", 40), y: sp.Float("0.21", 40), a: sp.Float("1.3", 40), b: sp.Float("0.7", 40)}

    def value(e: sp.Expr) -> sp.Expr:
        return e.xreplace(point).evalf(30)

    exact = value(expression)
    assert abs(value(lowest_terms(expression)) - exact) < 1e-20 * (1 + abs(exact))
    assert abs(value(factored(expression)) - exact) < 1e-20 * (1 + abs(exact))
    constant, powers = factor_list(expression)
    product = value(constant * sp.Mul(*[f**k for f, k in powers]))
    assert abs(product - value(numerator(expression))) < 1e-20 * (1 + abs(product))


def test_commensurable_exponents_and_roots_share_an_atom() -> None:
    assert factors(sp.exp(2 * y) - 3 * sp.exp(y) + 2, [y]) == [sp.exp(y) - 2, sp.exp(y) - 1]
    assert factors(y ** sp.Rational(3, 2) - y, [y]) == [sp.sqrt(y), sp.sqrt(y) - 1]
    assert numerator(sp.exp(x) * sp.exp(-x) - 1) == 0


def test_an_exponential_is_no_factor_that_vanishes() -> None:
    assert factors(sp.exp(-x) * (y - x), [x, y]) == [x - y]


def test_the_coefficients_of_a_polynomial_and_of_none() -> None:
    assert coefficients(sp.tanh(x) * y**2 - a, y) == [sp.tanh(x), 0, -a]
    assert coefficients(sp.tanh(y) * y, y) is None
    assert coefficients(x, y) == [x]


def test_what_is_over_the_budget_is_left_as_it_is() -> None:
    long = (x + y + a + b) ** 99 - 1
    assert quotient(long) is None
    assert numerator(long) == lowest_terms(long) == factored(long) == long
    assert factors(long, [x]) == [long]


def test_no_multiplication_exceeds_the_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    largest = 0
    check = factorisation._check

    def counted(p, q) -> None:
        nonlocal largest
        check(p, q)
        largest = max(largest, len(p) * len(q))

    monkeypatch.setattr(factorisation, "_check", counted)
    for n in (20, 60, 99):
        quotient((x + y + a + b) ** n / (x - y) + sp.exp(x))
    assert 1000 < largest <= factorisation.TERM_PRODUCTS


ROWS = [
    [x / 2 - y / 3, sp.Integer(0), (x - y * 2 / 3) * a / b],
    [-x / (x + y), x**2 / ((x + y) * (x - y))],
    [sp.exp(x) / (1 + sp.exp(2 * x)), sp.exp(x) * y],
    [sp.Integer(0), -sp.sqrt(2) * x / 3 + 1],
]


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_coprime_numerators_are_proportional_and_have_no_common_divisor(row: list[sp.Expr]) -> None:
    found = coprime_numerators(row)
    assert found is not None
    assert all(sp.simplify(p * f - q * e) == 0 for p, e in zip(row, found) for q, f in zip(row, found))
    assert all(quotient(e).denominator == 1 for e in found)  # pyright: ignore[reportOptionalMemberAccess]
    assert coprime_numerators(found) == found
    assert any(e != 0 for e in found)


def test_coprime_numerators_stop_at_the_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(factorisation, "TERM_PRODUCTS", 2)
    assert coprime_numerators([1 / (x + y + 1), 1 / (x - y + 2)]) is None
    assert coprime_numerators([sp.Integer(0), sp.Integer(0)]) == [0, 0]


@pytest.mark.parametrize(
    "expression", [x / (a / 2 - y / 3), (x / 5 + 1) / (2 - 4 * y), 3 * x / 7, x / (-6 * x - 9)], ids=str
)
def test_a_quotient_has_one_normal_form(expression: sp.Expr) -> None:
    found = quotient(expression)
    assert found is not None
    below = [flint.fmpq(c) for c in found.denominator.coeffs()]
    both = below + [flint.fmpq(c) for c in found.numerator.coeffs()]
    assert all(c.q == 1 for c in both)
    assert below[0] > 0
    assert gcd(*(int(c.p) for c in both)) == 1
    assert sp.cancel(found.expression(found.numerator) / found.expression(found.denominator) - expression) == 0
    again = quotient(sp.expand(-7 * sp.numer(expression)) / sp.expand(-7 * sp.denom(expression)))
    assert again is not None
    assert again.expression(again.numerator) == found.expression(found.numerator)


def test_exponentials_that_all_fall_share_one_that_falls() -> None:
    found = quotient(sp.exp(-2 * x) + y * sp.exp(-3 * x))
    assert found is not None
    assert found.denominator == 1
    assert found.expression(found.numerator) == sp.exp(-2 * x) + y * sp.exp(-3 * x)
    assert sp.exp(-x) in found.atoms


def test_degrees_are_those_of_the_numerator() -> None:
    assert degree(x**2 * y / (1 + a) + x, [x, y]) == 3
    assert degree(sp.exp(x) * y, [y]) == 1
    assert degree(sp.exp(x) * y, [x]) is None
    assert degree(x - x + sp.Integer(0), [x]) == 0


def test_exponentials_of_commensurable_exponents_are_powers_of_those_found() -> None:
    assert exponentials([sp.exp(3 * x / 2) + y, y * sp.exp(-x) / (1 + sp.exp(a * x))]) == [
        sp.exp(x / 2), sp.exp(a * x)
    ]  # fmt: skip
    assert exponentials([x + y, sp.log(x)]) == []


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        (x * sp.sqrt(sp.Abs(x)), [x]),
        (sp.sign(x) * sp.Abs(x) ** sp.Rational(3, 2), [x]),
        (x * sp.Abs(x * y), [x, y]),
        ((y - x) * sp.Abs(x - y) * (x + y), [x + y, x - y]),
        (sp.sign(x) * (1 + y**2), [sp.sign(x), y**2 + 1]),
    ],
)
def test_a_size_and_a_sign_vanish_where_their_argument_does(expression, expected) -> None:
    """They were factors of their own, and so branches of their own."""
    found = factors(expression, [x, y])
    assert len(found) == len(expected)
    assert all(e in found or -e in found for e in expected)
