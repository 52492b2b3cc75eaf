"""The expressions of a proof file: a parser and derivatives of the checker's own, over intervals in whole numbers.

The text is untrusted. It is read by a grammar without names of Python's, and its length, depth and numbers are
bounded.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from fractions import Fraction
from typing import Any

from gsp.proofs import intervals as ia
from gsp.proofs.intervals import Interval
from gsp.proofs.quotients import quotients

# Bounds on an expression: characters, depth, digits of a number, and numerator and denominator of an exponent.
MOST_TEXT, MOST_DEPTH, MOST_DIGITS, MOST_POWER, MOST_ROOT = 200_000, 100, 400, 1000, 64


class Rejected(ValueError):
    """A proof that does not hold; the text says why."""


class NotRational(Rejected):
    """A function in what is checked between rational functions."""


class TooLong(Rejected):
    """A proof that takes more operations than a check may."""


# Functions of one argument, each with its derivative from the argument and the value.
_FUNCTIONS: dict[str, tuple[Callable[[Interval], Interval], Callable[[Interval, Interval], Interval]]] = {
    "exp": (ia.exp, lambda _, value: value),
    "log": (ia.log, lambda a, _: ia.divide(ia.UNIT, a)),
    "tanh": (ia.tanh, lambda _, value: ia.subtract(ia.UNIT, ia.power(value, 2))),
    "sinh": (ia.sinh, lambda a, _: ia.cosh(a)),
    "cosh": (ia.cosh, lambda a, _: ia.sinh(a)),
    "sin": (ia.sin, lambda a, _: ia.cos(a)),
    "cos": (ia.cos, lambda a, _: ia.negative(ia.sin(a))),
    "atan": (ia.atan, lambda a, _: ia.divide(ia.UNIT, ia.add(ia.UNIT, ia.power(a, 2)))),
    "sqrt": (lambda a: ia.root(a, 2), lambda _, value: ia.divide((ia.ONE // 2, ia.ONE // 2), value)),
}
_ARITHMETIC = {"+": ia.add, "-": ia.subtract, "*": ia.multiply, "/": ia.divide}
_CONSTANTS: dict[str, Callable[[], Interval]] = {
    "pi": lambda: (2 * ia.HALF_PI[0], 2 * ia.HALF_PI[1]),
    "E": lambda: ia.exp(ia.UNIT),
}
_TOKEN = re.compile(r"\s*(?:([0-9]+)|([A-Za-z_][A-Za-z0-9_]*)|(\*\*|[-+*/()]))")


class IntervalProgram:
    """Expressions as straight-line code; values and first derivatives over intervals."""

    def __init__(self, texts: tuple[Any, ...], variables: int) -> None:
        self.variables = variables
        # (operation, one, two): "+", "-", "*", "/", "**" with a Fraction, a function's name, or "constant".
        self.code: list[tuple[str, Any, Any]] = []
        self.known: dict[tuple[str, Any, Any], int] = {}
        self.outputs = [_ProgramReader(text, self).read() for text in texts]
        # Operations on intervals so far, and those of one list of values: a power takes repeated squares of both ends.
        self.work = 0
        self.cost = sum(2 * two.numerator.bit_length() if name == "**" else 1 for name, _, two in self.code)
        self.constants = {i: ia.of(one) for i, (name, one, _) in enumerate(self.code) if name == "constant"}
        self.constants |= {
            i: _CONSTANTS[name]() for i, (name, _, _) in enumerate(self.code) if name in _CONSTANTS
        }
        self.quotients = quotients(self)
        self.gathering = sum(quotient.cost for quotient in self.quotients.values())

    def add(self, name: str, one: Any, two: Any = None) -> int:
        key = (name, one, two)
        if key not in self.known:
            self.known[key] = self.variables + len(self.code)
            self.code.append(key)
        return self.known[key]

    def spend(self, operations: int, most: int) -> None:
        """Count what takes as long as so many operations on intervals; raises `TooLong` past `most` in all."""
        self.work += operations
        if self.work > most:
            raise TooLong(f"the check takes more than {most} operations on intervals")

    def constant_at(self, place: int) -> Fraction | None:
        if place < self.variables:
            return None
        name, one, _ = self.code[place - self.variables]
        return one if name == "constant" else None

    def values(self, arguments: list[Interval]) -> list[Interval]:
        """Values (m,)."""
        self.work += self.cost
        found = list(arguments)
        for i, (name, one, two) in enumerate(self.code):
            found.append(self._value(i, name, one, two, found))
        return [found[place] for place in self.outputs]

    def _value(self, i: int, name: str, one: Any, two: Any, found: list[Interval]) -> Interval:
        operation = _ARITHMETIC.get(name)
        if operation is not None:
            return operation(found[one], found[two])
        if i in self.constants:
            return self.constants[i]
        return ia.raised(found[one], two) if name == "**" else _FUNCTIONS[name][0](found[one])

    def derivatives(self, arguments: list[Interval], first: int = 0) -> list[list[Interval]]:
        """Derivatives by the variables from the `first` on (m, variables - first), forward from variable to output."""
        self.work += 2 * self.cost + (len(self.code) + self.gathering) * (self.variables - first)
        found = list(arguments)
        slopes: list[dict[int, Interval]] = [{k: ia.UNIT} if k >= first else {} for k in range(self.variables)]
        for i, (name, one, two) in enumerate(self.code):
            value = self._value(i, name, one, two, found)
            found.append(value)
            slope = self._slope(name, one, two, value, found, slopes)
            if i in self.quotients:
                tight = self.quotients[i].slope(found, slopes)
                slope = {k: ia.common(slope[k], tight[k]) for k in slope}
            slopes.append(slope)
        return [[slopes[place].get(k, ia.ZERO) for k in range(first, self.variables)] for place in self.outputs]

    def _slope(
        self,
        name: str,
        one: Any,
        two: Any,
        value: Interval,
        found: list[Interval],
        slopes: list[dict[int, Interval]],
    ) -> dict[int, Interval]:
        if name == "constant" or name in _CONSTANTS:
            return {}
        if name in ("+", "-"):
            total = dict(slopes[one])
            for k, slope in slopes[two].items():
                before = total.get(k, ia.ZERO)
                total[k] = ia.add(before, slope) if name == "+" else ia.subtract(before, slope)
            return total
        if name == "*":
            total = {k: _scaled(slope, found[two]) for k, slope in slopes[one].items()}
            for k, slope in slopes[two].items():
                part = _scaled(slope, found[one])
                total[k] = ia.add(total[k], part) if k in total else part
            return total
        if name == "/":
            total = {k: ia.divide(slope, found[two]) for k, slope in slopes[one].items()}
            for k, slope in slopes[two].items():
                part = ia.divide(ia.multiply(value, slope), found[two])
                total[k] = ia.subtract(total.get(k, ia.ZERO), part)
            return total
        if not slopes[one]:
            return {}
        if name == "**":
            rate = ia.multiply(ia.of(two), ia.raised(found[one], two - 1))
        else:
            rate = _FUNCTIONS[name][1](found[one], value)
        return {k: _scaled(slope, rate) for k, slope in slopes[one].items()}


def _scaled(slope: Interval, by: Interval) -> Interval:
    """The product; the slope of a variable by itself is 1."""
    return by if slope is ia.UNIT else ia.multiply(slope, by)


class _ProgramReader:
    """Sums, products, powers with constant exponents, and functions of z0, z1, ...; nothing else is read."""

    def __init__(self, text: Any, program: IntervalProgram) -> None:
        if not isinstance(text, str) or len(text) > MOST_TEXT or not text.isprintable():
            raise Rejected(f"an expression is one line of at most {MOST_TEXT} characters")
        self.program = program
        self.tokens: list[str] = []
        place = 0
        end = len(text.rstrip())
        while place < end:
            match = _TOKEN.match(text, place)
            if match is None:
                raise Rejected(f"an expression has an unknown sign. Got {text[place : place + 20]!r}")
            self.tokens.append(match.group().strip())
            place = match.end()
        self.place = 0
        self.depth = 0

    def read(self) -> int:
        """The place of the whole expression."""
        place = self._sum()
        if self.place != len(self.tokens):
            raise Rejected(f"an expression goes on after its end. Got {self.tokens[self.place]!r}")
        return place

    def _next(self) -> str:
        return self.tokens[self.place] if self.place < len(self.tokens) else ""

    def _take(self, *signs: str) -> str:
        token = self._next()
        if token in signs:
            self.place += 1
            return token
        return ""

    def _sum(self) -> int:
        self.depth += 1
        if self.depth > MOST_DEPTH:
            raise Rejected(f"an expression is nested deeper than {MOST_DEPTH}")
        total = self._product()
        while sign := self._take("+", "-"):
            total = self._joined(sign, total, self._product())
        self.depth -= 1
        return total

    def _product(self) -> int:
        total = self._signed()
        while sign := self._take("*", "/"):
            total = self._joined(sign, total, self._signed())
        return total

    def _signed(self) -> int:
        minus = False
        while self._take("-"):
            minus = not minus
        place = self._raised()
        return self._joined("-", self.program.add("constant", Fraction(0)), place) if minus else place

    def _raised(self) -> int:
        base = self._atom()
        if not self._take("**"):
            return base
        self.depth += 1
        if self.depth > MOST_DEPTH:
            raise Rejected(f"an expression is nested deeper than {MOST_DEPTH}")
        place = self._signed()
        self.depth -= 1
        exponent = self.program.constant_at(place)
        if exponent is None:
            # Of a positive base: the logarithm is not defined elsewhere.
            return self.program.add("exp", self.program.add("*", place, self.program.add("log", base)))
        if abs(exponent.numerator) > MOST_POWER or exponent.denominator > MOST_ROOT:
            raise Rejected(
                f"a constant exponent is a fraction p/q, p up to {MOST_POWER} and q up to {MOST_ROOT}"
            )
        return self.program.add("**", base, exponent)

    def _atom(self) -> int:
        token = self._next()
        if token == "(":
            return self._bracketed(token)
        self.place += 1
        if token.isascii() and token.isdigit():
            if len(token) > MOST_DIGITS:
                raise Rejected(f"a number has at most {MOST_DIGITS} digits")
            return self.program.add("constant", Fraction(int(token)))
        if token in _CONSTANTS:
            return self.program.add(token, 0)
        if token == "tan":
            inside = self._bracketed(token)
            return self.program.add("/", self.program.add("sin", inside), self.program.add("cos", inside))
        if token in _FUNCTIONS:
            return self.program.add(token, self._bracketed(token))
        if re.fullmatch(r"z[0-9]{1,3}", token) and int(token[1:]) < self.program.variables:
            return int(token[1:])
        raise Rejected(f"an expression has an unknown name or ends too soon. Got {token[:40]!r}")

    def _bracketed(self, name: str) -> int:
        if not self._take("("):
            raise Rejected(f"{name} has an argument in brackets")
        inside = self._sum()
        if not self._take(")"):
            raise Rejected("a bracket is not closed")
        return inside

    def _joined(self, sign: str, one: int, two: int) -> int:
        a, b = self.program.constant_at(one), self.program.constant_at(two)
        if a is None or b is None:
            return self.program.add(sign, one, two)
        if sign == "/" and b == 0:
            raise Rejected("an expression divides by 0")
        value = a + b if sign == "+" else a - b if sign == "-" else a * b if sign == "*" else a / b
        return self.program.add("constant", value)
