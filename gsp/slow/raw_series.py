"""A series manifold carried back to the raw variables of the field it was split from.

The slow coordinates of a splitting (the sleigh's p) are the right ones to compute in and the wrong ones to read.
With xi the raw states that are not fast coordinates, xi = Z(x, h_epsilon(x)) is inverted order by order,
x = X(xi, epsilon), and everything is composed with X.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from gsp.algebra.functions import are_rational
from gsp.algebra.inversion import solve_for
from gsp.algebra.power_series import SeriesProgram
from gsp.algebra.ring import LocalisedRing, read
from gsp.algebra.ring_elements import RingElement
from gsp.errors import DeclarationError, HyperbolicityError
from gsp.slow.components import Components
from gsp.slow.coordinates import dot, invert
from gsp.slow.series import SeriesManifold
from gsp.splitting.splitting import Splitting
from gsp.systems.arguments import check_noun, shown


@dataclass(frozen=True)
class RawManifold:
    """The slow manifold as a graph over the raw states `chart`, and the reduced field on it.

    `coefficients[k]` gives the other raw states, `reduced_field[k]` the rates of the chart's, each the factor of
    epsilon^k; both are exact.
    """

    chart: tuple[sp.Symbol, ...]
    coefficients: tuple[Components, ...]
    reduced_field: tuple[Components, ...]

    @property
    def order(self) -> int:
        """The order in epsilon through which both are known."""
        return len(self.coefficients) - 1


def carry_back(series: SeriesManifold, splitting: Splitting) -> RawManifold | None:
    """`series` in the raw variables of the field that `splitting` split, through the same order.

    None when the slow variables on M0 cannot be solved for explicitly, as on an implicit branch of a field whose
    slow coordinates are new. When no coordinate is new this is the series itself.
    """
    check_noun(series, SeriesManifold, verb="carry_back")
    if not isinstance(splitting, Splitting):
        raise DeclarationError("splitting is what split(field) gives.", got=shown(splitting), value=splitting)
    system = series.branch.system
    chart = tuple(z for z in splitting.field.states if z not in system.y)
    if set(chart) == set(system.x):
        order = [system.x.index(z) for z in chart]
        rates = tuple(Components(chart, [f[i] for i in order]) for f in series.reduced_field)
        return RawManifold(chart, series.coefficients, rates)
    if not series.branch.is_explicit:
        return None
    epsilon = system.epsilon
    powers = [epsilon**k for k in range(series.order + 1)]

    def total(rows: tuple[Components, ...], symbol: sp.Symbol) -> sp.Expr:
        return sp.Add(*[power * row[symbol] for power, row in zip(powers, rows)])

    # A raw state that is a slow coordinate too has one name for two things: the coordinate gets a stand-in.
    stand_in = {x: sp.Dummy(x.name) for x in system.x}
    h = {y: total(series.coefficients, y).xreplace(stand_in) for y in system.y}
    f = [total(series.reduced_field, x).xreplace(stand_in) for x in system.x]
    onto = {z: splitting.inverse[z].xreplace(stand_in).xreplace(h) for z in splitting.field.states}
    leading = {z: onto[z].xreplace({epsilon: sp.Integer(0)}) for z in chart}
    start = solve_for(list(stand_in.values()), leading)
    if start is None:
        return None
    return _composed(series, chart, onto, f, start)


def _composed(series, chart, onto, f, start) -> RawManifold | None:
    system = series.branch.system
    order = series.order
    x = tuple(start)
    used = [*onto.values(), *f, *start.values()]
    ring = LocalisedRing(
        chart,
        constants=tuple(system.parameters),
        functions=not are_rational(used),
        derivations=len(chart),
    )
    for j, z in enumerate(chart):
        ring.set_derivative(z, j, ring.one)
    X: list[list[RingElement]] = [[read(start[s], ring, {}).reduced()] for s in x]
    program = SeriesProgram(ring, epsilon=system.epsilon, inputs=dict(zip(x, X)), constants={})
    images = {z: program.compile(onto[z]) for z in onto}
    rates = [program.compile(rate) for rate in f]
    program.extend(0)
    # DX_0, whose inverse is the Jacobian of xi by x on M0.
    DX = [[[ring.derive(row[0], j).reduced() for j in range(len(chart))] for row in X]]
    try:
        jacobian = invert(DX[0], ring)
    except HyperbolicityError:
        return None
    for k in range(1, order + 1):
        for row in X:
            row.append(ring.zero)
        program.extend(k)
        defect = [images[z].coefficients[k] for z in chart]
        for i, row in enumerate(X):
            row[k] = (-dot(DX[0][i], defect, ring)).reduced()
        program.extend(k)
        DX.append([[ring.derive(row[k], j).reduced() for j in range(len(chart))] for row in X])
    velocity: list[list[RingElement]] = []
    for k in range(order + 1):
        right = []
        for i in range(len(x)):
            value = rates[i].coefficients[k]
            for lower in range(1, k + 1):
                value = value - dot(DX[lower][i], velocity[k - lower], ring)
            right.append(value.reduced())
        velocity.append([dot(row, right, ring).reduced() for row in jacobian])
    others = [z for z in onto if z not in chart]
    coefficients = tuple(
        Components(others, [ring.to_sympy(images[z].coefficients[k].reduced()) for z in others])
        for k in range(order + 1)
    )
    field = tuple(Components(chart, [ring.to_sympy(v) for v in velocity[k]]) for k in range(order + 1))
    return RawManifold(chart, coefficients, field)
