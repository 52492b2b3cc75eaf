"""The equations of a value, as they stand on its card and in LaTeX."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import sympy as sp

from gsp.results import registry
from gsp.results.mathml import Typesetter, dotted, row
from gsp.results.tex import tex

# Longer coefficients, in terms and in operations, are not set: a card is read at a glance.
TERMS = 30
OPERATIONS = 200


@dataclass(frozen=True)
class Equation:
    """`left` = `right`; with `dotted` the left is a derivative in slow time, and `factor` stands before it.

    More than one expression on the right are the coefficients of the powers of `epsilon`.
    """

    left: sp.Expr
    right: tuple[sp.Expr, ...]
    dotted: bool = False
    factor: sp.Symbol | None = None
    epsilon: sp.Symbol | None = None

    @property
    def is_short(self) -> bool:
        return sum(int(sp.count_ops(e)) for e in self.right) <= OPERATIONS

    def latex(self) -> str:
        left = rf"\dot{{{tex(self.left)}}}" if self.dotted else tex(self.left)
        if self.factor is not None:
            left = rf"{tex(self.factor)}\,{left}"
        if self.epsilon is None:
            return f"{left} &= {tex(self.right[0])}"
        small = tex(self.epsilon)
        powers = ["", small, *(f"{small}^{{{k}}}" for k in range(2, len(self.right)))]
        terms = [
            rf"{power}\left({tex(e)}\right)" if power else tex(e)
            for power, e in zip(powers, self.right)
            if e != 0
        ]
        return f"{left} &= {' + '.join(terms) or '0'} + O({small}^{{{len(self.right)}}})"

    def mathml(self, setter: Typesetter) -> tuple[str, str]:
        left = dotted(setter.row(self.left)) if self.dotted else setter.row(self.left)
        if self.factor is not None:
            left = row(setter.row(self.factor), left)
        right = (
            setter.row(self.right[0]) if self.epsilon is None else setter.power_series(self.right, self.epsilon)
        )
        return left, right


def equations_of(value: object) -> list[Equation]:
    """The equations that say what `value` is, none for results that are numbers, or where one is too long to read."""
    found = all_equations_of(value)
    return found if all(equation.is_short for equation in found) else []


def all_equations_of(value: object) -> list[Equation]:
    """The equations of `value`, however long."""
    make = registry.equations.find(value)
    return [] if make is None else make(value)


def rates_of(pairs: Iterable[tuple[sp.Symbol, sp.Expr]], factor: sp.Symbol | None = None) -> list[Equation]:
    """An equation for each pair of a symbol and its rate."""
    return [Equation(symbol, (rate,), dotted=True, factor=factor) for symbol, rate in pairs]


def symbols_of(equations: Iterable[Equation]) -> list[sp.Symbol]:
    """The symbols as they should be written in a product: the small parameter, then the others by name."""
    found: Mapping[sp.Symbol, None] = {
        s: None for equation in equations for e in (equation.left, *equation.right) for s in e.free_symbols
    }
    small = [equation.epsilon or equation.factor for equation in equations]
    return list(dict.fromkeys([*(s for s in small if s is not None), *sorted(found, key=lambda s: s.name)]))
