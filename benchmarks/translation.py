"""Expressions in another package's language: values that know + - * / **, and functions by SymPy's class."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add, mul
from typing import Any

import sympy as sp

from gsp.errors import UnsupportedFunctionError

Value = Any
"""What the package calculates with: a node of its graph, an array being traced, a text."""

# As in `gsp.lowering.compiled_flow`: up to here powers are products.
_LARGEST_UNROLLED_POWER = 16


@dataclass(frozen=True, eq=False)
class Language:
    """What a package can say: numbers, powers with any exponent, roots and functions."""

    name: str
    number: Callable[[float], Value]
    power: Callable[[Value, Value], Value]
    root: Callable[[Value], Value]
    functions: Mapping[Any, Callable[..., Value]]


def translate(
    expressions: Sequence[sp.Expr], *, states: Mapping[sp.Symbol, Value], language: Language
) -> list[Value]:
    """`expressions`, in the `states` alone, said in `language`; equal subexpressions are said once.

    Raises `UnsupportedFunctionError` naming what the language lacks.
    """
    translator = Translator(language, dict(states))
    return [translator.value(expression) for expression in expressions]


class Translator:
    """Says expressions in a language whose `values` for states, and for all that was said before, are known."""

    def __init__(self, language: Language, values: dict[Any, Value]) -> None:
        self.language = language
        self.values = values

    def value(self, expression: Any) -> Value:
        """The expression in the language."""
        if expression not in self.values:
            self.values[expression] = self._fresh(expression)
        return self.values[expression]

    def _fresh(self, expression: Any) -> Value:
        if expression.is_number:
            return self._number(expression)
        if isinstance(expression, sp.Add):
            return reduce(add, map(self.value, expression.args))
        if isinstance(expression, sp.Mul):
            return self._product(expression)
        if isinstance(expression, sp.Pow):
            return self._power(expression)
        if isinstance(expression, sp.Piecewise):
            return self._piecewise(expression)
        return self._function(expression)

    def _number(self, expression: Any) -> Value:
        number = expression.evalf(25)
        if not (number.is_extended_real and number.is_finite):
            raise UnsupportedFunctionError(
                f"{expression} is not a finite real number.", "Write the expression in real terms."
            )
        return self.language.number(float(number))

    def _product(self, expression: sp.Mul) -> Value:
        above, below = [], []
        for factor in expression.args:
            if isinstance(factor, sp.Pow) and factor.exp.is_Number and factor.exp.is_negative:
                below.append(self.value(sp.Pow(factor.base, -factor.exp)))
            elif factor is not sp.S.NegativeOne:
                above.append(self.value(factor))
        result = reduce(mul, above) if above else self.language.number(1.0)
        if below:
            result = result / reduce(mul, below)
        return -result if sp.S.NegativeOne in expression.args else result

    def _power(self, expression: Any) -> Value:
        base, exponent = expression.base, expression.exp
        if exponent.is_Number and exponent.is_negative:
            return self.language.number(1.0) / self.value(sp.Pow(base, -exponent))
        if not exponent.is_Rational or exponent.q > 2 or exponent > _LARGEST_UNROLLED_POWER:
            return self.language.power(self.value(base), self.value(exponent))
        x, k = self.value(base), int(exponent)
        result = None if exponent.is_Integer else self.language.root(x)
        while k:
            if k & 1:
                result = x if result is None else result * x
            k >>= 1
            if k:
                x = x * x
        return result

    def _function(self, expression: Any) -> Value:
        kind = expression.func
        if kind in (sp.Max, sp.Min):
            values = map(self.value, expression.args)
            return reduce(lambda a, b: self._call(kind, a, b), values)
        if kind is sp.sign:
            return self._step(expression.args[0], sp.S.NegativeOne, sp.S.Zero)
        if kind is sp.Heaviside:
            return self._step(expression.args[0], sp.S.Zero, expression.args[1])
        return self._call(kind, *map(self.value, expression.args))

    def _call(self, kind: Any, *values: Value) -> Value:
        function = self.language.functions.get(kind)
        if function is None:
            raise self.missing(kind.__name__)
        return function(*values)

    def _step(self, argument: sp.Expr, below: Any, at_zero: Any) -> Value:
        branches = ((sp.S.One, argument > 0), (below, argument < 0), (at_zero, True))
        return self.value(sp.Piecewise(*branches))

    def _piecewise(self, expression: Any) -> Value:
        raise self.missing("Piecewise")

    def missing(self, what: str) -> UnsupportedFunctionError:
        """The error for what the language cannot say."""
        return UnsupportedFunctionError(f"{self.language.name} has no {what}, as far as is known here")
