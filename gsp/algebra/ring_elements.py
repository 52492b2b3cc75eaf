"""Elements N / D^e of a localised polynomial ring."""

from __future__ import annotations

from itertools import zip_longest
from typing import TYPE_CHECKING

import flint
import sympy as sp

from gsp.algebra.differences import Subtractable
from gsp.algebra.functions import CONSTANTS, RULES
from gsp.errors import HyperbolicityError

if TYPE_CHECKING:
    from gsp.algebra.ring import LocalisedRing


class RingElement(Subtractable):
    """N / D^e in a `LocalisedRing`; supports + - * with elements and integers."""

    __slots__ = ("_numerator", "_written", "exponents", "ring")

    def __init__(self, ring: LocalisedRing, numerator: flint.fmpq_mpoly, exponents: tuple[int, ...]) -> None:
        self.ring = ring
        self._numerator = numerator
        self.exponents = exponents

    @property
    def numerator(self) -> flint.fmpq_mpoly:
        """N, in the generators that the ring has by now."""
        if self._numerator.context() is not self.ring.context:
            self._numerator = self._numerator.project_to_context(self.ring.context)
        return self._numerator

    def __add__(self, other: RingElement | int) -> RingElement:
        if isinstance(other, int):
            other = self.ring.constant(other)
        common = self.exponents
        if common != other.exponents:
            common = exponents_maximum(common, other.exponents)
        return RingElement(self.ring, self.ring.formed(self._over(common) + other._over(common)), common)

    def __neg__(self) -> RingElement:
        return RingElement(self.ring, -self.numerator, self.exponents)

    def __mul__(self, other: RingElement | int | flint.fmpq | sp.Rational) -> RingElement:
        if isinstance(other, RingElement):
            exponents = exponents_sum(self.exponents, other.exponents)
            return RingElement(self.ring, self.ring.product(self.numerator, other.numerator), exponents)
        if isinstance(other, sp.Rational):
            return self * self.ring.constant(other)
        return RingElement(self.ring, self.numerator * other, self.exponents)

    __rmul__ = __mul__

    @property
    def length(self) -> int:
        """Terms of the numerator."""
        return len(self.numerator)

    @property
    def is_zero(self) -> bool:
        """Whether the numerator is the zero polynomial."""
        return self.numerator == 0

    def written(self) -> sp.Expr:
        """`LocalisedRing.horner` of this element, made once: reduced flows of every order hold the same elements."""
        known = getattr(self, "_written", None)
        if known is None or known[0] != self.ring.sizes:
            known = self._written = (dict(self.ring.sizes), self.ring.horner(self))
        return known[1]

    def _over(self, exponents: tuple[int, ...]) -> flint.fmpq_mpoly:
        numerator = self.numerator
        own = self.exponents
        for i, exponent in enumerate(exponents):
            missing = exponent - (own[i] if i < len(own) else 0)
            if missing:
                numerator = self.ring.product(numerator, self.ring.denominator_power(i, missing))
        return numerator

    @property
    def key(self) -> tuple:
        """A hashable identity of this representation."""
        return (str(self.numerator), self.exponents)

    def apply(self, name: str, exponent: RingElement | None = None) -> RingElement:
        """The elementary function `name` of this element, adjoined to the ring; "pow" takes an exponent."""
        if name == "sign":
            return self._sign()
        if name == "pow":
            assert exponent is not None
            if not self.ring.is_constant(exponent):
                return (exponent * self.apply("log")).apply("exp")
            number = number_of(exponent.reduced())
            if number is None:
                return self.ring.adjoin(name, self.reduced(), exponent.reduced())
            # x^(3/2) is a power of the generator sqrt(x), so that the two are not independent.
            if number.q == 1:
                return power(self, int(number.p))
            if number.q == 2:
                return power(self.apply("sqrt"), int(number.p))
            unit = self.ring.constant(sp.Rational(1, int(number.q)))
            return power(self.ring.adjoin(name, self.reduced(), unit), int(number.p))
        if self.is_zero and name in RULES and RULES[name].at_zero is not None:
            return self.ring.constant(RULES[name].at_zero)
        return self.ring.adjoin(name, self.ring.zero if name in CONSTANTS else self.reduced())

    def _sign(self) -> RingElement:
        """sign(u), made once for u, its multiples and -u."""
        own = self.reduced()
        if own.is_zero:
            # SymPy's sign(0). A series whose argument then leaves 0 is refused by `SeriesProgram`.
            return own
        leading = own.numerator.leading_coefficient()
        one = self.ring.one if leading > 0 else -self.ring.one
        if number_of(own) is not None:
            return one
        return one * self.ring.adjoin("sign", own * (1 / flint.fmpq(leading)))

    def reduced(self) -> RingElement:
        """The same element with every common factor of numerator and denominator divided out."""
        numerator, exponents = self.numerator, list(self.exponents)
        for relation in self.ring.relations:
            self.ring.spend(numerator, relation)
            numerator = numerator % relation
        if numerator == 0:
            return self.ring.zero
        for i in range(len(exponents)):
            while exponents[i]:
                self.ring.spend(numerator, self.ring.denominators[i])
                quotient, remainder = divmod(numerator, self.ring.denominators[i])
                if remainder != 0:
                    break
                numerator, exponents[i] = quotient, exponents[i] - 1
        # However many denominators the ring has by now: the keys of equal elements are equal.
        while exponents and not exponents[-1]:
            exponents.pop()
        return RingElement(self.ring, numerator, tuple(exponents))

    def inverse(self) -> RingElement:
        """1 / self; the irreducible factors of the numerator become denominators of the ring."""
        ring, own = self.ring, self.reduced()
        if own.is_zero:
            raise HyperbolicityError("division by an expression that vanishes identically on the branch.")
        ring.require_factorable(own.numerator)
        content, factors = own.numerator.factor()
        exponents: list[int] = []
        rationalised = ring.one
        for factor, multiplicity in factors:
            leading = factor.leading_coefficient()
            content = content * leading**multiplicity
            monic = factor * (1 / flint.fmpq(leading))
            root = next((reciprocal for v, reciprocal in ring.roots if v == monic), None)
            if root is not None:
                rationalised = rationalised * power(root(), multiplicity)
                continue
            i, quotient = ring.denominator_index(monic)
            content = content / quotient**multiplicity
            exponents += [0] * (len(ring.denominators) - len(exponents))
            exponents[i] += multiplicity
        numerator = ring.one.numerator * (1 / flint.fmpq(content))
        for i, exponent in enumerate(own.exponents):
            if exponent:
                numerator = ring.product(numerator, ring.denominator_power(i, exponent))
        return (RingElement(ring, numerator, tuple(exponents)) * rationalised).reduced()


def power(a: RingElement, exponent: int) -> RingElement:
    """An integer power of an element."""
    if exponent < 0:
        return power(a.inverse(), -exponent)
    result = a.ring.one
    for _ in range(exponent):
        result = result * a
    return result


def number_of(a: RingElement) -> flint.fmpq | None:
    """The rational number that `a` is, or None."""
    if a.is_zero:
        return flint.fmpq(0)
    if any(a.exponents) or not a.numerator.is_constant():
        return None
    return flint.fmpq(a.numerator.leading_coefficient())


def exponents_maximum(a: tuple[int, ...], b: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(map(max, zip_longest(a, b, fillvalue=0)))


def exponents_sum(a: tuple[int, ...], b: tuple[int, ...]) -> tuple[int, ...]:
    if not (a and b):
        return a or b
    return tuple(map(sum, zip_longest(a, b, fillvalue=0)))
