"""Delayed exit: an orbit that stays near a branch of M0 after it has lost its stability.

Along the reduced orbit x(t) on the branch, started at t = 0 where it attracts, the way-in/way-out function

    Phi(t) = int_0^t Re lambda(x(s)) ds,    lambda the rightmost fast eigenvalue,                              (1)

falls, and rises again after the loss; a deviation of size 1 at the start has the size exp(Phi/epsilon). Where the
branch is invariant for epsilon > 0 the orbit leaves when Phi is back at 0 (De Maesschalck and Schecter, J.
Differential Equations 260 (2016) 6697-6715). Where it is not, the slow manifolds of both sides differ, and Phi cannot
rise by more than the limit of the loss: up to the buffer point at a pair of complex eigenvalues
(`gsp.singular.passage.complex_time`), not at all at a real one (`gsp.singular.passage.losses_met`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.continuation import SpecialKind
from gsp.errors import DeclarationError, Status
from gsp.lowering.compiled_flow import compile_flow, compile_function
from gsp.results.card import Card
from gsp.singular.passage.failure import PassageError
from gsp.singular.passage.losses_met import Outcome, PassedLoss, passed_loss
from gsp.singular.passage.slow_orbit import Piece, SlowOrbit, crossing, interpolate
from gsp.systems.arguments import check_noun, check_number, shown
from gsp.systems.flow import Point, as_points, check_epsilon
from gsp.systems.region import Interval, check_region

# ln of what rounding adds to a deviation, relative to the fast variables, and of the least positive double.
ROUNDING = float(-np.log(np.finfo(float).eps / 2.0))
UNDERFLOW = float(-np.log(np.finfo(float).tiny))
# Roundings of a run add up, or cancel, by how the processor orders its sums: by 8 times up for 26,000 steps of RADAU5
# and 160 times down for 1,400 steps of RADAU13, over 160 runs. A thousand either way leaves none outside.
ROUNDING_SPREAD = float(np.log(1000.0))
# The branch counts as invariant when its residual is below this, relative to its terms, at these epsilons.
INVARIANT, TRIED = 1e-10, (0.37, 0.11)
# Takeovers nearer than this in slow time are one: where two eigenvalues meet they are known to the root of rounding.
SAME = 1e-4


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
    depth: float
    times: np.ndarray
    phi: np.ndarray
    eigenvalues: np.ndarray
    takeovers: tuple[float, ...]
    status: Status
    _pieces: tuple[Piece, ...] = ()
    _phi_ends: tuple[float, ...] = ()

    @property
    def loss(self) -> PassedLoss:
        """The loss that the exit belongs to: the last one met."""
        if not self.losses:
            raise PassageError(f"no loss of stability was met. {self.message}")
        return self.losses[-1]

    @property
    def buffer(self) -> float | None:
        """Slow time of the buffer point, the latest exit whatever the start; None where the losses set no limit."""
        for loss in self.losses:
            if np.isfinite(loss.limit) and loss.limit > 0.0:
                return self.time_of_rise(loss.limit)
        return None

    def time_of_rise(self, amount: float) -> float | None:
        """The slow time when Phi has risen by `amount` since the loss; None when it was not computed so far."""
        loss = self.loss
        level = self._phi_at(loss.t) + amount
        return self._first_time(level, loss.t)

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
        rise = self._phi_at(self.t) - self._phi_at(self.loss.t)
        return None if rise <= small * self.rounding else self.time_of_rise(small * self.rounding)

    def double_exit_band(self, epsilon: float) -> tuple[float, float] | None:
        """Slow times between which a computation in double precision leaves, on any processor; None as `double_exit`.

        What rounding restores is exp(-rounding) times at most a thousand, and at least a thousandth.
        """
        small = check_epsilon(epsilon)
        if self.double_exit(small) is None:
            return None
        rise = self._phi_at(self.t) - self._phi_at(self.loss.t)
        ends = []
        for spread in (-ROUNDING_SPREAD, ROUNDING_SPREAD):
            amount = small * (self.rounding + spread)
            time = self.time_of_rise(amount) if amount < rise else None
            ends.append(self.t if time is None else time)
        return ends[0], ends[1]

    def warning(self, epsilon: float) -> str:
        """What to know before integrating this passage in double precision at `epsilon`; empty when nothing."""
        small = check_epsilon(epsilon)
        band = self.double_exit_band(small)
        if band is None:
            return ""
        rise = (self._phi_at(self.t) - self._phi_at(self.loss.t)) / small
        return (
            f"double precision leaves early at epsilon = {small:g}, between t = {band[0]:.6g} and "
            f"{band[1]:.6g} instead of {self.t:.6g}: the deviation falls to exp(-{rise:.1f}), rounding holds "
            f"exp(-{self.rounding:.1f}). "
            f"Use follow(..., digits={int(rise / np.log(10.0)) + 16})."
        )

    @property
    def message(self) -> str:
        """One line: the exit, and why it is there."""
        place = ", ".join(f"{name} = {v:.12g}" for name, v in self.point.items())
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
            if self.losses and self.losses[-1].kind is SpecialKind.TRANSCRITICAL
            else "the branch is not invariant for epsilon > 0: exit O((epsilon ln 1/epsilon)^(1/2)) after the loss",
        }[self.kind]
        extra = ""
        if any(loss.outcome is Outcome.UNDECIDED for loss in self.losses):
            extra = "; the branch is not invariant, but rho = 0 at the loss: higher orders decide, this is the latest"
        elif self.kind is ExitKind.ENTRY_EXIT and not self.invariant:
            missing = [loss for loss in self.losses if loss.eigenvalue.imag and not loss.turning_points]
            extra = "; no turning point was found, so there may be a buffer point before" if missing else ""
        return f"{self.kind}: exit after slow time {self.t:.12g} at {place}; {reason}{extra}"

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
            "  from " + ", ".join(f"{k} = {v:.8g}" for k, v in self.start.items()),
        ]
        lines += [f"  {loss}" for loss in self.losses]
        lines += [f"  another eigenvalue takes over at t = {t:.8g}" for t in self.takeovers]
        if self.buffer is not None:
            lines.append(f"  buffer point at t = {self.buffer:.12g}")
        lines.append(f"  depth max(-Phi) = {self.depth:.8g}")
        lines.append(f"  {self.message}")
        return "\n".join(lines)


def entry_exit(
    branch: Branch,
    *,
    start: Point,
    region: Mapping[str, Interval] | None = None,
    longest: float = 100.0,
) -> DelayedExit:
    """Where an orbit that comes to `branch` over the slow variables `start` leaves it after a loss of stability.

    The reduced orbit is followed through the losses for at most `longest` in slow time, and while it stays in
    `region` (states by name). An implicit branch needs its sheet fixed. Any number of slow and of fast variables;
    several fast modes are taken to be coupled, as they are by eigenvectors that turn, so that the rightmost
    eigenvalue counts.

    Raises `PassageError` where the branch does not attract at the start, and where it ends (a fold);
    `UnsupportedFunctionError` when a pair is lost and the field is not analytic; `DeclarationError` for arguments
    that are not well formed.

    >>> from gsp import SlowFastSystem, solve_critical
    >>> x, y, epsilon = sp.symbols("x y epsilon")
    >>> branch = solve_critical(SlowFastSystem(slow={y: 1}, fast={x: (y + y**2)*x}, epsilon=epsilon)).branches[0]
    >>> round(entry_exit(branch, start={"y": -0.5}).point["y"], 12)
    0.366025403784
    """
    check_noun(branch, Branch, verb="entry_exit")
    system = branch.system
    array, single = as_points(system.x, start, what="start")
    if not single:
        raise DeclarationError(f"start is one point. Got {len(array)} of them. Call entry_exit for each.")
    longest = check_number(longest, what="longest", be="a positive slow time", above=0.0)
    if not np.isfinite(array).all():
        raise DeclarationError(f"start is finite. Got {shown(start)}.")
    box = None if region is None else check_region(region, [s.name for s in system.states])
    orbit = SlowOrbit(branch, array[0])
    values = orbit.eigenvalues(orbit.state[None, :])[0]
    if values[0].real >= 0.0:
        raise PassageError(
            f"the branch does not attract at the start, {orbit.shown(orbit.state)}: fast eigenvalues "
            f"{np.array2string(values, precision=4)}. Start where all real parts are negative."
        )
    return _Passage(orbit, box, float(longest)).result()


class _Passage:
    """The march along one orbit: pieces, losses and levels so far."""

    def __init__(self, orbit: SlowOrbit, box: Mapping[str, Interval] | None, longest: float) -> None:
        self.orbit, self.box, self.longest = orbit, box, longest
        self.start = orbit.state.copy()
        self.pieces: list[Piece] = []
        self.ends: list[float] = []
        self.losses: list[PassedLoss] = []
        self.takeovers: list[float] = []
        self.phi, self.depth = 0.0, 0.0
        # Phi at which an orbit leaves, and what sets it.
        self.level, self.kind = 0.0, ExitKind.ENTRY_EXIT
        self.invariant = True

    def result(self) -> DelayedExit:
        status = Status.TOO_MANY_STEPS
        while self.orbit.end < self.longest:
            panel = self.orbit.advance()
            self.invariant = self.invariant and is_invariant(self.orbit, panel.z)
            for piece in self.orbit.pieces(panel):
                found = self._piece(piece)
                if found is not None and self._outside(self.orbit.at(found)):
                    return self._finish(found, ExitKind.NONE, Status.REGION_LEFT)
                if found is not None:
                    self._look_ahead(found)
                    return self._finish(found, self.kind, Status.SUCCESS)
            if self._outside(panel.z[-1]):
                status = Status.REGION_LEFT
                break
        return self._finish(self.orbit.end, ExitKind.NONE, status)

    def _look_ahead(self, t: float) -> None:
        """Phi beyond the exit: as far again as the loss is behind, or to the buffer point, for charts."""
        loss = self.losses[-1]
        wanted = max((loss.limit for loss in self.losses if np.isfinite(loss.limit)), default=0.0)
        base = self.ends[-1] + float(np.max(self.pieces[-1].primitive))
        goal, until = base + wanted, min(self.longest, t + 0.5 * (t - loss.t))
        try:
            while self.orbit.end < self.longest and (self.orbit.end < until or self.phi < goal):
                panel = self.orbit.advance()
                for piece in self.orbit.pieces(panel):
                    self.pieces.append(piece)
                    self.ends.append(self.phi)
                    self.phi += float(piece.primitive[-1])
                if self._outside(panel.z[-1]):
                    break
        except PassageError:
            # The branch may end here: what was asked for has been found.
            return

    def _piece(self, piece: Piece) -> float | None:
        """Take in one piece; the time of the exit when it is on it."""
        if piece.has_kink and all(abs(piece.t[0] - other) > SAME * (1.0 + other) for other in self.takeovers):
            self.takeovers.append(float(0.5 * (piece.t[0] + piece.t[-1])))
        before = self.phi
        self.pieces.append(piece)
        self.ends.append(before)
        phi = before + piece.primitive
        self.phi = float(phi[-1])
        for i in range(1, len(phi)):
            if piece.values[i - 1] < 0.0 <= piece.values[i]:
                t = crossing(piece.t, piece.values, 0.0, i)
                self._meet(piece, t, before)
                if self.kind is ExitKind.AT_LOSS:
                    return t
            self.depth = max(self.depth, -float(phi[i]))
            if self.losses and phi[i] >= self.level and piece.values[i] > 0.0:
                return crossing(piece.t, phi, self.level, i)
        return None

    def _meet(self, piece: Piece, t: float, before: float) -> None:
        slope = float(interpolate(piece.t, _derivative(piece), np.array([t]))[0])
        loss = passed_loss(self.orbit, t, slope, invariant=self.invariant)
        self.losses.append(loss)
        here = before + float(interpolate(piece.t, piece.primitive, np.array([t]))[0])
        self.depth = max(self.depth, -here)
        if here + loss.limit < self.level:
            self.level = here + loss.limit
            self.kind = ExitKind.AT_LOSS if loss.limit == 0.0 else ExitKind.BUFFER

    def _outside(self, z: np.ndarray) -> bool:
        names = [s.name for s in self.orbit.branch.system.states]
        return self.box is not None and any(
            not low <= z[names.index(name)] <= high for name, (low, high) in self.box.items()
        )

    def _finish(self, t: float, kind: ExitKind, status: Status) -> DelayedExit:
        orbit = self.orbit
        names = [s.name for s in orbit.branch.system.states]
        small = 1e-14 * (1.0 + float(np.abs(self.start).max()))
        phi = [before + piece.primitive for piece, before in zip(self.pieces, self.ends)]
        return DelayedExit(
            branch=orbit.branch,
            start=MappingProxyType(dict(zip(names, map(float, self.start)))),
            kind=kind,
            t=t,
            point=MappingProxyType(
                dict(zip(names, (0.0 if abs(v) < small else float(v) for v in orbit.at(t))))
            ),
            losses=tuple(self.losses),
            invariant=self.invariant,
            depth=self.depth,
            times=np.concatenate([piece.t for piece in self.pieces]),
            phi=np.concatenate(phi),
            eigenvalues=np.concatenate([piece.eigenvalue for piece in self.pieces]),
            takeovers=tuple(self.takeovers),
            status=status,
            _pieces=tuple(self.pieces),
            _phi_ends=tuple(self.ends),
        )


def is_invariant(orbit: SlowOrbit, z: np.ndarray) -> bool:
    """Whether E_y g + epsilon E_x f vanishes at points (m, n) of the branch for epsilon > 0, to rounding."""
    system, equations = orbit.branch.system, orbit.equations
    m, n = len(system.x), len(system.y)
    function = compile_function(
        [*system.f, *system.g, *equations.E_x, *equations.E_y, *equations.g_y],
        arguments=system.states,
        epsilon=system.epsilon,
        parameters=tuple(system.parameters),
    )
    constants = compile_flow(system).constants.copy()
    for epsilon in TRIED:
        p = constants.copy()
        p[0] = epsilon
        out = function(z, p)
        f, g = out[:, :m], out[:, m : m + n]
        E_x = out[:, m + n : m + n + n * m].reshape(-1, n, m)
        E_y = out[:, m + n + n * m : m + n + n * m + n * n].reshape(-1, n, n)
        g_y = out[:, m + n + n * m + n * n :].reshape(-1, n, n)
        drift = np.einsum("kij,kj->ki", E_x, f)
        residual = np.einsum("kij,kj->ki", E_y, g) / epsilon + drift
        scale = np.abs(np.einsum("kij,kj->ki", np.abs(E_x), np.abs(f)))
        scale = scale + np.einsum("kij,kj->ki", np.abs(E_y), np.abs(g)) / epsilon
        noise = 1e-13 * np.abs(E_y).sum(axis=2) * (np.abs(g_y).sum(axis=2) * (1.0 + np.abs(z[:, m:])))
        if (np.abs(residual) > INVARIANT * scale + noise / epsilon).any():
            return False
    return True


def _derivative(piece: Piece) -> np.ndarray:
    """d/dt of the rightmost real part at the nodes."""
    degree = len(piece.t) - 1
    half = 0.5 * (piece.t[-1] - piece.t[0])
    nodes = (piece.t - piece.t[0]) / half - 1.0
    fitted = np.polynomial.chebyshev.chebfit(nodes, piece.values, degree)
    return np.polynomial.chebyshev.chebval(nodes, np.polynomial.chebyshev.chebder(fitted)) / half
