"""What SymPy would build of parts, without the questions to which they leave only one answer.

`Add`, `Mul` and the functions look for what cancels, combines or is a special value, and ask for signs and zeros of
everything. Most sums and products of a model have no two terms or bases in common, and then are only put in order; most
functions stand over polynomials and quotients of symbols, where they have no special value. All else goes to SymPy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cmp_to_key
from typing import Any

import sympy as sp

_ORDER = cmp_to_key(sp.Basic.compare)
_ODD = frozenset({sp.sin, sp.tan, sp.sinh, sp.tanh})
_EVEN = frozenset({sp.cos, sp.cosh})
_ONE_ARGUMENT = sp.exp.nargs
_SINGLE = frozenset({sp.sin, sp.cos, sp.tan, sp.sinh, sp.cosh, sp.tanh})
_SMOOTH = _SINGLE | {sp.exp}

Expr = Any


def sum_of(terms: Sequence[Expr]) -> Expr:
    """`sp.Add(*terms)`.

    >>> x, y = sp.symbols("x y")
    >>> sum_of([y, 2*x, sp.Integer(3)])
    2*x + y + 3
    """
    number: Expr = sp.S.Zero
    own: dict[tuple[Expr, ...], Expr] = {}
    for term in _spread(terms, sp.Add):
        if term.is_Rational:
            number += term
            continue
        key = _without_number(term)
        if key is None or key in own:
            return sp.Add(*terms)
        own[key] = term
    return _ordered(sp.Add, number, own.values())


def product_of(factors: Sequence[Expr]) -> Expr:
    """`sp.Mul(*factors)`.

    >>> x, y = sp.symbols("x y")
    >>> product_of([y, sp.Integer(2), x**2])
    2*x**2*y
    """
    number: Expr = sp.S.One
    own: dict[Expr, Expr] = {}
    for factor in _spread(factors, sp.Mul):
        if factor.is_Rational:
            number *= factor
            continue
        base = _base(factor)
        if base is None or base in own:
            return sp.Mul(*factors)
        own[base] = factor
    if number is sp.S.Zero or (len(own) == 1 and isinstance(next(iter(own)), sp.Add)):
        # A number is multiplied into a sum that stands alone.
        return sp.Mul(*factors)
    return _ordered(sp.Mul, number, own.values())


def function_of(function: Callable[..., Expr], arguments: Sequence[Expr]) -> Expr:
    """`function(*arguments)`.

    >>> a, s = sp.symbols("a s")
    >>> function_of(sp.tanh, [s - a])
    -tanh(a - s)
    """
    if function is sp.Pow:
        base, exponent = arguments
        if (
            type(base) is sp.Add
            and exponent.is_Integer
            and exponent.p not in (0, 1)
            and _is_plain(base, _SMOOTH)
        ):
            # A sum is asked only whether it is infinite or a complex number.
            value = sp.Expr.__new__(sp.Pow, base, exponent)
            value.is_commutative = True
            return value
    if function is sp.exp and _is_plain(arguments[0]):
        return _applied(sp.exp, arguments[0])
    if (function in _ODD or function in _EVEN) and _is_plain(arguments[0]):
        (argument,) = arguments
        if not _is_minus(argument):
            return _applied(function, argument)
        value = _applied(function, -argument)
        return value if function in _EVEN else -value
    return function(*arguments)


def _applied(function: Any, argument: Expr) -> Expr:
    """`function(argument, evaluate=False)`, whose number of arguments SymPy would count and put into a set again."""
    value = sp.Expr.__new__(function, argument)
    value.nargs = _ONE_ARGUMENT
    return value


def new_parts(expression: sp.Basic, seen: set[sp.Basic]) -> set[sp.Basic]:
    """Those parts of `expression`, itself among them, that are not in `seen` and stand in nothing that is."""
    new: set[sp.Basic] = set()
    waiting = [expression]
    while waiting:
        part = waiting.pop()
        if part in seen:
            continue
        known = len(new)
        new.add(part)
        if len(new) > known:
            waiting += part.args
    return new


def _spread(parts: Sequence[Expr], kind: type[sp.Basic]) -> Iterator[Expr]:
    for part in parts:
        if isinstance(part, kind):
            yield from part.args
        else:
            yield part


def _ordered(kind: Any, number: Expr, parts: Any) -> Expr:
    ordered = sorted(parts, key=_ORDER)
    if number is not (sp.S.Zero if kind is sp.Add else sp.S.One):
        ordered.insert(0, number)
    if len(ordered) < 2:
        return ordered[0] if ordered else number
    # Expressions in SymPy's order that are commutative: `evaluate=False` would ask each again whether it is one.
    return kind._from_args(ordered, is_commutative=True)


def _without_number(term: Expr) -> tuple[Expr, ...] | None:
    """What a term is multiplied by a number of; None where SymPy must look."""
    if isinstance(term, sp.Mul):
        parts = term.args[1:] if term.args[0].is_Rational else term.args
        return None if len(parts) == 1 and isinstance(parts[0], sp.Add) else parts
    return None if _base(term) is None else (term,)


def _base(factor: Expr) -> Expr | None:
    """What a factor is a power of; None where SymPy must look."""
    kind = type(factor)
    if not factor.is_commutative:
        return None
    if kind is sp.Symbol or kind is sp.Add or kind in _SINGLE:
        return factor
    if kind is sp.exp:
        return sp.E if _is_plain(factor.args[0]) else None
    if kind is sp.Pow and factor.args[1].is_Integer:
        base = factor.args[0]
        return base if type(base) is sp.Symbol or type(base) is sp.Add or type(base) in _SINGLE else None
    return None


def _is_plain(expression: Expr, functions: frozenset[Expr] = frozenset()) -> bool:
    """Whether symbols and rational numbers make it by sums, products, whole powers and `functions`; no number."""
    waiting, has_symbol = [expression], False
    while waiting:
        part = waiting.pop()
        kind = type(part)
        if kind is sp.Symbol:
            if part != sp.Symbol(part.name):
                return False
            has_symbol = True
        elif kind is sp.Pow:
            if not part.args[1].is_Integer:
                return False
            waiting.append(part.args[0])
        elif kind is sp.Add or kind is sp.Mul or kind in functions:
            waiting += part.args
        elif not part.is_Rational:
            return False
    return has_symbol


def _is_minus(argument: Expr) -> bool:
    """`argument.could_extract_minus_sign()`."""
    if isinstance(argument, sp.Add):
        signs: list[tuple[str, bool]] = []
        for term in argument.args:
            number, symbol = term.as_coeff_Mul()
            if type(symbol) is not sp.Symbol:
                break
            signs.append((symbol.name, number.is_negative))
        else:
            minus = sum(negative for _, negative in signs)
            return min(signs)[1] if 2 * minus == len(signs) else 2 * minus > len(signs)
    return argument.could_extract_minus_sign()
