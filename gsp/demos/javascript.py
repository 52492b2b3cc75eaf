"""Expressions as JavaScript: SymPy's printer after common-subexpression elimination, numbers to the last bit.

A symbol becomes a place in an array, `z[0]` or `p[2]`, so that no name of a model ever stands in code. Whole powers are
products, and every other power is `Math.pow`, which has no value where a real power has none.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import sympy as sp
from sympy.printing.jscode import JavascriptCodePrinter

from gsp.algebra.bounded_quotients import finite
from gsp.algebra.doubles import printed_double
from gsp.algebra.languages import PAGE
from gsp.algebra.printing import EXACT, Printer
from gsp.errors import UnsupportedFunctionError

# The sign in a number's exponent is no operation.
_EXPONENT = re.compile(r"(?<=[0-9.])[eE][+-]?(?=[0-9])")
_OPERATION = re.compile(r"[-+*/]|\b(?:Math\.[a-z]\w*|erf)\(")


def function(
    name: str, outputs: Sequence[sp.Expr], arguments: Mapping[str, Sequence[sp.Symbol]], *, into: str = "out"
) -> str:
    """A JavaScript function `name(*arguments, into)` that fills the array `into` with the values of `outputs`.

    `arguments` maps the name of each array argument to the symbols that stand in it, in order. Raises
    `UnsupportedFunctionError` for what JavaScript has no function for, and for a symbol that stands nowhere.

    >>> x, k = sp.symbols("x k")
    >>> print(function("rate", [k - x], {"z": [x], "p": [k]}), end="")
    function rate(z, p, out) {
      out[0] = p[0] - z[0];
    }
    """
    places = {
        symbol: sp.Dummy(f"{a}[{i}]") for a, symbols in arguments.items() for i, symbol in enumerate(symbols)
    }
    placed = [finite(expression.xreplace(places)) for expression in outputs]
    steps, results = sp.cse(placed, symbols=(sp.Dummy() for _ in iter(int, 1)), order="none")
    printer = _JavaScriptPrinter(set(places.values()))
    for symbol, expression in steps:
        printer.define(symbol, expression)
    assignments = [f"{into}[{i}] = {printer.text(result)};" for i, result in enumerate(results)]
    body = "".join(f"  {line}\n" for line in (*printer.lines, *assignments))
    return f"function {name}({', '.join((*arguments, into))}) {{\n{body}}}\n"


def operations(code: str) -> int:
    """Arithmetic operations in the text of a function: every sign of + - * / and every call counts as one.

    >>> x = sp.Symbol("x")
    >>> operations(function("rate", [1e-5 + 3 * sp.exp(x)], {"z": [x]}))
    3
    """
    _, _, body = code.partition("{")
    return len(_OPERATION.findall(_EXPONENT.sub("", body)))


class _JavaScriptPrinter(Printer, JavascriptCodePrinter):
    """Prints to single expressions; what is used more than once, and every power, gets a line of its own before."""

    def __init__(self, places: Iterable[sp.Symbol]) -> None:
        super().__init__(PAGE, {symbol: symbol.name for symbol in places})
        self.lines: list[str] = []
        self._known: dict[str, str] = {}

    def define(self, symbol: sp.Symbol, expression: sp.Expr) -> None:
        """A constant for `symbol`, which later expressions use."""
        self._names[symbol] = self._constant(self.text(expression))

    def _constant(self, text: str) -> str:
        name = f"t{len(self.lines)}"
        self.lines.append(f"const {name} = {text};")
        return name

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        if expr not in self._names:
            raise UnsupportedFunctionError(f"{expr} stands for no argument.", got="an expression that holds it")
        return self._names[expr]

    _print_Dummy = _print_Symbol

    def parenthesize(self, item: Any, level: int, strict: bool = False) -> str:
        """Brackets of the precedence alone: a negative fraction in a sum is taken away, by one operation."""
        return JavascriptCodePrinter.parenthesize(self, item, level, strict)

    def _print_Rational(self, expr: Any) -> str:
        p, q = int(expr.p), int(expr.q)
        return f"{p}/{q}" if max(abs(p), q) <= EXACT else printed_double(expr)

    _print_Half = _print_Rational

    def _print_Pow(self, expr: sp.Pow) -> str:
        base, exponent = expr.as_base_exp() if not expr.is_Pow else expr.args
        if exponent.is_Integer:
            count = abs(int(exponent))
            text = self.text(base)
            if count > 1 or exponent.is_negative:
                text = self._power(self._once(text), count)
            return f"(1/{text})" if exponent.is_negative else text
        if exponent == sp.Rational(1, 2):
            return f"Math.sqrt({self.text(base)})"
        if exponent == sp.Rational(-1, 2):
            return f"(1/Math.sqrt({self.text(base)}))"
        return f"Math.pow({self.text(base)}, {self.text(exponent)})"

    def _once(self, text: str) -> str:
        """A name for the value of `text`, which is computed there once."""
        if text.isidentifier() or text in self._names.values():
            return text
        if text not in self._known:
            self._known[text] = self._constant(text)
        return self._known[text]

    def _power(self, text: str, exponent: int) -> str:
        """The name `text` to a whole power as products, short ones in place."""
        if exponent <= 3:
            return "(" + "*".join([text] * exponent) + ")" if exponent > 1 else text
        half = self._once(self._power(text, exponent // 2))
        return self._once(f"{half}*{half}*{text}" if exponent % 2 else f"{half}*{half}")

    def _print_Heaviside(self, expr: Any) -> str:
        at_zero = self.text(expr.args[1]) if len(expr.args) > 1 else "0.5"
        argument = self._once(self.text(expr.args[0]))
        return f"({argument} > 0 ? 1 : {argument} < 0 ? 0 : {argument} === 0 ? {at_zero} : NaN)"
