"""Every operation on balls holds the exact value: against fractions, and mpmath at 400 bits."""

import math
import operator
import random
from fractions import Fraction

import flint
import mpmath
import pytest
import sympy as sp
from flint import arb

from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction

HOW_OFTEN = pytest.mark.parametrize("cases", [300, pytest.param(10_000, marks=pytest.mark.exhaustive)])
ELEMENTARY = ("exp", "log", "sin", "cos", "tanh", "sinh", "cosh", "sech", "atan")


def interval(random_, *, positive: bool = False) -> tuple[float, float]:
    """Ends of very different sizes: thin, wide, about 0, one point."""
    scale = 10.0 ** random_.uniform(-6, 2)
    centre = max(min(random_.uniform(-1, 1) * scale * random_.choice([0, 1, 1, 30]), 200.0), -200.0)
    width = scale * random_.choice([0.0, 1e-15, 1e-6, 0.1, 1.0, 5.0])
    low, high = max(centre - width, -300.0), min(centre + width, 300.0)
    return (abs(low) + 1e-9, abs(low) + 1e-9 + (high - low)) if positive else (low, high)


def inside(random_, low: float, high: float) -> Fraction:
    """A number of the interval, the ends among them."""
    share = random_.choice([Fraction(0), Fraction(1), Fraction(random_.random())])
    return Fraction(low) + share * (Fraction(high) - Fraction(low))


def exactly(number: arb) -> Fraction:
    """The fraction that an exact ball is."""
    mantissa, exponent = number.man_exp()
    return Fraction(int(mantissa)) * Fraction(2) ** int(exponent)


def holds(ball: arb, value: Fraction) -> bool:
    return ball.is_finite() and abs(value - exactly(ball.mid())) <= exactly(ball.rad())


@HOW_OFTEN
def test_products_quotients_and_powers_hold_the_exact_value(cases: int) -> None:
    draw = random.Random(1)
    for _ in range(cases):
        one, two = interval(draw), interval(draw)
        a, b = inside(draw, *one), inside(draw, *two)
        x, y = balls.hull(*one), balls.hull(*two)
        assert holds(balls.product(x, y), a * b), (one, two)
        if y > 0 or y < 0:
            assert holds(balls.quotient(x, y), a / b), (one, two)
        else:
            assert not balls.quotient(x, y).is_finite()
        for exponent in (0, 1, 2, 3, 4, 7):
            assert holds(balls.power(x, exponent), a**exponent), (one, exponent)
        if (x > 0 or x < 0) and abs(a) > Fraction(1, 10**6):
            assert holds(balls.power(x, -3), a**-3), one


@HOW_OFTEN
def test_elementary_functions_hold_the_exact_value(cases: int) -> None:
    draw = random.Random(2)
    with mpmath.workprec(400):
        for _ in range(cases):
            for name in ELEMENTARY:
                low, high = interval(draw, positive=name == "log")
                a = inside(draw, low, high)
                value = getattr(mpmath, name)(mpmath.mpf(a.numerator) / a.denominator)
                ball = getattr(balls, name)(balls.hull(low, high))
                sign, mantissa, exponent, _ = value._mpf_
                known = Fraction(-mantissa if sign else mantissa) * Fraction(2) ** exponent
                # mpmath rounds to the nearest of 400 bits.
                wide = ball + arb(0, 2.0**-300 * max(1.0, float(abs(value))))
                assert holds(wide, known), (name, low, high, a)


@HOW_OFTEN
def test_powers_of_fractions_hold_the_exact_value(cases: int) -> None:
    draw = random.Random(8)
    for _ in range(cases):
        # The power of a fraction is checked by whole powers: a = r^q, and r^p is to be held.
        low, high = interval(draw, positive=True)
        p, q = draw.choice([(1, 2), (1, 3), (-2, 3), (3, 2), (5, 4), (-1, 2)])
        r = inside(draw, low, high)
        wide = balls.hull(low, high)
        whole = balls.power(wide, q)
        found = balls.root_power(whole, p, q)
        # A midpoint and a radius of very different ends may reach 0: nothing is claimed then.
        assert holds(found, r**p) if whole > 0 else not found.is_finite(), (low, high, p, q)
        assert holds(balls.negative(wide), -r)
        assert holds(balls.hull(low, high), r)


