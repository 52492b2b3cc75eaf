"""The canard value of planar slow-fast systems: the parameter of the maximal canard as a series in epsilon.

At a canard point the family has a singular Hopf bifurcation at a_H(epsilon), and the small cycles born there explode
at a_c(epsilon), where the attracting slow manifold goes on into the repelling one. Both are asymptotic series in
epsilon (Krupa and Szmolyan, SIAM J. Math. Anal. 33 (2001) 286-314); slow manifolds are unique only up to
exp(-c/epsilon), and so is a_c.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import floor, log10

import flint
import sympy as sp

from gsp.algebra.algebraic_numbers import arb
from gsp.algebra.precision import precision
from gsp.algebra.taylor_ring import DIGITS, Algebraic, Balls, Inexact, Rationals, Scalar
from gsp.results.card import Card
from gsp.singular.singularities.canard_points import CanardError, CanardPoint, canard_point, planar_field
from gsp.singular.singularities.canard_series import PlanarField, formal_canard, hopf_series
from gsp.singular.singularities.located_points import Located
from gsp.systems.arguments import check_whole
from gsp.systems.declaration import exact
from gsp.systems.flow import Point, check_epsilon
from gsp.systems.system import SlowFastSystem

# Orders that `value` sums at most; the next doubling takes half a minute.
SUM_LIMIT = 128
# Over this many orders in a row the terms must stay below the tolerance; some systems have every other one zero.
WINDOW = 3
# The terms left out must be this much below the last digit.
MARGIN = 20


@dataclass(frozen=True, eq=False, repr=False)
class CanardValue(Card):
    """a_c = a_0 + a_1 epsilon + ... of the maximal canard, and a_H of the singular Hopf bifurcation.

    `coefficients` (order + 1 of them) and `hopf_coefficients` are rational or algebraic numbers when `is_exact`, and
    SymPy floats with the digits that ball arithmetic has proved otherwise. `point` gives the canard point by name,
    the parameter among them; `genericity` its coefficients g_x, g_yy, f_y and d (x slow, y fast); `others` the
    further canard points of the system. `field` is the system with all parameters but this one put in, `located`
    the point as it was solved for.
    """

    system: SlowFastSystem
    parameter: sp.Symbol
    order: int
    point: Mapping[str, sp.Expr]
    coefficients: tuple[sp.Expr, ...]
    hopf_coefficients: tuple[sp.Expr, ...]
    genericity: Mapping[str, sp.Expr]
    is_exact: bool
    others: tuple[Mapping[str, sp.Expr], ...]
    field: PlanarField
    located: Located

    def partial_sum(self, epsilon: float | sp.Rational, *, order: int | None = None) -> sp.Expr:
        """sum_(k <= order) a_k epsilon^k with the coefficients at hand; exact for an exact epsilon.

        Raises `DeclarationError` for an order beyond them.
        """
        check_epsilon(epsilon)
        check_whole(self.order if order is None else order, what="order", most=self.order)
        terms = self.coefficients if order is None else self.coefficients[: order + 1]
        return sp.Add(*[c * exact(epsilon) ** k for k, c in enumerate(terms)])

    def value(self, epsilon: float | sp.Rational, *, digits: int = 25) -> sp.Float:
        """a_c(epsilon) to `digits` significant digits, from as many orders as that takes.

        The series diverges; summed up to its least term it is wrong by about exp(-c/epsilon), which is also how far
        maximal canards lie apart. Raises `CanardError`, with the number of digits that there are, when the least
        term is too large.
        """
        check_epsilon(epsilon)
        check_whole(digits, what="digits", least=1, most=1000)
        small = exact(epsilon)
        order, bits = 16, int(digits * 3.33) + 64
        while True:
            with precision(bits):
                terms = [c * arb(small) ** k for k, c in enumerate(_balls(self, order, bits))]
                if all(t.contains(0) and t.rad() * 10 ** (2 * digits) < 1 for t in terms):
                    return sp.Float(0, digits)
                scale = max((t.abs_upper() for t in terms[:2]), key=float)
                if any(t.rad() * 1000 * 10**digits > scale for t in terms):
                    bits *= 2
                    continue
                found = _sum(terms, digits)
            if found is not None:
                return found
            grows = _least(terms)
            if grows < 3 * order // 4 or order >= SUM_LIMIT:
                with precision(64):
                    size = max(float(abs(t).mid()) for t in terms[grows : grows + WINDOW])
                    total = abs(float(sum(terms[: grows + 1], flint.arb(0)).mid())) or 1.0
                    left = max(0, floor(-log10(MARGIN * size / total)))
                if grows < 3 * order // 4:
                    why = "and maximal canards lie no closer together. "
                else:
                    why = f"and orders past {SUM_LIMIT} are not summed. "
                raise CanardError(
                    f"the canard series has about {left} digits at {self.system.epsilon} = {epsilon}: its "
                    f"least term, of order {grows}, is {size:.2g}, {why}Got digits={digits}.",
                    f"Ask for fewer digits, or lower {self.system.epsilon}.",
                )
            order *= 2

    def __repr__(self) -> str:
        return f"CanardValue({self.parameter} = {_series(self.coefficients, self.system.epsilon)})"

    def __str__(self) -> str:
        place = ", ".join(f"{name} = {value}" for name, value in self.point.items())
        return "\n".join(
            [
                f"maximal canard of {self.system.name or 'a planar system'} at {place}",
                f"  canard: {self.parameter} = {_series(self.coefficients, self.system.epsilon)}",
                f"  Hopf:   {self.parameter} = {_series(self.hopf_coefficients, self.system.epsilon)}",
            ]
        )


def canard_value(
    system: SlowFastSystem, *, parameter: sp.Symbol | str, order: int = 4, near: Point | None = None
) -> CanardValue:
    """The maximal-canard and singular-Hopf values of a parameter as series in epsilon through `order`.

    The system has one slow and one fast variable; its other parameters are put at their exact values. When there
    are several canard points, `near` (names of states or the parameter, with numbers) chooses; without it the one
    nearest to the declared parameter value is taken, of two equally near the one with the larger value. Rational
    systems are solved exactly, in a number field when the point is not rational; others in ball arithmetic unless
    the point and all values there are rational.

    Raises `CanardError` when there is no canard point, naming what there is: no fold, a cusp, a jump point, a
    parameter that does not move the equilibrium, a slow flow that crosses the other way.

    The slow manifold as a graph over the fast variable is smooth at the fold for this series only: Zvonkin and
    Shubin, Russian Math. Surveys 39 (1984) 69-131.

    >>> x, y, a, eps = sp.symbols("x y a epsilon")
    >>> canard_value(SlowFastSystem(
    ...     slow={y: a - x}, fast={x: y - x**3/3 + x}, epsilon=eps, parameters={a: 1}), parameter=a).coefficients
    (1, -1/8, -3/32, -173/1024, -7593/16384)
    """
    field = planar_field(system, parameter)
    # Orders past this are refused: by then the rational coefficients have thousands of digits.
    check_whole(order, what="order", most=320)
    chosen, others = canard_point(field, declared=sp.Rational(system.parameters[field.a]), near=near)
    exact_answer = _exact(field, chosen, order)
    coefficients, hopf_coefficients = exact_answer or _numeric(field, chosen, order)
    return CanardValue(
        system=system,
        parameter=field.a,
        order=order,
        point=chosen.point,
        coefficients=coefficients,
        hopf_coefficients=hopf_coefficients,
        genericity=chosen.coefficients,
        is_exact=exact_answer is not None,
        others=tuple(c.point for c in others),
        field=field,
        located=chosen.located,
    )


Answer = tuple[tuple[sp.Expr, ...], tuple[sp.Expr, ...]]


def _exact(field: PlanarField, chosen: CanardPoint, order: int) -> Answer | None:
    """Both series as exact numbers; None where the point has no formula, or a value on the way is not exact."""
    point = chosen.located.exact
    if point is None:
        return None
    scalars: Rationals = Rationals() if point.is_rational else Algebraic(point.field)
    start: dict[sp.Symbol, Scalar] = dict(point.values)
    if point.is_rational:
        start = {s: flint.fmpq(v[0]) for s, v in point.values.items()}
    try:
        canard = formal_canard(field, scalars, start, order=order).parameter
        hopf = hopf_series(field, scalars, start, order=order)
        return tuple(map(scalars.expression, canard)), tuple(map(scalars.expression, hopf))
    except Inexact:
        return None


def _numeric(field: PlanarField, chosen: CanardPoint, order: int) -> Answer:
    bits, scalars = int(DIGITS * 3.33) + 64, Balls()
    while True:
        with precision(bits):
            start = chosen.located.balls(bits)
            canard = formal_canard(field, scalars, start, order=order).parameter
            hopf = hopf_series(field, scalars, start, order=order)
            if all(c.rel_accuracy_bits() > DIGITS * 3.33 or c.rad() < 1e-60 for c in (*canard, *hopf)):
                return tuple(map(scalars.expression, canard)), tuple(map(scalars.expression, hopf))
        bits *= 2


def _balls(canard: CanardValue, order: int, bits: int) -> list[flint.arb]:
    start = canard.located.balls(bits)
    return formal_canard(canard.field, Balls(), start, order=order).parameter


def _sum(terms: list[flint.arb], digits: int) -> sp.Float | None:
    """The sum up to where `WINDOW` terms in a row are negligible; None when that does not happen."""
    total = flint.arb(0)
    for k, term in enumerate(terms[: len(terms) - WINDOW]):
        total = total + term
        ahead = max((abs(t).abs_upper() for t in terms[k + 1 : k + 1 + WINDOW]), key=float)
        if total.abs_lower() > 0 and ahead * MARGIN * 10**digits < total.abs_lower():
            return sp.Float(total.mid().str(digits + 10, radius=False), digits)
    return None


def _least(terms: list[flint.arb]) -> int:
    """Where `WINDOW` terms in a row are least."""
    sizes = [float(abs(t).mid()) for t in terms]
    return min(range(len(sizes) - WINDOW), key=lambda k: max(sizes[k : k + WINDOW]))


def _series(coefficients: tuple[sp.Expr, ...], epsilon: sp.Symbol) -> str:
    shown = [c if c.is_Rational else sp.N(c, 8) for c in coefficients]
    terms = [sp.sstr(c * epsilon**k) for k, c in enumerate(shown) if c != 0]
    return (" + ".join(terms) or "0").replace("+ -", "- ") + f" + O({epsilon}^{len(coefficients)})"
