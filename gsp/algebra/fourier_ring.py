"""Fourier polynomials in a phase, with coefficients in the localised ring: exact means, integrals and harmonics.

Sine and cosine of the phase are two generators S and C, S^2 + C^2 = 1, so that every element has the one form
p(C) + S q(C), and sums and products are those of the ring. No denominator and no adjoined function holds them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import comb

import flint
import sympy as sp

from gsp.algebra.ring import LocalisedRing
from gsp.algebra.ring_elements import RingElement
from gsp.errors import UnsupportedFunctionError


class FourierRing(LocalisedRing):
    """QQ[coordinates, constants, adjoined functions][cos theta, sin theta], localised; the last derivation is d/dtheta.

    Derivation j is that by coordinate j.

    >>> x = sp.Symbol("x")
    >>> ring = FourierRing([x])
    >>> square = ring.generator(ring.cosine) * ring.generator(ring.cosine) * ring.generator(x)
    >>> ring.to_sympy(ring.mean(square)), ring.in_harmonics(ring.integral(square), sp.Symbol("theta"))
    (x/2, x*sin(2*theta)/4)
    """

    def __init__(
        self,
        coordinates: Sequence[sp.Symbol],
        *,
        constants: Sequence[sp.Symbol] = (),
        functions: bool = False,
    ) -> None:
        self.sine, self.cosine = sp.Dummy("sin"), sp.Dummy("cos")
        n = len(coordinates)
        # The sine first: it leads in sin^2 + cos^2 - 1 in both orderings that the ring may have.
        super().__init__(
            (self.sine, self.cosine, *coordinates), constants=constants, functions=functions, derivations=n + 1
        )
        s, c = self.generator(self.sine), self.generator(self.cosine)
        self.relations.append((s * s + c * c - self.one).numerator)
        for j, symbol in enumerate(coordinates):
            self.set_derivative(symbol, j, self.one)
        self.set_derivative(self.sine, n, c)
        self.set_derivative(self.cosine, n, -s)

    def mean(self, a: RingElement) -> RingElement:
        """The mean over the phase: that of cos^c is binom(c, c/2)/2^c for even c, of all else 0."""
        total = self.zero
        for s, c, part in self._powers_of(a):
            if not s and c % 2 == 0:
                total = total + part * sp.Rational(comb(c, c // 2), 2**c)
        return total.reduced()

    def integral(self, a: RingElement) -> RingElement:
        """u of mean zero with du/dtheta = a - mean(a)."""
        total = self.zero
        sine, cosine = self.generator(self.sine), self._cosine_powers(a)
        for s, c, part in self._powers_of(a):
            if s:
                total = total - part * cosine[c + 1] * sp.Rational(1, c + 1)
                continue
            # int C^c = S C^(c-1)/c + (c-1)/c int C^(c-2); what is left of even powers is the mean's.
            factor = sp.Rational(1, 1)
            while c > 0:
                total = total + part * sine * cosine[c - 1] * (factor / c)
                factor, c = factor * sp.Rational(c - 1, c), c - 2
        return (total - self.mean(total)).reduced()

    def in_harmonics(self, a: RingElement, angle: sp.Expr) -> sp.Expr:
        """The element as a sum of cos k theta and sin k theta with `angle` for theta."""
        found: dict[tuple[bool, int], RingElement] = {}

        def add(is_sine: bool, k: int, part: RingElement) -> None:
            part = -part if is_sine and k < 0 else part
            key = (is_sine, abs(k))
            if not (is_sine and k == 0):
                found[key] = found.get(key, self.zero) + part

        for s, c, part in self._powers_of(a):
            for j in range(c + 1):
                k, share = c - 2 * j, part * sp.Rational(comb(c, j), 2**c)
                if s:
                    add(True, k + 1, share * sp.Rational(1, 2))
                    add(True, k - 1, share * sp.Rational(-1, 2))
                else:
                    add(False, k, share)
        terms = []
        for (is_sine, k), part in sorted(found.items(), key=lambda item: (item[0][1], item[0][0])):
            terms.append(self.to_sympy(part.reduced()) * (sp.sin(k * angle) if is_sine else sp.cos(k * angle)))
        return sp.Add(*terms)

    def _cosine_powers(self, a: RingElement) -> list[RingElement]:
        most = max((c for _, c, _ in self._powers_of(a)), default=0) + 1
        powers = [self.one]
        for _ in range(most):
            powers.append(powers[-1] * self.generator(self.cosine))
        return powers

    def _powers_of(self, a: RingElement) -> Iterator[tuple[int, int, RingElement]]:
        """(power of the sine, of the cosine, what they multiply) for each pair of powers in `a`."""
        a = a.reduced()
        terms = a.numerator.to_dict()
        length = self.context.nvars()
        sine, cosine = (length + self._index[symbol] for symbol in (self.sine, self.cosine))
        rows: dict[tuple[int, int], dict[tuple[int, ...], flint.fmpq]] = {}
        for exponents, coefficient in terms.items():
            rest = tuple(0 if i in (sine, cosine) else int(e) for i, e in enumerate(exponents))
            rows.setdefault((int(exponents[sine]), int(exponents[cosine])), {})[rest] = coefficient
        for (s, c), row in rows.items():
            yield s, c, RingElement(self, self.context.from_dict(row), a.exponents)

    def harmonics_of(self, expression: sp.Expr, phase: sp.Symbol) -> sp.Expr:
        """`expression` as a polynomial in the ring's sine and cosine, which stand for those of `phase`.

        Raises `UnsupportedFunctionError` that names what has no finite Fourier series.
        """
        rule = {}
        for wave in expression.atoms(sp.sin, sp.cos):
            if not wave.has(phase):
                continue
            (angle,) = wave.args
            k = sp.expand(angle).coeff(phase)
            rest = sp.expand(angle - k * phase)
            if rest.has(phase) or not k.is_Integer:
                raise UnsupportedFunctionError(
                    f"{wave} is no harmonic of the phase {phase}, which turns by 2*pi.",
                    f"Write it with whole multiples of {phase}, or take as the phase the angle that they are of.",
                )
            rule[wave] = self._wave(wave, int(k), rest)
        found = expression.xreplace(rule)
        if not found.has(phase) and found.is_polynomial(self.sine, self.cosine):
            return found
        raise UnsupportedFunctionError(
            f"{_infinite(found, phase, self).xreplace({self.sine: sp.sin(phase), self.cosine: sp.cos(phase)})} has no "
            f"finite Fourier series in {phase}.",
            f"Write out as many of its harmonics as matter, or take an angle in which the rates are polynomials in "
            f"the sine and cosine of {phase}.",
        )

    def _wave(self, wave: sp.Expr, k: int, rest: sp.Expr) -> sp.Expr:
        sign, k = (1 if k > 0 else -1), abs(k)
        cosine = sp.chebyshevt(k, self.cosine)
        sine = sign * self.sine * sp.chebyshevu(k - 1, self.cosine)
        if isinstance(wave, sp.cos):
            return cosine if rest == 0 else cosine * sp.cos(rest) - sine * sp.sin(rest)
        return sine if rest == 0 else sine * sp.cos(rest) + cosine * sp.sin(rest)


def _infinite(expression: sp.Expr, phase: sp.Symbol, ring: FourierRing) -> sp.Expr:
    """The smallest part, from the left, that holds the phase otherwise than as a polynomial in sine and cosine."""
    for part in expression.args:
        if part.has(phase) or not part.is_polynomial(ring.sine, ring.cosine):
            inner = _infinite(part, phase, ring)
            # A phase by itself says less than the function that it is in.
            return expression if inner == phase and not (expression.is_Add or expression.is_Mul) else inner
    return expression
