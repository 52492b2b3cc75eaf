"""Clocks, states of a constant rate, and where functions of one switch or peak: a step may pass over that unseen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import sympy as sp

from gsp.algebra.functions import NON_SMOOTH
from gsp.algebra.switching_functions import switches

# They vary all along their argument: whoever sees nothing of them takes steps of their period.
PERIODIC = (sp.sin, sp.cos, sp.tan)
Coefficients = tuple[sp.Expr, ...]


@dataclass(frozen=True)
class Clock:
    """The state number `state`, its `rate`, and polynomials in it, each by its coefficients, the highest first.

    A rate has a kink or a jump where one of `switches` is 0; where one of `peaks` is, a smooth function in a rate is
    steepest or largest.
    """

    state: int
    rate: sp.Expr
    switches: tuple[Coefficients, ...]
    peaks: tuple[Coefficients, ...]


def clocks(states: Sequence[sp.Symbol], rates: Sequence[sp.Expr]) -> tuple[Clock, ...]:
    """The clocks among `states` of which `rates` hold functions that switch or peak.

    A function of a polynomial p in the clock is steepest where p = 0, largest where p' = 0, or neither.

    >>> t, x, w = sp.symbols("t x w")
    >>> clocks((x, t), (sp.exp(-(((t - 5) / w) ** 2)) - x, sp.S.One))[0].peaks
    ((-1/w**2, 10/w**2, -25/w**2), (-2/w**2, 10/w**2))
    """
    found = []
    for i, rate in enumerate(rates):
        if rate != 0 and not rate.has(*states):
            jumps = [switch.surface for switch in switches(rates, [states[i]])]
            clock = Clock(
                i, rate, *(_polynomials(of, states, i) for of in (jumps, _arguments(rates, states[i])))
            )
            if clock.switches or clock.peaks:
                found.append(clock)
    return tuple(found)


def pulse_times(states: Sequence[sp.Symbol], rates: Sequence[sp.Expr]) -> tuple[list[sp.Expr], list[sp.Expr]]:
    """How long after `states` clocks switch a rate, and reach a peak; of quadratic polynomials and linear ones."""

    def times(clock: Clock, polynomials: tuple[Coefficients, ...]) -> Iterator[sp.Expr]:
        for p in polynomials:
            places: list[sp.Expr] = []
            if len(p) == 2:
                places = [-p[1] / p[0]]
            elif len(p) == 3:
                half, product = -p[1] / (2 * p[0]), p[2] / p[0]
                root = sp.sqrt(half**2 - product)
                places = [half - root, half + root] if root != 0 else [half]
            yield from ((place - states[clock.state]) / clock.rate for place in places)

    found = clocks(states, rates)
    return [t for c in found for t in times(c, c.switches)], [t for c in found for t in times(c, c.peaks)]


def _arguments(rates: Sequence[sp.Expr], clock: sp.Symbol) -> Iterator[sp.Expr]:
    nodes = {node for rate in rates for node in rate.atoms(sp.Function, sp.Pow)}
    for node in sorted(nodes, key=sp.default_sort_key):
        if isinstance(node, (*PERIODIC, *NON_SMOOTH)) or (
            node.is_Pow and node.exp.is_Integer and node.exp.is_positive
        ):
            continue
        for argument in node.args:
            if isinstance(argument, sp.Expr) and argument.has(clock):
                yield argument
                yield argument.diff(clock)


def _polynomials(
    expressions: Iterator[sp.Expr] | Sequence[sp.Expr], states: Sequence[sp.Symbol], clock: int
) -> tuple[Coefficients, ...]:
    """Those of the expressions that are polynomials in the clock alone, and may vanish."""
    others = [state for i, state in enumerate(states) if i != clock]
    found = [
        tuple(sp.Poly(e, states[clock]).all_coeffs())
        for e in expressions
        if e.has(states[clock]) and not e.has(*others) and e.is_polynomial(states[clock])
    ]
    return tuple(dict.fromkeys(found))