@HOW_OFTEN
def test_bounds_in_doubles_are_on_the_right_side(cases: int) -> None:
    """The least double that is not below, of ends that no double is: at the precision of proofs."""
    draw, between = random.Random(3), 0
    with flint.ctx.workprec(balls.PRECISION):
        for _ in range(cases):
            ball = arb(draw.uniform(-1, 1), draw.choice([0.0, 1e-17, 1e-9, 1.0])) * arb(draw.random()) / 3
            high, low, most = exactly(ball.upper()), exactly(ball.lower()), exactly(ball.abs_upper())
            for found, bound in (
                (balls.above(ball), high),
                (-balls.below(ball), -low),
                (balls.magnitude(ball), most),
            ):
                assert math.nextafter(found, -math.inf) < bound <= found
                between += bound != found
        assert between > cases


def test_roots_of_any_order_hold_the_exact_value() -> None:
    # (16^2^70)^(3/2^71) of longer numbers than machine words hold: 16^(3/2) = 64 and its reciprocal.
    for order in (2, balls.WORD, 2**71):
        for sign, exact in ((1, 64), (-1, Fraction(1, 64))):
            found = balls.root_power(balls.hull(15.0, 16.0), sign * 3 * order // 2, order)
            assert holds(found + arb(0, 1e-12), Fraction(exact))
            assert not holds(found, Fraction(exact) * 2)
            assert holds(found, Fraction(61) ** sign)


def test_waves_stay_within_one() -> None:
    for wave in (balls.sin, balls.cos):
        for ball in (
            balls.hull(-1e9, 1e9),
            balls.hull(1.0, 1.7),
            balls.hull(3.0, 3.3),
            arb("1e1000000000000000000"),
        ):
            found = wave(ball)
            assert found.is_finite()
            assert not found > 1
            assert float(found.abs_upper()) <= 1.0 + 1e-8
    assert balls.sin(balls.hull(1.0, 1.7)).overlaps(arb(1))


@pytest.mark.parametrize("function", [balls.log, lambda ball: balls.root_power(ball, -2, 3)])
def test_a_ball_that_leaves_the_domain_gives_nothing_finite(function) -> None:
    for low, high in [(-1.0, 2.0), (0.0, 1.0), (-2.0, -1.0)]:
        assert not function(balls.hull(low, high)).is_finite()


def test_nothing_is_claimed_of_what_is_not_a_number() -> None:
    nothing = balls.UNDEFINED
    for ball in (
        balls.power(nothing, 2),
        balls.power(nothing, 3),
        balls.product(nothing, balls.hull(1.0, 2.0)),
        balls.product(balls.hull(0.0, 2.0), nothing),
        balls.quotient(balls.hull(1.0, 2.0), nothing),
        balls.exp(nothing),
        balls.tanh(nothing),
        balls.sin(nothing),
        balls.cosh(nothing),
    ):
        assert not ball.is_finite()
        assert not ball > 0
        assert not ball < 0
    assert math.isnan(balls.above(nothing))
    assert math.isnan(balls.magnitude(nothing))


def test_wide_balls_stay_sharp() -> None:
    assert float(balls.tanh(balls.hull(-3.0, 3.0)).abs_upper()) < 1.0
    assert float(balls.power(balls.hull(1.0, 3.0), 2).lower()) > 0.999
    assert float(balls.quotient(arb(1), balls.hull(1.0, 3.0)).upper()) < 1.0001


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.03), (-2.05, -2.0), (7.0, 7.0)])
@pytest.mark.parametrize(("least", "most"), [(0.001, 2.0), (-3.0, 1.0), (-5.0, -4.9), (0.3, 0.3)])
def test_a_product_with_a_narrow_ball_loses_an_eighth_of_its_width_at_most(
    low: float, high: float, least: float, most: float
) -> None:
    found = balls.product(balls.hull(low, high), balls.hull(least, most))
    ends = [p * q for p in (low, high) for q in (least, most)]
    assert 2.0 * float(found.rad()) <= 1.125 * (max(ends) - min(ends)) + 1e-15


@pytest.mark.parametrize("exponent", [2, 3, 8, 27])
@pytest.mark.parametrize("share", [0.0, 1e-4, 0.01, 0.1, 0.9])
def test_powers_lose_a_tenth_of_their_width_at_most(exponent: int, share: float) -> None:
    low, high = 1.5 * (1.0 - share), 1.5 * (1.0 + share)
    found = balls.power(balls.hull(low, high), exponent)
    assert 2.0 * float(found.rad()) <= 1.1 * (high**exponent - low**exponent) + 1e-14 * high**exponent


