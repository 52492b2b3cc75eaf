"""Vibrations: rates of order 1/epsilon with mean zero, which move their variables by an amount that stays.

x' = P(z, theta)/epsilon + R, where P has mean zero and holds no variable that is shaken, is regular in X = x - V with
V(z, theta) the integral of P/omega over the phase: X' = R - V_z z' - V_theta (theta' - omega/epsilon). So is the
pendulum whose pivot vibrates fast (P. L. Kapitza, Soviet Physics JETP 21 (1951) 588-592).
"""

from __future__ import annotations

import sympy as sp

from gsp.algebra.fourier_ring import FourierRing
from gsp.algebra.functions import are_rational
from gsp.algebra.laurent import laurent, pole_order
from gsp.algebra.ring import read
from gsp.averaging.turning_frame import TurningFrame
from gsp.errors import SplittingError
from gsp.results.table import Names
from gsp.systems.flow import Flow


def without_vibration(
    flow: Flow, frame: TurningFrame, phase: sp.Symbol, turning: sp.Expr, omega: sp.Expr
) -> tuple[TurningFrame, sp.Expr]:
    """The frame of slow variables alone, without the phase's rate, and epsilon times that rate in it.

    Raises `SplittingError` for a rate with a pole in epsilon that is no vibration.
    """
    epsilon = flow.epsilon
    assert epsilon is not None
    rates = frame.rates
    shaken = {x: pole_order(rate, epsilon) for x, rate in rates.items() if pole_order(rate, epsilon)}
    if not shaken:
        return frame, turning
    others = [x for x in rates if x not in shaken]
    parts = {x: laurent(rates[x], epsilon, order=-k).get(-k, sp.Integer(0)) for x, k in shaken.items()}
    ring = FourierRing(
        others, constants=list(flow.parameters), functions=not are_rational([*parts.values(), omega])
    )
    taken = (*flow.states, *flow.parameters, *flow.observables, *rates, epsilon)
    free = Names(str(symbol) for symbol in taken)
    new, moved = {}, {}
    for x, part in parts.items():
        if shaken[x] == 1 and not part.has(*shaken) and not omega.has(*shaken):
            wave = read(ring.harmonics_of(part, phase), ring, {})
            if ring.mean(wave).is_zero:
                displacement = ring.integral(wave) * read(omega, ring, {}).inverse()
                new[x], moved[x] = sp.Symbol(free(f"{x}_slow")), ring.in_harmonics(displacement, phase)
                continue
        raise SplittingError(
            f"the rate of {x} has the leading part ({part})/{epsilon ** shaken[x]}, and {x} is no slow variable.",
            f"A vibration has mean zero over {phase} and moves nothing that it depends on. A variable that is "
            "attracted is fast, and is not averaged: put what it is attracted to in its place.",
        )
    states = {x: new[x] + moved[x] for x in parts}
    slower = sp.expand((turning - omega) / epsilon)
    result = {}
    for x, rate in rates.items():
        if x in parts:
            follows = [sp.diff(moved[x], z) * rates[z] for z in others]
            rate = sp.expand(rate - parts[x] / epsilon) - sp.Add(*follows) - sp.diff(moved[x], phase) * slower
        result[new.get(x, x)] = rate.xreplace(states)
    coordinates = {
        new.get(x, x): e - moved[x].xreplace(dict(frame.coordinates)) if x in moved else e
        for x, e in frame.coordinates.items()
    }
    inverse = {z: e.xreplace(states) for z, e in frame.inverse.items()}
    return TurningFrame(result, coordinates, inverse), turning.xreplace(states)
