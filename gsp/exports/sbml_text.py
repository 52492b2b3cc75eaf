"""SBML, level 3 version 1 core: rate rules for the states, assignment rules for the other variables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import sympy as sp

from gsp.algebra.doubles import printed_double
from gsp.algebra.languages import SBML
from gsp.algebra.printing import Printer
from gsp.exports.body import body_of, heading, values_of
from gsp.exports.names import renamed
from gsp.exports.reduced_model import ReducedModel, inert

SBML_WORDS = {"reduced", "time", "avogadro", "pi", "exponentiale", "true", "false", "notanumber", "infinity"}
# Whole numbers of MathML are held in so many bits by its readers.
_LARGEST_WHOLE = 2**31 - 1
_SIGNS = ((-1, "lt"), (1, "gt"))
_MATH = "http://www.w3.org/1998/Math/MathML"


class MathPrinter(Printer):
    """Expressions as content MathML."""

    def _print_Symbol(self, expr: sp.Symbol) -> str:
        return f"<ci>{self._names[expr]}</ci>"

    _print_Dummy = _print_Symbol

    def _print_Integer(self, expr: Any) -> str:
        if abs(int(expr)) <= _LARGEST_WHOLE:
            return f'<cn type="integer">{int(expr)}</cn>'
        return number(printed_double(expr))

    _print_Zero = _print_One = _print_NegativeOne = _print_Integer

    def _print_Rational(self, expr: Any) -> str:
        if max(abs(int(expr.p)), int(expr.q)) <= _LARGEST_WHOLE:
            return f'<cn type="rational">{int(expr.p)}<sep/>{int(expr.q)}</cn>'
        return number(printed_double(expr))

    _print_Half = _print_Rational

    def _print_Float(self, expr: Any) -> str:
        return number(repr(float(expr)))

    _print_NumberSymbol = _print_Pi = _print_Exp1 = _print_Float

    def _print_Add(self, expr: Any, order: str | None = None) -> str:
        return _applied("plus", *map(self.text, expr.as_ordered_terms()))

    def _print_Mul(self, expr: Any) -> str:
        return _applied("times", *map(self.text, expr.as_ordered_factors()))

    def _print_Pow(self, expr: Any, rational: bool = False) -> str:
        base, exponent = expr.args
        if exponent == sp.Rational(1, 2):
            return self._call("sqrt", base)
        if exponent.is_Rational and exponent.is_negative:
            turned = sp.Pow(base, -exponent, evaluate=False) if exponent != -1 else base
            return f'<apply><divide/><cn type="integer">1</cn>{self.text(turned)}</apply>'
        return _applied("power", *map(self.text, expr.args))

    def _print_sign(self, expr: Any) -> str:
        u, zero = self.text(expr.args[0]), self.text(sp.S.Zero)
        return _chosen([(self.text(sp.Integer(n)), _applied(o, u, zero)) for n, o in _SIGNS], u)

    def _print_Max(self, expr: Any) -> str:
        *first, last = map(self.text, expr.args)
        above = "geq" if isinstance(expr, sp.Max) else "leq"
        pieces = []
        for i, one in enumerate(first):
            behind = [_applied(above, one, other) for other in (*first[i + 1 :], last)]
            pieces.append((one, _applied("and", *behind) if len(behind) > 1 else behind[0]))
        return _chosen(pieces, last)

    _print_Min = _print_Max

    def _print_Heaviside(self, expr: Any) -> str:
        return self.text((1 + sp.sign(expr.args[0])) / 2)

    def _call(self, name: str, argument: Any) -> str:
        return _applied(self._function(name, argument), self.text(argument))


def _applied(operator: str, *arguments: str) -> str:
    return f"<apply><{operator}/>{''.join(arguments)}</apply>"


def _chosen(pieces: Iterable[tuple[str, str]], otherwise: str) -> str:
    """The first of the values whose condition holds."""
    found = "".join(f"<piece>{value}{condition}</piece>" for value, condition in pieces)
    return f"<piecewise>{found}<otherwise>{otherwise}</otherwise></piecewise>"


def number(text: str) -> str:
    """A real number as MathML has it, where an exponent stands by itself."""
    mantissa, found, exponent = text.partition("e")
    if found:
        return f'<cn type="e-notation">{mantissa}<sep/>{int(exponent)}</cn>'
    return f"<cn>{text}</cn>"


def sbml_text(model: ReducedModel) -> str:
    """A model of parameters and rules; the notes hold what comments say elsewhere."""
    names = renamed(model.symbols, reserved=SBML_WORDS)
    outputs = [*model.rates, *model.manifold]
    body = body_of(SBML, outputs, names, SBML_WORDS, printer=MathPrinter)
    rates, manifold = body.results[: len(model.states)], body.results[len(model.states) :]
    quantities = [_quantity(names[s], value) for s, value in values_of(model, with_epsilon=True)]
    quantities += [_quantity(names[s], repr(value), varies=True) for s, value in zip(model.states, model.start)]
    quantities += [
        _quantity(name, None, varies=True)
        for name in (*(n for n, _ in body.steps), *(names[s] for s in model.observed))
    ]
    rules = [_rule("assignment", name, text) for name, text in body.steps]
    rules += [_rule("assignment", names[s], text) for s, text in zip(model.observed, manifold)]
    rules += [_rule("rate", names[s], text) for s, text in zip(model.states, rates)]
    said = "".join(f"        <p>{escape(fact)}</p>\n" for fact in _facts(model, names))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<sbml xmlns="http://www.sbml.org/sbml/level3/version1/core" level="3" version="1">\n'
        '  <model id="reduced">\n    <notes>\n      <body xmlns="http://www.w3.org/1999/xhtml">\n'
        f"{said}      </body>\n    </notes>\n"
        f"    <listOfParameters>\n{''.join(quantities)}    </listOfParameters>\n"
        f"    <listOfRules>\n{''.join(rules)}    </listOfRules>\n  </model>\n</sbml>\n"
    )


def _facts(model: ReducedModel, names: Mapping[sp.Symbol, str]) -> list[str]:
    return [
        *map(inert, model.said(names)),
        heading("The rate rules are those of", model.states, names),
        heading("The slow manifold is given by assignment rules:", model.observed, names),
    ]


def _quantity(name: str, value: str | None, *, varies: bool = False) -> str:
    given = "" if value is None else f" value={quoteattr(value)}"
    return f'      <parameter id={quoteattr(name)}{given} constant="{str(not varies).lower()}"/>\n'


def _rule(kind: str, name: str, text: str) -> str:
    return (
        f'      <{kind}Rule variable={quoteattr(name)}>\n        <math xmlns="{_MATH}">{text}</math>\n'
        f"      </{kind}Rule>\n"
    )
