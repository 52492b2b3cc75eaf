"""Sine and cosine together, and the exponential, as intermediate code for one number or for all lanes of a vector.

The C library takes one argument a call. Here the argument is reduced to an interval round 0 by a constant in parts
(Cody and Waite 1980), the function of what is left is its Taylor polynomial, of a degree whose remainder is below half
a unit in the last place, and no lane waits for another. Results are within four units in the last place. Where an
argument is beyond the reduction, infinite or no number, a branch calls the library for every lane.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

from llvmlite import ir

from gsp.lowering.steps.arithmetic import RealArithmetic, intrinsic
from gsp.lowering.steps.values import spread

_INTEGER = ir.IntType(64)
# To 50 digits.
_HALF_PI = Fraction("1.5707963267948966192313216916397514420985846996876")
_LOG_2 = Fraction("0.69314718055994530941723212145817656807550013436026")


def _parts(value: Fraction, bits: int, count: int) -> tuple[float, ...]:
    """`value` as a sum of doubles of so many bits each, but for the last: a multiple up to 2^(53 - bits) is exact."""
    result = []
    for _ in range(count - 1):
        scale = Fraction(2) ** (bits - 1 - math.floor(math.log2(value)))
        part = Fraction(math.floor(value * scale)) / scale
        result.append(float(part))
        value -= part
    return *result, float(value)


# With 33 bits 2^20 quarter turns are exact, with 42 the 1100 powers of two of a double.
_QUARTER_TURN = _parts(_HALF_PI, 33, 3)
_DOUBLING = _parts(_LOG_2, 42, 2)
LARGEST_ANGLE = 1e6
LARGEST_EXPONENT = 700.0
# Added to a double, it rounds to an integer, which is then in its last bits.
_ROUNDING = 1.5 * 2.0**52
_SINE = [(-1.0) ** k / math.factorial(2 * k + 1) for k in range(8)]
_COSINE = [(-1.0) ** k / math.factorial(2 * k) for k in range(9)]
_EXPONENTIAL = [1.0 / math.factorial(k) for k in range(14)]

Library = Callable[[str, Any], Any]


def sine_and_cosine(builder: Any, x: Any, library: Library) -> tuple[Any, Any]:
    """(sin x, cos x); `library(name, x)` writes a call for every lane."""
    real = RealArithmetic(builder, _width(x))
    turns, rest = _reduced(real, x, 1.0 / float(_HALF_PI), _QUARTER_TURN)
    square = real.multiply(rest, rest)
    sine = real.multiply(rest, _polynomial(real, _SINE, square))
    cosine = _polynomial(real, _COSINE, square)
    one = _integer(builder, 1, x)
    odd = builder.icmp_unsigned("!=", builder.and_(turns, one), _integer(builder, 0, x))
    # In the third and fourth quadrant the sine changes its sign, in the second and third the cosine.
    found = (
        _signed(builder, builder.select(odd, cosine, sine), turns),
        _signed(builder, builder.select(odd, sine, cosine), builder.add(turns, one)),
    )
    return _guarded(real, x, LARGEST_ANGLE, ("sin", "cos"), found, library)


def exponential(builder: Any, x: Any, library: Library) -> Any:
    """exp x; `library(name, x)` writes a call for every lane."""
    real = RealArithmetic(builder, _width(x))
    power, rest = _reduced(real, x, 1.0 / float(_LOG_2), _DOUBLING)
    # 2^power from its bits: the exponent begins at 1023.
    exponent = builder.shl(builder.add(power, _integer(builder, 1023, x)), _integer(builder, 52, x))
    scale = builder.bitcast(exponent, x.type)
    found = real.multiply(scale, _polynomial(real, _EXPONENTIAL, rest))
    return _guarded(real, x, LARGEST_EXPONENT, ("exp",), (found,), library)[0]


def _width(x: Any) -> int:
    return x.type.count if isinstance(x.type, ir.VectorType) else 0


def _integer(builder: Any, value: int, like: Any) -> Any:
    one = ir.Constant(_INTEGER, value)
    return spread(builder, one, _width(like)) if _width(like) else one


def _reduced(real: RealArithmetic, x: Any, inverse: float, parts: tuple[float, ...]) -> tuple[Any, Any]:
    """(k, x - k c) for the integer k nearest to x/c and c the sum of `parts`; k in the last bits of 64."""
    builder = real.builder
    shifted = builder.fadd(builder.fmul(x, real.constant(inverse)), real.constant(_ROUNDING))
    count = builder.fsub(shifted, real.constant(_ROUNDING))
    kind = ir.VectorType(_INTEGER, _width(x)) if _width(x) else _INTEGER
    bits = builder.sub(builder.bitcast(shifted, kind), builder.bitcast(real.constant(_ROUNDING), kind))
    for part in parts:
        x = real.subtract_product(x, count, real.constant(part))
    return bits, x


def _polynomial(real: RealArithmetic, coefficients: list[float], x: Any) -> Any:
    """The sum of coefficient x^k, even and odd powers apart, so that half as many are waited for."""
    square = real.multiply(x, x)
    sums = []
    for own in (coefficients[0::2], coefficients[1::2]):
        total = real.constant(own[-1])
        for coefficient in own[-2::-1]:
            total = real.add_product(real.constant(coefficient), total, square)
        sums.append(total)
    return real.add_product(sums[0], sums[1], x)


def _signed(builder: Any, value: Any, quadrant: Any) -> Any:
    """`value`, negated where bit 1 of `quadrant` is set."""
    two, up = _integer(builder, 2, value), _integer(builder, 62, value)
    sign = builder.shl(builder.and_(quadrant, two), up)
    return builder.bitcast(builder.xor(builder.bitcast(value, quadrant.type), sign), value.type)


def _guarded(
    real: RealArithmetic,
    x: Any,
    largest: float,
    names: tuple[str, ...],
    found: tuple[Any, ...],
    library: Library,
) -> tuple[Any, ...]:
    """What was `found`, or the library's values where an argument is larger, or no number."""
    builder = real.builder
    fine = builder.fcmp_ordered("<=", intrinsic(builder, "fabs", x), real.constant(largest))
    if width := _width(x):
        bits = ir.IntType(width)
        fine = builder.icmp_unsigned("==", builder.bitcast(fine, bits), ir.Constant(bits, -1))
    begun = builder.block
    with builder.if_then(builder.not_(fine), likely=False):
        called = [library(name, x) for name in names]
        ended = builder.block
    result = []
    for ours, theirs in zip(found, called):
        value = builder.phi(x.type)
        value.add_incoming(ours, begun)
        value.add_incoming(theirs, ended)
        result.append(value)
    return tuple(result)
