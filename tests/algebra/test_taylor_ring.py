"""Series in a local variable: SymPy's coefficients over each kind of number, and how many of them are right."""

from __future__ import annotations

import flint
import pytest
import sympy as sp

from gsp.algebra.algebraic_numbers import NumberField, arb
from gsp.algebra.functions import RULES
from gsp.algebra.polynomials import rational
from gsp.algebra.taylor_ring import Algebraic, Balls, Inexact, Rationals, Taylor, TaylorRing, midpoint_sum
from gsp.errors import HyperbolicityError

t = sp.Symbol("t")
LENGTH = 5
ROOT = NumberField(flint.fmpq_poly([-2, 0, 1]), sp.sqrt(2))
KINDS = {"rationals": Rationals(), "a number field": Algebraic(ROOT), "balls": Balls()}
HALF = sp.Rational(1, 2)


def series(ring: TaylorRing, *coefficients) -> Taylor:
    """The series with these rational coefficients, all of its length being right."""
    return Taylor(
        ring, ring.scalars.polynomial([ring.scalars.number(sp.Rational(c)) for c in coefficients]), ring.length
    )


def shown(series: Taylor) -> list[sp.Expr]:
    return [series.ring.scalars.expression(series[k]) for k in range(series.length)]


def expected(expression: sp.Expr, length: int = LENGTH) -> list[sp.Expr]:
    """Coefficients of an expression in t, by differentiation."""
    return [sp.diff(expression, t, k).subs(t, 0) / sp.factorial(k) for k in range(length)]


def agree(found: list[sp.Expr], wanted: list[sp.Expr]) -> bool:
    """Whether they are equal, to 30 digits for numbers that are not exact."""
    return len(found) == len(wanted) and all(
        sp.expand(a - b) == 0 or abs(sp.N(a - b, 40)) < sp.Float("1e-30") for a, b in zip(found, wanted)
    )


@pytest.fixture(autouse=True)
def _digits():
    before, flint.ctx.prec = flint.ctx.prec, 160
    yield
    flint.ctx.prec = before


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", KINDS)
def test_arithmetic_is_that_of_the_polynomials(kind: str) -> None:
    ring = TaylorRing(KINDS[kind], LENGTH)
    a, b = series(ring, 2, -1, HALF, 0, 3), series(ring, -3, 0, 0, 5)
    p, q = 2 - t + t**2 / 2 + 3 * t**4, -3 + 5 * t**3
    assert agree(shown(a + b), expected(p + q))
    # The rules of |u| and of the larger of two multiply by 1/2.
    assert agree(shown(a * HALF), expected(p / 2))
    assert agree(shown(a - b), expected(p - q))
    assert agree(shown(a * b), expected(p * q))
    assert agree(shown(b * a), expected(p * q))
    assert agree(shown(3 * a), expected(3 * p))
    assert agree(shown(a + 4), expected(p + 4))
    assert agree(shown(a.inverse()), expected(1 / p))
    assert agree(shown(a.inverse() * a), expected(sp.Integer(1)))
    assert agree(shown(a.derivative()), expected(sp.diff(p, t), LENGTH - 1))
    assert agree(shown(a.integral()), expected(sp.integrate(p, t)))
    assert agree(shown((a - series(ring, 2)).over_t()), expected(sp.expand((p - 2) / t), LENGTH - 1))
    assert agree(shown(ring.scalar(ring.scalars.number(sp.Integer(7)), slope=-2)), expected(7 - 2 * t))
    assert agree(shown(ring.one + ring.constant(HALF)), expected(sp.Rational(3, 2)))
    assert a.reduced() is a


@pytest.mark.parametrize("kind", KINDS)
def test_a_series_knows_how_many_of_its_coefficients_are_right(kind: str) -> None:
    ring = TaylorRing(KINDS[kind], LENGTH)
    a = series(ring, 1, 1, 1, 1, 1)
    short = a.derivative()
    assert [a.length, short.length, short.derivative().length, a.over_t().length] == [5, 4, 3, 4]
    assert [(a + short).length, (short + a).length, (a * short).length, (short * a).length] == [4] * 4
    assert [a.integral().length, short.integral().length, (-short).length, (2 * short).length] == [5, 5, 4, 4]
    assert [
        short.inverse().length,
        short.apply("sign").length,
        short.apply("exp").length if kind == "balls" else 4,
    ] == [4] * 3
    # Nothing beyond them is kept, and nothing short is known to vanish.
    assert (a * short).polynomial.length() == (a + short).polynomial.length() == 4
    assert [ring.zero.is_zero, (a - a).is_zero, (short - short).is_zero, a.is_zero] == [
        True,
        True,
        False,
        False,
    ]
    assert ring.constant(3).key != ring.constant(4).key
    assert a.key != (a + short).key
    assert series(ring, 1, 2).key == (series(ring, 1) + series(ring, 0, 2)).key


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", sorted(set(RULES) - {"sign"}))
@pytest.mark.parametrize("kind", KINDS)
def test_functions_have_the_coefficients_that_differentiation_gives(kind: str, name: str) -> None:
    start = {"log": 1, "sqrt": sp.Rational(9, 4), "acosh": 2}.get(name, 0)
    ring = TaylorRing(KINDS[kind], LENGTH)
    u = series(ring, start, 1, -HALF, 0, 2)
    function = getattr(sp, name)(start + t - t**2 / 2 + 2 * t**4)
    if kind != "balls" and name in ("acos", "acosh", "erf"):
        with pytest.raises(Inexact):
            u.apply(name)
        return
    assert agree(shown(u.apply(name)), expected(function))


