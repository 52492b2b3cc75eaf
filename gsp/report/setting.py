"""Symbols, equations and numbers of a page as MathML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

import sympy as sp
from markupsafe import Markup

from gsp.report.wording import unit
from gsp.results import mathml
from gsp.results.long_formulas import count_lines
from gsp.results.mathml import Typesetter, dotted, numeral, operator, row
from gsp.systems.declaration import exact
from gsp.systems.region import digits_between

NO_UNITS: Mapping[str, str] = MappingProxyType({})


class Setting:
    """Sets what a page says, with one lettering for its `symbols`, and with `units` behind the values of names."""

    def __init__(self, symbols: Iterable[sp.Symbol], units: Mapping[str, str] = NO_UNITS) -> None:
        self.set = Typesetter(list(symbols))
        self.units = units

    def inline(self, expression: sp.Basic | str) -> Markup:
        return self.set.inline(expression)

    def block(self, left: str, right: sp.Basic | sp.MatrixBase | str) -> tuple[Markup, Markup]:
        """A displayed equation, in two halves that a column of them is aligned by."""
        if isinstance(right, sp.Expr):
            text = self.set.broken(right, sign=operator("="))
        else:
            text = row(operator("="), right if isinstance(right, str) else self.set.row(right))
        return Markup(mathml.math(left, display=True)), Markup(mathml.math(text, display=True))

    def rates(
        self, pairs: Iterable[tuple[sp.Symbol, sp.Expr]], factor: sp.Symbol | None = None
    ) -> list[tuple[Markup, Markup]]:
        """A displayed equation for each pair of a symbol and its rate, with a `factor` before the derivatives."""
        before = () if factor is None else (self.set.row(factor),)
        return [self.formula(row(*before, dotted(self.set.row(symbol))), rate) for symbol, rate in pairs]

    def formula(self, left: str, right: sp.Expr | str) -> tuple[Markup, Markup]:
        """A displayed equation; one that is too long to be read says where it stands."""
        taken = count_lines(right) if isinstance(right, sp.Expr) else 1
        # A formula of more lines is read by nobody on a page: four of so many are the most of one.
        if taken <= 12:
            return self.block(left, right)
        return self.block(left, f"<mtext>&#160;a formula of {taken} lines, in report.json</mtext>")

    def names(self, symbols) -> Markup:
        return Markup(", ").join(self.inline(s) for s in symbols)

    def named_value(self, symbol: sp.Symbol, value: Any) -> Markup:
        shown = numeral(float(value)) if not isinstance(value, sp.Basic) or is_decimal(value) else value
        return self.inline(self.set.equation(self.set.row(symbol), shown)) + self.unit(symbol.name)

    def unit(self, name: str) -> Markup:
        """The unit behind a value of the quantity `name`; empty where none is given."""
        return unit(name, self.units)

    def interval(self, name: str, bounds: tuple[float, float]) -> Markup:
        ends = operator(",").join(numeral(end, digits_between(bounds)) for end in bounds)
        symbol = self.set.row(sp.Symbol(name))
        return self.inline(row(symbol, operator("∈"), operator("["), ends, operator("]"))) + self.unit(name)


def is_decimal(value: sp.Basic) -> bool:
    """Whether a number was typed as a decimal of at most six digits: 0.3, and not 1/3 or 2."""
    return isinstance(value, sp.Rational) and not value.is_Integer and exact(f"{float(value):.6g}") == value
