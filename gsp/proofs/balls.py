"""Ball arithmetic: every operation returns a ball that holds all values over the balls it is given.

`flint.arb` does the work. Its own functions treat a ball as a point with an error and become useless on wide balls
(the square of [1, 3] is [-1, 9], tanh of [-3, 3] is 400 wide), so that monotone functions are taken at the two ends
here and even ones at the least and largest modulus. A ball that leaves the domain of a function gives a ball that is
not finite, and every comparison with it is False: what is not proved is not claimed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

from flint import arb, fmpq

# Bits of a midpoint. Radii have 30 bits whatever this is; 64 leave double data exact and cost as much as 53.
PRECISION = 64
UNDEFINED = arb("nan")
ZERO = arb(0)
# A ball with so many good bits is narrow: a product with one loses a share of 2^-NARROW of its radius, no more.
NARROW = 4


def exact(value: int | float | Fraction) -> arb:
    """The ball of one number; a fraction that no double holds gets a radius."""
    if isinstance(value, Fraction):
        return arb(fmpq(value.numerator, value.denominator))
    return arb(value)


def hull(low: float, high: float) -> arb:
    """The ball that holds [low, high]."""
    return arb(low).union(arb(high))


def above(ball: arb) -> float:
    """A double that no number in the ball exceeds; nan when the ball is not finite."""
    return _rounded_up(ball.upper()) if ball.is_finite() else math.nan


def below(ball: arb) -> float:
    """A double that no number in the ball falls below; nan when the ball is not finite."""
    return -_rounded_up(-ball.lower()) if ball.is_finite() else math.nan


def magnitude(ball: arb) -> float:
    """A double that no number in the ball exceeds in modulus; nan when the ball is not finite."""
    return _rounded_up(ball.abs_upper()) if ball.is_finite() else math.nan


def _rounded_up(number: arb) -> float:
    # Conversion rounds to nearest, which is below the number for every second one.
    found = float(number)
    return found if arb(found) >= number else math.nextafter(found, math.inf)


def rising(function: Callable[[arb], arb], ball: arb) -> arb:
    """A monotone function, from its values at both ends."""
    return function(ball.lower()).union(function(ball.upper()))


def negative(ball: arb) -> arb:
    """-ball."""
    return -ball


def product(one: arb, two: arb) -> arb:
    """one * two; of wide balls that keep their signs from their ends, for a midpoint and a radius lose the sign."""
    if one.rel_accuracy_bits() > NARROW or two.rel_accuracy_bits() > NARROW:
        return one * two
    if two < 0:
        return -product(one, -two)
    if one < 0:
        return -product(-one, two)
    if not two > 0 or not one.is_finite():
        return one * two
    low, high, least, most = one.lower(), one.upper(), two.lower(), two.upper()
    return (low * (least if low >= 0 else most)).union(high * (most if high >= 0 else least))


def quotient(one: arb, two: arb) -> arb:
    """one / two; not finite when `two` holds 0."""
    if two.rel_accuracy_bits() > NARROW:
        return one / two
    return product(one, rising(lambda end: 1 / end, two)) if two > 0 or two < 0 else UNDEFINED


def power(ball: arb, exponent: int) -> arb:
    """ball**exponent for a whole exponent: even powers by modulus, odd ones by their ends."""
    if exponent < 0:
        return quotient(arb(1), power(ball, -exponent))
    if exponent == 0:
        return arb(1)
    if exponent == 1:
        return ball
    if ball.rel_accuracy_bits() > NARROW + exponent.bit_length():
        return ball**exponent
    # arb's own integer power of a ball about 0 is not a number (python-flint #426); of a point it is the power.
    if exponent % 2:
        return (ball.lower() ** exponent).union(ball.upper() ** exponent)
    return (ball.abs_lower() ** exponent).union(ball.abs_upper() ** exponent)


WORD = 2**63
"""Roots of this order and above are not arb's own, which takes machine words."""


def root_power(ball: arb, numerator: int, denominator: int) -> arb:
    """ball**(numerator/denominator) of a positive ball; not finite when the ball reaches 0 or below."""
    if not ball > 0:
        return UNDEFINED
    if denominator >= WORD:
        return (ball.log() * numerator / denominator).exp()
    return power(rising(lambda end: end.root(denominator), ball), numerator)


def log(ball: arb) -> arb:
    """The logarithm; not finite when the ball reaches 0 or below."""
    return rising(arb.log, ball) if ball > 0 else UNDEFINED


def exp(ball: arb) -> arb:
    """The exponential."""
    return rising(arb.exp, ball)


def tanh(ball: arb) -> arb:
    """The hyperbolic tangent."""
    return rising(arb.tanh, ball)


def sinh(ball: arb) -> arb:
    """The hyperbolic sine."""
    return rising(arb.sinh, ball)


def cosh(ball: arb) -> arb:
    """The hyperbolic cosine, at the least and the largest modulus."""
    return ball.abs_lower().cosh().union(ball.abs_upper().cosh())


def sech(ball: arb) -> arb:
    """1/cosh, at the least and the largest modulus: the ball of a large cosh reaches below 1, and may hold 0."""
    return (1 / ball.abs_lower().cosh()).union(1 / ball.abs_upper().cosh())


def logistic(ball: arb) -> arb:
    """1/(1 + exp), at both ends: the ball of a wide exponential reaches below 0."""
    return rising(lambda end: 1 / (1 + end.exp()), ball)


def atan(ball: arb) -> arb:
    """The inverse tangent."""
    return rising(arb.atan, ball)


def sin(ball: arb) -> arb:
    """The sine, never beyond -1 and 1."""
    return _within_one(ball.sin(), ball)


def cos(ball: arb) -> arb:
    """The cosine, never beyond -1 and 1."""
    return _within_one(ball.cos(), ball)


def _within_one(value: arb, ball: arb) -> arb:
    return value.intersection(hull(-1.0, 1.0)) if ball.is_finite() else UNDEFINED
