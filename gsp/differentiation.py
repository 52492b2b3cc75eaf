"""Derivatives over the reals, where SymPy differentiates over the complex numbers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import sympy as sp


class _Absolute(sp.Function):
    """Abs of a real number: SymPy's own differentiates to re and im unless its argument is declared real."""

    def fdiff(self, argindex: int = 1) -> Any:
        return _Sign(self.args[0])


class _Sign(sp.Function):
    """sign of a real number, with derivative 0 almost everywhere."""

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        return sp.S.Zero


class _Step(sp.Function):
    """Heaviside's step of a real number, with derivative 0 almost everywhere, its second argument the value at 0."""

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        return sp.S.Zero


_OVER_THE_REALS = ((sp.Abs, _Absolute), (sp.sign, _Sign), (sp.Heaviside, _Step))


def derivative(expression: Any, symbol: sp.Symbol) -> Any:
    """Derivative of a real expression that can be evaluated wherever it exists.

    Two things SymPy leaves to the reader: |u|, sign(u) and a step are taken of real u, off u = 0, and
    d(x^n)/dx = n x^n/x, which is 0/0 at x = 0, becomes n x^(n-1).
    """
    if not expression.has(symbol):
        return sp.S.Zero
    if expression.has(*(theirs for theirs, _ in _OVER_THE_REALS)):
        for theirs, ours in _OVER_THE_REALS:
            expression = expression.replace(theirs, ours)
        result = sp.diff(expression, symbol)
        for theirs, ours in _OVER_THE_REALS:
            result = result.replace(ours, theirs)
    else:
        result = sp.diff(expression, symbol)
    if any(not power.exp.is_number for power in result.atoms(sp.Pow)):
        result = sp.powsimp(result, combine="exp")
    return result


def jacobian(expressions: Iterable[Any], symbols: Iterable[sp.Symbol]) -> sp.Matrix:
    """The matrix of `derivative`s, a row for each of `expressions`."""
    columns = list(symbols)
    return sp.Matrix([[derivative(e, s) for s in columns] for e in expressions])
