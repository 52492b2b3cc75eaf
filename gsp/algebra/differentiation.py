"""Derivatives over the reals, where SymPy differentiates over the complex numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import lru_cache
from typing import Any

import sympy as sp
from sympy.core.function import ArgumentIndexError

from gsp.algebra.sharing import parts_of, replaced


class _Absolute(sp.Function):
    """Abs of a real number: SymPy's own differentiates to re and im unless its argument is declared real."""

    def fdiff(self, argindex: int = 1) -> Any:
        return _Sign(self.args[0])


class _Sign(sp.Function):
    """sign of a real number, with derivative 0 almost everywhere."""

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        return sp.S.Zero


class _Step(sp.Function):
    """Heaviside's step of a real number, with derivative 0 almost everywhere, its second argument the value at 0."""

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        return sp.S.Zero


class _Power(sp.Function):
    """b^n, n a symbol or b a product: SymPy's own slope n b^n b'/b is 0/0 where b vanishes."""

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        base, exponent = self.args
        return exponent * base ** (exponent - 1) if argindex == 1 else sp.log(base) * base**exponent


_OVER_THE_REALS: dict[Any, Any] = {sp.Abs: _Absolute, sp.sign: _Sign, sp.Heaviside: _Step, sp.Pow: _Power}
_BACK = {ours: theirs for theirs, ours in _OVER_THE_REALS.items()}


def derivative(expression: Any, symbol: sp.Symbol) -> Any:
    """Derivative of a real expression that can be evaluated wherever it exists.

    Three things SymPy leaves to the reader: |u|, sign(u) and a step are taken of real u, off u = 0,
    d(u^n)/dx = n u^n u'/u, which is 0/0 at u = 0, becomes n u^(n-1) u', and u |u|^p is differentiated as one power.
    """
    if not expression.has(symbol):
        return sp.S.Zero
    if expression.is_Add:
        # Term by term, those apart that the symbol stands in as a factor: SymPy's way takes ten times as long.
        return sp.Add(*(derivative(term, symbol) for term in expression.args if term.has(symbol)))
    if expression == symbol:
        return sp.S.One
    if expression.is_Mul and symbol in expression.args:
        others = [factor for factor in expression.args if factor != symbol]
        if not any(factor.has(symbol) for factor in others):
            return sp.Mul(*others)
    if any(map(_is_left, parts_of(expression))):
        joined = _exchanged(expression, _has_root, lambda part, args: _with_roots_joined(part.func(*args)))
        ours = _exchanged(joined, _is_left, lambda part, args: _OVER_THE_REALS[part.func](*args))
        result = _exchanged(
            _smooth(ours, symbol), lambda part: part.func in _BACK, lambda part, args: _BACK[part.func](*args)
        )
    else:
        result = _smooth(expression, symbol)
    if any(part.is_Pow and not part.exp.is_number for part in parts_of(result)):
        result = sp.powsimp(result, combine="exp")
    return result


# The slopes of the parts of a few large models are remembered.
@lru_cache(maxsize=1 << 14)
def _smooth(expression: Any, symbol: sp.Symbol) -> Any:
    """What SymPy's `diff` gives, by the rules for sums, products, powers of numbers and functions.

    Its own way through a product is that for any number of derivatives: it asks each part for its symbols again, and
    sums that stand in many rates, as those of conserved totals do, are gone through again in each.
    """
    if not expression.has(symbol):
        return sp.S.Zero
    if expression == symbol:
        return sp.S.One
    if expression.is_Add:
        return sp.Add(*(_smooth(term, symbol) for term in expression.args))
    if expression.is_Mul:
        slopes = [(i, slope) for i, part in enumerate(expression.args) if (slope := _smooth(part, symbol)) != 0]
        return sp.Add(*(sp.Mul(*expression.args[:i], slope, *expression.args[i + 1 :]) for i, slope in slopes))
    if expression.is_Pow and expression.exp.is_number:
        return expression * (_smooth(expression.base, symbol) * expression.exp / expression.base)
    if (
        isinstance(expression, sp.Function)
        and type(expression)._eval_derivative is sp.Function._eval_derivative
    ):
        # SymPy's own way asks whether products with it are whole, which takes a quarter of a second for a tanh.
        slopes = [(i, slope) for i, part in enumerate(expression.args) if (slope := _smooth(part, symbol)) != 0]
        with suppress(ArgumentIndexError):
            return sp.Add(*(expression.fdiff(i + 1) * slope for i, slope in slopes))
    return sp.diff(expression, symbol)


def _has_root(part: Any) -> bool:
    powers = [factor.as_base_exp() for factor in part.args] if part.is_Mul else []
    return any(isinstance(base, sp.Abs) and not n.is_Integer for base, n in powers)


def _with_roots_joined(product: Any) -> Any:
    """The product with u^n |u|^p, p no whole number, as sign(u)^n |u|^(n + p): its slope is 0/0 at u = 0 otherwise."""
    for root in product.args:
        size, power = root.as_base_exp()
        if isinstance(size, sp.Abs) and not power.is_Integer:
            u = size.args[0]
            for part in product.args:
                base, n = part.as_base_exp()
                if base in (u, -u) and n.is_Integer and n > 0:
                    product = product / part * sp.sign(base) ** (n % 2) * size**n
    return product


def _is_left(piece: Any) -> bool:
    """Whether SymPy leaves the slope of `piece` to the reader."""
    if piece.func is sp.Pow:
        base, exponent = piece.args
        # The slope of any other power of a number has one power of its base.
        return not exponent.is_Integer and not (exponent.is_Rational and not (base.is_Mul or base.is_Pow))
    return piece.func in _OVER_THE_REALS


