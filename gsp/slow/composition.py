"""What depends on a point of the slow manifold, as a series in epsilon over it."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from gsp.algebra.power_series import SeriesProgram
from gsp.slow.components import Components
from gsp.slow.series import SeriesManifold


def compose(series: SeriesManifold, values: dict[sp.Symbol, sp.Expr]) -> tuple[Components, ...]:
    """The coefficients of epsilon^0, epsilon^1, ... of `values` along the slow manifold, through the order of `series`.

    Each value is an expression in slow and fast variables, the parameters and epsilon, regular at 0; it is exact, as
    `series.coefficients` is, and on an implicit branch the fast symbols in it stand for the point of M0.

    >>> y, x, eps, a = sp.symbols("y x epsilon a")
    >>> system = SlowFastSystem(slow={y: -y}, fast={x: y - x}, epsilon=eps)
    >>> compose(expand(solve_critical(system).branches[0], order=2), {a: x**2})
    ((y**2,), (2*y**2,), (3*y**2,))
    """
    chart, system = series.chart, series.branch.system
    program = SeriesProgram(
        chart.ring,
        epsilon=system.epsilon,
        inputs=dict(zip(system.y, series._h)),
        constants={x: chart.elements[x] for x in system.x},
    )
    nodes = [program.compile(value) for value in values.values()]
    for k in range(series.order + 1):
        program.extend(k)

    def written(k: int) -> Sequence[sp.Expr]:
        return [chart.ring.to_sympy(node.coefficients[k].reduced()) for node in nodes]

    return tuple(Components(values, written(k)) for k in range(series.order + 1))
