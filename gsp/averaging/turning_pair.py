"""Two states that turn about one another, as amplitude and phase or in the frame of a phase that there is.

With u' = b v/epsilon + p and v' = c u/epsilon + q, b c < 0, omega^2 = -b c, kappa = omega/b and w = v/kappa,
u' = omega w/epsilon + p and w' = -omega u/epsilon + s with s = q/kappa - kappa' w/kappa. In a frame that turns by psi,
u = A cos psi + B sin psi and w = B cos psi - A sin psi,

    A' = d B + p cos psi - s sin psi,  B' = -d A + p sin psi + s cos psi,  d = omega/epsilon - psi'.

Near resonance psi is the phase of a forcing and d has no pole. Otherwise psi = theta is chosen such that B = 0: A = r
is the amplitude, r' = p cos theta - s sin theta and theta' = omega/epsilon - (p sin theta + s cos theta)/r
(N. N. Bogoliubov and Y. A. Mitropolsky, Asymptotic Methods in the Theory of Non-Linear Oscillations, 1961).
"""

from __future__ import annotations

from typing import Any

import sympy as sp

from gsp.algebra.laurent import laurent, pole_order, vanishes
from gsp.averaging.turning_frame import TurningFrame
from gsp.errors import SplittingError
from gsp.results.table import names_of
from gsp.systems.flow import Flow, Values

Pair = tuple[sp.Symbol, sp.Symbol]


def in_pair(
    flow: Flow, frame: TurningFrame, pair: Pair, phase: sp.Symbol | None
) -> tuple[TurningFrame, sp.Symbol]:
    """The frame in which a pair moves slowly, and the phase, which is a new one unless given.

    Raises `SplittingError` where the pair does not turn, or not at the rate of the phase.
    """
    (u, v), epsilon = pair, flow.epsilon
    assert epsilon is not None
    rates = dict(frame.rates)
    b, c = _coefficient(rates[u], v, pair, epsilon), _coefficient(rates[v], u, pair, epsilon)
    omega, kappa = _rotation(flow, b, c)
    if phase is not None and not pole_order(sp.expand(omega / epsilon + rates[phase]), epsilon):
        # The phase turns the other way round.
        omega, kappa = -omega, -kappa
    p, q = sp.expand(rates.pop(u) - b * v / epsilon), sp.expand(rates.pop(v) - c * u / epsilon)
    bent = sp.Add(*[sp.diff(kappa, x) * rate for x, rate in rates.items() if kappa.has(x)])
    s = q / kappa - bent * v / kappa**2
    free = names_of(flow)
    if phase is None:
        psi, r = sp.Symbol(free("theta")), sp.Symbol(free("r"))
        cos, sin = sp.cos(psi), sp.sin(psi)
        states: Values = {u: r * cos, v: -kappa * r * sin}
        p, s = (_in_frame(e, states, psi, r) for e in (p, s))
        new = {r: p * cos - s * sin, psi: omega / epsilon - (p * sin + s * cos) / r}
        old = {r: sp.sqrt(u**2 + (v / kappa) ** 2), psi: sp.atan2(-v / kappa, u)}
    else:
        psi, r, A, B = phase, None, sp.Symbol(free("A")), sp.Symbol(free("B"))
        cos, sin = sp.cos(psi), sp.sin(psi)
        states = {u: A * cos + B * sin, v: kappa * (B * cos - A * sin)}
        detuning = sp.expand(omega / epsilon - rates[psi])
        if pole_order(detuning, epsilon):
            raise SplittingError(
                f"{u} and {v} turn at {omega}/{epsilon}, the phase {psi} at {rates[psi]}, which is not near resonance.",
                f"Near resonance the two differ by a detuning without 1/{epsilon}; elsewhere name the pair alone, or "
                "the phase alone.",
            )
        p, s, d = (_in_frame(e, states, psi, r) for e in (p, s, detuning))
        new = {A: d * B + p * cos - s * sin, B: -d * A + p * sin + s * cos}
        old = {A: u * cos - v / kappa * sin, B: u * sin + v / kappa * cos}
    others = {z: _in_frame(rate, states, psi, r) for z, rate in rates.items()}
    kept = {z: e for z, e in frame.coordinates.items() if z not in pair}
    return TurningFrame({**new, **others}, {**old, **kept}, {**frame.inverse, **states}), psi


def _in_frame(rate: sp.Expr, states: Values, phase: sp.Symbol, size: sp.Symbol | None) -> sp.Expr:
    """`rate` with `states` put in; functions of u^2 + w^2 do not hold the phase, and its root is the `size`."""
    sin, cos, rule = sp.sin(phase), sp.cos(phase), dict(states)
    positive = {} if size is None else {size: sp.Dummy(positive=True)}
    for piece in rate.atoms(sp.Function, sp.Pow):
        if piece.has(*states):
            turned = sp.expand(piece.xreplace(dict(states)).xreplace(positive)).subs(sin**2, 1 - cos**2)
            if not (plain := sp.expand(turned)).has(phase):
                rule[piece] = plain.xreplace({new: old for old, new in positive.items()})
    return rate.xreplace(rule)


def _coefficient(rate: sp.Expr, other: sp.Symbol, pair: Pair, epsilon: sp.Symbol) -> sp.Expr:
    """b of the leading part b `other`/epsilon of a rate of a pair."""
    fast = laurent(rate, epsilon, order=-1).get(-1, sp.Integer(0))
    b = sp.diff(fast, other)
    if pole_order(rate, epsilon) > 1 or b == 0 or b.has(*pair) or not vanishes(fast - b * other):
        u, v = pair
        raise SplittingError(
            f"{u} and {v} do not turn about one another: the leading part of a rate is ({fast})/{epsilon}, which is no "
            f"multiple of {other} alone.",
            f"To leading order {u}' = b*{v}/{epsilon} and {v}' = c*{u}/{epsilon} with b*c < 0, as for a weakly "
            "nonlinear oscillator. Of any other declare the phase as a state.",
        )
    return b


def _rotation(flow: Flow, b: sp.Expr, c: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """(omega, kappa), omega^2 = -b c and kappa = omega/b; positive parameters leave their roots."""
    positive: dict[Any, Any] = {
        p: sp.Dummy(p.name, positive=True) for p, value in flow.parameters.items() if value.is_positive
    }
    back = {dummy: p for p, dummy in positive.items()}
    square = sp.factor(-b * c).xreplace(positive)
    if square.xreplace(back).xreplace(dict(flow.parameters)).is_nonpositive:
        raise SplittingError(
            f"the pair does not turn: omega^2 = {square.xreplace(back)} is not positive.",
            "Where it is attracted or repelled, `split` finds what is fast.",
        )
    # Of a square its root, of either sign: where it keeps its sign it is smooth, and sqrt(z^2) is not.
    root = sp.Mul(
        *[
            base ** (k // 2)
            for base, k in square.as_powers_dict().items()
            if k.is_Integer and not base.is_number
        ]
    )
    omega = root * sp.sqrt(square / root**2)
    return omega.xreplace(back), sp.factor(omega / b.xreplace(positive)).xreplace(back)
