"""The checker's rational functions against fractions: each element has the value of what it was made of."""

from __future__ import annotations

from fractions import Fraction
from math import prod

import pytest

from gsp.proofs import rational_functions
from gsp.proofs.programs import Rejected
from gsp.proofs.rational_functions import FactoredFraction, RationalFunctions

POINTS = [(Fraction(2, 3), Fraction(-5, 7)), (Fraction(-3), Fraction(1, 4))]


def value(ring: RationalFunctions, found: FactoredFraction, point: tuple[Fraction, ...]) -> Fraction:
    def polynomial(terms: rational_functions.Polynomial) -> Fraction:
        return sum(
            (c * prod(p**e for p, e in zip(point, exponents)) for exponents, c in terms.items()), Fraction(0)
        )

    return polynomial(found.numerator) * prod(polynomial(ring.factors[k]) ** e for k, e in found.powers.items())


def elements(ring: RationalFunctions) -> tuple[FactoredFraction, FactoredFraction, FactoredFraction]:
    """x, y and 6 x - 4 y^2."""
    x, y = ring.variable(0), ring.variable(1)
    six, four = ring.constant(Fraction(6)), ring.constant(Fraction(4))
    return x, y, ring.add(ring.multiply(six, x), ring.multiply(four, ring.multiply(y, y)), -1)


@pytest.mark.parametrize("exponent", [-3, -2, -1, 0, 1, 2, 3])
def test_powers_sums_and_products_have_the_values_of_fractions(exponent: int) -> None:
    ring = RationalFunctions(2)
    x, y, sum_ = elements(ring)
    power = ring.power(sum_, exponent)
    again = ring.power(ring.multiply(x, power), 2)
    mixed = ring.add(again, ring.multiply(y, ring.power(sum_, -1)), -1)
    for a, b in POINTS:
        s = 6 * a - 4 * b**2
        assert value(ring, power, (a, b)) == s**exponent
        assert value(ring, again, (a, b)) == (a * s**exponent) ** 2
        assert value(ring, mixed, (a, b)) == (a * s**exponent) ** 2 - b / s
    # What is the same function has no terms left, however it was made.
    assert not ring.add(
        ring.multiply(power, ring.power(sum_, -exponent)), ring.constant(Fraction(1)), -1
    ).numerator


def test_multiples_of_one_polynomial_are_one_factor() -> None:
    ring = RationalFunctions(2)
    _, _, sum_ = elements(ring)
    half = ring.multiply(sum_, ring.constant(Fraction(-1, 2)))
    quotient = ring.multiply(ring.power(sum_, 2), ring.power(half, -2))
    assert len(ring.factors) == 1
    assert not ring.add(quotient, ring.constant(Fraction(4)), -1).numerator


def test_derivatives_are_those_of_the_quotient_rule() -> None:
    ring = RationalFunctions(2)
    x, y, sum_ = elements(ring)
    other = ring.add(ring.multiply(x, y), ring.constant(Fraction(1)))
    # x y^2 s^-2 o^-1 with s = 6 x - 4 y^2 and o = x y + 1.
    top = ring.multiply(x, ring.multiply(y, y))
    found = ring.multiply(top, ring.multiply(ring.power(sum_, -2), ring.power(other, -1)))
    for a, b in POINTS:
        s, o = 6 * a - 4 * b**2, a * b + 1
        whole = a * b**2 / (s**2 * o)
        assert value(ring, ring.derivative(found, 0), (a, b)) == whole * (1 / a - 2 * 6 / s - b / o)
        assert value(ring, ring.derivative(found, 1), (a, b)) == whole * (2 / b + 2 * 8 * b / s - a / o)


def test_what_grows_too_large_is_rejected_and_so_is_a_division_by_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    ring = RationalFunctions(2)
    x, y, sum_ = elements(ring)
    with pytest.raises(Rejected, match="divides by 0"):
        ring.power(ring.add(x, x, -1), -1)
    monkeypatch.setattr(rational_functions, "MOST_FACTORS", 2)
    ring.power(sum_, -1)
    ring.power(ring.add(x, y), -1)
    with pytest.raises(Rejected, match="more than 2 denominators"):
        ring.power(ring.add(x, y, -1), -1)
    monkeypatch.setattr(rational_functions, "MOST_PRODUCTS", ring._products + 4)
    ring.multiply(sum_, sum_)
    with pytest.raises(Rejected, match="products of terms"):
        ring.multiply(sum_, x)


def test_long_numbers_count_as_their_arithmetic_takes() -> None:
    def products(bits: int) -> int:
        ring = RationalFunctions(1)
        long = ring.add(ring.variable(0), ring.constant(Fraction(1, 3**bits)))
        before = ring._products
        ring.multiply(long, long)
        return ring._products - before

    assert products(1) == 4
    assert 3 < products(2000) / products(1000) < 5
    with pytest.raises(Rejected, match="products of terms"):
        products(200_000)
