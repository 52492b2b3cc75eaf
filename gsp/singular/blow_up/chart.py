"""Charts of a weighted blow-up: the leading field on them, divided by r^k, and its equilibria.

With z_i = r^(w_i) Z_i and Q the kept monomials, the rescaling chart Z_epsilon = 1 has r' = 0 and Z' = Q(Z). In the
chart of direction c, Z_c = +1 or -1 =: sigma,

    r' = rho r,   Z_i' = Q_i(Z) - w_i rho Z_i,   rho = sigma Q_c(Z)/w_c                                              (1)

after division by r^k, to leading order in r (Krupa and Szmolyan, SIAM J. Math. Anal. 33 (2001) 286-314, section 2).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import sympy as sp

from gsp.algebra.algebraic_numbers import InfinitelyManyPoints, real_points
from gsp.algebra.differentiation import jacobian
from gsp.results.card import Card


class LeadingField(NamedTuple):
    """The kept field: `rates` Q_i of the variables that are blown up, in fast time, and their weights.

    `fast` and `slow` say which are states; parameters follow epsilon.
    """

    rates: Mapping[sp.Symbol, sp.Expr]
    weights: Mapping[sp.Symbol, int]
    degree: int
    fast: tuple[sp.Symbol, ...]
    slow: tuple[sp.Symbol, ...]
    epsilon: sp.Symbol


class ChartEquilibrium(NamedTuple):
    """A rest point with r = 0: `point` by symbol, and the `eigenvalues` of the chart's field there, exact."""

    point: Mapping[sp.Symbol, sp.Expr]
    eigenvalues: tuple[sp.Expr, ...]


@dataclass(frozen=True, eq=False, repr=False)
class BlowUpChart(Card):
    """One chart: `direction` is `sign` r^w there, epsilon in the rescaling chart.

    `radius` is r, `variables` the symbols of the Z_i by the variables that they rescale, `rates` (1) for r and them.
    """

    field: LeadingField
    direction: sp.Symbol
    sign: int
    radius: sp.Symbol
    variables: Mapping[sp.Symbol, sp.Symbol]

    @property
    def is_rescaling(self) -> bool:
        """Whether epsilon is r^w, so that r is a constant."""
        return self.direction == self.field.epsilon

    @cached_property
    def substitution(self) -> Mapping[sp.Symbol, sp.Expr]:
        """The blown-up variables in those of the chart."""
        weights, r = self.field.weights, self.radius
        return MappingProxyType(
            {z: r**w * (self.sign if z == self.direction else self.variables[z]) for z, w in weights.items()}
        )

    @cached_property
    def rates(self) -> Mapping[sp.Symbol, sp.Expr]:
        """(1), by the symbols of the chart."""
        here = {**self.variables, self.direction: sp.Integer(self.sign)}
        fields = {z: sp.expand(q.xreplace(here)) for z, q in self.field.rates.items()}
        weights = self.field.weights
        rho = sp.expand(self.sign * fields[self.direction] / weights[self.direction])
        rates = {self.radius: sp.expand(self.radius * rho)}
        for z, Z in self.variables.items():
            rates[Z] = sp.expand(fields[z] - weights[z] * rho * Z)
        return MappingProxyType(rates)

    @cached_property
    def equilibria(self) -> tuple[ChartEquilibrium, ...]:
        """Real rest points with r = 0 and the parameters at theirs, isolated in the chart's fast directions.

        In directions other than epsilon they lie at epsilon = 0 and with the other slow variables at 0; lines of rest
        points, such as M0, are met there once.
        """
        rates, field = self.rates, self.field
        own = (*field.fast, *field.slow) if self.is_rescaling else field.fast
        unknowns = [self.variables[z] for z in own if z in self.variables]
        zero = {Z: sp.Integer(0) for Z in (self.radius, *self.variables.values()) if Z not in unknowns}
        equations = [rates[Z].xreplace(zero) for Z in unknowns]
        found = []
        for point in _real_roots(equations, unknowns):
            place = {**zero, **point}
            values = _eigenvalues(jacobian(equations, unknowns).xreplace(point))
            rho = sp.diff(rates[self.radius], self.radius).xreplace(place)
            others = [z for z in self.variables if self.variables[z] not in unknowns]
            values = [rho, *values, *(-field.weights[z] * rho for z in others)]
            found.append(ChartEquilibrium(MappingProxyType(place), tuple(map(sp.simplify, values))))
        return tuple(found)

    @property
    def title(self) -> str:
        """What the chart is called: the direction as a power of r."""
        weight = self.field.weights[self.direction]
        power = str(self.radius) if weight == 1 else f"{self.radius}^{weight}"
        return f"{self.direction} = {'-' if self.sign < 0 else ''}{power}"

    def __repr__(self) -> str:
        return f"BlowUpChart({self.title})"

    def __str__(self) -> str:
        lines = [f"chart {self.title}" + (", the rescaling chart" if self.is_rescaling else "")]
        shown = [Z for Z in self.rates if Z in self.variables.values() or not self.is_rescaling]
        lines += [f"  {Z}' = {self.rates[Z]}" for Z in shown]
        for rest in self.equilibria:
            place = ", ".join(f"{Z} = {v}" for Z, v in rest.point.items() if v != 0) or "the origin"
            lines.append(f"  at rest: {place}; eigenvalues {', '.join(map(str, rest.eigenvalues))}")
        return "\n".join(lines)


def charts_of(field: LeadingField) -> tuple[BlowUpChart, ...]:
    """The rescaling chart, then those of both signs of the slow and of the fast variables."""
    directions = [(field.epsilon, 1)]
    directions += [(z, sign) for z in (*field.slow, *field.fast) for sign in (1, -1)]
    charts = []
    for number, (direction, sign) in enumerate(directions, start=1):
        variables = {z: sp.Symbol(f"{z.name}_{number}", real=True) for z in field.weights if z != direction}
        radius = sp.Symbol(f"r_{number}", real=True)
        charts.append(BlowUpChart(field, direction, sign, radius, MappingProxyType(variables)))
    return tuple(charts)


def _real_roots(equations: Sequence[sp.Expr], unknowns: Sequence[sp.Symbol]) -> list[dict[sp.Symbol, sp.Expr]]:
    """Isolated real solutions; where a rate is a number other than 0 there are none."""
    if any(e.is_number and e != 0 for e in equations):
        return []
    if not unknowns:
        return [{}]
    if len(unknowns) == 1:
        (equation,), (unknown,) = equations, unknowns
        if equation == 0:
            return []
        roots = sp.roots(sp.Poly(equation, unknown))
        return [{unknown: root} for root in sorted(roots, key=_as_number) if _is_real(root)]
    try:
        points = real_points(equations, unknowns)
    except InfinitelyManyPoints:
        return []
    return [point.expressions() for point in points or ()]


def _as_number(value: sp.Expr) -> tuple[float, float]:
    number = complex(sp.N(value, 30))
    return number.real, number.imag


def _is_real(value: sp.Expr) -> bool:
    return bool(value.is_real) if value.is_real is not None else sp.im(sp.N(value, 30)) == 0


def _eigenvalues(matrix: sp.Matrix) -> list[sp.Expr]:
    if not matrix.rows:
        return []
    return sorted(matrix.eigenvals(multiple=True), key=_as_number)
