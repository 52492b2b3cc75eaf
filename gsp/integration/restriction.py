"""Restriction of a system to its slow manifold, which gives the reduced flow."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

import sympy as sp

from gsp.algebra.ring import LocalisedRing
from gsp.algebra.ring_elements import RingElement
from gsp.algebra.sharing import holding, plus, replaced, times
from gsp.errors import BudgetError
from gsp.integration.reduced_flow import ReducedFlow
from gsp.slow.coordinates import moving, set_apart
from gsp.slow.series import LONGEST, SeriesManifold
from gsp.systems.arguments import check_noun
from gsp.systems.declaration import reconstruction_of
from gsp.systems.flow import check_order
from gsp.systems.system import SlowFastSystem


def restrict(
    manifold: SeriesManifold,
    *,
    order: int | None = None,
    reconstruction: Mapping[sp.Symbol, sp.Expr] | None = None,
) -> ReducedFlow:
    """The reduced flow on `manifold`, cut at `order`.

    `reconstruction` maps further symbols to rates in the system's variables, its observables and one another;
    they are driven by the reduced flow (a position by velocities). A run of it ends where an eigenvalue of the fast
    Jacobian changes too fast for the series; a steep h_0 with constant eigenvalues ends none. `choose` tells the error.

    >>> y, x, eps = sp.symbols("y x epsilon")
    >>> system = SlowFastSystem(slow={y: -x}, fast={x: y - x}, epsilon=eps)
    >>> restrict(expand(solve_critical(system).branches[0], order=1)).rates
    (-epsilon*y - y,)
    """
    check_noun(manifold, SeriesManifold, verb="restrict")
    if order is not None:
        check_order(order)
    rates_driven = reconstruction_of(manifold.branch.system, reconstruction)
    truncated = manifold.at_order(manifold.order if order is None else order).specialised
    try:
        moved = moving(truncated.chart, truncated._f)
    except BudgetError:
        moved = None
    if moved is None or (not truncated.is_program and _longest(truncated.chart.ring, moved) > LONGEST):
        # What fast coordinates do is longer than the series.
        programs = truncated.as_programs
        truncated, moved = programs, moving(programs.chart, programs._f)
    system = manifold.branch.system
    ring = truncated.chart.ring
    epsilon = system.epsilon
    values = dict(system.parameters)
    renamed = set_apart(truncated.chart, rates_driven)

    known = {ring.generator(s).index: name for s, name in renamed.items()} if truncated.is_program else {}

    def written(element) -> sp.Expr:
        return (
            ring.written([element], known)[0] if truncated.is_program else element.written().xreplace(renamed)
        )

    def total(elements) -> sp.Expr:
        if truncated.is_program:
            return plus([times(written(e), epsilon**k) for k, e in enumerate(elements)])
        return sp.Add(*[written(e) * epsilon**k for k, e in enumerate(elements)])

    rates = [total(row) for row in moved]
    observables: dict[sp.Symbol, sp.Expr] = {}
    for x in system.x:
        if x not in truncated.coordinates:
            observables[x] = total([truncated.chart.elements[x]])
    for i, y in enumerate(system.y):
        observables[y] = total(truncated._h[i])
    for symbol, expression in system.observables.items():
        observables[symbol] = replaced(expression.xreplace(values), observables)
    states = tuple(renamed.get(c, c) for c in truncated.coordinates)
    driven = tuple(rates_driven)
    for rate in rates_driven.values():
        rates.append(replaced(rate.xreplace(values), observables))
    return ReducedFlow(
        manifold=manifold,
        order=truncated.order,
        states=(*states, *driven),
        rates=tuple(rates),
        observables=MappingProxyType(real_or_nan(observables)),
        epsilon=epsilon,
        driven=driven,
        base=tuple(total([truncated.chart.elements[s]]) for s in system.states),
        last_terms=tuple(
            tuple(times(written(h[k]), epsilon**k) for h in truncated._h)
            for k in (truncated.order - 1, truncated.order)
            if truncated.order > 1
        ),
        driven_rates=tuple(_own(rate, system) for rate in rates_driven.values()),
    )


def real_or_nan(observables: Mapping[sp.Symbol, sp.Expr]) -> dict[sp.Symbol, sp.Expr]:
    """Them, with nan where one is infinite or imaginary whatever the variables are, as 1/(y - h(x)) on y = h(x) is."""
    unreal = holding(observables.values(), (sp.zoo, sp.oo, -sp.oo, sp.nan, sp.I))
    return {symbol: sp.nan if bad else value for (symbol, value), bad in zip(observables.items(), unreal)}


def _longest(ring: LocalisedRing, rows: Iterable[Iterable[RingElement]]) -> int:
    """Terms of the longest polynomial in which the elements of `rows` are written."""
    elements = [element for row in rows for element in row]
    below = {i for element in elements for i, exponent in enumerate(element.exponents) if exponent}
    return max(
        *(len(element.numerator) for element in elements), *(len(ring.denominators[i]) for i in below), 0
    )


def _own(rate: sp.Expr, system: SlowFastSystem) -> sp.Expr:
    """A reconstructed rate in slow and fast variables, with the parameters' values."""
    return rate.xreplace(dict(system.observables)).xreplace(dict(system.parameters))
