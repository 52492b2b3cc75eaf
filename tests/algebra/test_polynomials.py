import flint
import pytest
import sympy as sp

from gsp.algebra.polynomials import horner_expression, polynomial_expression

CONTEXT = flint.fmpq_mpoly_ctx.get(["t", "x", "y"], flint.Ordering.lex)
T, X, Y = CONTEXT.gens()
t, x, y = MEANING = sp.symbols("t x y")


@pytest.mark.parametrize(
    ("polynomial", "written"),
    [
        ((T - 1000) ** 4 + X, (t - 1000) ** 4 + x),
        ((T - Y) ** 4 * X + (T - Y) ** 2, x * (t - y) ** 4 + (t - y) ** 2),
        ((T - 80) ** 3 * (X + 70) ** 2 + Y, (t - 80) ** 3 * (x + 70) ** 2 + y),
        (T**2 - 2 * T, t**2 - 2 * t),
        ((T - Y**2) ** 2 + X, t**2 - 2 * t * y**2 + x + y**4),
        # As 12 (t + x - y/2 - 2/3)^2 - 12 (x - 2/3)^2 - 64 y it is shorter, and cancels where t and y are small.
        (
            12 * T**2 + 24 * T * X - 12 * T * Y - 16 * T - 12 * X * Y + 3 * Y**2 - 56 * Y,
            12 * t**2 + 24 * t * x - 12 * t * y - 16 * t - 12 * x * y + 3 * y**2 - 56 * y,
        ),
    ],
)
def test_a_polynomial_is_written_about_its_centre_where_that_is_shorter(polynomial, written: sp.Expr) -> None:
    assert polynomial_expression(polynomial, MEANING) == written
    assert sp.expand(horner_expression(polynomial, MEANING) - written) == 0


def test_what_stands_beside_a_polynomial_lends_it_its_centre() -> None:
    numerator = ((T - 1000) ** 3 + (T - 1000) ** 2) * X + 1
    # Of its own it has 1000 - 1/3.
    assert polynomial_expression(numerator, MEANING).has(t - sp.Rational(2999, 3))
    assert polynomial_expression(numerator, MEANING, [(T - 1000) ** 2 + 1]).has(t - 1000)