def _exchanged(expression: Any, is_meant: Callable[[Any], bool], made: Callable[[Any, list], Any]) -> Any:
    """`expression` with what is `made` of each part that is meant, inner parts before outer ones, each once."""
    rule: dict[Any, Any] = {}
    for part in filter(is_meant, parts_of(expression)):
        rule[part] = made(part, [replaced(argument, rule) for argument in part.args])
    return replaced(expression, rule) if rule else expression


def slopes(expressions: Iterable[Any], symbols: Iterable[sp.Symbol]) -> dict[tuple[int, int], Any]:
    """Those `derivative`s of `expressions` by `symbols` that are not 0, by row and column, in the order of rows."""
    columns = {s: j for j, s in enumerate(symbols)}
    found: dict[tuple[int, int], Any] = {}
    for i, expression in enumerate(expressions):
        for s in sorted(expression.free_symbols & columns.keys(), key=columns.__getitem__):
            slope = derivative(expression, s)
            if slope != 0:
                found[i, columns[s]] = slope
    return found


def entries(expressions: Iterable[Any], symbols: Iterable[sp.Symbol]) -> list[Any]:
    """The `derivative`s of `expressions` by `symbols`, row by row."""
    rows, columns = list(expressions), list(symbols)
    known = slopes(rows, columns)
    return [known.get((i, j), sp.S.Zero) for i in range(len(rows)) for j in range(len(columns))]


def jacobian(expressions: Iterable[Any], symbols: Iterable[sp.Symbol]) -> sp.Matrix:
    """The matrix of `derivative`s, a row for each of `expressions`."""
    rows, columns = list(expressions), list(symbols)
    return sp.Matrix(len(rows), len(columns), entries(rows, columns))


def gathered_derivative(expression: Any, symbol: sp.Symbol) -> Any:
    """`derivative`, in which that of f^k B^p, B = sum_j c_j f^j with p < 0, is one product:

        f' f^(k-1) B^(p-1) sum_j (k + p j) c_j f^j.                                                             (1)

    So f/sqrt(1 + f^2) has the slope f' (1 + f^2)^(-3/2), where the product rule leaves a difference of two terms that
    is small beside them for large f, and that enclosures do not see through.
    """
    if expression.is_Add:
        return sp.Add(*(gathered_derivative(term, symbol) for term in expression.args))
    found = _quotient(expression, symbol) if expression.is_Mul else None
    if found is None:
        return derivative(expression, symbol)
    (f, k), (base, p), terms = found
    own = f**k * base**p
    rest = expression / own
    inner = sp.Add(*((k + p * j) * c * f**j for c, j in terms))
    gathered = rest * derivative(f, symbol) * f ** (k - 1) * base ** (p - 1) * inner
    return gathered + derivative(rest, symbol) * own


def _quotient(product: Any, symbol: sp.Symbol) -> tuple[tuple, tuple, list[tuple[Any, Any]]] | None:
    """(f, k), (B, p) and the (c_j, j) of (1) in a product, None where there are none."""
    powers = [part.args if part.is_Pow else (part, sp.S.One) for part in product.args]
    moving = [(base, n) for base, n in powers if n.is_Rational and base.has(symbol)]
    for base, p in moving:
        if not (base.is_Add and p < 0):
            continue
        for f, k in moving:
            terms = [_term(term, f, symbol) for term in base.args] if k >= 1 else [None]
            if None not in terms:
                return (f, k), (base, p), [term for term in terms if term is not None]
    return None


def _term(term: Any, f: Any, symbol: sp.Symbol) -> tuple[Any, Any] | None:
    """c and j where `term` is c f^j, c free of the symbol, and j > 0 unless all is; None for another."""
    c, rest = term.as_independent(symbol, as_Add=False)
    base, j = rest.args if rest.is_Pow else (rest, sp.S.One)
    if rest == 1:
        return c, sp.S.Zero
    return (c, j) if base == f and j.is_Rational and j > 0 else None


def bounded_product(expression: Any) -> Any:
    """A product with the quotients that derivatives of 1/cosh and of 1/(c + k exp) bring in made of bounded parts.

    sinh(u)/cosh(u) becomes tanh(u), and exp(u)/B with B = c + k exp(u) becomes 1/(k + c exp(-u)); both parts of each
    overflow where the quotient is finite. It is returned itself where there is none.
    """
    for base, exponent in [factor.as_base_exp() for factor in expression.args]:
        if not (exponent.is_Integer and exponent < 0):
            continue
        if isinstance(base, sp.cosh):
            powers, above = expression.as_powers_dict(), sp.sinh(base.args[0])
            times = min(int(powers.get(above, 0)), -int(exponent)) if above in powers else 0
            if times > 0:
                expression = expression / above**times * base**times * sp.tanh(base.args[0]) ** times
        elif base.is_Add:
            expression = _gate_bounded(expression, base, -int(exponent))
    return expression


def _gate_bounded(expression: Any, base: Any, most: int) -> Any:
    """`expression`, a product with 1/`base`^`most`, with its factor exp(u) over the base bounded."""
    raised = [term for term in base.args if term.has(sp.exp)]
    if len(raised) != 1:
        return expression
    k, wave = raised[0].as_independent(sp.exp, as_Add=False)
    if not (k.is_number and isinstance(wave, sp.exp)):
        return expression
    # One by one: SymPy leaves exp(1 - 2 x) exp(2 x - 1) as it is.
    factors = sp.Mul.make_args(expression)
    exponent = sp.Add(*(factor.args[0] for factor in factors if isinstance(factor, sp.exp)))
    rest = sp.Mul(*(factor for factor in factors if not isinstance(factor, sp.exp)))
    for times in range(most, 0, -1):
        if exponent - times * wave.args[0] == 0:
            return rest * base**times / (k + (base - raised[0]) * sp.exp(-wave.args[0])) ** times
    return expression
