"""python-flint polynomials as SymPy expressions, to read and to evaluate."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import flint
import numpy as np
import sympy as sp

import gsp.algebra.pickling  # noqa: F401 - who has a polynomial may send it

# Powers of one generator that are nested in one another.
LONGEST = 64
# Polynomials with more terms are not factored, and not written about a centre.
FACTOR_TERMS = 400


def rational(value: flint.fmpq) -> sp.Rational:
    """A python-flint number as a SymPy one."""
    number = flint.fmpq(value)
    return sp.Rational(int(number.p), int(number.q))


def characteristic_roots(matrix: np.ndarray) -> np.ndarray:
    """Eigenvalues (n,), complex, of a matrix of finite floats taken as exact numbers, multiple ones repeated."""
    entries = [flint.fmpq(*float(value).as_integer_ratio()) for value in matrix.ravel()]
    roots = flint.fmpq_mat(*matrix.shape, entries).charpoly().complex_roots()  # pyright: ignore[reportCallIssue]
    return np.array([complex(root) for root, times in roots for _ in range(times)])  # pyright: ignore[reportGeneralTypeIssues]


def polynomial_expression(
    polynomial: flint.fmpq_mpoly, meaning: Sequence[sp.Expr], beside: Sequence[flint.fmpq_mpoly] = ()
) -> sp.Expr:
    """The polynomial, a sum of terms about its centres or of those `beside` it, with `meaning[i]` for generator i."""
    return _sum(*centred(polynomial, meaning, beside))


def centred(
    polynomial: flint.fmpq_mpoly, meaning: Sequence[sp.Expr], beside: Sequence[flint.fmpq_mpoly] = ()
) -> tuple[flint.fmpq_mpoly, list[sp.Expr]]:
    """(Q, m) with Q(m) = P(`meaning`), each generator v replaced by v - c where that makes P shorter.

    (t - c)^4 + x is written so: its expansion cancels near t = c. Tried are the centres of P and of the polynomials
    `beside` it, and taken where no terms cancel that did not: x^2 - 2 x is not (x - 1)^2 - 1.
    """
    meaning, beside = list(meaning), list(beside)
    if len(polynomial) > FACTOR_TERMS:
        return polynomial, meaning
    generators, shortest = polynomial.context().gens(), length(polynomial)
    while True:
        best = None
        for i, centre in _tried(polynomial, beside, meaning):
            further = [v + centre if k == i else v for k, v in enumerate(generators)]
            moved = polynomial.compose(*further)
            found = length(moved) + length(centre)
            if found < shortest and _cancels_no_more(polynomial, moved, i, centre):
                best, shortest = (i, centre, further, moved), found
        if best is None:
            return polynomial, meaning
        i, centre, further, polynomial = best
        meaning[i] -= _sum(centre, meaning)
        beside, shortest = [p.compose(*further) for p in beside], length(polynomial)


def _tried(
    polynomial: flint.fmpq_mpoly, beside: Sequence[flint.fmpq_mpoly], meaning: Sequence[sp.Expr]
) -> Iterator[tuple[int, flint.fmpq_mpoly]]:
    """Generators, each with the centres that are tried; one that is linear has them where it has a centre already."""
    plainly = [m.is_Symbol or m.is_Add for m in meaning]
    for i in (i for i, degree in enumerate(polynomial.degrees()) if degree):
        least = 1 if meaning[i].is_Add else 2
        for p in (p for p in (polynomial, *beside) if p.degrees()[i] >= least):
            for c in middles(p, i):
                yield i, c
                # Of v - t0 + r/9 - 1 with a root r also the centre t0.
                plain = {e: a for e, a in c.to_dict().items() if any(map(int.__mul__, map(int, e), plainly))}
                if 0 < len(plain) < len(c):
                    yield i, c.context().from_dict(plain)


def _cancels_no_more(
    polynomial: flint.fmpq_mpoly, moved: flint.fmpq_mpoly, i: int, centre: flint.fmpq_mpoly
) -> bool:
    """Whether the terms of `moved`, Q(v - c) = P, are no larger than those of P, but for one bit, wherever that is."""
    context = polynomial.context()
    sizes, step = (
        context.from_dict({powers: abs(c) for powers, c in p.to_dict().items()}) for p in (moved, centre)
    )
    far = sizes.compose(*[v + step if k == i else v for k, v in enumerate(context.gens())]).to_dict()
    own = polynomial.to_dict()
    return all(size <= 2 * abs(own.get(powers, 0)) for powers, size in far.items())


def middles(polynomial: flint.fmpq_mpoly, i: int) -> list[flint.fmpq_mpoly]:
    """Of a v^n + b v^(n-1) + ... in generator i, with b = q a + r, the linear -q/n and its number, unless they are 0.

    Powers of v - c about c are one term each.
    """
    degree = int(polynomial.degrees()[i])
    context, rows = polynomial.context(), {degree: {}, degree - 1: {}}
    for exponents, coefficient in polynomial.to_dict().items():
        if exponents[i] in rows:
            rest = tuple(0 if k == i else e for k, e in enumerate(exponents))
            rows[exponents[i]][rest] = coefficient
    leading, lower = (context.from_dict(row) for row in rows.values())
    centre = divmod(lower, leading)[0] * flint.fmpq(-1, degree)
    if centre == 0:
        return []
    number = context.constant(centre[(0,) * context.nvars()])
    linear = [centre] if centre.total_degree() < 2 and centre != number else []
    return linear + [number] * (number != 0)


def length(polynomial: flint.fmpq_mpoly) -> int:
    """Bits of the coefficients and factors of the terms, together."""
    return sum(
        int(c.p).bit_length() + int(c.q).bit_length() + sum(map(int, exponents))
        for exponents, c in polynomial.to_dict().items()
    )


def _sum(polynomial: flint.fmpq_mpoly, meaning: Sequence[sp.Expr]) -> sp.Expr:
    return sp.Add(
        *[
            sp.Mul(rational(coefficient), *[meaning[i] ** int(e) for i, e in enumerate(exponents) if e])
            for exponents, coefficient in polynomial.to_dict().items()
        ]
    )


def horner_expression(
    polynomial: flint.fmpq_mpoly,
    meaning: Sequence[sp.Expr],
    sizes: Sequence[int] = (),
    size: int = 0,
    beside: Sequence[flint.fmpq_mpoly] = (),
) -> sp.Expr:
    """The polynomial over 2^size in nested form about its centres, the generator that occurs in most terms outermost.

    With `sizes` generator i stands in it over 2^sizes[i]. More than `LONGEST` powers of a generator are a sum of nested
    forms, or SymPy's recursions end in the stack's limit.
    """
    polynomial, inner = centred(polynomial, meaning, beside)
    terms = polynomial.to_dict()
    if size or any(sizes):
        powers = {exponents: sum(map(int.__mul__, map(int, exponents), sizes)) for exponents in terms}
        terms = {exponents: c * flint.fmpq(2) ** (powers[exponents] - size) for exponents, c in terms.items()}
        inner = [m * sp.Integer(2) ** -k for m, k in zip(inner, sizes)]
    return _horner(terms, list(range(len(inner))), inner)


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
