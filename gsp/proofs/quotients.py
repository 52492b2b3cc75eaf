"""Products f^k B^p with B = sum_j c_j f^j and p < 0 in the checker's programs: f/sqrt(1 + f^2), x/(K + x), and others.

Their slope by f is one product,

    f^(k-1) B^(p-1) sum_j (k + p j) c_j f^j,                                                                       (1)

where the product rule takes the difference of two terms, which over intervals is far wider for large f.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Protocol

from gsp.proofs import intervals as ia
from gsp.proofs.intervals import Interval

Slopes = Mapping[int, Interval]


class Program(Protocol):
    """Straight-line code: (operation, one, two) behind so many variables, and the values of its constants."""

    variables: int
    code: list[tuple[str, Any, Any]]
    constants: dict[int, Interval]


@dataclass(frozen=True)
class PowerQuotient:
    """sign rest f^k B^p: places of f and B, the (k + p j) c_j with j, and places of the rest with their powers."""

    sign: int
    f: int
    k: Fraction
    base: int
    p: Fraction
    terms: tuple[tuple[Interval, Fraction], ...]
    rest: tuple[tuple[int, Fraction], ...]

    @property
    def cost(self) -> int:
        """Operations on intervals for the slope by one variable, about."""
        return 6 + 3 * len(self.terms) + 4 * len(self.rest)

    def slope(self, found: Sequence[Interval], slopes: Sequence[Slopes]) -> dict[int, Interval]:
        """The slopes by the variables, from values and slopes of what stands before."""
        f, base = found[self.f], found[self.base]
        inner = ia.ZERO
        for coefficient, j in self.terms:
            inner = ia.add(inner, ia.multiply(coefficient, ia.raised(f, j)))
        by_f = ia.multiply(ia.multiply(ia.raised(f, self.k - 1), ia.raised(base, self.p - 1)), inner)
        value = ia.multiply(ia.raised(f, self.k), ia.raised(base, self.p))
        if self.sign < 0:
            by_f, value = ia.negative(by_f), ia.negative(value)
        total = {v: ia.multiply(slope, by_f) for v, slope in slopes[self.f].items()}
        for place, power in self.rest:
            factor = ia.raised(found[place], power)
            total = {v: ia.multiply(slope, factor) for v, slope in total.items()}
            if slopes[place]:
                rate = ia.multiply(value, ia.multiply(ia.of(power), ia.raised(found[place], power - 1)))
                for v, slope in slopes[place].items():
                    total[v] = ia.add(total.get(v, ia.ZERO), ia.multiply(slope, rate))
            value = ia.multiply(value, factor)
        return total


def quotients(program: Program) -> dict[int, PowerQuotient]:
    """Those of the outermost products of a program that are such, by their places in its code."""
    inner = {
        place - program.variables
        for name, one, two in program.code
        if name in ("*", "/")
        for place in (one, two)
    }
    found = {}
    for i, (name, _, _) in enumerate(program.code):
        if name in ("*", "/") and i not in inner:
            quotient = _quotient(program, *_factors(program, program.variables + i))
            if quotient is not None:
                found[i] = quotient
    return found


def _entry(program: Program, place: int) -> tuple[str, Any, Any]:
    return program.code[place - program.variables] if place >= program.variables else ("variable", None, None)


def _factors(program: Program, product: int) -> tuple[int, dict[int, Fraction]]:
    """The sign of a product, and the places of its factors with their powers."""
    sign, found = 1, dict[int, Fraction]()
    waiting = [(product, Fraction(1))]
    while waiting:
        place, power = waiting.pop()
        name, one, two = _entry(program, place)
        if name == "*" or name == "/":
            waiting += [(one, power), (two, power if name == "*" else -power)]
            continue
        if name == "-" and program.constants.get(one - program.variables) == ia.ZERO:
            sign = -sign
            waiting.append((two, power))
            continue
        # A root of a power is no power of its base: sqrt(z^2) is |z|.
        if name == "**":
            place, power = one, power * two
        elif name == "sqrt":
            place, power = one, power / 2
        found[place] = found.get(place, Fraction(0)) + power
    return sign, found


def _quotient(program: Program, sign: int, factors: dict[int, Fraction]) -> PowerQuotient | None:
    for base, p in factors.items():
        if p >= 0 or _entry(program, base)[0] not in ("+", "-"):
            continue
        terms = _terms(program, base)
        moving = {f for term in terms for f in term[1]}
        if len(moving) != 1 or any(len(term[1]) > 1 for term in terms):
            continue
        (f,) = moving
        k = factors.get(f, Fraction(0))
        if k < 1:
            continue
        rows = [(coefficient, powers.get(f, Fraction(0))) for coefficient, powers in terms]
        if any(j < 0 for _, j in rows):
            continue
        weighted = tuple((ia.multiply(ia.of(k + p * j), c), j) for c, j in rows if k + p * j)
        rest = tuple((place, power) for place, power in factors.items() if place not in (f, base) and power)
        return PowerQuotient(sign, f, k, base, p, weighted, rest)
    return None


def _terms(program: Program, total: int) -> list[tuple[Interval, dict[int, Fraction]]]:
    """The terms of a sum: what is constant of each, and the places of its other factors with their powers."""
    found = []
    waiting = [(total, 1)]
    while waiting:
        place, sign = waiting.pop()
        name, one, two = _entry(program, place)
        if name in ("+", "-"):
            waiting += [(one, sign), (two, sign if name == "+" else -sign)]
            continue
        own, factors = _factors(program, place)
        coefficient, powers = ia.of(Fraction(sign * own)), {}
        for factor, power in factors.items():
            value = program.constants.get(factor - program.variables)
            if value is None:
                powers[factor] = power
            else:
                coefficient = ia.multiply(coefficient, ia.raised(value, power))
        # What a minus sign leaves: 0 - z.
        if coefficient != ia.ZERO:
            found.append((coefficient, powers))
    return found
