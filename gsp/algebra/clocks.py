"""Clocks, states of a constant rate, and where functions of one switch or peak: a step may pass over that unseen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.functions import NON_SMOOTH
from gsp.algebra.sharing import unshared
from gsp.algebra.switching_functions import nodes, switches

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
    >>> clocks((x, t), (sp.exp(-(((t - 5) / w) ** 2)) - x, sp.S.One))[0].peaks
    (Zeros(numbers=(1, -5), is_wave=False),)
    """
    found = []
    for i, rate in enumerate(rates):
        if rate != 0 and rate.free_symbols.isdisjoint(states):
            jumps = [switch.surface for switch in switches(rates, [states[i]])]
            places = (_zeros(of, states, i, slopes) for slopes, of in enumerate((jumps, _arguments(rates))))
            clock = Clock(i, rate, *places)
            if clock.switches or clock.peaks:
                found.append(clock)
    return tuple(found)


def _arguments(rates: Sequence[sp.Expr]) -> Iterator[sp.Expr]:
    for node in nodes(rates, (sp.Function, sp.Pow)):
        # The square of a wave is one, its higher powers are ever narrower pulses.
        whole = node.is_Pow and node.exp.is_Integer and node.exp.is_positive
        if isinstance(node, (*WAVES, *NON_SMOOTH)) or (whole and (node.exp == 2 or not node.base.has(*WAVES))):
            continue
        yield from (argument for argument in node.args if isinstance(argument, sp.Expr))


def _zeros(
    expressions: Iterable[sp.Expr], states: Sequence[sp.Symbol], clock: int, slopes: int
) -> tuple[Zeros, ...]:
    """The zeros of the expressions of the clock alone and of so many of their derivatives."""
    t, found = states[clock], dict[Zeros, None]()
    for expression in expressions:
        if t in expression.free_symbols and expression.free_symbols.isdisjoint({*states} - {t}):
            line, period = _unfolded(unshared(expression), t)
            for slope in (line, derivative(line, t))[: slopes + 1]:
                found |= dict.fromkeys(_zeros_of(slope, t, period) if slope.has(t) else ())
    return tuple(found)


def _unfolded(expression: sp.Expr, clock: sp.Symbol) -> tuple[sp.Expr, sp.Expr | None]:
    """The expression with the line of which each sawtooth atan(tan(k t + b)) is made, and the period of those.

    A remainder is such a sawtooth and signs, which move it by whole periods.
    """
    saws = {
        node: node.args[0].args[0] for node in expression.atoms(sp.atan) if isinstance(node.args[0], sp.tan)
    }
    slopes = {angle.diff(clock) for angle in saws.values()} - {0}
    if len(slopes) != 1 or (slope := slopes.pop()).has(clock):
        return expression, None
    signs = dict.fromkeys(expression.atoms(sp.sign), sp.S.One)
    return expression.xreplace(signs).xreplace(saws), sp.pi / slope


def _zeros_of(expression: sp.Expr, clock: sp.Symbol, period: sp.Expr | None) -> Iterator[Zeros]:
    """The zeros of a polynomial or a wave, each once; of a polynomial with a `period` those of its linear factors."""
    if expression.is_polynomial(clock):
        # By its factors, since rounding would part roots that are one, and blur those that are close.
        for coefficients in (factor.all_coeffs() for factor, _ in sp.Poly(expression, clock).factor_list()[1]):
            if period is None:
                yield Zeros(tuple(coefficients))
            elif len(coefficients) == 2:
                slope, rest = sp.pi / period, coefficients[1] / coefficients[0]
                yield Zeros((slope, slope * rest, sp.S.One, sp.S.Zero, sp.S.Zero), is_wave=True)
        return
    waves = sorted((w for w in expression.atoms(*WAVES) if w.has(clock)), key=sp.default_sort_key)
    angles = {wave.args[0] for wave in waves}
    if len(angles) != 1 or not (angle := angles.pop()).is_polynomial(clock):
        return
    slope, *phase = sp.Poly(angle, clock).all_coeffs()
    of = {wave: sp.Dummy() for wave in waves}
    flat = expression.xreplace(of)
    if len(phase) != 1 or flat.has(clock) or not flat.is_polynomial(*of.values()):
        return
    terms = sp.Poly(flat, *of.values())
    if terms.total_degree() != 1:
        return
    sine, cosine = (sum(terms.coeff_monomial(of[w]) for w in waves if isinstance(w, kind)) for kind in WAVES)
    yield Zeros((slope, phase[0], sp.S(sine), sp.S(cosine), terms.coeff_monomial(1)), is_wave=True)
