"""Clocks, states of a constant rate, and where functions of one switch or peak: a step may pass over that unseen."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
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
    largest, or has changed by its own size.
    """

    state: int
    rate: sp.Expr
    switches: tuple[Zeros, ...]
    peaks: tuple[Zeros, ...]


def clocks(states: Sequence[sp.Symbol], rates: Sequence[sp.Expr]) -> tuple[Clock, ...]:
    """The clocks among `states` of which `rates` hold functions that switch or peak.

    A function of p(t), a polynomial or a wave, also of a logarithm, an exponential or a power of one, is steepest where
    p = 0, largest where p' = 0, or neither. Where p' has no zero the function changes from p = -1 to p = 1 and little
    beyond: beside a jump, as that of u exp(-u) at u = 0, that is all that tells how narrow it is.

    >>> t, x, w = sp.symbols("t x w")
    >>> clocks((x, t), (sp.exp(-(((t - 5) / w) ** 2)) - x, sp.S.One))[0].peaks
    (Zeros(numbers=(1, -5), is_wave=False),)
    """
    found = []
    for i, rate in enumerate(rates):
        if rate != 0 and rate.free_symbols.isdisjoint(states):
            jumps = [switch.surface for switch in switches(rates, [states[i]])]
            clock = Clock(i, rate, _zeros(jumps, states, i), _zeros(_arguments(rates), states, i, peaks=True))
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
    expressions: Iterable[sp.Expr], states: Sequence[sp.Symbol], clock: int, *, peaks: bool = False
) -> tuple[Zeros, ...]:
    """The zeros of expressions p of the clock alone; for `peaks` of p' too, or where it has none of p + 1 and p - 1."""
    t, found = states[clock], dict[Zeros, None]()
    for expression in expressions:
        if t in expression.free_symbols and expression.free_symbols.isdisjoint({*states} - {t}):
            for smooth in _branches(unshared(expression)):
                line, period = _unfolded(smooth, t)
                found |= dict.fromkeys(_zeros_of(line, t, period))
                if peaks:
                    flat = list(_zeros_of(derivative(line, t), t, period))
                    found |= dict.fromkeys(
                        flat or [*_zeros_of(line + 1, t, period), *_zeros_of(line - 1, t, period)]
                    )
    return tuple(found)


def _branches(expression: sp.Expr) -> Iterator[sp.Expr]:
    """The smooth expressions of which one with kinks is made; it alone where it has several kinks side by side."""
    outer = _outermost(expression.atoms(sp.Abs, sp.Max, sp.Min))
    if len(outer) != 1:
        # Each would double their number.
        yield expression
        return
    (kink,) = outer
    parts = (kink.args[0], -kink.args[0]) if isinstance(kink, sp.Abs) else kink.args
    for part in parts:
        yield from _branches(expression.xreplace({kink: part}))


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
    """The zeros of a polynomial or a wave, each once, or of a polynomial in a function that has an inverse.

    With a `period` those of a polynomial's linear factors.
    """
    if not expression.has(clock):
        return
    if expression.is_polynomial(clock):
        # By its factors, since rounding would part roots that are one, and blur those that are close.
        for coefficients in (factor.all_coeffs() for factor, _ in sp.Poly(expression, clock).factor_list()[1]):
            if period is None:
                yield Zeros(tuple(coefficients))
            elif len(coefficients) == 2:
                slope, rest = sp.pi / period, coefficients[1] / coefficients[0]
                yield Zeros((slope, slope * rest, sp.S.One, sp.S.Zero, sp.S.Zero), is_wave=True)
        return
    yield from _zeros_of_inverse(expression, clock, period)
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


def _zeros_of_inverse(expression: sp.Expr, clock: sp.Symbol, period: sp.Expr | None) -> Iterator[Zeros]:
    """The zeros of a rational function of one logarithm, exponential or root of the clock, by its linear factors."""
    top = sp.fraction(sp.together(expression))[0]
    if top.is_polynomial(clock):
        yield from _zeros_of(top, clock, period)
        return
    inner = [
        n for n in top.atoms(sp.log, sp.exp, sp.Pow) if n.has(clock) and not (n.is_Pow and n.exp.is_Integer)
    ]
    outer, of = _outermost(inner), sp.Dummy()
    if len(outer) != 1 or (flat := top.xreplace({outer[0]: of})).has(clock) or not flat.is_polynomial(of):
        return
    for coefficients in (factor.all_coeffs() for factor, _ in sp.Poly(flat, of).factor_list()[1]):
        if len(coefficients) == 2:
            argument, value = _inverse(outer[0], -coefficients[1] / coefficients[0], clock)
            if not value.has(sp.I, sp.nan, sp.zoo, sp.oo, -sp.oo):
                yield from _zeros_of(argument - value, clock, period)


def _outermost(nodes: Collection[sp.Expr]) -> list[sp.Expr]:
    """Those of the nodes that stand in no other one."""
    return [node for node in nodes if not any(node is not other and other.has(node) for other in nodes)]


def _inverse(function: sp.Expr, value: sp.Expr, clock: sp.Symbol) -> tuple[sp.Expr, sp.Expr]:
    """The argument of a logarithm, an exponential or a root, and what it is where the function has the value."""
    if isinstance(function, sp.log):
        return function.args[0], sp.exp(value)
    base, power = function.as_base_exp()
    return (power, sp.log(value) / sp.log(base)) if power.has(clock) else (base, value ** (1 / power))
