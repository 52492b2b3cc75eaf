"""Laws of a switch: phi(w), which rises from -1 to 1, at once, over a tail, or over a peak as Stribeck's.

Where sliding ends is decided by the end of the part on which phi rises: where phi is flat from there on, with
1 - phi ~ C (w_e - w)^n just before (clipped laws, contact order n), at a maximum (laws that overshoot), or at infinity,
with 1 - phi ~ C w^-m (algebraic tails, n = -m) or faster than any power (tanh).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from fractions import Fraction
from functools import cached_property
from math import inf, pi, tan
from types import MappingProxyType

import numpy as np
import sympy as sp

from gsp.errors import DeclarationError
from gsp.results.card import Card
from gsp.roots import root
from gsp.systems.arguments import shown
from gsp.systems.region import powers_of_two

W = sp.Symbol("w")
_CLIPPED = sp.Max(-1, sp.Min(1, W))
LAWS: Mapping[str, sp.Expr] = MappingProxyType(
    {
        "linear": _CLIPPED,
        "cubic": (3 * _CLIPPED - _CLIPPED**3) / 2,
        "tanh": sp.tanh(W),
        "algebraic": W / sp.sqrt(1 + W**2),
        "atan": 2 * sp.atan(W) / sp.pi,
        # Static friction, its maximum at w = sqrt(3), is 3 sqrt(3)/4 = 1.30 of kinetic friction.
        "stribeck": W / sp.sqrt(1 + W**2) + W / (1 + W**2),
    }
)
# A tail is measured at these two distances, in so many digits, and is a power where both agree on it to this.
FAR, DIGITS, AGREEMENT = (sp.Integer(10) ** 10, sp.Integer(10) ** 12), 60, 1e-6
# Powers are fractions of whole numbers this small; two of them differ by more than what is measured.
DENOMINATOR = 100
# Which operand of a Max is the larger beside a place: far beyond a double's digits, within those.
BESIDE = sp.Rational(1, 10**30)


class LawEndKind(StrEnum):
    """How phi stops rising."""

    CLIPPED = "flat from there on"
    PEAK = "a maximum"
    ALGEBRAIC_TAIL = "a tail that falls as a power"
    FLAT_TAIL = "a tail that falls faster than any power"


@dataclass(frozen=True)
class LawEnd:
    """Where phi stops rising: at `place`, where |phi| is `value`; `kind` says how.

    1 - |phi| ~ `coefficient` (place - |w|)^`order` before the end of a clipped law, or coefficient |w|^order with a
    negative order along an algebraic tail; both are None for a peak and for a flat tail.
    """

    kind: LawEndKind
    place: float
    value: float
    order: sp.Rational | None = None
    coefficient: float | None = None

    @property
    def exponent(self) -> sp.Rational | None:
        """n/(2n - 1): orbits leave a visible fold where it is this power of epsilon wide; None without an order."""
        return None if self.order is None else self.order / (2 * self.order - 1)

    def in_units(self, unit: float) -> LawEnd:
        """The same where w was in a `unit`."""
        coefficient = None if self.coefficient is None else self.coefficient * unit ** -float(self.order or 0)
        return replace(self, place=self.place * unit, coefficient=coefficient)


@dataclass(frozen=True, repr=False)
class SwitchLaw(Card):
    """phi as `expression` in `symbol`, with phi -> -1 and 1 at the ends of the line and a positive slope at 0."""

    symbol: sp.Symbol
    expression: sp.Expr
    name: str = ""

    def at(self, argument: sp.Expr) -> sp.Expr:
        """phi(argument)."""
        return self.expression.xreplace({self.symbol: argument})

    @cached_property
    def slope(self) -> float:
        """phi'(0), by which contacts creep."""
        rising = active(self.expression, self.symbol, sp.S.Zero)[0]
        return float(sp.diff(rising, self.symbol).xreplace({self.symbol: sp.S.Zero}))

    @cached_property
    def upper(self) -> LawEnd:
        """The end of the rising part over w > 0."""
        return _end(self.at(self.unit * self.symbol), self.symbol).in_units(float(self.unit))

    @cached_property
    def lower(self) -> LawEnd:
        """The end of the rising part over w < 0, of -phi(-w)."""
        return _end(-self.at(-self.unit * self.symbol), self.symbol).in_units(float(self.unit))

    @cached_property
    def unit(self) -> sp.Expr:
        """The power of two next to 1/phi'(0), in which w is where phi is looked at; 1 where there is none."""
        slope = abs(self.slope)
        if not 0.0 < slope < inf:
            return sp.S.One
        return sp.Rational(*float(powers_of_two([1.0 / slope])[0]).as_integer_ratio())

    @property
    def overshoots(self) -> bool:
        """Whether sliding can bear more than the limits at both ends, as static friction above kinetic."""
        return LawEndKind.PEAK in (self.upper.kind, self.lower.kind)

    def __repr__(self) -> str:
        return f"SwitchLaw({self.name or self.expression})"

    def __str__(self) -> str:
        ends = [f"{side}: |phi| = {end.value:.10g} at w = {sign * end.place:.10g}, {end.kind}"
                for side, end, sign in (("above", self.upper, 1), ("below", self.lower, -1))]  # fmt: skip
        return "\n".join([f"phi({self.symbol}) = {self.expression}, slope {self.slope:.10g} at 0", *ends])


