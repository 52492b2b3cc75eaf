"""Exact functions of fast time: sums of c tau^n exp(lambda tau) with rational c and lambda.

They are what the layer of a system that is linear in its fast variables is made of. Elements and ring have the
operations of `gsp.algebra.ring`, so that a `SeriesProgram` runs over them; what leads out of the class raises
`NotClosed`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import isqrt

import flint
import numpy as np
import sympy as sp

from gsp.algebra.differences import Subtractable
from gsp.algebra.functions import RULES
from gsp.algebra.rational_matrices import rational_eigenvectors, rational_matrix


class NotClosed(Exception):
    """An operation whose result is no exponential polynomial with rational coefficients."""


class ExponentialPolynomial(Subtractable):
    """sum over rates lambda and powers n of c tau^n exp(lambda tau); `terms` maps lambda to (c_0, c_1, ...)."""

    __slots__ = ("ring", "terms")

    def __init__(self, ring: ExponentialRing, terms: Mapping[Fraction, Sequence[Fraction]]) -> None:
        self.ring = ring
        kept: dict[Fraction, tuple[Fraction, ...]] = {}
        for rate, coefficients in terms.items():
            n = len(coefficients)
            while n and not coefficients[n - 1]:
                n -= 1
            if n:
                kept[rate] = tuple(coefficients[:n])
        self.terms = kept

    def __add__(self, other: ExponentialPolynomial | int) -> ExponentialPolynomial:
        if isinstance(other, int):
            other = self.ring.constant(other)
        terms = {rate: list(c) for rate, c in self.terms.items()}
        for rate, coefficients in other.terms.items():
            own = terms.setdefault(rate, [])
            own += [Fraction(0)] * (len(coefficients) - len(own))
            for n, c in enumerate(coefficients):
                own[n] += c
        return ExponentialPolynomial(self.ring, terms)

    def __mul__(self, other: ExponentialPolynomial | int | Fraction | sp.Rational) -> ExponentialPolynomial:
        if not isinstance(other, ExponentialPolynomial):
            number = _fraction(other)
            return ExponentialPolynomial(self.ring, {r: [c * number for c in p] for r, p in self.terms.items()})
        terms: dict[Fraction, list[Fraction]] = {}
        for rate, p in self.terms.items():
            for other_rate, q in other.terms.items():
                own = terms.setdefault(rate + other_rate, [])
                own += [Fraction(0)] * (len(p) + len(q) - 1 - len(own))
                for i, a in enumerate(p):
                    for j, b in enumerate(q):
                        own[i + j] += a * b
        return ExponentialPolynomial(self.ring, terms)

    __rmul__ = __mul__

    @property
    def is_zero(self) -> bool:
        """Whether there is no term."""
        return not self.terms

    @property
    def key(self) -> tuple:
        """A hashable identity."""
        return tuple(sorted(self.terms.items()))

    def reduced(self) -> ExponentialPolynomial:
        """The element itself: its representation is unique."""
        return self

    def inverse(self) -> ExponentialPolynomial:
        """1/self of a constant."""
        return self.ring.constant(1 / self._constant())

    def apply(self, name: str, exponent: ExponentialPolynomial | None = None) -> ExponentialPolynomial:
        """An elementary function of a constant at which it is rational."""
        value = self._constant()
        if name == "sign":
            return self.ring.constant((value > 0) - (value < 0))
        if name == "Abs":
            return self.ring.constant(abs(value))
        if name == "sqrt" and value >= 0:
            root = Fraction(isqrt(value.numerator), isqrt(value.denominator))
            if root * root == value:
                return self.ring.constant(root)
        if value == 0 and name in RULES and RULES[name].at_zero is not None:
            return self.ring.constant(RULES[name].at_zero)
        if value == 0 and exponent is not None and exponent._constant() > 0:
            return self.ring.zero
        raise NotClosed

    def solve(self, rate: Fraction, initial: Fraction) -> ExponentialPolynomial:
        """u with u' = rate u + self and u(0) = initial; with rate 0 the integral."""
        terms: dict[Fraction, list[Fraction]] = {}
        at_zero = Fraction(0)
        for own, p in self.terms.items():
            if own == rate:
                terms[own] = [Fraction(0), *(c / (n + 1) for n, c in enumerate(p))]
                continue
            # u = q exp(own tau) with q' + (own - rate) q = p, from the highest power down.
            q = [Fraction(0)] * (len(p) + 1)
            for n in reversed(range(len(p))):
                q[n] = (p[n] - (n + 1) * q[n + 1]) / (own - rate)
            terms[own] = q
            at_zero += q[0]
        homogeneous = terms.setdefault(rate, [Fraction(0)])
        homogeneous[0] += initial - at_zero
        return ExponentialPolynomial(self.ring, terms)

    @property
    def growing(self) -> Fraction:
        """The largest rate when it is positive, else 0."""
        return max([Fraction(0), *self.terms])

    @property
    def outer(self) -> tuple[Fraction, ...]:
        """Coefficients of the polynomial that remains when the exponentials have decayed; at least one."""
        return self.terms.get(Fraction(0), (Fraction(0),))

    def decaying(self, tau: np.ndarray) -> np.ndarray:
        """Values (m,) of the exponential terms."""
        total = np.zeros(len(tau))
        for rate, p in self.terms.items():
            if rate != 0:
                total += np.exp(float(rate) * tau) * np.polyval([float(c) for c in reversed(p)], tau)
        return total

    def to_sympy(self, tau: sp.Symbol) -> sp.Expr:
        """The same as an expression in `tau`."""
        return sp.Add(
            *[
                sp.Rational(c.numerator, c.denominator)
                * tau**n
                * sp.exp(sp.Rational(rate.numerator, rate.denominator) * tau)
                for rate, p in sorted(self.terms.items(), reverse=True)
                for n, c in enumerate(p)
            ]
        )

    def _constant(self) -> Fraction:
        value, *rest = self.outer
        if rest or any(rate != 0 for rate in self.terms):
            raise NotClosed
        return value