@pytest.mark.parametrize("kind", KINDS)
def test_powers_signs_and_absolute_values(kind: str) -> None:
    ring = TaylorRing(KINDS[kind], LENGTH)
    u, p = series(ring, 4, 1, 0, -2), 4 + t - 2 * t**3
    for exponent in (sp.Rational(3, 2), sp.Rational(-1, 2), sp.Integer(3)):
        assert agree(shown(u.apply("pow", ring.constant(exponent))), expected(p**exponent))
    assert agree(shown(u.apply("sign")), [1, 0, 0, 0, 0])
    assert agree(shown((-u).apply("sign")), [-1, 0, 0, 0, 0])
    assert agree(shown((-u).apply("Abs")), expected(p))
    assert agree(shown(u.apply("Abs")), expected(p))


def test_numbers_that_leave_a_field_are_refused() -> None:
    exact = Rationals()
    number = exact.number
    for name, value, exponent in (
        ("sqrt", 2, None), ("sqrt", -4, None), ("exp", 1, None), ("log", 2, None), ("sin", 1, None), ("pi", 0, None),
        ("pow", 2, number(HALF)),
    ):  # fmt: skip
        with pytest.raises(Inexact):
            exact.function(name, number(sp.Integer(value)), exponent)
    assert exact.function("pow", number(sp.Integer(8)), number(sp.Rational(2, 3))) == 4
    assert [exact.function("sign", number(sp.Integer(v)), None) for v in (-3, 0, 5)] == [-1, 0, 1]
    field = KINDS["a number field"]
    theta = flint.fmpq_poly([0, 1])
    for name, value, exponent in (("sqrt", theta, None), ("pow", field.number(sp.Integer(4)), theta)):
        with pytest.raises(Inexact):
            field.function(name, value, exponent)
    assert [rational(field.function("sign", v, None)[0]) for v in (theta - 2, theta - 1)] == [-1, 1]
    assert rational(field.function("pow", field.number(sp.Integer(4)), field.number(HALF))[0]) == 2


def test_products_in_a_number_field_are_reduced() -> None:
    ring = TaylorRing(KINDS["a number field"], LENGTH)
    u = ring.scalar(flint.fmpq_poly([1, 1]), slope=1)
    root = sp.sqrt(2)
    assert agree(shown(u * u * u), expected((1 + root + t) ** 3))
    assert agree(shown(u.inverse()), expected(1 / (1 + root + t)))
    assert (u * u)[0] == flint.fmpq_poly([3, 2])
    assert ring.scalars.product(u[0], u[0]) == flint.fmpq_poly([3, 2])


@pytest.mark.parametrize("kind", KINDS)
def test_a_division_by_what_vanishes_at_the_point_is_refused(kind: str) -> None:
    ring = TaylorRing(KINDS[kind], LENGTH)
    with pytest.raises(HyperbolicityError, match="vanishes at the point of expansion"):
        series(ring, 0, 1).inverse()


def test_balls_show_the_digits_that_they_have() -> None:
    balls = Balls()
    third = balls.expression(arb(sp.Rational(1, 3)))
    assert abs(third - sp.Rational(1, 3)) < sp.Float("1e-45")
    coarse = balls.expression(flint.arb("0.333333333", "1e-6"))
    assert 5 <= -sp.log(sp.Float("1e-30") + abs(2 * sp.Float(2) ** -coarse._prec), 10) <= 9
    assert balls.expression(flint.arb(0, 1)) == 0
    assert balls.expression(flint.arb("1", "1e-3")) != 0
    assert not balls.is_exact
    assert Rationals().is_exact
    assert agree([balls.expression(balls.function(name, None, None)) for name in ("pi", "E")], [sp.pi, sp.E])
    assert balls.product(arb(sp.Integer(3)), arb(HALF)).contains(flint.fmpq(3, 2))


def test_the_middle_of_a_sum_is_horners() -> None:
    coefficients = [arb(sp.Integer(c)) for c in (1, -2, 0, 5)]
    assert float(midpoint_sum(coefficients, arb(sp.Rational(1, 4)))) == 1 - 2 / 4 + 5 / 64
    assert float(midpoint_sum([], arb(HALF))) == 0.0
