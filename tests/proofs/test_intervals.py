"""The checker's whole-number intervals hold the exact value: against fractions, and mpmath at 400 bits."""

import random
from fractions import Fraction

import mpmath
import pytest

from gsp.proofs import intervals as ia
from tests.proofs.test_balls import HOW_OFTEN, inside, interval

ELEMENTARY = ("exp", "log", "sin", "cos", "tanh", "sinh", "cosh", "atan")


def holds(found: ia.Interval, value: Fraction) -> bool:
    return found[0] <= value * ia.ONE <= found[1]


def enclosing(low: float, high: float) -> ia.Interval:
    return ia.of(Fraction(low))[0], ia.of(Fraction(high))[1]


@HOW_OFTEN
def test_rational_operations_hold_the_exact_value(cases: int) -> None:
    draw = random.Random(4)
    for _ in range(cases):
        one, two = interval(draw), interval(draw)
        a, b = inside(draw, *one), inside(draw, *two)
        x, y = enclosing(*one), enclosing(*two)
        assert holds(ia.add(x, y), a + b)
        assert holds(ia.subtract(x, y), a - b)
        assert holds(ia.negative(x), -a)
        assert holds(ia.multiply(x, y), a * b)
        assert ia.magnitude(x) >= abs(a) * ia.ONE
        if y[0] > 0 or y[1] < 0:
            assert holds(ia.divide(x, y), a / b)
            assert holds(ia.power(y, -3), b**-3)
        for exponent in (0, 1, 2, 3, 6):
            assert holds(ia.power(x, exponent), a**exponent), (one, exponent)
        if a > 0 and x[0] > 0:
            for degree in (2, 3, 5):
                low, high = ia.root(x, degree)
                assert low**degree <= a * ia.ONE**degree <= high**degree
                # Of ends two units apart at most.
                end = ia.root((x[0], x[0]), degree)
                assert (end[0], end[1] - end[0] <= 2) == (low, True)


@HOW_OFTEN
def test_elementary_functions_hold_the_exact_value(cases: int) -> None:
    draw = random.Random(5)
    with mpmath.workprec(400):
        for _ in range(cases):
            for name in ELEMENTARY:
                low, high = interval(draw, positive=name == "log")
                a = inside(draw, low, high)
                value = getattr(mpmath, name)(mpmath.mpf(a.numerator) / a.denominator) * ia.ONE
                found = getattr(ia, name)(enclosing(low, high))
                assert found[0] <= value <= found[1], (name, low, high, a)
                # Of one number a few units, or the last of eighty bits.
                most = (1 << 10) + (max(map(abs, found)) >> 80)
                assert low != high or found[1] - found[0] <= most, (name, low)


def test_a_product_is_the_least_interval_for_all_signs() -> None:
    ends = [k * ia.ONE for k in (-3, -2, 0, 1, 2)]
    sides = [(low, high) for low in ends for high in ends if low <= high]
    for a in sides:
        for b in sides:
            products = [p * q // ia.ONE for p in a for q in b]
            assert ia.multiply(a, b) == (min(products), max(products))


def test_a_hull_is_the_least_interval_that_holds_both() -> None:
    assert ia.hull((1, 3), (2, 5)) == ia.hull((2, 5), (1, 3)) == (1, 5)
    assert ia.hull((1, 5), (2, 3)) == ia.hull((2, 3), (1, 5)) == (1, 5)


def test_exponentials_of_large_numbers_hold_the_exact_value_and_no_more_than_rounding() -> None:
    # The most powers of two are taken out here, each with the rounding of log 2.
    draw = random.Random(6)
    with mpmath.workprec(400):
        for _ in range(60):
            a = Fraction(draw.uniform(1000.0, 2000.0))
            value = mpmath.exp(mpmath.mpf(a.numerator) / a.denominator) * ia.ONE
            low, high = ia.exp(ia.of(a))
            assert low <= value <= high
            assert high - low <= value * 2.0**-110


def test_half_pi_is_enclosed_to_the_last_digits() -> None:
    with mpmath.workprec(400):
        assert ia.HALF_PI[0] <= mpmath.pi / 2 * ia.ONE <= ia.HALF_PI[1]
    assert ia.HALF_PI[1] - ia.HALF_PI[0] < 1 << 8


SIZES = [
    2.0**-192,
    3 * 2.0**-192,
    2.0**-96,
    1e-20,
    0.5,
    1.0,
    63.9,
    64.1,
    65.0,
    300.0,
    1e19,
    2e19,
    1e25,
    1e200,
    1e300,
]


@pytest.mark.parametrize("name", ["atan", "tanh", "log"])
@pytest.mark.parametrize("x", SIZES)
def test_functions_of_the_smallest_and_the_largest_numbers_are_held(name: str, x: float) -> None:
    for sign in (1,) if name == "log" else (1, -1):
        unit = int(sign * Fraction(x) * ia.ONE)
        low, high = getattr(ia, name)((unit, unit))
        with mpmath.workprec(2500):
            assert low <= getattr(mpmath, name)(mpmath.mpf(unit) / ia.ONE) * ia.ONE <= high
        assert high - low <= 512


@pytest.mark.parametrize(
    "out",
    [
        lambda: ia.divide(ia.UNIT, (-1, 1)),
        lambda: ia.log((0, 5)),
        lambda: ia.root((-1, 5), 2),
        lambda: ia.root((0, 5), 2),
        lambda: ia.exp((0, 3000 * ia.ONE)),
        lambda: ia.power(enclosing(1e300, 1e300), 1000),
    ],
)
def test_what_is_out_of_the_domain_or_too_large_is_refused(out) -> None:
    with pytest.raises(ia.OutOfDomain):
        out()


@pytest.mark.parametrize("x", [0.0, 1e-30, 0.5, -0.5, 0.7, 11.3, -11.3, 300.7, -40.2, 1999.0])
def test_an_exponential_is_sharp_and_holds_the_value(x: float) -> None:
    low, high = ia.exp(ia.of(Fraction(x)))
    with mpmath.workprec(4000):
        assert low <= mpmath.exp(mpmath.mpf(x)) * ia.ONE <= high
    # Two units, or the last of a hundred bits.
    assert high - low <= 2 + (high >> 100)


def test_the_logarithm_of_two_is_enclosed_between_neighbours() -> None:
    with mpmath.workprec(400):
        assert ia.LOG_2 <= mpmath.log(2) * 2**ia.FINE <= ia.LOG_2 + 1
