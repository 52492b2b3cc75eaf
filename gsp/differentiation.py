"""Derivatives over the reals, where SymPy differentiates over the complex numbers."""

from __future__ import annotations

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


def derivative(expression: Any, symbol: sp.Symbol) -> Any:
    """Derivative of a real expression that can be evaluated wherever it exists.

    Two things SymPy leaves to the reader: |u| and sign(u) are taken as real, and d(x^n)/dx = n x^n/x, which is
    0/0 at x = 0, becomes n x^(n-1).
    """
    if not expression.has(symbol):
        return sp.S.Zero
    if expression.has(sp.Abs, sp.sign):
        expression = expression.replace(sp.Abs, _Absolute).replace(sp.sign, _Sign)
        result = sp.diff(expression, symbol).replace(_Absolute, sp.Abs).replace(_Sign, sp.sign)
    else:
        result = sp.diff(expression, symbol)
    if any(not power.exp.is_number for power in result.atoms(sp.Pow)):
        result = sp.powsimp(result, combine="exp")
    return result
