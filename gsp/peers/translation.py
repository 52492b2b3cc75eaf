"""Expressions in another package's language: values that know + - * / **, and functions by SymPy's class."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import add, mul
from typing import Any

import sympy as sp
from sympy.logic.boolalg import BooleanFalse, BooleanTrue

from gsp.errors import UnsupportedFunctionError

Value = Any
"""What the package calculates with: a node of its graph, an array being traced, a text."""

# As in `gsp.lowering.compiled_flow`: up to here powers are products.
_LARGEST_UNROLLED_POWER = 16


@dataclass(frozen=True, eq=False)
class Language:
    """What a package can say: numbers, powers with any exponent, roots, functions, and choices if it has any.

    `choose(condition, a, b)` is a where the condition holds; `relations` and `joins` make conditions.
    """

    name: str
    number: Callable[[float], Value]
    power: Callable[[Value, Value], Value]
    root: Callable[[Value], Value]
    functions: Mapping[Any, Callable[..., Value]]
    choose: Callable[[Value, Value, Value], Value] | None = None
    relations: Mapping[Any, Callable[[Value, Value], Value]] = field(default_factory=dict)
    joins: Mapping[Any, Callable[[Value, Value], Value]] = field(default_factory=dict)


def translate(
    expressions: Sequence[sp.Expr], *, states: Mapping[sp.Symbol, Value], language: Language
) -> list[Value]:
    """`expressions`, in the `states` alone, said in `language`; equal subexpressions are said once.

    Raises `UnsupportedFunctionError` naming what the language lacks.
    """
    translator = _Translator(language, dict(states))
    return [translator.value(expression) for expression in expressions]


class _Translator:
    def __init__(self, language: Language, values: dict[Any, Value]) -> None:
        self.language = language
        self.values = values

    def value(self, expression: Any) -> Value:
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
                f"{expression} is not a finite real number. Write the expression in real terms."
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
            raise self._missing(kind.__name__)
        return function(*values)

    def _step(self, argument: sp.Expr, below: Any, at_zero: Any) -> Value:
        branches = ((sp.S.One, argument > 0), (below, argument < 0), (at_zero, True))
        return self.value(sp.Piecewise(*branches))

    def _piecewise(self, expression: Any) -> Value:
        if self.language.choose is None:
            raise self._missing("Piecewise")
        # Where no condition holds there is no value.
        *others, (last, condition) = expression.args
        if isinstance(condition, BooleanTrue):
            result = self.value(last)
        else:
            others, result = list(expression.args), self.language.number(float("nan"))
        for value, condition in reversed(others):
            result = self.language.choose(self._condition(condition), self.value(value), result)
        return result

    def _condition(self, condition: Any) -> Value:
        if isinstance(condition, (BooleanTrue, BooleanFalse)):
            one, zero = self.language.number(1.0), self.language.number(0.0)
            return self._relation(sp.Gt, *((one, zero) if condition else (zero, one)))
        if isinstance(condition, sp.Not):
            return self._condition(sp.to_nnf(condition))
        if isinstance(condition, (sp.And, sp.Or)):
            join = self.language.joins.get(condition.func)
            if join is None:
                raise self._missing(condition.func.__name__)
            return reduce(join, map(self._condition, condition.args))
        if len(condition.args) != 2:
            raise self._missing(f"the condition {condition}")
        return self._relation(condition.func, *map(self.value, condition.args))

    def _relation(self, kind: Any, left: Value, right: Value) -> Value:
        relation = self.language.relations.get(kind)
        if relation is None:
            raise self._missing(kind.__name__)
        return relation(left, right)

    def _missing(self, what: str) -> UnsupportedFunctionError:
        return UnsupportedFunctionError(f"{self.language.name} has no {what}, as far as is known here")