def test_powers_of_e_and_of_other_bases_are_exponentials() -> None:
    x, y = sp.symbols("x y")
    for expression, value in (
        (sp.Pow(sp.E, x, evaluate=False), math.exp(0.75)),
        (y**x, 3.0**0.75),
        (3**x, 3.0**0.75),
    ):
        (found,) = BallFunction([x, y], [expression])([arb(0.75), arb(3)])
        assert found.rel_accuracy_bits() > 40
        assert float(found.mid()) == pytest.approx(value, rel=1e-14)


def test_a_constant_is_a_factor_without_a_test_of_widths() -> None:
    x, y = sp.symbols("x y")
    code = BallFunction([x, y], [3 * x * y])._code
    assert [function for _, function, *_ in code].count(operator.mul) == 1
    assert [function for _, function, *_ in code].count(balls.product) == 1


@pytest.mark.parametrize(
    ("write", "most"),
    [
        (lambda u, v: 1 / sp.cosh(u), 1.0),
        (lambda u, v: sp.sinh(u) / sp.cosh(u) ** 2, 1.0),
        (lambda u, v: 3 * v * sp.sinh(u) ** 2 / (2 * sp.cosh(u) ** 3), 1.5),
        (lambda u, v: sp.sinh(u) / sp.cosh(u), 1.0),
        (lambda u, v: v / (sp.cosh(u) * (1 + sp.cosh(v))), 1.0),
        (lambda u, v: v / (1 + sp.exp(u)), 1.0),
        (lambda u, v: 1 / (2 + 3 * sp.exp(u)) ** 2, 0.25),
        (lambda u, v: sp.exp(u) / (1 + sp.exp(u)) ** 2, 1.0),
        (lambda u, v: 6 * sp.exp(-u) / (2 + 3 * sp.exp(-u)) ** 2, 1.0),
        (lambda u, v: sp.exp(-3 * u) * sp.cosh(v) / (5 + sp.exp(-3 * u)), 1.55),
        (lambda u, v: 1 / (sp.exp(u) + sp.exp(-u)), 0.5),
        (lambda u, v: v / (2 * sp.exp(u - 1) + 5 * sp.exp(-u)), 0.2607),
        (lambda u, v: (sp.exp(-u) - sp.exp(u)) / (sp.exp(u) + sp.exp(-u)) ** 2, 0.5),
        (lambda u, v: (sp.exp(2 * u) - sp.exp(-2 * u)) / (sp.exp(2 * u) + sp.exp(-2 * u)), 1.0),
    ],
)
def test_quotients_by_a_cosh_or_a_gate_are_bounded_over_any_ball(write, most: float) -> None:
    u, v = sp.symbols("u v")
    expression = write(u, v)
    function = BallFunction([u, v], [expression])
    wide = function([balls.hull(-1e9, 1e8), balls.hull(0.5, 1.0)])[0]
    assert float(wide.abs_upper()) < 1.0001 * most
    for place in (-40.0, -0.5, 0.0, 2.0, 30.0):
        (found,) = function([arb(place), arb(0.75)])
        known = float(expression.subs({u: sp.Rational(place), v: sp.Rational(3, 4)}).evalf(30))
        assert float(found.mid()) == pytest.approx(known, rel=1e-14)
        assert not wide > known
        assert not wide < known


@pytest.mark.parametrize("k", range(1, 12))
def test_doubles_about_a_ball_are_bounds(k: int) -> None:
    for exact in (Fraction(k, 7), Fraction(-k, 7)):
        ball = balls.exact(exact)
        assert Fraction(balls.below(ball)) <= exact <= Fraction(balls.above(ball))
        assert Fraction(balls.magnitude(ball)) >= abs(exact)


def test_a_function_of_which_arguments_are_known_takes_fewer_operations_to_the_same_enclosures() -> None:
    x, y = sp.symbols("x y")
    whole = BallFunction([x, y], [sp.tanh(x) * y, sp.exp(x + y), sp.cosh(x) + x])
    at = [arb(2, 0.25), arb(-1, 0.125)]
    some = whole.among((2, 0))
    for known in ([at[0], None], [None, at[1]], [None, None], at):
        found = some.given(known)
        assert found.operations <= some.operations < whole.operations
        for one, two in zip(found(at), (whole(at)[2], whole(at)[0])):
            assert one.contains(two)
            assert two.contains(one)
    assert some.given([at[0], None]).operations == 1
    # Another ball for what is not known.
    assert some.given([at[0], None])([at[0], arb(5)])[1].contains(arb(2).tanh() * 5)
