"""Formulas that are wider than a page: sums are broken between terms, and what cannot be is named."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, cast

import sympy as sp

from gsp.results.lettering import GREEK, rate_of
from gsp.results.table import Names

# Letters of a line on a page as wide as a report: 46 rem hold about so many, beside a name on the left.
WIDTH = 50.0


def width(expression: sp.Basic) -> float:
    """Letters across that an expression takes when it is set: a fraction is as wide as its wider half.

    >>> a, b = sp.symbols("a b")
    >>> width((a + b) / (a + b + 1)) < width(a + b + 1) + 1
    True
    """
    if isinstance(expression, sp.Symbol):
        return (
            1.0
            if expression.name in GREEK or rate_of(expression.name)
            else max(1.0, 0.8 * len(expression.name))
        )
    if isinstance(expression, sp.Rational):
        return float(max(len(str(expression.p)), len(str(expression.q))))
    if not expression.args:
        return float(len(str(expression)))
    if isinstance(expression, sp.Add):
        return sum(width(term) + 2.5 for term in expression.args) - 2.5
    if isinstance(expression, sp.Mul):
        above, below = sp.fraction(expression)
        if below != 1:
            return max(width(above), width(below)) + 0.5
        return sum(width(factor) + 2 * factor.is_Add + 0.3 for factor in expression.args)
    if isinstance(expression, sp.Piecewise):
        return max(width(value) + width(condition) for value, condition in cast(Any, expression.args)) + 5.0
    if isinstance(expression, sp.Pow):
        base, exponent = expression.args
        brackets = 2.0 * (not base.is_Atom)
        return width(base) + brackets + 0.7 * width(exponent)
    return len(type(expression).__name__) + 2.0 + sum(width(argument) + 1 for argument in expression.args)


class NamedParts:
    """The parts of formulas that have names, S_1, S_2, ...: on one page a part has one name, and no other has it."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._names = Names(taken)
        self._symbols: dict[sp.Expr, sp.Symbol] = {}

    def __contains__(self, part: sp.Expr) -> bool:
        return part in self._symbols

    def __getitem__(self, part: sp.Expr) -> sp.Symbol:
        if part not in self:
            self._symbols[part] = sp.Symbol(self._names(f"S_{len(self._symbols) + 1}"))
        return self._symbols[part]


def lines(
    expression: sp.Expr, named: NamedParts | None = None
) -> tuple[list[sp.Expr], list[tuple[sp.Symbol, list[sp.Expr]]]]:
    """(rows of the expression, its named parts with their rows): sums of terms that each fit into a line.

    The rows add up to the expression once the names are replaced in order; a narrow expression is one row. Parts that
    have a name in `named` stand by it, and those that get one are added to it.
    """
    if named is None:
        named = NamedParts(s.name for s in expression.free_symbols if isinstance(s, sp.Symbol))
    parts: list[tuple[sp.Symbol, list[sp.Expr]]] = []
    waiting: list[tuple[sp.Symbol, sp.Expr]] = []
    rows = _rows(expression, named, waiting)
    while waiting:
        symbol, part = waiting.pop(0)
        parts.append((symbol, _rows(part, named, waiting)))
    return rows, parts


def count_lines(expression: sp.Expr) -> int:
    """How many lines it takes, its named parts among them."""
    rows, parts = lines(expression)
    return len(rows) + sum(len(terms) for _, terms in parts)


def _rows(expression: sp.Expr, named: NamedParts, waiting: list[tuple[sp.Symbol, sp.Expr]]) -> list[sp.Expr]:
    """Terms packed into lines; a term that is too wide gives its widest sums away to `waiting`."""
    if width(expression) <= WIDTH:
        return [expression]
    # Ordered by name, so that the same expression is always broken in the same places.
    terms = list(sp.Add.make_args(expression)) if not expression.is_Add else list(expression.as_ordered_terms())
    rows: list[list[sp.Expr]] = [[]]
    for term in terms:
        while width(term) > WIDTH:
            # A part that is narrower than this is read more quickly than a name for it.
            sums = [s for s in sp.preorder_traversal(term) if s.is_Add and s != term and width(s) > 12.0]
            if not sums:
                break
            widest = max(sums, key=width)
            if widest not in named:
                waiting.append((named[widest], widest))
            term = term.xreplace({widest: named[widest]})
        if rows[-1] and sum(map(width, rows[-1])) + 2.5 * len(rows[-1]) + width(term) > WIDTH:
            rows.append([])
        rows[-1].append(term)
    return [sp.Add(*row, evaluate=False) if len(row) > 1 else row[0] for row in rows]
