"""Clocks, states of a constant rate, and where functions of one switch or peak: a step may pass over that unseen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import sympy as sp

from gsp.algebra.functions import NON_SMOOTH
from gsp.algebra.switching_functions import switches

# What oscillates at its own frequency is no pulse; a function of it may be a train of them.
WAVES = (sp.sin, sp.cos)


@dataclass(frozen=True)
class Zeros:
    """The zeros of a polynomial in a clock, by its coefficients, the highest first; or those of a wave of it.

    A wave a sin(k t + b) + c cos(k t + b) + d has the `numbers` (k, b, a, c, d).
    """

    numbers: tuple[sp.Expr, ...]
    is_wave: bool = False


@dataclass(frozen=True)
class Clock:
    """The state number `state` and its `rate`.

    A rate has a kink or a jump in the zeros `switches`; in the zeros `peaks` a smooth function in a rate is steepest or
    largest.
    """

    state: int
    rate: sp.Expr
    switches: tuple[Zeros, ...]
    peaks: tuple[Zeros, ...]


def clocks(states: Sequence[sp.Symbol], rates: Sequence[sp.Expr]) -> tuple[Clock, ...]:
    """The clocks among `states` of which `rates` hold functions that switch or peak.

    A function of p(t), a polynomial or a wave, is steepest where p = 0, largest where p' = 0, or neither.

    >>> t, x, w = sp.symbols("t x w")
    >>> clocks((x, t), (sp.exp(-(((t - 5) / w) ** 2)) - x, sp.S.One))[0].peaks[1]
    Zeros(numbers=(-2/w**2, 10/w**2), is_wave=False)
    """
    found = []
    for i, rate in enumerate(rates):
        if rate != 0 and not rate.has(*states):
            jumps = [switch.surface for switch in switches(rates, [states[i]])]
            places = (_zeros(of, states, i) for of in (jumps, _arguments(rates, states[i])))
            clock = Clock(i, rate, *places)
            if clock.switches or clock.peaks:
                found.append(clock)
    return tuple(found)


def _arguments(rates: Sequence[sp.Expr], clock: sp.Symbol) -> Iterator[sp.Expr]:
    nodes = {node for rate in rates for node in rate.atoms(sp.Function, sp.Pow)}
    for node in sorted(nodes, key=sp.default_sort_key):
        whole = node.is_Pow and node.exp.is_Integer and node.exp.is_positive
        if whole or isinstance(node, (*WAVES, *NON_SMOOTH)):
            continue
        for argument in node.args:
            if isinstance(argument, sp.Expr) and argument.has(clock):
                yield argument
                yield argument.diff(clock)


def _zeros(expressions: Iterable[sp.Expr], states: Sequence[sp.Symbol], clock: int) -> tuple[Zeros, ...]:
    """The zeros of those of the expressions that are polynomials or waves of the clock alone."""
    others = [state for i, state in enumerate(states) if i != clock]
    alone = (e for e in expressions if e.has(states[clock]) and not e.has(*others))
    return tuple(dict.fromkeys(found for e in alone if (found := _zeros_of(e, states[clock]))))


def _zeros_of(expression: sp.Expr, clock: sp.Symbol) -> Zeros | None:
    if expression.is_polynomial(clock):
        return Zeros(tuple(sp.Poly(expression, clock).all_coeffs()))
    waves = sorted((w for w in expression.atoms(*WAVES) if w.has(clock)), key=sp.default_sort_key)
    angles = {wave.args[0] for wave in waves}
    if len(angles) != 1 or not (angle := angles.pop()).is_polynomial(clock):
        return None
    slope, *phase = sp.Poly(angle, clock).all_coeffs()
    of = {wave: sp.Dummy() for wave in waves}
    flat = expression.xreplace(of)
    if len(phase) != 1 or flat.has(clock) or not flat.is_polynomial(*of.values()):
        return None
    terms = sp.Poly(flat, *of.values())
    if terms.total_degree() != 1:
        return None
    sine, cosine = (sum(terms.coeff_monomial(of[w]) for w in waves if isinstance(w, kind)) for kind in WAVES)
    return Zeros((slope, phase[0], sp.S(sine), sp.S(cosine), terms.coeff_monomial(1)), is_wave=True)
