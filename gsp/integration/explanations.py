"""Why an integration failed, as far as its record tells: what is said beside the status, and the remedy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.switching_functions import switches
from gsp.errors import Status
from gsp.integration.loop import remedy_of
from gsp.integration.run_array import RunRecord
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over
from gsp.systems.flow import Flow

# A backward run whose fast directions grow by more than e to this has lost every digit.
LOST = 36.0
# A solution that has grown this much, by a power law that three of its points agree on, is blowing up.
GROWN = 1e3
# So many steps tell that a run goes to and fro.
ENOUGH = 64
_FAILED = (Status.NON_FINITE, Status.STEP_TOO_SMALL, Status.TOO_MANY_STEPS, Status.SINGULAR_JACOBIAN)


class Explanation(NamedTuple):
    """What is known beyond the status, and what to do; both may be empty."""

    note: str
    remedy: str


def explain(flow: Flow, p: np.ndarray, record: RunRecord, last: float) -> Explanation:
    """What the record of a run towards `last` tells about its ending."""
    status, stats = record.status, record.stats
    if status not in _FAILED:
        return Explanation("", status.remedy)
    if len(record.times) == 1 and status is Status.NON_FINITE:
        if not np.isfinite(compile_flow(flow).rates(record.states[0], p)).all():
            return Explanation(
                "the field is not finite at the start", "move the start into the domain of the field"
            )
        return Explanation("", status.remedy)
    backward = _backward(flow, p, record, last)
    if backward is not None:
        return backward
    slides = None if status is Status.NON_FINITE else _sliding(flow, p, record)
    if slides is not None:
        return Explanation(
            f"the run goes to and fro across {slides} = 0, where the field points there from both sides",
            "where it jumps, give the fields of both sides to PiecewiseField: run_piecewise follows what slides",
        )
    if status in (Status.TOO_MANY_STEPS, Status.SINGULAR_JACOBIAN):
        return Explanation("", remedy_of(status, stats))
    return Explanation(_pole(flow, p, record), status.remedy)


def lost_below(flow: Flow, record: RunRecord, rtol: float, atol: float) -> Explanation:
    """Of a run that reached its end: a state that grew from below atol, though its rate is 0 where the state is.

    Nothing tells how small such a state was there, nor on which side, so nothing tells when it is large again.
    """
    states = record.states
    small = np.sign(states[0]) * states <= atol
    # What one step may be wrong by, as its error is a mean over all states.
    allowed = np.sqrt(states.shape[1]) * (atol + rtol * np.abs(states).max(axis=0))
    for i, state in enumerate(flow.states):
        since = int(np.argmax(small[:, i]))
        if not small[since, i] or np.abs(states[since:, i]).max() <= allowed[i]:
            continue
        slope = derivative(flow.rates[i], state).xreplace({state: sp.S.Zero})
        # By a root two orbits meet, and one of them may go through.
        if flow.rates[i].xreplace({state: sp.S.Zero}) == 0 and not slope.has(sp.nan, sp.zoo, sp.oo):
            return Explanation(
                f"{state} is smaller than atol = {atol:.3g} at t = {record.times[since]:.6g} and grows in "
                "proportion to itself, so that when it is large again is not known",
                f"give an atol below the least that {state} gets to, or take its logarithm for a state",
            )
    return Explanation("", "")


def _backward(flow: Flow, p: np.ndarray, record: RunRecord, last: float) -> Explanation | None:
    """Backward in time the fast directions of an attracting stiff field grow."""
    length = float(record.times[0]) - last
    if not (flow.is_stiff and length > 0.0):
        return None
    jacobian = compile_flow(flow).jacobians(record.states[0], p)
    if not np.isfinite(jacobian).all():
        return None
    rate = float(-np.linalg.eigvals(jacobian).real.min())
    if rate * length < LOST:
        return None
    return Explanation(
        f"backward in time the fast directions grow at the rate {rate:.3g}, by 1e{rate * length / np.log(10):.0f} "
        "over this span",
        "no integrator can follow that: integrate forward from an earlier start, or restrict() the system to its slow "
        "manifold and run that backward",
    )


def _sliding(flow: Flow, p: np.ndarray, record: RunRecord) -> str | None:
    """The switching function of the rates about whose zeros the run goes to and fro in the second half of its steps.

    It goes further than it gets: what leads across may be steps, or the stages of steps that end on one side.
    """
    half = len(record.states) // 2
    found, states, steps = switches(flow.rates, flow.states), record.states[half:], np.diff(record.times[half:])
    if not found or len(states) < ENOUGH:
        return None
    surfaces = [switch.surface for switch in found]
    slopes = [derivative(surface, state) for surface in surfaces for state in flow.states]
    function = compile_over(flow, (*surfaces, *slopes))
    values, normals = np.split(function(states, p), [len(surfaces)], axis=1)
    rates = compile_flow(flow).rates
    for i, surface in enumerate(surfaces):
        value, normal = values[:, i], normals.reshape(len(states), len(surfaces), -1)[:, i]
        squares = np.einsum("mj,mj->m", normal, normal)
        if not (squares > 0.0).all():
            continue
        # The same places on the other side; of |x| there is none.
        mirrored = states - 2.0 * (value / squares)[:, None] * normal
        here, there = (np.einsum("mj,mj->m", normal, rates(places, p)) for places in (states, mirrored))
        goes = np.abs(here[:-1]) @ np.abs(steps)
        points = (np.sign(value) * here <= 0.0).all() and (np.sign(value) * there >= 0.0).all()
        has_sides = (function(mirrored, p)[:, i] * value <= 0.0).all()
        if has_sides and points and goes > 2.0 * np.abs(value).max():
            return str(surface)
    return None


def _pole(flow: Flow, p: np.ndarray, record: RunRecord) -> str:
    """How the largest state blows up, if it does.

    For y ~ C (T - t)^(-k) the quotient y/y' = (T - t)/k falls linearly in t, which gives k and T.
    """
    t, y = record.times, record.states
    i = int(np.argmax(np.abs(y[-1])))
    size = np.abs(y[:, i])
    if not size[-1] > GROWN * (1.0 + size[0]):
        return ""
    with np.errstate(all="ignore"):
        ratio = y[:, i] / compile_flow(flow).rates(y, p)[:, i]
        # The points are taken where the distance from the pole stands clear of the rounding of t.
        clear = np.flatnonzero((size > GROWN * (1.0 + size[0])) & (np.abs(ratio) > 1e-9 * np.abs(t)))
        chosen = list(clear[-1:])
        # Far enough apart that the slope of what is no power, such as exp(1/(T - t)), has changed.
        for k in clear[::-1]:
            if len(chosen) < 3 and abs(ratio[k]) >= 2.0 * abs(ratio[chosen[-1]]):
                chosen.append(k)
        if len(chosen) < 3:
            return ""
        c, b, a = chosen
        slopes = [(ratio[j] - ratio[i_]) / (t[j] - t[i_]) for i_, j in ((a, b), (b, c))]
        power = -1.0 / slopes[1]
        # They agree to this share.
        agree = abs(slopes[0] - slopes[1]) <= 0.02 * abs(slopes[1])
    if not (agree and np.isfinite(power) and power > 0.0):
        return ""
    pole = t[c] + power * ratio[c]
    name = flow.states[i].name
    return f"{name} grows without bound, like (T - t)^-{power:.3g} with T = {pole:.8g}"
