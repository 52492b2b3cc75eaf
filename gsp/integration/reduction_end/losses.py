"""Zeros of det g_y that a reduced flow of order 0 runs into, found in its desingularised flow, which passes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsp.integration.crossings import Search, Stepper, Watched, settle_event
from gsp.integration.loop import advance
from gsp.integration.methods import Method
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.reduction_end.validity import Validity
from gsp.lowering.compiled_flow import compile_flow

# How far the desingularised flow is followed, in times of the linear prediction of the zero of det g_y.
HORIZON = 20.0
# det g_y crosses zero when its slope there is at least this share of that at the start; where it only tends to zero,
# its slope does too, and a sign change would be an error of integration.
TRANSVERSAL = 1e-3
# The desingularised flow costs little; at these tolerances its errors stay far below TRANSVERSAL.
INNER_RTOL, INNER_ATOL = 1e-12, 1e-15
# An equilibrium of the desingularised flow is located by following it so much further, until det g_y has fallen
# to this share.
LONG_HORIZON = 400.0
TENDED = 1e-7
# At a branch point of M0 the slow variables do not move what has the eigenvalue 0, A g_x = 0; at a folded
# singularity A g_x f = 0 alone. |A g_x| is 0 below this share of its size on the way.
BRANCH_POINT = 1e-3
MAX_STEPS = 20_000


@dataclass(frozen=True)
class Loss:
    """A zero of det g_y that the reduced flow of order 0 runs into: its time, the flow's state there, and (x, y).

    `is_fold` where the desingularised flow crosses it; otherwise that flow has an equilibrium there.
    """

    t: float
    state: np.ndarray
    point: np.ndarray
    is_fold: bool
    is_branch_point: bool


def loss_ahead(
    flow: ReducedFlow,
    validity: Validity,
    stepper: Stepper,
    span: tuple[float, float],
    t: float,
    y: np.ndarray,
    horizon: float,
) -> Loss | None:
    """Where the desingularised flow from `y` at `t` crosses det g_y = 0, or, at an equilibrium there, what it tends to.

    It is followed for `horizon` times of the linear prediction; None when it comes to no zero.
    """
    z = validity.point(y, stepper.p)
    driven = y[len(y) - len(flow.driven) :] if flow.driven else []
    begun = np.concatenate([z, driven, [t]])
    value, slope = validity.crossing(begun, stepper.p)
    # dt = Delta ds: this is the way in which t runs on.
    sense = np.sign(value) * np.sign(span[1] - span[0])
    if not (np.isfinite(slope) and slope * sense * np.sign(value) < 0.0):
        return None
    length = horizon * abs(value / slope) * sense
    inner = Stepper(
        compile_flow(validity.desingularised),
        stepper.p,
        Method.DOP853,
        min(stepper.rtol, INNER_RTOL),
        min(stepper.atol, INNER_ATOL),
    )
    search = Search(
        lambda s, states: validity.crossing(states, stepper.p)[:, :1],
        [Watched("det g_y", 0, 1, settle_event)],
        np.array([np.sign(value)]),
        inner,
        0.0,
        begun,
    )
    asked = inner.run(begun, 0.0, np.array([length]), max_steps=MAX_STEPS, watch=search)
    record = advance(asked, inner.method)
    end = record.states[-1] if search.end is None else search.end.y
    reached = validity.crossing(end, stepper.p)
    is_fold = search.end is not None and bool(abs(reached[1]) > TRANSVERSAL * abs(slope))
    if not is_fold and not abs(reached[0]) <= TENDED * abs(value):
        return None
    point = end[: len(z)]
    places = [validity.states.index(s) for s in flow.manifold.coordinates]
    state = np.concatenate([point[places], end[len(z) : -1]])
    pulled = [np.linalg.norm(validity.pulled(at, stepper.p)) for at in (z, point)]
    return Loss(float(end[-1]), state, point, is_fold, bool(pulled[1] <= BRANCH_POINT * pulled[0]))
