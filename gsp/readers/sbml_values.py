"""Values of an SBML model at time 0: initial assignments, assignment rules and rates, exact where they can be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import sympy as sp

from gsp.algebra.substitution import substituted
from gsp.errors import ModelFileError, met_at
from gsp.readers.definitions import read_definitions
from gsp.readers.expressions import Definitions, parse_expression
from gsp.readers.tokens import DIGITS, parse_number


class Values:
    """Values at time 0 by identifier, worked out on demand.

    `formula` gives the expression of an identifier and the numbers in it that are its own, or None where the
    identifier is a `given` number, its text with a sign. `functions` are the definitions of functions so far.
    """

    def __init__(
        self,
        identifiers: Mapping[str, str],
        *,
        formula: Callable[[str], tuple[str, Mapping[str, sp.Rational]] | None],
        given: Callable[[str], sp.Rational],
        functions: Callable[[], Mapping[str, str]],
        time: str,
    ) -> None:
        self.word = identifiers
        self.identifier = {word: identifier for identifier, word in identifiers.items()}
        self.formula, self.given, self.functions, self.clock = formula, given, functions, time
        self.known: dict[str, sp.Rational] = {}
        self.pending: list[str] = []
        self.definitions: tuple[int, Definitions] = 0, Definitions()

    def of(self, identifier: str) -> sp.Rational:
        """The value of `identifier`; raises `ModelFileError` for a circle and for what is no finite number."""
        if identifier in self.known:
            return self.known[identifier]
        if identifier in self.pending:
            circle = [*self.pending[self.pending.index(identifier) :], identifier]
            raise ModelFileError(
                f"{' -> '.join(circle)[:300]} is a circle of values.", "Give one of them a number."
            )
        self.pending.append(identifier)
        formula = self.formula(identifier)
        value = self.given(identifier) if formula is None else self.evaluated(*formula, what=identifier)
        self.pending.pop()
        self.known[identifier] = value
        return value

    def evaluated(self, text: str, own: Mapping[str, sp.Rational], *, what: str) -> sp.Rational:
        """The value of an expression at time 0; `own` are numbers by words that only this expression has."""
        heads = self.functions()
        symbols = {word: sp.Symbol(word) for word in (*self.identifier, *own, self.clock)}
        names = {head.partition("(")[0] for head in heads}
        free = {word: symbol for word, symbol in symbols.items() if word not in names}
        if self.definitions[0] != len(heads):
            self.definitions = len(heads), read_definitions(heads, free)
        with met_at(f"the value of {what[:64]}"):
            expression = parse_expression(text, symbols=free, definitions=self.definitions[1])
        at: dict[sp.Symbol, sp.Expr] = {}
        for symbol in sorted(expression.free_symbols, key=str):
            if symbol.name in own:
                at[symbol] = own[symbol.name]
            elif symbol.name == self.clock:
                at[symbol] = sp.Integer(0)
            else:
                at[symbol] = self.of(self.identifier[symbol.name])
        return _number(substituted(expression, at), what)


def _number(value: sp.Expr, what: str) -> sp.Rational:
    if isinstance(value, sp.Rational) and max(len(str(abs(value.p))), len(str(value.q))) <= DIGITS:
        return value
    number = sp.nan if value.has(sp.nan, sp.zoo, sp.oo, -sp.oo, sp.I) else value.evalf(17)
    if not (number.is_Float or number.is_Rational) or not 0 <= abs(number) < 1e300:
        raise ModelFileError(f"the value of {what[:64]} is no finite number at time 0.", "Correct it.")
    return exact(repr(float(number)))


def exact(text: str) -> sp.Rational:
    """The exact number that a decimal with a sign is."""
    magnitude = parse_number(text.removeprefix("-"))
    return -magnitude if text.startswith("-") else magnitude


def fraction_text(value: Any) -> str:
    """A number as a decimal where it is a short one, else as a fraction.

    >>> fraction_text(sp.Rational(3, 20000)), fraction_text(sp.Rational(1, 3))
    ('0.00015', '1/3')
    """
    short = repr(float(value)).removesuffix(".0")
    return short if exact(short) == value else f"{value.p}/{value.q}"