class ExponentialRing:
    """The ring of exponential polynomials, with the solution of the linear layer Y' = A Y + R.

    `matrix` A (n, n) must be rational, diagonalisable and have rational eigenvalues; otherwise `NotClosed`.

    >>> from gsp.algebra.exponential_polynomials import ExponentialRing
    >>> ring = ExponentialRing(sp.Matrix([[-2]]))
    >>> ring.fast([ring.one], [Fraction(0)])[0].to_sympy(sp.Symbol("tau"))
    1/2 - exp(-2*tau)/2
    """

    def __init__(self, matrix: sp.Matrix) -> None:
        exact = rational_matrix(matrix)
        pairs = None if exact is None else rational_eigenvectors(exact)
        if pairs is None:
            raise NotClosed
        n = matrix.rows
        vectors = flint.fmpq_mat(n, n, [vector[i] for i in range(n) for _, vector in pairs])  # pyright: ignore[reportCallIssue]
        self.rates = [_fraction(rate) for rate, _ in pairs]
        self._vectors, self._inverse = (
            [[_fraction(e) for e in row] for row in m.tolist()] for m in (vectors, vectors.inv())
        )
        self.zero = ExponentialPolynomial(self, {})
        self.one = self.constant(1)

    def constant(self, value) -> ExponentialPolynomial:
        """A rational number as an element."""
        return ExponentialPolynomial(self, {Fraction(0): (_fraction(value),)})

    def slow(self, rate: ExponentialPolynomial, initial: Fraction) -> ExponentialPolynomial:
        """X with X' = rate and X(0) = initial."""
        return rate.solve(Fraction(0), initial)

    def fast(
        self, rest: Sequence[ExponentialPolynomial], initial: Sequence[Fraction]
    ) -> list[ExponentialPolynomial]:
        """Y with Y' = A Y + rest and Y(0) = initial."""
        n = range(len(rest))
        modes = [
            self._combined(self._inverse[i], rest).solve(
                self.rates[i], sum((self._inverse[i][j] * initial[j] for j in n), Fraction(0))
            )
            for i in n
        ]
        return [self._combined(self._vectors[i], modes) for i in n]

    def _combined(self, row: Sequence[Fraction], elements: Sequence[ExponentialPolynomial]):
        total = self.zero
        for c, element in zip(row, elements):
            if c:
                total = total + element * c
        return total


def _fraction(value) -> Fraction:
    if isinstance(value, (int, Fraction)):
        return Fraction(value)
    if not isinstance(value, flint.fmpq):
        value = sp.Rational(value)
    return Fraction(int(value.p), int(value.q))
