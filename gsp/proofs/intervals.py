"""Interval arithmetic in whole numbers, for the checker: an interval is a pair (low, high) in units of 2^-192.

Only the standard library is used, and nothing of the prover. Every operation rounds its lower end down and its upper
end up. Elementary functions are summed as Taylor series by the same operations, with a bound on what is left off.
"""

from __future__ import annotations

import math
from fractions import Fraction

SHIFT = 192
ONE = 1 << SHIFT
Interval = tuple[int, int]
ZERO: Interval = (0, 0)
UNIT: Interval = (ONE, ONE)
# exp of more than this has no use in a proof, and would take long.
LARGEST_EXPONENT = 2000 * ONE
TERMS = 40
# An exponential is summed in units of 2^-FINE: u < 2^-HALVINGS, and u^FINE_TERMS/FINE_TERMS! < 2^-FINE.
FINE, HALVINGS, FINE_TERMS = 224, 6, 25
# Beyond doubles, and squares of them: whole numbers do not grow without end.
LARGEST = ONE << 4096
_LARGEST_PRODUCT = LARGEST << SHIFT


class OutOfDomain(ArithmeticError):
    """A function is asked outside its domain, or an interval that holds 0 divides."""


def of(value: Fraction) -> Interval:
    """The least interval that holds a fraction."""
    low, rest = divmod(value.numerator << SHIFT, value.denominator)
    return low, low + (rest != 0)


def add(a: Interval, b: Interval) -> Interval:
    """a + b."""
    return a[0] + b[0], a[1] + b[1]


def subtract(a: Interval, b: Interval) -> Interval:
    """a - b."""
    return a[0] - b[1], a[1] - b[0]


def negative(a: Interval) -> Interval:
    """-a."""
    return -a[1], -a[0]


def multiply(a: Interval, b: Interval) -> Interval:
    """a b; raises `OutOfDomain` when it is larger than any double."""
    # By signs: two products instead of four.
    (low, high), (least, most) = a, b
    if least >= 0:
        low, high = low * (least if low >= 0 else most), high * (most if high >= 0 else least)
    elif most <= 0:
        low, high = high * (least if high >= 0 else most), low * (most if low >= 0 else least)
    elif low >= 0:
        low, high = high * least, high * most
    elif high <= 0:
        low, high = low * most, low * least
    else:
        low, high = min(low * most, high * least), max(low * least, high * most)
    if high > _LARGEST_PRODUCT or low < -_LARGEST_PRODUCT:
        raise OutOfDomain("a number is too large")
    return low >> SHIFT, -(-high >> SHIFT)


