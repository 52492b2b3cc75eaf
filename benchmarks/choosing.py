"""Expressions in the languages of packages that can also choose: pieces, signs and steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import sympy as sp
from sympy.logic.boolalg import BooleanFalse, BooleanTrue
from translation import Language, Translator, Value


@dataclass(frozen=True, eq=False, kw_only=True)
class ChoosingLanguage(Language):
    """A language in which `choose(condition, a, b)` is a where the condition holds.

    `relations` and `joins` make conditions.
    """

    choose: Callable[[Value, Value, Value], Value]
    relations: Mapping[Any, Callable[[Value, Value], Value]]
    joins: Mapping[Any, Callable[[Value, Value], Value]]


def translate(
    expressions: Sequence[sp.Expr], *, states: Mapping[sp.Symbol, Value], language: ChoosingLanguage
) -> list[Value]:
    """`translation.translate` with choices."""
    translator = _Chooser(language, dict(states))
    return [translator.value(expression) for expression in expressions]


class _Chooser(Translator):
    language: ChoosingLanguage

    def _piecewise(self, expression: Any) -> Value:
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
                raise self.missing(condition.func.__name__)
            return reduce(join, map(self._condition, condition.args))
        if len(condition.args) != 2:
            raise self.missing(f"the condition {condition}")
        return self._relation(condition.func, *map(self.value, condition.args))

    def _relation(self, kind: Any, left: Value, right: Value) -> Value:
        relation = self.language.relations.get(kind)
        if relation is None:
            raise self.missing(kind.__name__)
        return relation(left, right)