def switch_law(phi: str | sp.Expr | SwitchLaw) -> SwitchLaw:
    """The law named `phi` ("linear", "cubic", "tanh", "algebraic", "atan", "stribeck"), or an expression in one symbol.

    Raises `DeclarationError` for an expression that does not rise through 0 or does not tend to -1 and 1.
    """
    if isinstance(phi, SwitchLaw):
        return phi
    if isinstance(phi, str):
        if phi not in LAWS:
            raise DeclarationError.none_of(LAWS, phi, f'phi = "{phi[:40]}" is no law.', "The laws are")
        return SwitchLaw(W, LAWS[phi], phi)
    if not isinstance(phi, sp.Expr) or len(phi.free_symbols) != 1:
        raise DeclarationError(
            "phi is the name of a law, or an expression in one symbol.",
            f"The names are {', '.join(LAWS)}.",
            got=shown(phi),
            value=phi,
        )
    (symbol,) = phi.free_symbols
    assert isinstance(symbol, sp.Symbol)
    law = SwitchLaw(symbol, phi)
    for side in (1, -1):
        limit = sp.N(phi.xreplace({symbol: side * law.unit * FAR[1]}), DIGITS)
        if not limit.is_Float or abs(limit - side) > AGREEMENT:
            raise DeclarationError(
                f"phi tends to {sp.N(limit, 6)} where {symbol} goes to {side * sp.oo}.",
                "Scale it to -1 and 1, and the two fields with it.",
                got=str(phi),
            )
    if not law.slope > 0.0:
        raise DeclarationError(f"phi does not rise at 0: its slope is {law.slope:g}.", got=str(phi))
    return law


def active(expression: sp.Expr, symbol: sp.Symbol, place: sp.Expr) -> tuple[sp.Expr, list[sp.Expr]]:
    """`expression` right of `place` without Max, Min, Abs and sign, and the places beyond where operands linear in w
    take over.
    """
    probe = place + BESIDE
    breaks = []
    while extrema := expression.atoms(sp.Max, sp.Min, sp.Abs, sp.sign):
        piece = min(extrema, key=sp.count_ops)
        pick = min if isinstance(piece, sp.Min) else max
        among = piece.args if isinstance(piece, (sp.Max, sp.Min)) else (piece.args[0], -piece.args[0])
        chosen = pick(among, key=lambda part: sp.N(part.xreplace({symbol: probe}), DIGITS))
        for other in among:
            gap = chosen - other
            slope = sp.diff(gap, symbol)
            if slope != 0 and not slope.free_symbols:
                breaks.append(-gap.xreplace({symbol: sp.S.Zero}) / slope)
        side = sp.Integer(1 if chosen == piece.args[0] else -1)
        expression = expression.xreplace({piece: side if isinstance(piece, sp.sign) else chosen})
    return expression, [found for found in breaks if (found - probe).is_positive]


