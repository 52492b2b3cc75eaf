"""Rational functions in exact arithmetic, for the checker: whether two expressions are the same function.

Only the standard library is used, and nothing of the prover. An element is a polynomial, a dictionary from exponents
to fractions, times whole powers of factors, which are polynomials too. Nothing is cancelled: a sum takes the lowest
powers out, and what is zero has no terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from gsp.proofs.programs import IntervalProgram, NotRational, Rejected

Polynomial = dict[tuple[int, ...], Fraction]
# Operations on terms that one proof may take, factors, and bits of a power of a number: seconds. An operation on longer
# numbers counts as the square of how many times LONG bits they have, for so the greatest common divisor goes.
MOST_PRODUCTS, MOST_FACTORS, MOST_BITS, LONG = 500_000, 200, 20_000, 256


class FactoredFraction:
    """A polynomial times powers of the factors, by their places; 0 has none."""

    __slots__ = ("numerator", "powers")

    def __init__(self, numerator: Polynomial, powers: dict[int, int]) -> None:
        self.numerator = numerator
        self.powers = {k: power for k, power in powers.items() if power} if numerator else {}


class RationalFunctions:
    """Arithmetic of rational functions of so many `variables`; raises `Rejected` where it grows too large."""

    def __init__(self, variables: int) -> None:
        self.variables = variables
        self.factors: list[Polynomial] = []
        self._places: dict[tuple, int] = {}
        self._products = 0

    def constant(self, value: Fraction) -> FactoredFraction:
        """A number."""
        return FactoredFraction({(0,) * self.variables: value} if value else {}, {})

    def variable(self, place: int) -> FactoredFraction:
        """A variable by its place."""
        return FactoredFraction({tuple(int(k == place) for k in range(self.variables)): Fraction(1)}, {})

    def add(self, a: FactoredFraction, b: FactoredFraction, sign: int = 1) -> FactoredFraction:
        """a + sign b."""
        if not b.numerator:
            return a
        if not a.numerator:
            return FactoredFraction(
                {exponents: sign * value for exponents, value in b.numerator.items()}, b.powers
            )
        least = {k: min(a.powers.get(k, 0), b.powers.get(k, 0)) for k in {*a.powers, *b.powers}}
        return FactoredFraction(self._sum(self._over(a, least), self._over(b, least), sign), least)

    def multiply(self, a: FactoredFraction, b: FactoredFraction) -> FactoredFraction:
        """a b."""
        powers = dict(a.powers)
        for k, power in b.powers.items():
            powers[k] = powers.get(k, 0) + power
        return FactoredFraction(self._product(a.numerator, b.numerator), powers)

    def power(self, a: FactoredFraction, exponent: int) -> FactoredFraction:
        """a**exponent, whole; the numerator becomes a factor unless it is a single term."""
        if exponent == 0:
            return self.constant(Fraction(1))
        if not a.numerator:
            if exponent < 0:
                raise Rejected("an expression divides by 0")
            return a
        powers = {k: p * exponent for k, p in a.powers.items()}
        if len(a.numerator) == 1 and (exponent > 0 or not any(next(iter(a.numerator)))):
            ((exponents, value),) = a.numerator.items()
            return FactoredFraction({tuple(e * exponent for e in exponents): _power(value, exponent)}, powers)
        place, scale = self._factor(a.numerator)
        powers[place] = powers.get(place, 0) + exponent
        return FactoredFraction({(0,) * self.variables: _power(scale, exponent)}, powers)

    def derivative(self, a: FactoredFraction, place: int) -> FactoredFraction:
        """The partial derivative by a variable: (N' + N sum e_i F_i'/F_i) times the same powers."""
        moving = [k for k in a.powers if self._by(self.factors[k], place)]
        total = self._by(a.numerator, place)
        for k in moving:
            total = self._product(total, self.factors[k])
        for k in moving:
            part = self._product(a.numerator, self._by(self.factors[k], place))
            for other in moving:
                if other != k:
                    part = self._product(part, self.factors[other])
            total = self._sum(total, part, a.powers[k])
        return FactoredFraction(total, {k: power - (k in moving) for k, power in a.powers.items()})

    def evaluate(
        self, program: IntervalProgram, arguments: Sequence[FactoredFraction]
    ) -> list[FactoredFraction]:
        """The outputs of a program of sums, products, quotients and whole powers."""
        found = list(arguments)
        for name, one, two in program.code:
            if name == "constant":
                found.append(self.constant(one))
            elif name in ("+", "-"):
                found.append(self.add(found[one], found[two], 1 if name == "+" else -1))
            elif name == "*":
                found.append(self.multiply(found[one], found[two]))
            elif name == "/":
                found.append(self.multiply(found[one], self.power(found[two], -1)))
            elif name == "**" and two.denominator == 1:
                found.append(self.power(found[one], int(two)))
            else:
                raise NotRational(f"an identity is checked between rational functions. Got {name}")
        return [found[place] for place in program.outputs]

    # -- polynomials -------------------------------------------------------------------------------

    def _spend(self, terms: int, *polynomials: Polynomial) -> None:
        """Count operations on so many terms of polynomials; raises `Rejected` when there were too many."""
        bits = sum(max(map(_bits, p.values()), default=0) for p in polynomials)
        self._products += terms * (1 + (bits // LONG) ** 2)
        if self._products > MOST_PRODUCTS:
            raise Rejected(f"an identity takes more than {MOST_PRODUCTS} products of terms")

    def _sum(self, a: Polynomial, b: Polynomial, factor: int) -> Polynomial:
        """a + factor b."""
        self._spend(len(b), a, b)
        total = a | {exponents: a.get(exponents, 0) + factor * value for exponents, value in b.items()}
        return {exponents: value for exponents, value in total.items() if value}

    def _product(self, a: Polynomial, b: Polynomial) -> Polynomial:
        self._spend(len(a) * len(b), a, b)
        if len(a) > len(b):
            a, b = b, a
        total: Polynomial = {}
        for one, first in a.items():
            for two, second in b.items():
                exponents = tuple(map(int.__add__, one, two))
                total[exponents] = total.get(exponents, 0) + first * second
        return {exponents: value for exponents, value in total.items() if value}

    def _over(self, a: FactoredFraction, least: dict[int, int]) -> Polynomial:
        """The numerator of an element over lower powers of the factors."""
        total = a.numerator
        for k in {*a.powers, *least}:
            for _ in range(a.powers.get(k, 0) - least.get(k, 0)):
                total = self._product(total, self.factors[k])
        return total

    def _factor(self, polynomial: Polynomial) -> tuple[int, Fraction]:
        """The place of a polynomial among the factors, and by how much it is larger than the one there."""
        self._spend(len(polynomial), polynomial)
        scale = polynomial[max(polynomial)]
        key = tuple(sorted((exponents, value / scale) for exponents, value in polynomial.items()))
        if key not in self._places:
            if len(self.factors) >= MOST_FACTORS:
                raise Rejected(f"an identity has more than {MOST_FACTORS} denominators")
            self._places[key] = len(self.factors)
            self.factors.append(dict(key))
        return self._places[key], scale

    @staticmethod
    def _by(polynomial: Polynomial, place: int) -> Polynomial:
        return {
            tuple(e - (k == place) for k, e in enumerate(exponents)): value * exponents[place]
            for exponents, value in polynomial.items()
            if exponents[place]
        }


def _power(value: Fraction, exponent: int) -> Fraction:
    if _bits(value) * abs(exponent) > MOST_BITS:
        raise Rejected(f"a power of a number has more than {MOST_BITS} bits")
    return value**exponent


def _bits(value: Fraction) -> int:
    return max(value.numerator.bit_length(), value.denominator.bit_length())
