"""Zeros of det g_y that a reduced flow of order 0 runs into, found in its desingularised flow, which passes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsp.critical.loss_kind import LossKind
from gsp.integration.crossings import Search, settle_event
from gsp.integration.methods import Method
from gsp.integration.pieces import RunPiece
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.reduction_end.validity import Validity
from gsp.integration.watched import Settled, Stepper, Watched
from gsp.lowering.compiled_flow import compile_flow

# How far the desingularised flow is followed, in times of the linear prediction of the zero of det g_y.
HORIZON = 20.0
# det g_y crosses zero when its slope there is at least this share of that at the start; where it only tends to zero,
# its slope does too, and a sign change would be an error of integration.
TRANSVERSAL = 1e-3
# An equilibrium of the desingularised flow is followed so much further, until det g_y has fallen to this share. M0 does
# not attract: rounding grows as the inverse of the share, and what one linear step leaves falls as its square.
LONG_HORIZON = 400.0
TENDED = 1e-5
# On the way to an equilibrium the fast variables may fall as a root of det g_y, as at a pitchfork, seldom faster.
SLOWEST = 0.25
# What is left there is at most such a share of the way; where M0 has a pole it is as long as the way itself.
SMALL_STEP = TENDED**SLOWEST
# At a branch point of M0 the slow variables do not move what has the eigenvalue 0, A g_x = 0; at a folded
# singularity A g_x f = 0 alone. |A g_x| is 0 below this share of its size on the way.
BRANCH_POINT = 1e-3
MAX_STEPS = 20_000


@dataclass(frozen=True)
class DeterminantZero:
    """A zero of det g_y that the reduced flow of order 0 runs into: its time, the flow's state there, and (x, y)."""

    t: float
    state: np.ndarray
    point: np.ndarray
    kind: LossKind

    @property
    def is_fold(self) -> bool:
        """Whether the desingularised flow crosses it."""
        return self.kind is LossKind.FOLD


def loss_ahead(
    flow: ReducedFlow,
    validity: Validity,
    stepper: Stepper,
    span: tuple[float, float],
    t: float,
    y: np.ndarray,
    horizon: float,
) -> DeterminantZero | None:
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
    # The desingularised flow costs little; at these tolerances its errors stay far below TRANSVERSAL.
    inner = Stepper(
        compile_flow(validity.desingularised),
        stepper.p,
        Method.DOP853,
        min(stepper.rtol, 1e-12),
        min(stepper.atol, 1e-15),
    )

    def above(s: np.ndarray, states: np.ndarray) -> np.ndarray:
        """det g_y, and what is left of it until it has all but tended to zero; both positive at first."""
        left = np.sign(value) * validity.crossing(states, stepper.p)[:, :1]
        return left - abs(value) * np.array([0.0, TENDED])

    def settle_tended(search: Search, column: int, s: float, piece: RunPiece) -> Settled | None:
        settled = settle_event(search, column, s, piece)
        crosses = (
            settled is not None
            and abs(validity.crossing(settled.y, stepper.p)[1]) > TRANSVERSAL * abs(slope)
        )  # fmt: skip
        return None if crosses else settled

    watched = [Watched("det g_y", 0, 1, settle_event), Watched("rest of det g_y", 0, 1, settle_tended)]
    search = Search(above, watched, np.ones(2), inner, (0.0, np.nan), begun)
    record = search.truncated(inner.through(begun, 0.0, np.array([length]), max_steps=MAX_STEPS, watch=search))
    if search.end is None:
        return None
    end = search.end.y
    reached = validity.crossing(end, stepper.p)
    if abs(reached[0]) > 2.0 * TENDED * abs(value):
        # It jumps through zero, at a kink.
        return None
    kind = LossKind.FOLD
    if abs(reached[0]) > 0.5 * TENDED * abs(value):
        count = len(validity.slow)
        fast = slice(count, count + len(validity.fast))
        step = _rest(inner, end, -reached[1] / reached[0], fast)
        end = end + step
        is_long = np.abs(step) > SMALL_STEP * np.abs(record.states).max(axis=0) + stepper.atol
        kind = LossKind.BRANCH_POLE if is_long.any() else LossKind.FOLDED_SINGULARITY
    elif not abs(reached[1]) > TRANSVERSAL * abs(slope):
        return None
    places = [validity.states.index(s) for s in flow.manifold.coordinates]
    point = end[: len(z)]
    state = np.concatenate([point[places], end[len(z) : -1]])
    if kind is LossKind.FOLDED_SINGULARITY:
        # What has grown off an explicit branch is no part of it.
        on_manifold = validity.point(state, stepper.p)
        point = on_manifold if np.isfinite(on_manifold).all() else point
        pulled = [np.linalg.norm(validity.pulled(at, stepper.p)) for at in (z, point)]
        if pulled[1] <= BRANCH_POINT * pulled[0]:
            kind = LossKind.BRANCH_POINT
    return DeterminantZero(float(end[-1]), state, point, kind)


def _rest(inner: Stepper, end: np.ndarray, decay: float, fast: slice) -> np.ndarray:
    """What is left of the way from `end` to an equilibrium where det g_y falls at the rate `decay`.

    All but the `fast` variables move at multiples of det g_y; these have a rate of their own.
    """
    moved = inner.compiled.rates(end, inner.p)
    step = moved / decay
    bend = inner.compiled.rates(end + SLOWEST * step, inner.p) - moved
    size = float(moved[fast] @ moved[fast])
    if size > 0.0:
        step[fast] /= np.clip(-float(moved[fast] @ bend[fast]) / (SLOWEST * size), SLOWEST, 4.0)
    return step
