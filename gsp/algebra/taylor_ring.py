"""Truncated Taylor series in one local variable over rational, algebraic or ball coefficients.

The elements support what `SeriesProgram` asks of a ring, so that the coefficients of a series in epsilon may be
functions of the local variable t. Each element knows how many of its coefficients are right.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import flint
import sympy as sp

from gsp.algebra.algebraic_numbers import NumberField, arb
from gsp.algebra.differences import Subtractable
from gsp.algebra.functions import CONSTANTS, RULES
from gsp.algebra.polynomials import rational
from gsp.errors import HyperbolicityError

Scalar = Any
"""`fmpq`, an element of a number field (`fmpq_poly`), or `arb`."""

# Digits in which values that are neither rational nor algebraic are shown.
DIGITS = 50

# Each with its derivative up to a sign: name to (sine, cosine, sign of cosine's derivative).
PARTNERS = {
    "sin": ("sin", "cos", -1),
    "cos": ("sin", "cos", -1),
    "sinh": ("sinh", "cosh", 1),
    "cosh": ("sinh", "cosh", 1),
}


class Inexact(ArithmeticError):
    """A value that is neither rational nor in the number field: balls have to be used."""


class Rationals:
    """Coefficients in QQ."""

    is_exact = True

    def number(self, value: sp.Rational) -> Scalar:
        """A rational number as a scalar."""
        return flint.fmpq(int(value.p), int(value.q))

    def polynomial(self, coefficients: Sequence[Scalar]) -> Any:
        """The polynomial with these coefficients."""
        return flint.fmpq_poly(list(coefficients))

    def multiply(self, a: Any, b: Any, length: int) -> Any:
        """The first `length` coefficients of a product."""
        return a.mul_low(b, length)

    def inverse(self, a: Scalar) -> Scalar:
        """1/a; raises `ZeroDivisionError` when a is, or may be, 0."""
        return 1 / a

    def product(self, a: Scalar, b: Scalar) -> Scalar:
        """The product of two scalars."""
        return a * b

    def function(self, name: str, a: Scalar, exponent: Scalar | None) -> Scalar:
        """The elementary function `name` of a scalar; raises `Inexact` when it leaves the field."""
        rule = RULES.get(name)
        if a == 0 and rule is not None and rule.at_zero is not None:
            return flint.fmpq(rule.at_zero)
        if name == "log" and a == 1:
            return flint.fmpq(0)
        if name == "sign":
            return flint.fmpq((a > 0) - (a < 0))
        if name in ("sqrt", "pow"):
            power = sp.Rational(1, 2) if exponent is None else rational(flint.fmpq(exponent))
            value = rational(flint.fmpq(a)) ** power
            if value.is_Rational:
                return flint.fmpq(int(value.p), int(value.q))
        raise Inexact(name)

    def expression(self, a: Scalar) -> sp.Expr:
        """The scalar as a SymPy number."""
        return rational(a)


class _FieldPolynomial:
    """A polynomial over a number field: a list of elements, with the few operations of a flint polynomial."""

    __slots__ = ("items",)

    def __init__(self, items: list[flint.fmpq_poly]) -> None:
        while items and items[-1].is_zero():
            items.pop()
        self.items = items

    def __getitem__(self, i: int) -> flint.fmpq_poly:
        return self.items[i] if i < len(self.items) else flint.fmpq_poly([0])

    def length(self) -> int:
        return len(self.items)

    def __add__(self, other: _FieldPolynomial) -> _FieldPolynomial:
        count = max(len(self.items), len(other.items))
        return _FieldPolynomial([self[i] + other[i] for i in range(count)])

    def __neg__(self) -> _FieldPolynomial:
        return _FieldPolynomial([-item for item in self.items])

    def __mul__(self, number: Any) -> _FieldPolynomial:
        return _FieldPolynomial([item * number for item in self.items])

    def truncate(self, length: int) -> _FieldPolynomial:
        return _FieldPolynomial(self.items[:length])

    def right_shift(self, places: int) -> _FieldPolynomial:
        return _FieldPolynomial(self.items[places:])

    def derivative(self) -> _FieldPolynomial:
        return _FieldPolynomial([self.items[i] * i for i in range(1, len(self.items))])

    def integral(self) -> _FieldPolynomial:
        shifted = [item * flint.fmpq(1, i + 1) for i, item in enumerate(self.items)]
        return _FieldPolynomial([flint.fmpq_poly([0]), *shifted])


class Algebraic(Rationals):
    """Coefficients in a number field."""

    def __init__(self, field: NumberField) -> None:
        self.field = field

    def number(self, value: sp.Rational) -> Scalar:
        return flint.fmpq_poly([super().number(value)])

    def polynomial(self, coefficients: Sequence[Scalar]) -> Any:
        return _FieldPolynomial(list(coefficients))

    def multiply(self, a: Any, b: Any, length: int) -> Any:
        result = []
        for k in range(min(length, len(a.items) + len(b.items) - 1)):
            total = flint.fmpq_poly([0])
            for i in range(max(0, k - len(b.items) + 1), min(k + 1, len(a.items))):
                total = total + a.items[i] * b.items[k - i]
            result.append(self.field.reduce(total))
        return _FieldPolynomial(result)

    def inverse(self, a: Scalar) -> Scalar:
        return self.field.inverse(a)

    def product(self, a: Scalar, b: Scalar) -> Scalar:
        return self.field.multiply(a, b)

    def function(self, name: str, a: Scalar, exponent: Scalar | None) -> Scalar:
        if a.degree() > 0 or (exponent is not None and exponent.degree() > 0):
            if name == "sign":
                return flint.fmpq_poly([self.field.sign(a)])
            raise Inexact(name)
        return flint.fmpq_poly([super().function(name, a[0], None if exponent is None else exponent[0])])

    def expression(self, a: Scalar) -> sp.Expr:
        return self.field.expression(a)


class Balls(Rationals):
    """Coefficients enclosed in balls, at the precision that python-flint is set to."""

    is_exact = False

    def number(self, value: sp.Rational) -> Scalar:
        return arb(value)

    def polynomial(self, coefficients: Sequence[Scalar]) -> Any:
        return flint.arb_poly(list(coefficients))

    def multiply(self, a: Any, b: Any, length: int) -> Any:
        return (a * b).truncate(length)

    def inverse(self, a: Scalar) -> Scalar:
        if a.contains(0):
            raise ZeroDivisionError("the ball contains 0")
        return 1 / a

    def function(self, name: str, a: Scalar, exponent: Scalar | None) -> Scalar:
        if name == "pi":
            return flint.arb.pi()
        if name == "E":
            return flint.arb.const_e()
        if name == "sign":
            return a.sgn()
        if name == "pow":
            return a**exponent
        return getattr(a, name)()

    def expression(self, a: Scalar) -> sp.Expr:
        """A float of at most `DIGITS` digits, and no more than the radius leaves; 0 where the ball contains it."""
        if a.contains(0):
            return sp.Integer(0)
        digits = max(1, min(DIGITS, int(a.rel_accuracy_bits() * 0.30103)))
        return sp.Float(a.mid().str(digits + 5, radius=False), digits)


class Taylor(Subtractable):
    """sum_j c_j t^j with `length` correct coefficients, in a `TaylorRing`."""

    __slots__ = ("length", "polynomial", "ring")

    def __init__(self, ring: TaylorRing, polynomial: Any, length: int) -> None:
        self.ring = ring
        self.polynomial = polynomial
        self.length = length

    def __getitem__(self, i: int) -> Scalar:
        return self.polynomial[i]

    def __add__(self, other: Taylor | int) -> Taylor:
        if isinstance(other, int):
            other = self.ring.constant(other)
        length = min(self.length, other.length)
        return Taylor(self.ring, (self.polynomial + other.polynomial).truncate(length), length)

    def __neg__(self) -> Taylor:
        return Taylor(self.ring, -self.polynomial, self.length)

    def __mul__(self, other: Taylor | int | sp.Rational) -> Taylor:
        if isinstance(other, int):
            return Taylor(self.ring, self.polynomial * other, self.length)
        if not isinstance(other, Taylor):
            other = self.ring.constant(other)
        length = min(self.length, other.length)
        product = self.ring.scalars.multiply(self.polynomial, other.polynomial, length)
        return Taylor(self.ring, product, length)

    __rmul__ = __mul__

    @property
    def is_zero(self) -> bool:
        """Whether it is known to vanish to the full length of the ring."""
        return self.length == self.ring.length and self.polynomial.length() == 0

    @property
    def key(self) -> tuple:
        """Identity of a constant."""
        return (*(str(self[i]) for i in range(self.polynomial.length())), self.length)

    def reduced(self) -> Taylor:
        """Itself; there is nothing to cancel."""
        return self

    def derivative(self) -> Taylor:
        """d/dt; one coefficient is lost."""
        return Taylor(self.ring, self.polynomial.derivative(), self.length - 1)

    def over_t(self) -> Taylor:
        """Division by t, the constant term being zero (in balls: containing it)."""
        return Taylor(self.ring, self.polynomial.right_shift(1), self.length - 1)

    def inverse(self) -> Taylor:
        """1/self by Newton's iteration v <- v (2 - u v)."""
        try:
            first = self.ring.scalars.inverse(self[0])
        except ZeroDivisionError:
            raise HyperbolicityError("division by a series that vanishes at the point of expansion.") from None
        v, known = self.ring.scalars.polynomial([first]), 1
        while known < self.length:
            known = min(2 * known, self.length)
            result = Taylor(self.ring, v, known)
            v = (result * (-(self * result) + 2)).polynomial
        return Taylor(self.ring, v, self.length)

    def apply(self, name: str, exponent: Taylor | None = None) -> Taylor:
        """The elementary function `name`: v' = rate(v, u) u', one more coefficient at each sweep."""
        ring, scalars = self.ring, self.ring.scalars
        if name == "Abs":
            return self.apply("sign") * self
        power = None if exponent is None else exponent[0]
        first = scalars.function(name, self[0], power)
        start = ring.scalar(first)
        if name in CONSTANTS or name == "sign" or self.polynomial.length() <= 1:
            return Taylor(ring, start.polynomial, self.length)
        slope = self.derivative()
        if name in PARTNERS:
            sine, cosine, sign = PARTNERS[name]
            s0, c0 = (ring.scalar(scalars.function(n, self[0], None)) for n in (sine, cosine))
            s, c = s0, c0
            for _ in range(self.length):
                s, c = s0 + (c * slope).integral(), c0 + (s * slope * sign).integral()
            return Taylor(ring, (s if name == sine else c).polynomial, self.length)
        rule = RULES[name].rate if name in RULES else None
        v = start
        for _ in range(self.length):
            rate = rule(v, self) if rule is not None else exponent * v * self.inverse()  # pyright: ignore
            v = start + (rate * slope).integral()
        return Taylor(ring, v.polynomial, self.length)

    def integral(self) -> Taylor:
        """The primitive that vanishes at t = 0."""
        length = min(self.length + 1, self.ring.length)
        return Taylor(self.ring, self.polynomial.integral().truncate(length), length)


class TaylorRing:
    """Series in t with `length` coefficients in `scalars`."""

    def __init__(self, scalars: Rationals, length: int) -> None:
        self.scalars = scalars
        self.length = length
        self.zero = Taylor(self, scalars.polynomial([]), length)
        self.one = self.constant(1)

    def constant(self, value: sp.Rational | int) -> Taylor:
        """A rational constant."""
        return self.scalar(self.scalars.number(sp.Rational(value)))

    def scalar(self, value: Scalar, *, slope: int = 0) -> Taylor:
        """The series value + slope t."""
        items = [value] if not slope else [value, self.scalars.number(sp.Rational(slope))]
        return Taylor(self, self.scalars.polynomial(items[: self.length]), self.length)


def midpoint_sum(coefficients: list[Any], t: Any) -> Any:
    """The middle of sum_k coefficients[k] t^k, lowest first, by Horner's rule in balls."""
    total = flint.arb(0)
    for coefficient in reversed(coefficients):
        total = total * t + coefficient
    return total.mid()
