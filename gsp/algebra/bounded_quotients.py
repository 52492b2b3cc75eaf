"""Quotients of sums of exponentials, finite where the sums overflow: each exponential is a quotient of two below 1.

With e1 = exp(min(u, 0)) and e2 = exp(min(-u, 0)), exp(u) = e1/e2, and one of the two is 1. An expression is written as

    value e1^-c e2^-d,                                                                                        (1)

the value a polynomial in e1, e2, or a quotient of such: sums are made homogeneous, so that in 1 + exp(u) = (e1 + e2)/e2
no term is above 1, and what grows is in the powers alone.
"""

from __future__ import annotations

from functools import reduce
from typing import Any, NamedTuple

import sympy as sp
from sympy.codegen.cfunctions import expm1, log1p

from gsp.algebra.differentiation import bounded_product
from gsp.algebra.sharing import is_shared, parts_of, plus, times

_WAVES = (sp.exp, sp.cosh, sp.sinh)
_Powers = dict[Any, int]


class Written(NamedTuple):
    """An expression as (1): `powers` has c by -u and d by u, for each u."""

    value: Any
    powers: _Powers


def bounded(expression: Any, known: dict[Any, Written]) -> Any:
    """A product or a logarithm by parts that are finite where its value is; itself where there is nothing to do.

    What its parts are as (1) is kept in `known`: the terms of a long sum share most of them.
    """
    if expression.is_Mul:
        return bounded_product(_bounded_quotient(expression, known))
    return _bounded_logarithm(expression, known) if isinstance(expression, sp.log) else expression


def finite(expression: Any) -> Any:
    """`expression` with all its parts `bounded`; itself where parts are shared, which a walk would meet as often."""
    if is_shared(expression) or not (_waves(expression) or expression.has(sp.log)):
        return expression
    found = bounded(expression, {})
    if found is not expression:
        return finite(found)
    return expression.func(*map(finite, expression.args))


def _bounded_quotient(expression: Any, known: dict[Any, Written]) -> Any:
    """A product over and under a bar of sums of exp, cosh and sinh, none of which overflows then; itself if it is none.

    The same number: (a + b exp(u))/(c + d exp(u)) is (a e2 + b e1)/(c e2 + d e1).
    """
    if is_shared(expression):
        return expression
    below = [f.base for f in expression.args if f.is_Pow and f.exp.is_Integer and f.exp.is_negative]
    above = [f.base if f.is_Pow else f for f in expression.args]
    if not (any(map(_waves, below)) and any(f.is_Add and f not in below and _waves(f) for f in above)):
        return expression
    value, powers = _written(expression, known)
    if not powers:
        # What is left of exponentials stands within other functions.
        return expression
    return times(value, sp.exp(_exponent(powers), evaluate=False))


def _bounded_logarithm(expression: Any, known: dict[Any, Written]) -> Any:
    """log of a sum of exponentials, such as 2 + exp(u), or of 1 and more; itself of anything else.

    With p = max(u, 0), log(1 + exp(u)) = p + log1p((exp(-p) - 1) + e1), which keeps its digits where it is small.
    """
    (inside,) = expression.args
    if is_shared(inside) or not inside.is_Add:
        return expression
    one, rest = inside.as_coeff_Add()
    value, powers = _written(rest if one == 1 else inside, known)
    exponent = _exponent(powers)
    if one == 1:
        return exponent + log1p(
            plus([expm1(-exponent, evaluate=False), value] if powers else [value]), evaluate=False
        )
    return exponent + sp.log(value) if powers else expression


def _exponent(powers: _Powers) -> Any:
    """The logarithm of e1^-c e2^-d, in one sum: what falls makes up for what grows."""
    return sp.Add(*(_part(u, 1, power) for u, power in powers.items()))


def _waves(expression: Any) -> bool:
    return any(map(_is_wave, parts_of(expression)))


def _is_wave(e: Any) -> bool:
    # The sign of u is what exponents have in what is written here.
    return isinstance(e, _WAVES) and bool(e.free_symbols) and not e.has(sp.sign)


def _below_one(u: Any, power: int) -> Any:
    """exp(min(u, 0)) to a power.

    The power of an exponential would be off by as many times its rounding.
    """
    return sp.exp(_part(u, -1, power), evaluate=False) if power else sp.S.One


def _part(u: Any, side: int, power: int) -> Any:
    """max(u, 0) for `side` 1, min(u, 0) for -1, times `power`.

    A product, which is u or exactly 0: in a sum with |u| SymPy takes u apart, and log(1 + exp(u)) is below 0.
    """
    side_of_u = -sp.sign(-u) if u.could_extract_minus_sign() else sp.sign(u)
    return sp.Mul(sp.Rational(power, 2), u, 1 + side * side_of_u)


def _written(e: Any, known: dict[Any, Written]) -> Written:
    if e not in known:
        known[e] = _fresh(e, known)
    return known[e]


def _fresh(e: Any, known: dict[Any, Written]) -> Written:
    if _is_wave(e):
        return _wave(e)
    if not (e.is_Add or e.is_Mul or (e.is_Pow and e.exp.is_Integer)):
        # Who walks what is made of it passes by its parts, which may be shared.
        return Written(finite(e), {})
    inner = e.args[:1] if e.is_Pow else e.args
    parts = [_written(part, known) for part in inner]
    if all(part == Written(own, {}) for own, part in zip(inner, parts)):
        return Written(e, {})
    if e.is_Pow:
        powers = {u: int(e.exp) * n for u, n in parts[0].powers.items()}
        return Written(sp.Pow(parts[0].value, e.exp, evaluate=False), powers)
    exponents = {u: None for part in parts for u in part.powers}
    if e.is_Mul:
        powers = {u: sum(part.powers.get(u, 0) for part in parts) for u in exponents}
        return Written(times(*(part.value for part in parts)), powers)
    most = {u: reduce(max, (part.powers.get(u, 0) for part in parts)) for u in exponents}
    terms = [
        times(part.value, *(_below_one(-u, most[u] - part.powers.get(u, 0)) for u in exponents))
        for part in parts
    ]
    return Written(plus(terms), most)


def _wave(e: Any) -> Written:
    content, u = sp.expand(e.args[0]).as_content_primitive()
    if u.could_extract_minus_sign():
        content, u = -content, -u
    # exp(2 x/3) and exp(x/3) have their common root.
    n, root = int(content.p), u / content.q
    if not isinstance(e, sp.exp):
        # (exp(n u) + exp(-n u))/2, and that times tanh, which keeps its digits where sinh is small.
        up, down = (_below_one(v, 2 * abs(n)) for v in (root, -root))
        half = (up + down) / 2
        value = half if isinstance(e, sp.cosh) else half * sp.tanh(e.args[0])
        return Written(value, {root: abs(n), -root: abs(n)})
    if n > 0:
        return Written(_below_one(root, n), {root: n})
    return Written(_below_one(-root, -n), {-root: -n})
