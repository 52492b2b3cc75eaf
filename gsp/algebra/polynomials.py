"""python-flint polynomials as SymPy expressions, to read and to evaluate."""

from __future__ import annotations

import math
from collections.abc import Sequence

import flint
import numpy as np
import sympy as sp

import gsp.algebra.pickling  # noqa: F401 - who has a polynomial may send it

# Powers of one generator that are nested in one another.
LONGEST = 64


def rational(value: flint.fmpq) -> sp.Rational:
    """A python-flint number as a SymPy one."""
    number = flint.fmpq(value)
    return sp.Rational(int(number.p), int(number.q))


def characteristic_roots(matrix: np.ndarray) -> np.ndarray:
    """Eigenvalues (n,), complex, of a matrix of finite floats taken as exact numbers, multiple ones repeated."""
    entries = [flint.fmpq(*float(value).as_integer_ratio()) for value in matrix.ravel()]
    roots = flint.fmpq_mat(*matrix.shape, entries).charpoly().complex_roots()  # pyright: ignore[reportCallIssue]
    return np.array([complex(root) for root, times in roots for _ in range(times)])  # pyright: ignore[reportGeneralTypeIssues]


def polynomial_expression(polynomial: flint.fmpq_mpoly, meaning: Sequence[sp.Expr]) -> sp.Expr:
    """The polynomial, expanded, with `meaning[i]` for its generator i."""
    return sp.Add(
        *[
            sp.Mul(rational(coefficient), *[meaning[i] ** int(e) for i, e in enumerate(exponents) if e])
            for exponents, coefficient in polynomial.to_dict().items()
        ]
    )


def horner_expression(
    polynomial: flint.fmpq_mpoly, meaning: Sequence[sp.Expr], sizes: Sequence[int] = (), size: int = 0
) -> sp.Expr:
    """The polynomial over 2^size in nested form, the generator that occurs in most terms outermost.

    With `sizes` generator i stands in it over 2^sizes[i]. More than `LONGEST` powers of a generator are a sum of nested
    forms, or SymPy's recursions end in the stack's limit.
    """
    terms, inner = polynomial.to_dict(), meaning
    if size or any(sizes):
        powers = {exponents: sum(map(int.__mul__, map(int, exponents), sizes)) for exponents in terms}
        terms = {exponents: c * flint.fmpq(2) ** (powers[exponents] - size) for exponents, c in terms.items()}
        inner = [m * sp.Integer(2) ** -k for m, k in zip(meaning, sizes)]
    return _horner(terms, list(range(len(meaning))), inner)


def reach(polynomial: flint.fmpq_mpoly, sizes: Sequence[int]) -> tuple[int, int]:
    """(largest size of a term, furthest from 1 that a coefficient or a term is) in powers of 2, its generators i of
    size 2^sizes[i]."""
    largest, furthest = -(10**9), 0
    for exponents, c in polynomial.to_dict().items():
        own = int(c.p).bit_length() - int(c.q).bit_length()
        whole = own + sum(map(int.__mul__, map(int, exponents), sizes))
        largest, furthest = max(largest, whole), max(furthest, abs(own), abs(whole))
    return largest, furthest


def primitive_multiple(polynomial: flint.fmpq_mpoly) -> tuple[flint.fmpq_mpoly, sp.Rational]:
    """(c P, c) with the smallest integer c > 0 for which c P has integer coefficients."""
    scale = math.lcm(*(int(flint.fmpq(coefficient).q) for coefficient in polynomial.coeffs()))
    return polynomial * flint.fmpq(scale), sp.Integer(scale)


def _horner(terms: dict, variables: list[int], meaning: Sequence[sp.Expr]) -> sp.Expr:
    used = [i for i in variables if any(m[i] for m in terms)]
    if not used:
        return sp.Add(*[rational(c) for c in terms.values()])
    first = max(used, key=lambda i: sum(1 for m in terms if m[i]))
    rest = [i for i in used if i != first]
    by_power: dict[int, dict] = {}
    for m, c in terms.items():
        by_power.setdefault(int(m[first]), {})[m] = c

    def nested(powers: list[int], below: int) -> sp.Expr:
        """The part with `powers`, highest first, divided by the power `below`."""
        if len(powers) > LONGEST:
            half = len(powers) // 2
            return nested(powers[half:], below) + nested(powers[:half], below)
        result: sp.Expr = sp.Integer(0)
        for power, lower in zip(powers, [*powers[1:], below]):
            result = (result + _horner(by_power[power], rest, meaning)) * meaning[first] ** (power - lower)
        return result

    return nested(sorted(by_power, reverse=True), 0)
