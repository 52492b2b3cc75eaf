"""Values with a first and a second derivative along a line, of the checker's programs: over intervals, and exactly.

Exactly only rational expressions are evaluated, and functions at 0.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any, NamedTuple

from gsp.proofs import intervals as ia
from gsp.proofs.intervals import Interval
from gsp.proofs.programs import IntervalProgram, Rejected


class _Arithmetic(NamedTuple):
    """What values are made by, `function` giving one of them with its first and its second derivative."""

    of: Callable[[Fraction], Any]
    add: Callable[[Any, Any], Any]
    multiply: Callable[[Any, Any], Any]
    divide: Callable[[Any, Any], Any]
    power: Callable[[Any, int], Any]
    function: Callable[[str, Any], tuple[Any, Any, Any]]


def along(
    program: IntervalProgram, place: int, point: list[Interval], way: list[Interval]
) -> tuple[Interval, Interval, Interval]:
    """The value of an output over a box `point`, and its first and its second derivative along `way`."""
    program.work += 6 * program.cost
    return _carried(program, place, list(zip(point, way)), _INTERVALS)


def exactly(
    program: IntervalProgram, place: int, point: list[Fraction], way: list[Fraction]
) -> tuple[Fraction, ...]:
    """The same at one point, in fractions."""
    return _carried(program, place, list(zip(point, way)), _FRACTIONS)


def _carried(
    program: IntervalProgram, place: int, start: list[tuple[Any, Any]], a: _Arithmetic
) -> tuple[Any, Any, Any]:
    zero, two, minus = (a.of(Fraction(v)) for v in (0, 2, -1))
    found = [(value, way, zero) for value, way in start]

    def times(one: tuple, other: tuple) -> tuple:
        cross = a.multiply(two, a.multiply(one[1], other[1]))
        second = a.add(a.add(a.multiply(one[2], other[0]), cross), a.multiply(one[0], other[2]))
        return (
            a.multiply(one[0], other[0]),
            a.add(a.multiply(one[1], other[0]), a.multiply(one[0], other[1])),
            second,
        )

    def plus(one: tuple, other: tuple) -> tuple:
        return tuple(map(a.add, one, other))

    def over(one: tuple, derivatives: tuple) -> tuple:
        """A function of one, from it and its derivatives: phi' u'' + phi'' u'^2."""
        value, first, second = derivatives
        bent = a.multiply(second, a.multiply(one[1], one[1]))
        return value, a.multiply(first, one[1]), a.add(a.multiply(first, one[2]), bent)

    def reciprocal(value: Any) -> tuple:
        inverse = a.divide(a.of(Fraction(1)), value)
        square = a.multiply(inverse, inverse)
        return inverse, a.multiply(minus, square), a.multiply(two, a.multiply(square, inverse))

    def power(value: Any, n: int) -> tuple:
        if n < 0:
            raise Rejected("a negative power is not looked at where branches meet")
        parts = []
        factor = 1
        for k in range(3):
            parts.append(a.multiply(a.of(Fraction(factor)), a.power(value, n - k)) if n >= k else zero)
            factor *= n - k
        return tuple(parts)

    for name, one, other in program.code:
        if name == "constant":
            found.append((a.of(one), zero, zero))
        elif name == "+":
            found.append(plus(found[one], found[other]))
        elif name == "-":
            turned = tuple(a.multiply(minus, v) for v in found[other])
            found.append(plus(found[one], turned))
        elif name == "*":
            found.append(times(found[one], found[other]))
        elif name == "/":
            found.append(times(found[one], over(found[other], reciprocal(found[other][0]))))
        elif name == "**" and other.denominator == 1:
            found.append(over(found[one], power(found[one][0], int(other))))
        elif name in _AT_ZERO:
            found.append(over(found[one], a.function(name, found[one][0])))
        else:
            raise Rejected(f"{name} is not looked at where branches meet")
    return found[program.outputs[place]]


# The value and the two derivatives at 0.
_AT_ZERO = {
    "exp": (1, 1, 1), "sin": (0, 1, 0), "cos": (1, 0, -1), "tanh": (0, 1, 0), "sinh": (0, 1, 0), "cosh": (1, 0, 1),
    "atan": (0, 1, 0),
}  # fmt: skip


def _at_zero(name: str, value: Fraction) -> tuple[Fraction, Fraction, Fraction]:
    if value != 0:
        raise Rejected(f"{name} is known exactly at 0 only")
    first, second, third = map(Fraction, _AT_ZERO[name])
    return first, second, third


def _over_interval(name: str, u: Interval) -> tuple[Interval, Interval, Interval]:
    if name == "exp":
        value = ia.exp(u)
        return value, value, value
    if name in ("sin", "cos"):
        s, c = ia.sin(u), ia.cos(u)
        return (s, c, ia.negative(s)) if name == "sin" else (c, ia.negative(s), ia.negative(c))
    if name in ("sinh", "cosh"):
        s, c = ia.sinh(u), ia.cosh(u)
        return (s, c, s) if name == "sinh" else (c, s, c)
    two = ia.of(Fraction(-2))
    if name == "tanh":
        t = ia.tanh(u)
        first = ia.subtract(ia.UNIT, ia.power(t, 2))
        return t, first, ia.multiply(two, ia.multiply(t, first))
    assert name == "atan"
    first = ia.divide(ia.UNIT, ia.add(ia.UNIT, ia.power(u, 2)))
    return ia.atan(u), first, ia.multiply(two, ia.multiply(u, ia.power(first, 2)))


_INTERVALS = _Arithmetic(ia.of, ia.add, ia.multiply, ia.divide, ia.power, _over_interval)
_FRACTIONS = _Arithmetic(
    lambda v: v, lambda a, b: a + b, lambda a, b: a * b, lambda a, b: a / b, lambda a, n: a**n, _at_zero
)
