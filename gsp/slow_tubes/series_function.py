"""Expressions over power series with balls as coefficients: Taylor's theorem for whatever has an enclosure."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

import flint
import sympy as sp
from flint import arb, arb_series

from gsp.proofs import balls
from gsp.proofs.ball_functions import BallProgram


def _reciprocal(u: arb_series) -> arb_series:
    # Of a series that may be 0 to begin with, "/" raises and inv() is not finite.
    return u.inv() if u[0] > 0 or u[0] < 0 else u + balls.UNDEFINED


def _tanh(u: arb_series) -> arb_series:
    return 1 - 2 * _reciprocal((2 * u).exp() + 1)


def _sinh(u: arb_series) -> arb_series:
    return (u.exp() - (-u).exp()) / 2


def _cosh(u: arb_series) -> arb_series:
    return (u.exp() + (-u).exp()) / 2


_FUNCTIONS: dict[Any, Callable[[Any], Any]] = {
    sp.exp: arb_series.exp,
    sp.log: arb_series.log,
    sp.sin: arb_series.sin,
    sp.cos: arb_series.cos,
    sp.tan: arb_series.tan,
    sp.atan: arb_series.atan,
    sp.tanh: _tanh,
    sp.sinh: _sinh,
    sp.cosh: _cosh,
}


class SeriesFunction(BallProgram):
    """A tuple of expressions as a function of power series, by the order of `arguments`.

    Constants have the precision of the time at which it is made. Where a series leaves the domain of a function its
    coefficients are not finite. Raises `UnsupportedFunctionError` for a function without an enclosure.
    """

    functions, over = _FUNCTIONS, "power series"

    def __init__(self, arguments: Sequence[sp.Symbol], outputs: Sequence[sp.Expr]) -> None:
        super().__init__(arguments, sp.cse(list(outputs), order="none"))

    def __call__(self, arguments: Sequence[Sequence[arb]], length: int) -> list[list[arb]]:
        """`length` coefficients of every output, of coefficients of the arguments (fewer are followed by 0)."""
        cap = flint.ctx.cap
        flint.ctx.cap = length
        try:
            registers: list[Any] = [None if c is None else arb_series([c], length) for c in self._registers]
            registers[: len(arguments)] = [arb_series(list(a[:length]), length) for a in arguments]
            for out, function, one, two in self._code:
                registers[out] = (
                    function(registers[one]) if two < 0 else function(registers[one], registers[two])
                )
            return [[registers[place][k] for k in range(length)] for place in self._outputs]
        finally:
            flint.ctx.cap = cap

    # -- writing -----------------------------------------------------------------------------------

    def _new(self, expression: Any) -> int:
        if expression.is_Add or expression.is_Mul:
            function = operator.add if expression.is_Add else operator.mul
            places = [self._written(part) for part in expression.args]
            total = places[0]
            for place in places[1:]:
                total = self._operation(function, total, place)
            return total
        if expression.is_Pow:
            return self._power(*expression.args)
        return super()._new(expression)

    def _power(self, base: Any, exponent: Any) -> int:
        if base is sp.E:
            return self._written(sp.exp(exponent, evaluate=False))
        if exponent.is_Integer:
            return self._whole_power(base, int(exponent))
        if exponent == sp.Rational(1, 2):
            return self._operation(arb_series.sqrt, self._written(base))
        # Of a positive base: the logarithm is not finite elsewhere.
        inside = self._operation(operator.mul, self._written(exponent), self._written(sp.log(base)))
        return self._operation(arb_series.exp, inside)

    def _whole_power(self, base: Any, exponent: int) -> int:
        if exponent < 0:
            return self._operation(_reciprocal, self._written(base**-exponent))
        half = self._written(base ** (exponent // 2))
        square = self._operation(operator.mul, half, half)
        return square if exponent % 2 == 0 else self._operation(operator.mul, square, self._written(base))