def divide(a: Interval, b: Interval) -> Interval:
    """a / b; raises `OutOfDomain` when b holds 0."""
    if b[0] <= 0 <= b[1]:
        raise OutOfDomain("an interval that holds 0 divides")
    low = min((end << SHIFT) // by for end in a for by in b)
    high = max(-((-end << SHIFT) // by) for end in a for by in b)
    return low, high


def magnitude(a: Interval) -> int:
    """The largest modulus."""
    return max(abs(a[0]), abs(a[1]))


def hull(a: Interval, b: Interval) -> Interval:
    """The least interval that holds both."""
    return min(a[0], b[0]), max(a[1], b[1])


def common(a: Interval, b: Interval) -> Interval:
    """What two enclosures of one number leave."""
    return max(a[0], b[0]), min(a[1], b[1])


def times(a: Interval, number: int) -> Interval:
    """a times a whole number that has no units."""
    return (a[0] * number, a[1] * number) if number >= 0 else (a[1] * number, a[0] * number)


def power(a: Interval, exponent: int) -> Interval:
    """a**exponent for a whole exponent."""
    if exponent < 0:
        return divide(UNIT, power(a, -exponent))
    if exponent == 0:
        return UNIT
    if exponent % 2:
        return _repeated(a[0], exponent)[0], _repeated(a[1], exponent)[1]
    least = 0 if a[0] <= 0 <= a[1] else min(abs(a[0]), abs(a[1]))
    return _repeated(least, exponent)[0], _repeated(magnitude(a), exponent)[1]


def raised(a: Interval, exponent: Fraction) -> Interval:
    """a**exponent, that of a positive root where the exponent is not whole."""
    if exponent.denominator == 1:
        return power(a, int(exponent))
    return power(root(a, exponent.denominator), exponent.numerator)


def _repeated(end: int, exponent: int) -> Interval:
    result, base = UNIT, (end, end)
    while exponent:
        if exponent & 1:
            result = multiply(result, base)
        exponent >>= 1
        if exponent:
            base = multiply(base, base)
    return result


def root(a: Interval, degree: int) -> Interval:
    """The positive root of a positive interval."""
    if a[0] <= 0:
        raise OutOfDomain("a root of a number that is not positive")
    low = _whole_root(a[0] << (SHIFT * (degree - 1)), degree)
    return low, _whole_root(a[1] << (SHIFT * (degree - 1)), degree) + 1


def _whole_root(value: int, degree: int) -> int:
    """The largest whole number whose power is at most `value`."""
    if degree == 2:
        return math.isqrt(value)
    guess = 1 << -(-value.bit_length() // degree)
    while True:
        better = ((degree - 1) * guess + value // guess ** (degree - 1)) // degree
        if better >= guess:
            return guess
        guess = better


def exp(a: Interval) -> Interval:
    """The exponential."""
    return _exp(a[0])[0], _exp(a[1])[1]


def _exp(x: int) -> Interval:
    """exp(x), by x = k log 2 + 2^HALVINGS u with 0 <= u < 2^-HALVINGS, in units of 2^-FINE."""
    if abs(x) > LARGEST_EXPONENT:
        raise OutOfDomain("the exponential of a large number")
    turns, rest = divmod(x << (FINE - SHIFT), LOG_2 + 1 if x >= 0 else LOG_2)
    # The true u is at least this one, and less than `slack` units more.
    u, slack = rest >> HALVINGS, 2 + (abs(turns) >> HALVINGS)
    total = term = 1 << FINE
    for k in range(1, FINE_TERMS):
        term = (term * u >> FINE) // k
        total += term
    # Each term is at most 2 units too small, what is left off is less than one, and exp(u + s) - exp(u) <= 2 s.
    low, high = total, total + 2 * FINE_TERMS + 2 * slack
    for _ in range(HALVINGS):
        low, high = low * low >> FINE, -(-high * high >> FINE)
    shift = FINE - SHIFT - turns
    return (low >> shift, -(-high >> shift)) if shift >= 0 else (low << -shift, high << -shift)


def log(a: Interval) -> Interval:
    """The logarithm of a positive interval."""
    if a[0] <= 0:
        raise OutOfDomain("the logarithm of a number that is not positive")
    return _log(a[0])[0], _log(a[1])[1]


def _log(x: int) -> Interval:
    # log x = k log 2 + y + log(1 + u), x = 2^k m, 1 + u = m exp(-y), with y the double nearest to log m and u of the
    # order of rounding.
    k = x.bit_length() - SHIFT
    m = (x >> k, -(-x >> k)) if k >= 0 else (x << -k, x << -k)
    y = of(Fraction(math.log(m[0] / ONE)))
    u = subtract(multiply(m, exp(negative(y))), UNIT)
    if magnitude(u) > ONE >> 8:
        raise OutOfDomain("a logarithm that was not found")
    low, high = sorted((k * LOG_2, k * (LOG_2 + 1)))
    twos = low >> (FINE - SHIFT), -(-high >> (FINE - SHIFT))
    return add(twos, add(y, _alternating(u, 1)))


def tanh(a: Interval) -> Interval:
    """The hyperbolic tangent."""
    return _tanh(a[0])[0], _tanh(a[1])[1]


def _tanh(x: int) -> Interval:
    if abs(x) > SHIFT // 2 * ONE:
        # 1 - tanh(n/2) = 2/(exp(n) + 1) is below 2^-n for n > 3.
        return (ONE - 1, ONE) if x > 0 else (-ONE, 1 - ONE)
    return subtract(UNIT, divide((2 * ONE, 2 * ONE), add(_exp(2 * x), UNIT)))


def sinh(a: Interval) -> Interval:
    """The hyperbolic sine."""
    return _sinh(a[0])[0], _sinh(a[1])[1]


def _sinh(x: int) -> Interval:
    twice = subtract(_exp(x), _exp(-x))
    return twice[0] >> 1, -(-twice[1] >> 1)


def cosh(a: Interval) -> Interval:
    """The hyperbolic cosine."""
    least = 0 if a[0] <= 0 <= a[1] else min(abs(a[0]), abs(a[1]))
    return _cosh(least)[0], _cosh(magnitude(a))[1]


def _cosh(x: int) -> Interval:
    twice = add(_exp(x), _exp(-x))
    return twice[0] >> 1, -(-twice[1] >> 1)


def sin(a: Interval) -> Interval:
    """The sine: in the middle, and away from it by at most the radius."""
    return _wave(a, 0)


def cos(a: Interval) -> Interval:
    """The cosine."""
    return _wave(a, 1)


def _wave(a: Interval, quarter: int) -> Interval:
    # The middle is rounded down, away from the upper end.
    middle = (a[0] + a[1]) >> 1
    radius = a[1] - middle
    if radius >= 4 * ONE:
        return -ONE, ONE
    low, high = _sin_at(middle, quarter)
    return max(low - radius, -ONE), min(high + radius, ONE)


def _sin_at(x: int, quarter: int) -> Interval:
    """sin(x + quarter pi/2)."""
    turns = (2 * x + HALF_PI[0]) // (2 * HALF_PI[0])
    rest = subtract((x, x), times(HALF_PI, turns))
    if magnitude(rest) > 2 * ONE:
        raise OutOfDomain("a sine whose argument was not reduced")
    quadrant = (turns + quarter) % 4
    value = _series(rest, quadrant % 2)
    return negative(value) if quadrant >= 2 else value


def _series(x: Interval, even: int) -> Interval:
    """The series of the sine, or when `even` of the cosine, for |x| <= 2."""
    square = multiply(x, x)
    term = UNIT if even else x
    total, k = term, 0 if even else 1
    for _ in range(TERMS):
        term = negative(multiply(term, square))
        term = _over(term, (k + 1) * (k + 2))
        k += 2
        total = add(total, term)
        if k > 4 and magnitude(term) <= 1:
            break
    # Terms alternate and fall from here on.
    left = magnitude(term) + 1
    return total[0] - left, total[1] + left


def _over(a: Interval, number: int) -> Interval:
    return a[0] // number, -(-a[1] // number)


def atan(a: Interval) -> Interval:
    """The inverse tangent."""
    return _atan(a[0])[0], _atan(a[1])[1]


def _atan(x: int) -> Interval:
    # atan x = y + atan u, u = (x - tan y)/(1 + x tan y), with y a double near it and u of the order of rounding.
    if abs(x) > ONE << 64:
        # Else the tangent would divide by next to nothing.
        return subtract(HALF_PI if x > 0 else negative(HALF_PI), _alternating(divide(UNIT, (x, x)), 2))
    rough = math.atan(x / ONE)
    if not (abs(rough) < 1.6 and (rough >= 0.0) == (x >= 0)):
        raise OutOfDomain("an inverse tangent that was not found")
    y = of(Fraction(rough))
    tangent = divide(sin(y), cos(y))
    number = (x, x)
    u = divide(subtract(number, tangent), add(UNIT, multiply(number, tangent)))
    if magnitude(u) > ONE >> 8:
        raise OutOfDomain("an inverse tangent that was not found")
    return add(y, _alternating(u, 2))


def _alternating(u: Interval, step: int) -> Interval:
    """The sum of (-1)^j u^k/k over k = 1 + j `step` for |u| <= 2^-8: log(1 + u) for step 1, and atan u for step 2."""
    factor, term, total, k = negative(power(u, step)), u, u, 1
    while magnitude(term) > 1:
        term, k = multiply(term, factor), k + step
        total = add(total, _over(term, k))
    # Each term that is left out is below 2^-8 of the one before.
    return total[0] - 1, total[1] + 1


def _machin() -> Interval:
    """pi/2 = 8 atan(1/5) - 2 atan(1/239), summed in units of 2^-FINE."""

    def inverse_tangent(number: int) -> Interval:
        total, power_, k = ZERO, _over((1 << FINE, 1 << FINE), number), 0
        while power_[1] > 1:
            term = _over(power_, 2 * k + 1)
            total = add(total, negative(term) if k % 2 else term)
            power_ = _over(power_, number * number)
            k += 1
        return total[0] - 2, total[1] + 2

    first, second = inverse_tangent(5), inverse_tangent(239)
    low, high = 8 * first[0] - 2 * second[1], 8 * first[1] - 2 * second[0]
    return low >> (FINE - SHIFT), -(-high >> (FINE - SHIFT))


HALF_PI = _machin()


def _log_2() -> int:
    """The whole number of units of 2^-FINE below log 2 = 2 (1/3 + 1/(3 3^3) + 1/(5 3^5) + ...)."""
    guard = 32
    total, power_, k = 0, (2 << (FINE + guard)) // 3, 1
    while power_:
        total += power_ // k
        power_ //= 9
        k += 2
    # Every term is at most 3 units too small, and what is left off is less than one.
    assert (total + 3 * k) >> guard == total >> guard
    return total >> guard


LOG_2 = _log_2()
