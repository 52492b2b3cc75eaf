"""A field with a fast phase: x' = f(x, theta, epsilon), epsilon theta' = Omega(x, theta, epsilon).

A phase is a state that turns, theta' = omega(x)/epsilon + ... with omega nowhere 0. It is neither attracted nor
repelled, so that it is no fast variable of a slow manifold: what moves slowly is averaged over it.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from gsp.algebra.laurent import laurent, pole_order, vanishes
from gsp.averaging.turning_frame import TurningFrame
from gsp.averaging.turning_pair import in_pair
from gsp.averaging.vibration import without_vibration
from gsp.errors import DeclarationError, SplittingError
from gsp.systems.flow import Flow, Values, read_only


@dataclass(frozen=True, eq=False)
class PhaseForm:
    """x' = `rates`(x, theta, epsilon), epsilon theta' = `turning`(x, theta, epsilon), both regular at epsilon = 0.

    `coordinates` are x and the `phase` in the states of the field, `inverse` the states in x and the phase; `omega` is
    the leading part of `turning`, which holds x alone.
    """

    phase: sp.Symbol
    rates: Values
    turning: sp.Expr
    omega: sp.Expr
    coordinates: Values
    inverse: Values

    def back_from(self, centres: Values) -> tuple[PhaseForm, Values]:
        """The form of the field itself, where this is that about its `centres`, and what in it was each variable here.

        A variable that is a state, or one less what it vibrates by, is counted from where that state is.
        """
        less = {z: z - c for z, c in centres.items()}
        offsets = {x: c for x, e in self.coordinates.items() for z, c in centres.items() if sp.diff(e, z) == 1}
        there = {x: x - c for x, c in offsets.items()}
        form = PhaseForm(
            self.phase,
            read_only({x: e.xreplace(there) for x, e in self.rates.items()}),
            self.turning.xreplace(there),
            self.omega.xreplace(there),
            read_only({x: e.xreplace(less) + offsets.get(x, 0) for x, e in self.coordinates.items()}),
            read_only({z: e.xreplace(there) + centres.get(z, 0) for z, e in self.inverse.items()}),
        )
        return form, there


def phase_form(flow: Flow, phase: sp.Symbol | None, pair: tuple[sp.Symbol, sp.Symbol] | None) -> PhaseForm:
    """The form of a flow that has a phase among its states, a pair that turns, or both.

    Raises `SplittingError`, which names what it met, for a field that is not of this form.
    """
    epsilon = flow.epsilon
    if epsilon is None:
        raise DeclarationError(
            "a phase is fast beside a small parameter, and the field has none.",
            "Divide the rate of the phase by it, theta' = omega/epsilon, or name a parameter that is, --small NAME.",
        )
    if pair is not None and phase is None and not any(pole_order(rate, epsilon) for rate in flow.rates):
        # In fast time, and with nothing that is slow: else its rates were divided.
        fast = [
            z.name
            for z, rate in zip(flow.states, flow.rates)
            if z not in pair and not vanishes(laurent(rate, epsilon, order=0).get(0, sp.S.Zero))
        ]
        if fast:
            raise SplittingError(
                f"{', '.join(fast)} {'moves' if len(fast) == 1 else 'move'} as fast as {pair[0]} and {pair[1]} turn.",
                f'Near resonance name the phase beside the pair, phase="{fast[0]}" in Python, name = "{fast[0]}" in a '
                "model file.",
            )
    same = {z: z for z in flow.states}
    frame = TurningFrame(dict(zip(flow.states, flow.rates)), same, same)
    if pair is not None:
        frame, phase = in_pair(flow, frame, pair, phase)
    assert phase is not None
    rates = dict(frame.rates)
    turning = sp.expand(rates.pop(phase) * epsilon)
    omega = sp.Integer(0) if pole_order(turning, epsilon) else laurent(turning, epsilon, order=0).get(0, 0)
    if omega == 0:
        raise SplittingError(
            f"the rate of {phase} is {frame.rates[phase]}, which is not that of a fast phase.",
            f"A phase turns at omega/{epsilon} with omega nowhere 0. One that turns slowly is a ramp that returns: "
            "take `Ramp.there_and_back`.",
        )
    if omega.has(phase):
        raise SplittingError(
            f"the phase {phase} turns at ({omega})/{epsilon}, which depends on itself.",
            "Take the angle that advances evenly, at the mean rate, as the phase.",
        )
    frame, turning = without_vibration(
        flow, TurningFrame(rates, frame.coordinates, frame.inverse), phase, turning, omega
    )
    return PhaseForm(
        phase, read_only(frame.rates), turning, omega, read_only(frame.coordinates), read_only(frame.inverse)
    )
