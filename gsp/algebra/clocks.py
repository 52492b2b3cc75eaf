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
