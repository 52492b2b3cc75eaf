"""The checks of a declaration: equations, names, parameters and their exact values."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NoReturn

import numpy as np
import sympy as sp
from sympy.core.function import AppliedUndef

from gsp.algebra.canonical import new_parts
from gsp.algebra.laurent import misplaced_epsilon
from gsp.algebra.substitution import UNCOMPARABLE, is_long_power
from gsp.algebra.switches import misplaced_pieces, surface_of
from gsp.errors import DeclarationError, met_at
from gsp.systems.arguments import hides, shown
from gsp.systems.flow import Values

DEGREE = 100
"""Bound on exponents and on the total degree of text, so that nobody meets a polynomial that cannot be expanded."""
LARGEST = 1e300
"""Bound on constants, which doubles hold."""
# Numbers given as text: a larger exponent would be written out in full.
DECIMAL = re.compile(r"[+-]?\d{1,60}(\.\d{0,60})?([eE][+-]?\d{1,3}|/\d{1,60})?")


def exact(value: float | str | sp.Expr) -> sp.Rational:
    """Exact rational of a number; a float counts as the shortest decimal that prints it, 0.2 as 1/5."""
    if isinstance(value, sp.Rational):
        return value
    if isinstance(value, (bool, np.bool_, complex)) or value is None:
        raise DeclarationError(f"{shown(value)} is no number.", "Give an int, a float or a Fraction.")
    if isinstance(value, int):
        return sp.Integer(value)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, str) and not DECIMAL.fullmatch(value):
        raise DeclarationError(
            f"{value[:80]!r} is no number.", "Give an int, a float or a Fraction, or digits as text."
        )
    if isinstance(value, sp.Float):
        # SymPy prints 15 digits; a double needs up to 17 to come back.
        value = float(value) if getattr(value, "_prec", 53) <= 53 else sp.sstr(value, full_prec=True)
    try:
        number = sp.Rational(str(value))
    except (TypeError, ValueError):
        number = None
    if number is None and getattr(value, "is_number", False) and getattr(value, "is_real", False):
        raise DeclarationError(
            f"{shown(value)} is irrational, and values are exact fractions.", f"Give digits, {sp.N(value, 17)}."
        )
    if not isinstance(number, sp.Rational):
        raise DeclarationError(
            f"{shown(value)} is no finite real number.", "Give an int, a float or a Fraction."
        )
    return number


def equations_of(equations: Mapping, what: str) -> dict[sp.Symbol, sp.Expr]:
    """`equations` as symbols to exact expressions; `what` names the argument in errors."""
    if not isinstance(equations, Mapping):
        raise DeclarationError(f"{what} maps symbols to expressions.", got=shown(equations), value=equations)
    result: dict[sp.Symbol, sp.Expr] = {}
    seen: set[sp.Basic] = set()
    for symbol, expression in equations.items():
        if not isinstance(symbol, sp.Symbol):
            raise DeclarationError(
                f"{what} is keyed by SymPy symbols.", got=f"the key {shown(symbol)}", value=symbol
            )
        if isinstance(expression, (float, complex, np.inexact)):
            try:
                expression = exact(expression)
            except DeclarationError as error:
                raise DeclarationError(
                    f"{what}: the right-hand side of {symbol} is no number.", str(error)
                ) from None
        try:
            if hides(expression):
                raise TypeError
            expression = sp.sympify(expression, strict=True)
        except (sp.SympifyError, TypeError, ValueError):
            raise DeclarationError(
                f"{what}: the right-hand side of {symbol} is a {type(expression).__name__}, "
                f"{shown(expression)}.",
                "Give a SymPy expression; text is read by gsp.load only.",
            ) from None
        if not isinstance(expression, sp.Expr) or isinstance(expression, (sp.MatrixBase, sp.MatrixExpr)):
            raise DeclarationError(
                f"{what}: the right-hand side of {symbol} is no scalar expression.",
                got=shown(expression),
                value=expression,
            )
        result[symbol] = _exact_numbers(expression, seen)
    return result


def _exact_numbers(expression: sp.Expr, seen: set[sp.Basic]) -> sp.Expr:
    """`expression` with exact numbers for floats, and real symbols; `seen` are parts known to be so, and gets more."""
    new = new_parts(expression, seen)
    rule: dict[sp.Basic, sp.Basic] = {part: exact(part) for part in new if isinstance(part, sp.Float)}
    # Evaluated, SymPy writes Abs(exp(x**2)) as exp(re(x)**2 - im(x)**2).
    rule |= {part: _of_real_symbols(part) for part in new if isinstance(part, (sp.re, sp.im))}
    if rule:
        return expression.xreplace(rule)
    seen |= new
    return expression


def _of_real_symbols(part: sp.Expr) -> sp.Expr:
    real = {symbol: sp.Dummy(symbol.name, real=True) for symbol in part.free_symbols}
    return part.xreplace(real).xreplace({dummy: symbol for symbol, dummy in real.items()})


_NOT_FINITE = frozenset({sp.nan, sp.zoo, sp.oo, -sp.oo})


def checked_parameters(
    *,
    states: tuple[sp.Symbol, ...],
    expressions: tuple[sp.Expr, ...],
    observables: Mapping[sp.Symbol, sp.Expr],
    epsilon: sp.Symbol | None,
    parameters: Mapping,
    may_switch: bool = False,
) -> dict[sp.Symbol, sp.Rational]:
    """Parameter values, exact, in the order given, after every check that does not depend on the noun."""
    if epsilon is not None and not isinstance(epsilon, sp.Symbol):
        raise DeclarationError(
            "epsilon is a SymPy symbol.", got=f"{shown(epsilon)}; its value is given later", value=epsilon
        )
    if not isinstance(parameters, Mapping):
        raise DeclarationError("parameters maps symbols to numbers.", got=shown(parameters), value=parameters)
    values: dict[sp.Symbol, sp.Rational] = {}
    for symbol, value in parameters.items():
        if not isinstance(symbol, sp.Symbol):
            raise DeclarationError(
                "parameters is keyed by SymPy symbols.", got=f"the key {symbol!r}", value=symbol
            )
        if value is None:
            raise DeclarationError(f"the parameter {symbol} has no value.", "Give it a number.")
        try:
            values[symbol] = exact(value)
        except DeclarationError as error:
            raise DeclarationError(f"the parameter {symbol} has the value {shown(value)}. {error}") from None
    everything = (*expressions, *observables.values())
    symbols_of: dict[sp.Basic, frozenset[sp.Basic]] = {}
    # Equations share most of their pieces.
    new_pieces = [list(_innermost_first(expression, symbols_of)) for expression in everything]
    used = set().union(*(symbols_of[expression] for expression in everything))
    own = () if epsilon is None else (epsilon,)
    moving = set(states)
    _check_names([*states, *own, *values, *(used - moving - set(own) - set(values)), *observables])
    for role, symbols in (("epsilon", own), ("a parameter", values), ("an observable", observables)):
        for symbol in symbols:
            if symbol in moving:
                raise DeclarationError(
                    f"{symbol} is a state and also {role}.", "Give one of the two another name."
                )
    for symbol in observables:
        if symbol in values or symbol in own:
            role = "epsilon" if symbol in own else "a parameter"
            raise DeclarationError(f"{symbol} is an observable and also {role}.", "Give it another name.")
    if epsilon in values:
        raise DeclarationError(
            f"{epsilon} is epsilon and also a parameter.", "Its value is given when integrating."
        )
    unknown = sorted(used - moving - set(own) - set(values), key=str)
    if unknown:
        names = ", ".join(map(str, unknown))
        known = [s.name for s in (*states, *values, *own)]
        raise DeclarationError(
            f"{names} has no value: it is no state and no parameter.",
            f"Add it as parameters={{{unknown[0]}: ...}}.",
            value=unknown[0].name,
            known=known,
        )
    for expression, pieces in zip(everything, new_pieces):
        _check_pieces(expression, pieces)
        _check_at_values(pieces, values, symbols_of)
        if epsilon is not None:
            wrong = misplaced_epsilon(expression, epsilon, symbols_of)
            if wrong is not None:
                _check_switches(expression, epsilon, states, may_switch)
    return values


def _check_switches(
    expression: sp.Expr, epsilon: sp.Symbol, states: tuple[sp.Symbol, ...], may_switch: bool
) -> None:
    """Raise `DeclarationError` where epsilon stands in a function, unless that is a switch where one may be."""
    for piece in misplaced_pieces([expression], epsilon):
        surface = surface_of(piece, epsilon, states)
        if surface is None:
            raise DeclarationError(
                f"{epsilon} stands in {piece}, which is no pole or power of {epsilon}.",
                f"Replace it by its Taylor polynomial in {epsilon}, or rescale.",
            )
        if not may_switch:
            raise DeclarationError(
                f"{epsilon} stands in {piece}, a switch on {surface} = 0, which is no pole or power of {epsilon}.",
                f"Declare a VectorField: `split` makes a fast variable of ({surface})/{epsilon}.",
            )


def _check_names(symbols: Iterable[sp.Symbol]) -> None:
    seen: dict[str, sp.Symbol] = {}
    for symbol in symbols:
        if not symbol.name.isidentifier() or len(symbol.name) > 64:
            raise DeclarationError(
                f"the symbol {symbol.name[:80]!r} is no plain word.", "Use letters, digits and _, at most 64."
            )
        other = seen.setdefault(symbol.name, symbol)
        if other != symbol:
            raise DeclarationError(
                f"two different symbols are named {symbol.name} (their assumptions differ).",
                "Use one object throughout.",
            )


def _check_pieces(expression: sp.Expr, pieces: Iterable[sp.Basic]) -> None:
    for piece in pieces:
        if piece in _NOT_FINITE:
            raise DeclarationError(f"{expression} is not finite.", "Remove the division by zero.")
        if piece is sp.I:
            raise DeclarationError(
                f"{expression} is complex.", "Declare real and imaginary parts as separate states."
            )
        if isinstance(piece, AppliedUndef):
            raise DeclarationError(
                f"{expression} contains the unknown function {piece}.",
                "Use plain symbols for states; for time declare a state t with t' = 1.",
            )
        if isinstance(piece, (sp.Derivative, sp.Integral)):
            raise DeclarationError(
                f"{expression} contains {piece}.", "Carry out derivatives and integrals first."
            )


def _check_at_values(
    pieces: Iterable[sp.Basic], values: Values, symbols_of: Mapping[sp.Basic, frozenset[sp.Basic]]
) -> None:
    """Raise `DeclarationError` for a power or a function of which the parameters' values make no number.

    What passes can have its parameters replaced by their exact values: no integer gets too long, no degree too high.
    """
    used: list[sp.Symbol] = []

    def refuse(piece: sp.Expr, fact: str, remedy: str) -> NoReturn:
        given = ", ".join(f"{symbol} = {values[symbol]}" for symbol in used)
        raise DeclarationError(f"{str(piece)[:200]} {fact}.", remedy, got=given)

    # Inner pieces first, so that those around them are built of moderate numbers.
    for piece in pieces:
        if not isinstance(piece, (sp.Pow, sp.Function)):
            continue
        free = symbols_of[piece]
        used = [symbol for symbol in values if symbol in free]
        if not used:
            continue
        if (
            isinstance(piece, sp.Pow)
            and piece.args[1] == -1
            and _keeps_a_term(piece.args[0], values, symbols_of)
        ):
            continue
        at = {symbol: values[symbol] for symbol in used}
        if isinstance(piece, sp.exp):
            # SymPy makes z**c of exp(c*log(z)) as soon as c is a number.
            for base, exponent in _hidden_powers(piece.args[0].xreplace(at)):
                if is_long_power(base, exponent) or abs(exponent) > DEGREE:
                    refuse(
                        piece, "is too long to be written out", "Rescale the variables, or write it as a power."
                    )
        if isinstance(piece, sp.Pow):
            base, exponent = (part.xreplace(at) for part in piece.args)
            if is_long_power(base, exponent):
                refuse(piece, "is too long to be written out", "Rescale the variables, or round the exponent.")
            if exponent.is_Rational and abs(exponent) > DEGREE and base.free_symbols:
                refuse(piece, f"has an exponent above {DEGREE}", "Use a smaller one.")
            if base.is_Rational and base.is_zero and not exponent.is_positive:
                refuse(piece, "is zero to a power that is not always positive", "Give its base another value.")
            if base.is_Rational and base.is_negative and not exponent.is_integer:
                refuse(piece, "is not real", "Keep its base positive.")
        if free <= at.keys():
            try:
                number = piece.xreplace(at).evalf(15)
            except UNCOMPARABLE:
                number = sp.nan
            if not (number.is_Float or number.is_Rational):
                refuse(piece, "is not real and finite", "Keep its arguments in its domain.")
            if abs(number) > LARGEST:
                refuse(piece, f"lies beyond {LARGEST:g}", "Rescale the variables.")


def _keeps_a_term(
    expression: sp.Expr, values: Values, symbols_of: Mapping[sp.Basic, frozenset[sp.Basic]]
) -> bool:
    """Whether it is a sum with a power of a state that no other term has, so that no parameters make a number of it."""
    if not isinstance(expression, sp.Add):
        return False
    for term in expression.args:
        rest = term.as_coeff_Mul()[1]
        symbol = rest.args[0] if isinstance(rest, sp.Pow) and rest.args[1].is_Integer else rest
        is_state = isinstance(symbol, sp.Symbol) and symbol not in values
        if is_state and sum(symbol in symbols_of[other] for other in expression.args) == 1:
            return True
    return False


def _hidden_powers(argument: sp.Expr) -> Iterator[tuple[sp.Expr, sp.Expr]]:
    """z and c of each c*log(z) among the terms of an exponent."""
    for term in sp.Add.make_args(argument):
        factor, rest = term.as_coeff_Mul()
        if isinstance(rest, sp.log):
            yield rest.args[0], factor


def _innermost_first(
    expression: sp.Basic, symbols_of: dict[sp.Basic, frozenset[sp.Basic]]
) -> Iterator[sp.Basic]:
    """The pieces of an expression that are not in `symbols_of` yet, each after its arguments, with their symbols."""
    waiting: list[tuple[sp.Basic, bool]] = [(expression, False)]
    while waiting:
        piece, is_ready = waiting.pop()
        if piece in symbols_of:
            continue
        if is_ready or not piece.args:
            # Of other kinds some bind symbols, such as an integral.
            is_open = isinstance(piece, (sp.Add, sp.Mul, sp.Pow, sp.Function))
            symbols_of[piece] = (
                frozenset().union(*(symbols_of[part] for part in piece.args))
                if is_open
                else frozenset(piece.free_symbols)
            )
            yield piece
        else:
            waiting.append((piece, True))
            waiting += [(part, False) for part in reversed(piece.args)]


def updated_parameters(parameters: Values, values: Mapping[str, float]) -> dict[sp.Symbol, sp.Expr]:
    """`parameters` with other exact values for those that `values` names."""
    names = {symbol.name: symbol for symbol in parameters}
    result = dict(parameters)
    for name, value in values.items():
        if name not in names:
            raise DeclarationError.none_of(
                names, name, f'there is no parameter "{name}".', "The parameters are"
            )
        result[names[name]] = exact(value)
    return result


def reconstruction_of(field: Any, reconstruction: Mapping | None) -> dict[sp.Symbol, sp.Expr]:
    """Rates of variables that `field` drives, exact, {} for None; no symbol of the field's is one of them.

    Raises `DeclarationError` for what is no mapping of new symbols to expressions in what is known.
    """
    rates = equations_of({} if reconstruction is None else reconstruction, "reconstruction")
    roles = {state.name: "a state" for state in field.states}
    roles |= {symbol.name: "a parameter" for symbol in field.parameters}
    roles |= {symbol.name: "an observable" for symbol in field.observables}
    roles[str(field.epsilon)] = "epsilon"
    for symbol in rates:
        if symbol.name in roles:
            raise DeclarationError(
                f"{symbol} is a reconstruction variable and also {roles[symbol.name]}.", "Give it another name."
            )
    known = {*roles, *(symbol.name for symbol in rates)}
    for symbol, rate in rates.items():
        with met_at(f"the reconstruction of {symbol}"):
            _check_pieces(rate, _innermost_first(rate, {}))
        unknown = sorted(s.name for s in rate.free_symbols if s.name not in known)
        if unknown:
            raise DeclarationError.none_of(
                known,
                unknown[0],
                f"the reconstruction of {symbol} contains {unknown[0]}, which is no state, observable or "
                "parameter.",
                "There are",
            )
    return rates
