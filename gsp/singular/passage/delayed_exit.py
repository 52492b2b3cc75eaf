"""Where and when a delayed loss of stability lets go: the result of `entry_exit`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.loss_kind import LossKind
from gsp.errors import Status
from gsp.results.card import Card
from gsp.singular.passage.failure import PassageError
from gsp.singular.passage.losses_met import Outcome, PassedLoss
from gsp.singular.passage.slow_orbit import ResolvedPanel, crossing, interpolate
from gsp.systems.arguments import check_number
from gsp.systems.flow import check_epsilon, in_words

# ln of what rounding adds to a deviation, relative to the fast variables, and of the least positive double.
ROUNDING = float(-np.log(np.finfo(float).eps / 2.0))
UNDERFLOW = float(-np.log(np.finfo(float).tiny))


# Roundings of a run add up, or cancel, by how the processor orders its sums: by 8 times up for 26,000 steps of RADAU5
# and 160 times down for 1,400 steps of RADAU13, over 160 runs. A thousand either way leaves none outside.
ROUNDING_SPREAD = float(np.log(1000.0))


class ExitKind(StrEnum):
    """What ends the stay near the branch."""

    ENTRY_EXIT = "way in, way out"
    BUFFER = "buffer point"
    AT_LOSS = "no delay"
    NONE = "no exit"


@dataclass(frozen=True, eq=False, repr=False)
class DelayedExit(Card):
    """How long an orbit stays near `branch` from `start` on: `kind`, slow time `t` of the exit, its `point` by name.

    `losses` are those met on the way, in order; `invariant` says whether the branch is invariant for epsilon > 0.
    `depth` = max(-Phi): a deviation shrinks by exp(-depth/epsilon). `times`, `phi` and `eigenvalues` (k,) sample (1)
    for charts, and `takeovers` are the times where another eigenvalue becomes the rightmost, or two real ones become
    a pair. Without an exit `t` is the last time reached and `status` says why.
    """

    branch: Branch
    start: Mapping[str, float]
    kind: ExitKind
    t: float
    point: Mapping[str, float]
    losses: tuple[PassedLoss, ...]
    invariant: bool
    times: np.ndarray
    phi: np.ndarray
    eigenvalues: np.ndarray
    takeovers: tuple[float, ...]
    status: Status
    _pieces: tuple[ResolvedPanel, ...] = ()
    _phi_ends: tuple[float, ...] = ()

    @property
    def loss(self) -> PassedLoss:
        """The loss that the exit belongs to: the last one met."""
        if not self.losses:
            raise PassageError(f"no loss of stability was met. {self.message}")
        return self.losses[-1]

    @property
    def depth(self) -> float:
        """max(-Phi) up to `t`."""
        met = [self._phi_at(t) for t in (self.t, *(loss.t for loss in self.losses))]
        return max(0.0, *(-float(phi) for phi in (*met, *self.phi[self.times <= self.t])))

    @property
    def buffer(self) -> float | None:
        """Slow time of the buffer point, the latest exit whatever the start; None where the losses set no limit, or a
        real one is met before."""
        for loss in self.losses:
            if np.isfinite(loss.limit) and self.kind is not ExitKind.AT_LOSS:
                return self._first_time(self._phi_at(loss.t) + loss.limit, loss.t)
        return None

    def time_of_rise(self, amount: float) -> float | None:
        """The slow time when Phi has risen by `amount` since the loss; None when it was not computed so far."""
        after = self.loss.t
        rise = check_number(amount, what="amount", be="a rise of Phi")
        return self._first_time(self._phi_at(after) + rise, after)

    @property
    def _rise(self) -> float:
        """By how much Phi rises from the loss to the exit."""
        return self._phi_at(self.t) - self._phi_at(self.loss.t)

    @property
    def rounding(self) -> float:
        """ln of the smallest relative deviation that double precision holds on this branch.

        36.7 where the fast variables are not 0 on the slow manifold; 708 where they are, since numbers near 0 keep
        their relative precision until they underflow, provided that the integrator's atol is as small.
        """
        vanishing = self.branch.graph is not None and all(h == 0 for h in self.branch.graph.values())
        return UNDERFLOW if self.invariant and vanishing else ROUNDING

    def double_exit(self, epsilon: float) -> float | None:
        """Slow time at which a computation in double precision leaves, when that is before the exit; else None.

        Rounding restores a deviation exp(-rounding), which grows from the loss on: Phi rises by epsilon * rounding.
        """
        small = check_epsilon(epsilon)
        if self.kind in (ExitKind.AT_LOSS, ExitKind.NONE) or not self.losses:
            return None
        amount = small * self.rounding
        return None if self._rise <= amount else self.time_of_rise(amount)

    def double_exit_band(self, epsilon: float) -> tuple[float, float] | None:
        """Slow times between which a computation in double precision leaves, on any processor; None as `double_exit`.

        What rounding restores is exp(-rounding) times at most a thousand, and at least a thousandth.
        """
        small = check_epsilon(epsilon)
        if self.double_exit(small) is None:
            return None
        ends = []
        for spread in (-ROUNDING_SPREAD, ROUNDING_SPREAD):
            amount = small * (self.rounding + spread)
            time = self.time_of_rise(amount) if amount < self._rise else None
            ends.append(self.t if time is None else time)
        return ends[0], ends[1]

    def warning(self, epsilon: float) -> str:
        """What to know before integrating this passage in double precision at `epsilon`; empty when nothing."""
        small = check_epsilon(epsilon)
        band = self.double_exit_band(small)
        if band is None:
            return ""
        rise = self._rise / small
        return (
            f"double precision leaves early at {self.branch.system.epsilon} = {small:g}, between t = "
            f"{band[0]:.6g} and {band[1]:.6g} instead of {self.t:.6g}: the deviation falls to exp(-{rise:.1f}), "
            f"rounding holds exp(-{self.rounding:.1f}). "
            f"Use follow(..., digits={int(rise / np.log(10.0)) + 16})."
        )

    @property
    def message(self) -> str:
        """One line: the exit, and why it is there."""
        place = in_words(self.point, 12)
        if self.kind is ExitKind.NONE:
            why = "Phi has not come back" if self.losses else "no loss of stability was met"
            remedy = {
                Status.REGION_LEFT: "the orbit leaves the region there; enlarge it",
                Status.TOO_MANY_STEPS: "raise longest, or start nearer to a loss of stability",
            }.get(self.status, self.status.remedy)
            return f"no exit up to slow time {self.t:.6g}, {place}: {why}; {remedy}"
        reason = {
            ExitKind.ENTRY_EXIT: "int Re lambda is back at 0",
            ExitKind.BUFFER: "no orbit stays longer than to the buffer point",
            ExitKind.AT_LOSS: "the branch is not invariant for epsilon > 0: exit O(epsilon^(1/2)) after the loss"
            if self._is_pushed_off
            else "the branch is not invariant for epsilon > 0: exit O((epsilon ln 1/epsilon)^(1/2)) after the loss",
        }[self.kind]
        extra = ""
        if any(loss.outcome is Outcome.UNDECIDED for loss in self.losses):
            extra = "; the branch is not invariant, but rho = 0 at the loss: higher orders decide, this is the latest"
        elif self.kind is ExitKind.ENTRY_EXIT and not self.invariant:
            missing = [loss for loss in self.losses if loss.eigenvalue.imag and not loss.turning_points]
            extra = (
                "; no turning point that sets a limit was found: there may be a buffer point before"
                if missing
                else ""
            )
        return f"{self.kind}: exit after slow time {self.t:.12g} at {place}; {reason}{extra}"

    @property
    def _is_pushed_off(self) -> bool:
        """Whether a push of the first order in epsilon meets another branch at the last loss."""
        last = self.losses[-1:]
        return bool(last) and last[0].kind is LossKind.TRANSCRITICAL and "order" not in last[0].coefficients

    def _phi_at(self, t: float) -> float:
        for piece, before in zip(self._pieces, self._phi_ends):
            if t <= piece.t[-1]:
                return before + float(interpolate(piece.t, piece.primitive, np.array([t]))[0])
        return float(self.phi[-1])

    def _first_time(self, level: float, after: float) -> float | None:
        for piece, before in zip(self._pieces, self._phi_ends):
            if piece.t[-1] <= after:
                continue
            values = before + piece.primitive
            for i in range(1, len(values)):
                if piece.t[i] > after and values[i] >= level:
                    return crossing(piece.t, values, level, i)
        return None

    def __repr__(self) -> str:
        return f"DelayedExit({self.message})"

    def __str__(self) -> str:
        lines = [
            f"passage along {self.branch}",
            "  from " + in_words(self.start, 8),
        ]
        lines += [f"  {loss}" for loss in self.losses]
        lines += [f"  another eigenvalue takes over at t = {t:.8g}" for t in self.takeovers]
        if self.buffer is not None:
            lines.append(f"  buffer point at t = {self.buffer:.12g}")
        lines.append(f"  depth max(-Phi) = {self.depth:.8g}")
        lines.append(f"  {self.message}")
        return "\n".join(lines)
