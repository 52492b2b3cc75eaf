"""Values and expressions put in the place of symbols, within a budget, and not a number where there is no number."""

from __future__ import annotations

import math
from collections.abc import Mapping

import sympy as sp

BITS = 4096
"""Bound on a numerator or denominator: Python prints no integer above 4300 digits, 14_000 bits."""
EXPONENT_BITS = 128
"""Bound on the exponent of a root of a number: SymPy may factor it, which takes hours for some of 150 digits."""
UNCOMPARABLE = (ArithmeticError, AttributeError, TypeError, ValueError)
"""What SymPy raises when a Max or Min is to compare what is not real; an AttributeError where its cache stumbles over
the message of a TypeError that says so."""


def substituted(expression: sp.Expr, values: Mapping[sp.Symbol, sp.Expr]) -> sp.Expr:
    """`expression` with `values` in the place of symbols, at once.

    Not a number (`nan`) where a Max or Min would compare what is not real, and where a power of a number would be
    longer than `BITS`, as 3**y is at y = 10**300: SymPy would write it out.
    """
    done: dict[sp.Expr, sp.Expr] = {}

    def at(piece: sp.Expr) -> sp.Expr:
        if piece not in done:
            done[piece] = built(piece)
        return done[piece]

    def built(piece: sp.Expr) -> sp.Expr:
        if piece in values:
            return values[piece]
        parts = [at(part) for part in piece.args]
        if all(new is old for new, old in zip(parts, piece.args)):
            return piece
        if any(part is sp.nan for part in parts) or (piece.is_Pow and is_long_power(*parts)):
            return sp.nan
        try:
            return piece.func(*parts)
        except UNCOMPARABLE:
            return sp.nan

    return at(expression)


def is_long_power(base: sp.Expr, exponent: sp.Expr) -> bool:
    """Whether SymPy would write base**exponent out by numbers of more than `BITS` bits, or a root as fine."""
    # b**(c + x) is worked out as b**c b**x, and the whole part of c is taken out of a root.
    constant = exponent.as_coeff_Add()[0]
    if not isinstance(constant, sp.Rational):
        return False
    for factor, power in base.as_powers_dict().items():
        if isinstance(factor, sp.Rational) and isinstance(power, sp.Rational) and abs(factor) not in (0, 1):
            written = power * constant
            if bits_of(factor) * abs(written) > BITS or (
                not written.is_Integer and _is_long_root(factor, written)
            ):
                return True
    return False


def _is_long_root(base: sp.Rational, exponent: sp.Rational) -> bool:
    if bits_of(exponent) > EXPONENT_BITS:
        return True
    # SymPy gathers the primes of a base below one root, each to what its power leaves over the root's order.
    for part, power in ((abs(int(base.p)), exponent.p), (int(base.q), -exponent.p)):
        try:
            primes = sp.Integer(part).factors(2**15).items()
        except OverflowError:
            # Beyond doubles; SymPy fails in the same way when it takes the root, which is caught there.
            continue
        except ValueError:
            # SymPy's factorisation fails on some numbers of a hundred digits, and would when it takes the root.
            return True
        left = [(prime, times * power % exponent.q) for prime, times in primes]
        shared = math.gcd(*(times for _, times in left))
        if shared and sum(times // shared * int(prime).bit_length() for prime, times in left) > BITS:
            return True
    return False


def bits_of(number: sp.Rational) -> int:
    """Bits of the larger of numerator and denominator."""
    return max(int(number.p).bit_length(), int(number.q).bit_length())
