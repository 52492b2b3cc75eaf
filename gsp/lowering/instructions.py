"""Expressions as straight-line instructions, for the Taylor coefficients of `gsp.kernels.jets`.

An instruction is (operation, a, b, c), as `gsp.kernels.jets` says. Whatever does not depend on the states is an
expression of its own, a constant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import sympy as sp
from sympy.codegen.cfunctions import expm1, log1p

from gsp.algebra.bounded_quotients import Written, bounded
from gsp.algebra.functions import COMPOSED, CONSTANTS, RULES, Rule, composed, parts
from gsp.algebra.sharing import parts_of
from gsp.kernels import jets

# Levels of nesting that are written by recursion, a few calls each.
_DEEPEST = 80
# What `bounded` brings in beside the functions of a model.
_RULES = RULES | {"log1p": Rule(lambda v, u: (u + 1).inverse()), "expm1": Rule(lambda v, u: v + 1)}
_CODES = {name: getattr(jets, name.upper()) for name in _RULES if name != "sign"}


@dataclass(frozen=True)
class Instructions:
    """Instructions `rows`, the first n of them the states; the rows of the `outputs`; the `constants` by place."""

    rows: tuple[tuple[int, int, int, int], ...]
    outputs: tuple[int, ...]
    constants: tuple[sp.Expr, ...]


def write_instructions(states: Sequence[sp.Symbol], outputs: Sequence[sp.Expr]) -> Instructions:
    """The instructions for `outputs` as functions of `states`; equal subexpressions are written once.

    Raises `UnsupportedFunctionError` for a function that has no differential equation in `gsp.algebra.functions`.

    >>> x, y = sp.symbols("x y")
    >>> len(write_instructions((x, y), (-x, sp.sin(x) - y)).rows)
    7
    """
    writer = _TapeWriter(states)
    for landing in landings(*outputs):
        writer.read(landing)
    rows = tuple(writer.row(writer.read(output)) for output in outputs)
    return Instructions(tuple(writer.rows), rows, tuple(writer.constants))


class _Value:
    """An expression on the tape: a row, or a constant; the operations are those that `gsp.algebra.functions` asks
    for.
    """

    __slots__ = ("constant", "row", "writer")

    def __init__(self, writer: _TapeWriter, row: int = -1, constant: sp.Expr | None = None) -> None:
        self.writer = writer
        self.row = row
        self.constant = constant

    def __add__(self, other: _Value | int) -> _Value:
        a, b = self, self.writer.lift(other)
        if a.constant is not None and b.constant is not None:
            return self.writer.lift(a.constant + b.constant)
        if a.constant is not None:
            a, b = b, a
        if b.constant is None:
            return self.writer.emit(jets.ADD, min(a.row, b.row), max(a.row, b.row))
        return a if b.constant == 0 else self.writer.emit(jets.SHIFT, a.row, constant=b.constant)

    def __sub__(self, other: _Value) -> _Value:
        if self.constant is None and other.constant is None:
            return self.writer.emit(jets.SUBTRACT, self.row, other.row)
        return self + (-other)

    def __neg__(self) -> _Value:
        return self * -1

    def __mul__(self, other: _Value | int | sp.Rational) -> _Value:
        a, b = self, self.writer.lift(other)
        if a.constant is not None and b.constant is not None:
            return self.writer.lift(a.constant * b.constant)
        if a.constant is not None:
            a, b = b, a
        if b.constant is None:
            return self.writer.emit(jets.MULTIPLY, min(a.row, b.row), max(a.row, b.row))
        if b.constant in (0, 1):
            return a if b.constant == 1 else self.writer.lift(0)
        return self.writer.emit(jets.SCALE, a.row, constant=b.constant)

    def __truediv__(self, other: _Value) -> _Value:
        if other.constant is not None:
            return self * self.writer.lift(1 / other.constant)
        if self.constant is not None:
            return self.writer.emit(jets.QUOTIENT, other.row, constant=self.constant)
        return self.writer.emit(jets.DIVIDE, self.row, other.row)

    def inverse(self) -> _Value:
        return self.writer.lift(1) / self

    def apply(self, name: str) -> _Value:
        return self.writer.function(name, self)


class _TapeWriter:
    """Writes each different row once; `constants` maps each expression to its place."""

    def __init__(self, states: Sequence[sp.Symbol]) -> None:
        self.rows: list[tuple[int, int, int, int]] = [(jets.STATE, i, 0, 0) for i in range(len(states))]
        self.constants: dict[sp.Expr, int] = {}
        self._states: Mapping[sp.Symbol, int] = {symbol: i for i, symbol in enumerate(states)}
        self._known: dict[tuple, int] = {}
        self._read: dict[sp.Expr, _Value] = {}
        self._written: dict[sp.Basic, Written] = {}
        self._dependent: dict[sp.Basic, bool] = dict.fromkeys(states, True)

    def lift(self, value: _Value | sp.Expr | int) -> _Value:
        return value if isinstance(value, _Value) else _Value(self, constant=sp.sympify(value, strict=True))

    def row(self, value: _Value) -> int:
        """The row of a value; constants get one of their own."""
        return (
            self.emit(jets.CONSTANT, constant=value.constant).row if value.constant is not None else value.row
        )

    def emit(self, operation: int, a: int = 0, b: int = 0, constant: sp.Expr | None = None) -> _Value:
        place = 0 if constant is None else self.constants.setdefault(constant, len(self.constants))
        key = (operation, a, b, place)
        if key not in self._known:
            self._known[key] = len(self.rows)
            self.rows.append(key)
        return _Value(self, self._known[key])

    def function(self, name: str, u: _Value, exponent: sp.Expr | None = None) -> _Value:
        if name in CONSTANTS:
            return self.lift(CONSTANTS[name])
        if u.constant is not None:
            return self.lift(u.constant**exponent if exponent is not None else getattr(sp, name)(u.constant))
        if name == "sign":
            return self.emit(jets.SIGN, u.row)
        operation = jets.POWER if exponent is not None else _CODES[name]
        place = 0 if exponent is None else self.constants.setdefault(exponent, len(self.constants))
        key = (operation, u.row, place)
        if key in self._known:
            return _Value(self, self._known[key])
        v = _Value(self, len(self.rows))
        self._known[key] = v.row
        self.rows.append((operation, u.row, 0, place))
        # The rate is written after v, which it may contain, and its row is then put in.
        if exponent is not None:
            rate = v * self.lift(exponent) / u
        else:
            rule = _RULES[name].rate
            assert rule is not None
            rate = rule(v, u)
        self.rows[v.row] = (operation, u.row, self.row(rate), place)
        return v

    def read(self, expression: sp.Expr) -> _Value:
        """`expression` written to the tape."""
        if expression not in self._read:
            self._read[expression] = self._fresh(expression)
        return self._read[expression]

    def _depends(self, e: sp.Basic) -> bool:
        """Whether `e` has a state in it."""
        if e not in self._dependent:
            self._dependent[e] = any(self._depends(part) for part in e.args)
        return self._dependent[e]

    def _fresh(self, e: sp.Expr) -> _Value:
        if not self._depends(e):
            return self.lift(e)
        if isinstance(e, sp.Symbol):
            return _Value(self, self._states[e])
        if e.is_Add:
            return self._sum(e)
        if (found := bounded(e, self._written)) is not e:
            return self.read(found)
        if e.is_Mul:
            return self._product(e)
        if e.is_Pow and e.exp.is_Integer:
            return self._power(e.base, int(e.exp))
        name, arguments = (type(e).__name__, e.args) if isinstance(e, (log1p, expm1)) else parts(e)
        if name in COMPOSED:
            return composed(name, [self.read(argument) for argument in arguments])
        u = self.read(arguments[0])
        if name != "pow":
            return u.apply(name)
        exponent = arguments[1]
        if self._depends(exponent):
            # u^w = exp(w log u)
            return (self.read(exponent) * u.apply("log")).apply("exp")
        return self.function("pow", u, exponent)

    def _sum(self, e: sp.Expr) -> _Value:
        constant = [t for t in e.args if not self._depends(t)]
        terms = [t for t in e.args if self._depends(t)]
        terms.sort(key=lambda t: bool(t.as_coeff_Mul()[0].is_negative))
        total = self.lift(sp.Add(*constant)) if constant else None
        for term in terms:
            if total is None:
                total = self.read(term)
            elif term.as_coeff_Mul()[0].is_negative:
                total = total - self.read(-term)
            else:
                total = total + self.read(term)
        assert total is not None
        return total

    def _product(self, e: sp.Expr) -> _Value:
        constant = sp.Mul(*[t for t in e.args if not self._depends(t)])
        above, below = self.lift(1), self.lift(1)
        for factor in e.args:
            if not self._depends(factor):
                continue
            if factor.is_Pow and factor.exp.is_Integer and factor.exp.is_negative:
                below = below * self._power(factor.base, -int(factor.exp))
            else:
                above = above * self.read(factor)
        return above * self.lift(constant) / below

    def _power(self, base: sp.Expr, exponent: int) -> _Value:
        if exponent < 0:
            return self._power(base, -exponent).inverse()
        square = self.read(base)
        result = self.lift(1)
        while exponent:
            if exponent & 1:
                result = result * square
            exponent >>= 1
            if exponent:
                square = square * square
        return result


def landings(*expressions: sp.Expr) -> list[sp.Expr]:
    """Subexpressions, lowest first, such that between one and the next nothing is nested deeper than `_DEEPEST`.

    Horner forms of long series are nested a thousand deep, beyond what Python's stack holds.
    """
    heights: dict[sp.Basic, int] = {}
    for part in parts_of(*reversed(expressions)):
        heights[part] = 1 + max(heights.get(inner, 1) for inner in part.args)
    arithmetic = (sp.Add, sp.Mul, sp.Pow)
    found = [e for e, height in heights.items() if height % _DEEPEST == 0 and isinstance(e, arithmetic)]
    return sorted(found, key=heights.__getitem__)
