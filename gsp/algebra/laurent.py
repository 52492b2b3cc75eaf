"""Expansion in powers of epsilon: the Laurent series of an expression that is rational in epsilon."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import lru_cache

import sympy as sp

from gsp.algebra.factorisation import lowest_terms
from gsp.algebra.substitution import substituted
from gsp.errors import DeclarationError

# The order of what is zero identically, larger than any other.
_NEVER = 1 << 30


def misplaced_epsilon(
    expression: sp.Expr, epsilon: sp.Symbol, symbols_of: Mapping[sp.Basic, Collection[sp.Basic]] | None = None
) -> sp.Expr | None:
    """First subexpression in which `epsilon` stands inside a function, an exponent or a root; else `None`.

    `symbols_of` holds the symbols of each part, where they are known. What remains when there is none is
    rational in epsilon, so that its Laurent series at 0 exists.
    """
    has_epsilon = expression.has(epsilon) if symbols_of is None else epsilon in symbols_of[expression]
    if not has_epsilon or expression == epsilon:
        return None
    if expression.is_Add or expression.is_Mul:
        parts = expression.args
    elif expression.is_Pow and expression.exp.is_Integer:
        parts = (expression.base,)
    else:
        return expression
    for part in parts:
        found = misplaced_epsilon(part, epsilon, symbols_of)
        if found is not None:
            return found
    return None


def laurent(expression: sp.Expr, epsilon: sp.Symbol, *, order: int) -> dict[int, sp.Expr]:
    """Nonzero coefficients {k: c_k} of epsilon^k for k <= `order`, c_k free of epsilon.

    >>> x, eps = sp.symbols("x epsilon")
    >>> laurent(x / eps + 1 / (1 + eps * x), eps, order=1)
    {-1: x, 0: 1, 1: -x}
    """
    return dict(_coefficients(expression, epsilon, order))


# Nested quotients ask for the same series at every level; without memory that is exponential in the depth.
@lru_cache(maxsize=4096)
def _coefficients(expression: sp.Expr, epsilon: sp.Symbol, order: int) -> dict[int, sp.Expr]:
    if not expression.has(epsilon):
        return {0: expression} if order >= 0 and expression != 0 else {}
    if expression == epsilon:
        return {1: sp.Integer(1)} if order >= 1 else {}
    if expression.is_Add:
        total: dict[int, list[sp.Expr]] = {}
        for part in expression.args:
            for k, coefficient in _coefficients(part, epsilon, order).items():
                total.setdefault(k, []).append(coefficient)
        return _nonzero({k: sp.Add(*parts) for k, parts in sorted(total.items())})
    if expression.is_Mul:
        free, bound = expression.as_independent(epsilon, as_Add=False)
        factors = sp.Mul.make_args(bound)
        lowest = [_valuation(factor, epsilon) for factor in factors]
        if sum(lowest) > order:
            return {}
        product: dict[int, sp.Expr] = {0: free}
        for i, factor in enumerate(factors):
            slack = order - sum(lowest) + lowest[i]
            series = _coefficients(factor, epsilon, slack)
            product = _multiply(product, series, order - sum(lowest[i + 1 :]))
        return _nonzero(product)
    # Also refuses the reciprocal of zero, and whatever is no power.
    length = order - _valuation(expression, epsilon)
    base, exponent = expression.base, int(expression.exp)
    valuation = _valuation(base, epsilon)
    if length < 0:
        return {}
    series = _coefficients(base, epsilon, valuation + length)
    shifted = {k - valuation: c for k, c in series.items()}
    if exponent < 0:
        shifted, exponent = _reciprocal(shifted, length), -exponent
    result: dict[int, sp.Expr] = {0: sp.Integer(1)}
    for _ in range(exponent):
        result = _multiply(result, shifted, length)
    offset = valuation * int(expression.exp)
    return _nonzero({k + offset: c for k, c in sorted(result.items())})


def pole_order(expression: sp.Expr, epsilon: sp.Symbol) -> int:
    """Order of the pole of `expression` at epsilon = 0; 0 when it is regular there."""
    return max(0, -_valuation(expression, epsilon)) if expression.has(epsilon) else 0


@lru_cache(maxsize=4096)
def _valuation(expression: sp.Expr, epsilon: sp.Symbol) -> int:
    if not expression.has(epsilon):
        return 0
    if expression == epsilon:
        return 1
    if expression.is_Mul:
        return sum(_valuation(part, epsilon) for part in expression.args)
    if expression.is_Pow and expression.exp.is_Integer:
        valuation = _valuation(expression.base, epsilon)
        if valuation >= _NEVER and int(expression.exp) < 0:
            raise DeclarationError(
                f"{expression} divides by zero: {expression.base} is 0 identically.", "Remove it."
            )
        return int(expression.exp) * valuation
    if expression.is_Add:
        # Leading terms may cancel, as in 1/epsilon - 1/(epsilon + epsilon^2): raise the bound until one survives.
        valuations = [_valuation(part, epsilon) for part in expression.args]
        lowest = min(valuations)
        if valuations.count(lowest) == 1:
            return lowest
        for k in range(lowest, lowest + 64):
            if _coefficients(expression, epsilon, k):
                return k
            if k == lowest and vanishes(expression):
                return _NEVER
        raise DeclarationError(
            f"{expression} vanishes to all orders in {epsilon}.", "Simplify it before declaring."
        )
    raise DeclarationError(
        f"{epsilon} stands in {expression}, which is no pole or power of {epsilon}.",
        f"Replace it by its Taylor polynomial in {epsilon}.",
    )


def _multiply(a: dict[int, sp.Expr], b: dict[int, sp.Expr], order: int) -> dict[int, sp.Expr]:
    total: dict[int, list[sp.Expr]] = {}
    for i, x in a.items():
        for j, y in b.items():
            if i + j <= order:
                total.setdefault(i + j, []).append(x * y)
    return {k: sp.Add(*parts) for k, parts in sorted(total.items())}


def _reciprocal(a: dict[int, sp.Expr], order: int) -> dict[int, sp.Expr]:
    inverse = [1 / a[0]]
    for k in range(1, order + 1):
        known = sp.Add(*[a[j] * inverse[k - j] for j in range(1, k + 1) if j in a])
        inverse.append(-known / a[0])
    return {k: c for k, c in enumerate(inverse) if c != 0}


def _nonzero(series: dict[int, sp.Expr]) -> dict[int, sp.Expr]:
    # A sum can vanish without SymPy seeing it.
    return {k: c for k, c in series.items() if c != 0 and not (c.is_Add and vanishes(c))}


def vanishes(expression: sp.Expr) -> bool:
    """Whether an expression is identically zero: decided by its value at a point when that is not zero.

    `cancel` alone takes minutes on nested quotients, and a value settles nearly every case.
    """
    symbols = sorted(expression.free_symbols, key=str)
    point = {s: sp.Rational(sp.prime(i + 4), sp.prime(i + 9)) for i, s in enumerate(symbols)}
    value = substituted(expression, point)
    number = value if value.is_Rational else sp.N(value, 30)
    if number.is_number and number.is_finite and abs(number) > sp.Float("1e-20"):
        return False
    return lowest_terms(expression) == 0
