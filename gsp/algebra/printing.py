"""Expressions as text of a programming language: SymPy's code printer with a table of what the language has."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Never

import sympy as sp
from sympy.printing.codeprinter import CodePrinter

from gsp.algebra.bounded_quotients import finite
from gsp.algebra.doubles import printed_double
from gsp.algebra.sharing import is_shared, named_parts
from gsp.errors import UnsupportedFunctionError

# Whole numbers up to here are doubles, and the quotient of two of them is rounded once.
EXACT = 2**53
REWRITTEN = ("asinh", "acosh", "atanh", "log1p", "expm1")
"""What a language without it has written with exp and log."""


@dataclass(frozen=True)
class Language:
    """How a language writes what SymPy has.

    `functions` maps SymPy's names to the language's, `power` writes a base and an exponent, `whole` a whole number, so
    that the quotient of two of them is not whole. `longest` is how many characters an expression may have.
    """

    name: str
    functions: Mapping[str, str]
    power: Callable[[str, str], str]
    whole: str = "{}"
    longest: int | None = None


class Printer(CodePrinter):
    """Prints expressions in `language`; `names` gives the text of every symbol."""

    language = "another language"
    printmethod = "_gsp_export"

    def __init__(self, language: Language, names: Mapping[sp.Symbol, str]) -> None:
        super().__init__()
        self._in = language
        self._names = dict(names)

    def text(self, expression: Any) -> str:
        """One expression; raises `UnsupportedFunctionError` for what the language has no function for."""
        return str(self._print(expression))

    def steps(
        self, outputs: Sequence[sp.Expr], fresh: Iterator[str]
    ) -> tuple[list[tuple[str, str]], list[str]]:
        """(intermediate values by name, in order; results): what is used more than once is computed once, and what is
        too long for the language in parts.
        """
        # Symbols of the text's own names: what SymPy puts in order is then in the same order every time.
        places = {symbol: sp.Symbol(name) for symbol, name in self._names.items()}
        self._names.update({place: place.name for place in places.values()})
        symbols = map(sp.Symbol, fresh)
        if any(map(is_shared, outputs)):
            shared, results = named_parts(outputs, symbols, places)
        else:
            placed = [finite(output.xreplace(places)) for output in outputs]
            shared, results = sp.cse(placed, symbols=symbols, order="none")
        lines = []

        def step(symbol: sp.Symbol, expression: sp.Expr) -> sp.Symbol:
            lines.append((symbol.name, self.text(expression)))
            self._names[symbol] = symbol.name
            return symbol

        def part(expression: sp.Expr) -> sp.Symbol:
            return step(next(symbols), expression)

        for symbol, expression in shared:
            step(symbol, self._in_parts(expression, part))
        results = [self._in_parts(result, part) for result in results]
        return lines, [self.text(result) for result in results]

    def _in_parts(self, expression: sp.Expr, part: Callable[[sp.Expr], sp.Symbol]) -> sp.Expr:
        """`expression` with symbols for parts of it, so that it and they are no longer than the language allows."""
        longest = self._in.longest
        if longest is None or len(self.text(expression)) <= longest:
            return expression
        # Of arguments within half of it the next one fits too.
        groups: list[list[sp.Expr]] = [[]]
        room = longest // 2
        for argument in (self._in_parts(each, part) for each in expression.args):
            length = len(self.text(argument))
            if length > room and groups[-1]:
                groups.append([])
                room = longest // 2
            groups[-1].append(part(argument) if length > longest // 2 else argument)
            room -= min(length, room)
        if not isinstance(expression, (sp.Add, sp.Mul)):
            return expression.func(*(argument for group in groups for argument in group))
        return self._in_parts(expression.func(*(part(expression.func(*group)) for group in groups)), part)

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        return self._names[expr]

    _print_Dummy = _print_Symbol

    def _print_Integer(self, expr: Any) -> str:
        return self._in.whole.format(int(expr)) if abs(int(expr)) <= EXACT else printed_double(expr)

    _print_Zero = _print_One = _print_NegativeOne = _print_Integer

    def _print_Rational(self, expr: Any) -> str:
        p, q = int(expr.p), int(expr.q)
        if max(abs(p), q) > EXACT:
            return f"({printed_double(expr)})"
        return f"({self._in.whole.format(p)}/{self._in.whole.format(q)})"

    _print_Half = _print_Rational

    def _print_Float(self, expr: Any) -> str:
        return repr(float(expr))

    def parenthesize(self, item: Any, level: int, strict: bool = False) -> str:
        """A fraction has brackets of its own."""
        if item.is_Rational and not item.is_Integer:
            return self.text(item)
        return super().parenthesize(item, level, strict)

    def _print_NumberSymbol(self, expr: Any) -> str:
        return repr(float(expr))

    _print_Pi = _print_Exp1 = _print_NumberSymbol

    def _print_Pow(self, expr: Any, rational: bool = False) -> str:
        base, exponent = expr.args
        if exponent.is_Rational and exponent.is_negative:
            return f"(1.0/{self.text(sp.Pow(base, -exponent, evaluate=False))})"
        if exponent == 1:
            return f"({self.text(base)})"
        if exponent == sp.Rational(1, 2):
            return self._call("sqrt", base)
        inner = self.text(base) if base.is_Symbol else f"({self.text(base)})"
        power = self._in.whole.format(int(exponent)) if exponent.is_Integer else f"({self.text(exponent)})"
        return self._in.power(inner, power)

    def _print_Function(self, expr: Any) -> str:
        name = type(expr).__name__
        if name in ("Max", "Min"):
            first, *others = map(self.text, expr.args)
            for other in others:
                first = f"{self._function(name, expr)}({first}, {other})"
            return first
        if name == "Heaviside":
            # Off the switching set, on which no reduced flow is defined.
            return f"(0.5*(1.0 + {self._call('sign', expr.args[0])}))"
        if name in REWRITTEN and name not in self._in.functions:
            return f"({self.text(expr.rewrite(sp.exp).rewrite(sp.log))})"
        if len(expr.args) == 1:
            return self._call(name, expr.args[0])
        self._print_not_supported(expr)

    _print_exp = _print_log = _print_Abs = _print_sign = _print_Max = _print_Min = _print_Function
    _print_Heaviside = _print_ExpBase = _print_Function

    def _call(self, name: str, argument: Any) -> str:
        return f"{self._function(name, argument)}({self.text(argument)})"

    def _function(self, name: str, expression: Any) -> str:
        if name not in self._in.functions:
            raise UnsupportedFunctionError(
                f"{name} has no counterpart in {self._in.name}.",
                "Use other functions, or export to python or c.",
                got=str(expression)[:80],
            )
        return self._in.functions[name]

    def _print_not_supported(self, expr: Any) -> Never:
        raise UnsupportedFunctionError(
            f"{type(expr).__name__} has no counterpart in {self._in.name}.",
            "Use other functions.",
            got=str(expr)[:80],
        )

    emptyPrinter = _print_not_supported
