"""Taylor polynomials in several variables about a point, over the rationals or a number field.

An element is the list of its homogeneous parts, so that a product takes none of the terms that are cut off. A function
v = F(u) follows from dv/du = rate(v, u) by Euler's operator E = sum_i x_i d/dx_i, which multiplies a part by its
degree: E v = rate(v, u) E u, one degree after another.
"""

from __future__ import annotations

from collections.abc import Sequence

import flint
import sympy as sp

from gsp.algebra.algebraic_numbers import NumberField, arb
from gsp.algebra.differences import Subtractable
from gsp.algebra.functions import CONSTANTS, RULES
from gsp.algebra.polynomials import rational
from gsp.algebra.precision import precision
from gsp.algebra.taylor_ring import PARTNERS, Balls, Inexact, Rationals
from gsp.errors import HyperbolicityError

Polynomial = flint.fmpq_mpoly

# Values that no formula gives are taken to so many bits, and count as zero below the square root of a unit in them.
BITS = 256
ZERO = flint.fmpq(1, 2 ** (BITS // 2))
# In which they are shown, where they are no such fractions.
DIGITS, DENOMINATOR = 15, 1000


class LocalRing:
    """Taylor polynomials of total degree `degree` in `size` variables over `field`, or over QQ where there is none.

    `is_exact` is false once a value has entered that is in no such field: then numbers below `ZERO` count as zero.
    """

    def __init__(self, size: int, degree: int, field: NumberField | None = None, is_exact: bool = True) -> None:
        self.size, self.degree, self.field, self.is_exact = size, degree, field, is_exact
        names = ("t", *(f"x{i}" for i in range(size)))
        self.context = flint.fmpq_mpoly_ctx.get(names, "lex")
        self.theta, *self.generators = self.context.gens()
        self.nothing = self.context.constant(0)
        self._minimal = None if field is None else self.element(field.minimal)
        self.zero = LocalSeries(self, [])
        self.one = self.constant(sp.Integer(1))

    def element(self, value: flint.fmpq_poly) -> Polynomial:
        """An element of the number field."""
        return self.context.from_dict(
            {(i, *(0,) * self.size): c for i, c in enumerate(value.coeffs()) if c != 0}
        )

    def constant(self, value: sp.Rational) -> LocalSeries:
        """A rational constant."""
        return self.scalar(self.context.constant(flint.fmpq(int(value.p), int(value.q))))

    def scalar(self, value: Polynomial) -> LocalSeries:
        """The constant series of a polynomial in theta."""
        return LocalSeries(self, [value])

    def variable(self, i: int) -> LocalSeries:
        """The variable i."""
        return LocalSeries(self, [self.nothing, self.generators[i]])

    def reduced(self, value: Polynomial) -> Polynomial:
        """`value` with theta below the degree of its minimal polynomial, and without what counts as zero."""
        if self._minimal is not None and not value.is_zero():
            value = value % self._minimal
        if self.is_exact:
            return value
        return self.context.from_dict({m: _rounded(c) for m, c in value.to_dict().items() if abs(c) > ZERO})

    def inverse(self, value: Polynomial) -> Polynomial:
        """1/value of a constant; raises `ZeroDivisionError` for 0."""
        if value.is_zero():
            raise ZeroDivisionError("0 has no inverse")
        if value.is_constant():
            return self.context.constant(1 / flint.fmpq(value.leading_coefficient()))
        assert self.field is not None
        return self.element(self.field.inverse(self.coordinates(value)))

    def coordinates(self, value: Polynomial) -> flint.fmpq_poly:
        """A constant as a polynomial in theta."""
        terms = {int(m[0]): c for m, c in value.to_dict().items()}
        return flint.fmpq_poly([terms.get(i, 0) for i in range(max(terms, default=0) + 1)])

    def expression(self, value: Polynomial) -> sp.Expr:
        """A constant as a number of SymPy's: exact, or a float of as many digits as are known."""
        if self.field is not None:
            return self.field.expression(self.coordinates(value))
        number = rational(value.leading_coefficient()) if not value.is_zero() else sp.Integer(0)
        simple = number.limit_denominator(DENOMINATOR)
        if self.is_exact or abs(number - simple) < rational(ZERO):
            return number if self.is_exact else sp.Rational(simple)
        return sp.Float(number, DIGITS)

    def function(self, name: str, value: Polynomial, exponent: flint.fmpq | None) -> Polynomial:
        """An elementary function of a constant."""
        if value.is_constant():
            number = flint.fmpq(0) if value.is_zero() else flint.fmpq(value.leading_coefficient())
            try:
                return self.context.constant(Rationals().function(name, number, exponent))
            except Inexact:
                pass
        with precision(BITS + 64):
            ball = (
                arb(rational(number)) if self.field is None else self.field.ball(self.coordinates(value), BITS)
            )
            found = Balls().function(name, ball, exponent if exponent is None else arb(rational(exponent)))
            if not found.is_finite():
                raise HyperbolicityError(f"{name} has no finite value at the point of expansion.")
            mantissa, power = found.mid().man_exp()
        self.is_exact = False
        return self.context.constant(flint.fmpq(mantissa) * flint.fmpq(2) ** int(power))


def _rounded(value: flint.fmpq) -> flint.fmpq:
    """A number that is not exact to `BITS` bits: products of fractions grow by those of both."""
    above, below = int(value.p), int(value.q)
    shift = BITS - above.bit_length() + below.bit_length()
    if max(above.bit_length(), below.bit_length()) <= BITS or shift <= 0:
        return value
    return flint.fmpq((above << shift) // below, 1 << shift)


class LocalSeries(Subtractable):
    """A Taylor polynomial of a `LocalRing`: `parts[k]` is homogeneous of degree k; what is not there is zero."""

    __slots__ = ("parts", "ring")

    def __init__(self, ring: LocalRing, parts: Sequence[Polynomial]) -> None:
        self.ring = ring
        self.parts = list(parts[: ring.degree + 1])

    def __getitem__(self, k: int) -> Polynomial:
        return self.parts[k] if k < len(self.parts) else self.ring.nothing

    def __add__(self, other: LocalSeries | int) -> LocalSeries:
        if isinstance(other, int):
            other = self.ring.constant(sp.Integer(other))
        ring, count = self.ring, max(len(self.parts), len(other.parts))
        total = [self[k] + other[k] for k in range(count)]
        # What cancels leaves the rounding of its terms.
        return LocalSeries(ring, total if ring.is_exact else [ring.reduced(part) for part in total])

    def __mul__(self, other: LocalSeries | int | sp.Rational) -> LocalSeries:
        if not isinstance(other, LocalSeries):
            number = flint.fmpq(int(sp.Rational(other).p), int(sp.Rational(other).q))
            return LocalSeries(self.ring, [part * number for part in self.parts])
        if not self.parts or not other.parts:
            return self.ring.zero
        count = min(self.ring.degree + 1, len(self.parts) + len(other.parts) - 1)
        parts = [self.ring.nothing] * count
        for i, left in enumerate(self.parts):
            if left.is_zero():
                continue
            for j, right in enumerate(other.parts[: count - i]):
                parts[i + j] = parts[i + j] + left * right
        return LocalSeries(self.ring, [self.ring.reduced(part) for part in parts])

    __rmul__ = __mul__

    @property
    def is_zero(self) -> bool:
        """Whether all its parts vanish."""
        return all(part.is_zero() for part in self.parts)

    def is_rounding_of(self, other: LocalSeries) -> bool:
        """Whether it is zero beside `other`, degree by degree: exactly, where all numbers are exact."""
        if self.ring.is_exact:
            return self.is_zero
        sizes = [max(map(abs, other[k].coeffs()), default=flint.fmpq(0)) for k in range(len(self.parts))]
        return all(abs(c) <= ZERO * size for part, size in zip(self.parts, sizes) for c in part.coeffs())

    def inverse(self) -> LocalSeries:
        """1/self by v = v_0 (1 - (u - u_0) v), one more degree at each step."""
        try:
            first = self.ring.scalar(self.ring.inverse(self[0]))
        except ZeroDivisionError:
            raise HyperbolicityError("division by a series that vanishes at the point of expansion.") from None
        rest, v = LocalSeries(self.ring, [self.ring.nothing, *self.parts[1:]]), first
        for _ in range(self.ring.degree):
            v = first - first * rest * v
        return v

    def apply(self, name: str, exponent: LocalSeries | None = None) -> LocalSeries:
        """The elementary function `name` of u."""
        if name == "pow" and exponent is not None and any(not part.is_zero() for part in exponent.parts[1:]):
            return (exponent * self.apply("log")).apply("exp")
        power = None if exponent is None else flint.fmpq(exponent[0].leading_coefficient())
        slope = LocalSeries(self.ring, [part * k for k, part in enumerate(self.parts)])
        if name == "sign" and self[0].is_zero() and not slope.is_zero:
            raise HyperbolicityError("the field is not smooth at the point of expansion.")
        start = self.ring.scalar(self.ring.function(name, self[0], power))
        if slope.is_zero or name == "sign" or name in CONSTANTS:
            return start

        def integrated(first: LocalSeries, rate: LocalSeries) -> LocalSeries:
            change = (rate * slope).parts
            return LocalSeries(
                self.ring, [first[0], *(part * flint.fmpq(1, k) for k, part in enumerate(change) if k)]
            )

        if name in PARTNERS:
            sine, cosine, sign = PARTNERS[name]
            s0, c0 = (self.ring.scalar(self.ring.function(n, self[0], None)) for n in (sine, cosine))
            s, c = s0, c0
            for _ in range(self.ring.degree):
                s, c = integrated(s0, c), integrated(c0, s * sign)
            return s if name == sine else c
        rule, v = RULES[name].rate if name in RULES else None, start
        for _ in range(self.ring.degree):
            rate = rule(v, self) if rule is not None else exponent * v * self.inverse()  # pyright: ignore
            v = integrated(start, rate)
        return v

    def derivative(self, i: int) -> LocalSeries:
        """The derivative with respect to variable i; its last part is lost."""
        return LocalSeries(self.ring, [part.derivative(i + 1) for part in self.parts[1:]])

    def powers(self, i: int) -> list[LocalSeries]:
        """The coefficients of 1, x_i, x_i^2, ..., series in the other variables."""
        found = [[{} for _ in self.parts] for _ in self.parts]
        for k, part in enumerate(self.parts):
            for m, c in part.to_dict().items():
                power = int(m[i + 1])
                found[power][k - power][(*m[: i + 1], 0, *m[i + 2 :])] = c
        return [LocalSeries(self.ring, [self.ring.context.from_dict(p) for p in terms]) for terms in found]

    def with_variable(self, i: int, image: LocalSeries) -> LocalSeries:
        """The series with `image`, which vanishes at the point, in place of variable i: Horner's scheme."""
        total = self.ring.zero
        for coefficient in reversed(self.powers(i)):
            total = total * image + coefficient
        return total

    def without(self, variables: Sequence[int]) -> LocalSeries:
        """The terms that hold none of the `variables`."""
        return LocalSeries(
            self.ring,
            [
                self.ring.context.from_dict(
                    {m: c for m, c in part.to_dict().items() if not any(m[i + 1] for i in variables)}
                )
                for part in self.parts
            ],
        )

    def slope(self, i: int) -> Polynomial:
        """The coefficient of variable i in the linear part."""
        return self[1].derivative(i + 1)

    def terms(self) -> list[tuple[tuple[int, ...], Polynomial]]:
        """(exponents, coefficient) of its terms, lowest degree first; coefficients are polynomials in theta."""
        found: dict[tuple[int, ...], dict] = {}
        for part in self.parts:
            for m, c in part.to_dict().items():
                own = found.setdefault(tuple(map(int, m[1:])), {})
                own[(int(m[0]), *(0,) * self.ring.size)] = c
        return [(m, self.ring.context.from_dict(c)) for m, c in found.items()]