def _end(expression: sp.Expr, symbol: sp.Symbol) -> LawEnd:
    last = sp.S.Zero
    inner, breaks = active(expression, symbol, last)
    while breaks:
        place = min(breaks)
        peak = _peak(inner, symbol, float(last), float(place))
        if peak is not None:
            return LawEnd(LawEndKind.PEAK, *peak)
        beyond, breaks = active(expression, symbol, place)
        if not beyond.has(symbol):
            return _clipped(beyond - inner, symbol, place, float(beyond))
        last, inner = place, beyond
    peak = _peak(inner, symbol, float(last), inf)
    if peak is not None:
        return LawEnd(LawEndKind.PEAK, *peak)
    return _tail(inner, symbol)


def _clipped(gap: sp.Expr, symbol: sp.Symbol, place: sp.Expr, value: float) -> LawEnd:
    """The end of a law that is `value` from `place` on, `gap` what it lacks to it before."""
    order, slope, at_end = 0, gap, gap.xreplace({symbol: place})
    while at_end.is_zero and slope.has(symbol):
        order, slope = order + 1, -sp.diff(slope, symbol)
        at_end = slope.xreplace({symbol: place})
    coefficient = at_end / sp.factorial(order)
    if not at_end.is_finite:
        # Of a power that is not whole a derivative is infinite.
        u = sp.Dummy("u", positive=True)
        coefficient, order = gap.xreplace({symbol: place - u}).as_leading_term(u).as_coeff_exponent(u)
        if coefficient.has(u) or not order.is_Rational or order <= 0:
            return LawEnd(LawEndKind.FLAT_TAIL, float(place), value)
        if order < 1:
            raise DeclarationError(
                f"phi ends at {symbol} = {place} with an infinite slope.", "Take one whose slope is bounded."
            )
    return LawEnd(LawEndKind.CLIPPED, float(place), value, sp.Rational(order), float(coefficient))


def _peak(inner: sp.Expr, symbol: sp.Symbol, first: float, last: float) -> tuple[float, float] | None:
    """The first maximum between two places, and phi there."""
    slope = sp.diff(inner, symbol)

    def value(angle: float) -> float:
        return float(sp.N(slope.xreplace({symbol: sp.Float(tan(angle), 30)}), 20))

    # Peaks are looked for between 256 places, even in the angle whose tangent is w.
    angles = np.linspace(np.arctan(first), np.arctan(last) if last < inf else pi / 2, 257)[1:-1]
    values = [value(float(angle)) for angle in angles]
    for k in range(1, len(values)):
        if values[k - 1] > 0.0 > values[k]:
            found = root(value, float(angles[k - 1]), float(angles[k]))
            assert found is not None
            place = tan(found)
            return place, float(sp.N(inner.xreplace({symbol: sp.Float(place, 30)}), 20))
    return None


def _tail(inner: sp.Expr, symbol: sp.Symbol) -> LawEnd:
    def gap(place: sp.Expr) -> sp.Expr:
        # Functions in which nothing is left to cancel in: tanh(10^10) needs 10^10 digits otherwise.
        return sp.N(1 - inner.xreplace({symbol: place}), DIGITS, maxn=10 * DIGITS)

    gaps = [(gap(place), gap(2 * place)) for place in FAR]
    if not all(a.is_positive and b.is_positive for a, b in gaps):
        return LawEnd(LawEndKind.FLAT_TAIL, inf, 1.0)
    powers = [float(sp.log(a / b, 2)) for a, b in gaps]
    order = sp.Rational(Fraction(powers[1]).limit_denominator(DENOMINATOR))
    if abs(powers[0] - powers[1]) > AGREEMENT or abs(powers[1] - order) > AGREEMENT or order <= 0:
        return LawEnd(LawEndKind.FLAT_TAIL, inf, 1.0)
    return LawEnd(LawEndKind.ALGEBRAIC_TAIL, inf, 1.0, -order, float(gaps[1][0] * FAR[1] ** order))
