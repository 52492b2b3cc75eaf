"""Delayed exit: an orbit that stays near a branch of M0 after it has lost its stability.

Along the reduced orbit x(t) on the branch, started at t = 0 where it attracts, the way-in/way-out function

    Phi(t) = int_0^t Re lambda(x(s)) ds,    lambda the rightmost fast eigenvalue,                              (1)

falls, and rises again after the loss; a deviation of size 1 at the start has the size exp(Phi/epsilon). Where the
branch is invariant for epsilon > 0 the orbit leaves when Phi is back at 0 (De Maesschalck and Schecter, J.
Differential Equations 260 (2016) 6697-6715). Where it is not, the slow manifolds of both sides differ, and Phi cannot
rise by more than the limit of the loss: up to the buffer point at a pair of complex eigenvalues
(`gsp.singular.passage.complex_time`), not at all at a real one (`gsp.singular.passage.losses_met`), be it the rightmost
or one that follows it.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.loss_kind import LossKind
from gsp.errors import DeclarationError, Status
from gsp.lowering.compiled_flow import parameter_vector
from gsp.lowering.compiled_function import compile_over
from gsp.roots import root
from gsp.singular.passage.delayed_exit import DelayedExit, ExitKind
from gsp.singular.passage.failure import PassageError
from gsp.singular.passage.losses_met import PassedLoss, check_touching, passed_loss
from gsp.singular.passage.slow_orbit import RESOLVED, ResolvedPanel, SlowOrbit, crossing, interpolate
from gsp.systems.arguments import check_noun, check_number
from gsp.systems.flow import Point, as_points
from gsp.systems.region import Interval, check_region, shown_region

# Takeovers nearer than this share of the slow time are one: where two eigenvalues meet they are known to the root of
# rounding.
SAME = 1e-4


def entry_exit(
    branch: Branch,
    *,
    start: Point,
    region: Mapping[str, Interval] | None = None,
    longest: float | None = None,
) -> DelayedExit:
    """Where an orbit that comes to `branch` over the slow variables `start` leaves it after a loss of stability.

    The reduced orbit is followed through the losses for at most `longest` in slow time, or `PATIENCE` times that in
    which it or its rightmost eigenvalue gets somewhere, and while it stays in `region` (states by name). An implicit
    branch needs its sheet fixed. Any number of slow and of fast variables; several fast modes are taken to be
    coupled, as they are by eigenvectors that turn, so that the rightmost eigenvalue counts.

    Raises `PassageError` where the branch does not attract at the start, where it ends (a fold), where an eigenvalue of
    fast variables that the others do not move takes over, and on a branch that is not invariant where an eigenvalue
    rises through 0 with no speed, where several do together, and where a second pair reaches its buffer point first;
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
        raise DeclarationError("start is one point.", "Call entry_exit for each.", got=f"{len(array)} of them")
    if longest is not None:
        longest = check_number(longest, what="longest", be="a positive slow time", above=0.0)
    box = None if region is None else check_region(region, [s.name for s in system.states])
    orbit = SlowOrbit(branch, array[0], box)
    if orbit.margin(orbit.state) < 0.0:
        raise DeclarationError(
            f"the start, {orbit.shown(orbit.state)}, lies outside the region.",
            "Enlarge the region, or start in it.",
            got=shown_region(box or {}),
        )
    values = orbit.eigenvalues(orbit.state[None, :])[0]
    if values[0].real >= 0.0:
        raise PassageError(
            f"the branch does not attract at the start, {orbit.shown(orbit.state)}: fast eigenvalues "
            f"{np.array2string(values, precision=4)}.",
            "Start where all real parts are negative.",
        )
    return _Passage(orbit, orbit.patience if longest is None else longest).result()


class _Passage:
    """The march along one orbit: pieces, losses and levels so far."""

    def __init__(self, orbit: SlowOrbit, longest: float) -> None:
        self.orbit, self.longest = orbit, longest
        self.start = orbit.state.copy()
        self.pieces: list[ResolvedPanel] = []
        self.ends: list[float] = []
        self.losses: list[PassedLoss] = []
        self.takeovers: list[float] = []
        self.phi = 0.0
        # Phi at which an orbit leaves, and what sets it.
        self.level, self.kind = 0.0, ExitKind.ENTRY_EXIT
        self.invariant = True
        # Pairs that are lost beside the rightmost eigenvalue, with the time and the growth that their limit allows.
        self.beside: list[tuple[int, float, float]] = []

    def result(self) -> DelayedExit:
        while self.orbit.end < self.longest:
            panel = self.orbit.advance()
            self.invariant = self.invariant and is_invariant(self.orbit, panel.z)
            for piece in self.orbit.pieces(panel):
                found = self._piece(piece)
                if found is not None and self.orbit.margin(self.orbit.at(found)) < 0.0:
                    return self._finish(self._leaving(panel.t[0], found), ExitKind.NONE, Status.REGION_LEFT)
                if found is not None and found <= self.longest:
                    self._check_beside(found)
                    self._look_ahead(found)
                    return self._finish(found, self.kind, Status.SUCCESS)
            if self.orbit.margin(panel.z[-1]) < 0.0:
                left = self._leaving(panel.t[0], panel.t[-1])
                if left <= self.longest:
                    return self._finish(left, ExitKind.NONE, Status.REGION_LEFT)
        return self._finish(self.longest, ExitKind.NONE, Status.TOO_MANY_STEPS)

    def _leaving(self, inside: float, outside: float) -> float:
        """The time at which the orbit leaves the region between two."""
        found = root(lambda t: self.orbit.margin(self.orbit.at(t)), float(inside), float(outside))
        return float(outside) if found is None else found

    def _look_ahead(self, t: float) -> None:
        """Phi beyond the exit: as far again as the loss is behind, or to the buffer point, for charts."""
        loss = self.losses[-1]
        furthest = max((loss.limit for loss in self.losses if np.isfinite(loss.limit)), default=0.0)
        base = self.ends[-1] + float(np.max(self.pieces[-1].primitive))
        goal, until = base + furthest, min(self.longest, t + 0.5 * (t - loss.t))
        try:
            while self.orbit.end < self.longest and (self.orbit.end < until or self.phi < goal):
                panel = self.orbit.advance()
                for piece in self.orbit.pieces(panel):
                    self.pieces.append(piece)
                    self.ends.append(self.phi)
                    self.phi += float(piece.primitive[-1])
                if self.orbit.margin(panel.z[-1]) < 0.0:
                    break
        except PassageError:
            # The branch may end here: what was asked for has been found.
            return

    def _piece(self, piece: ResolvedPanel) -> float | None:
        """Take in one piece; the time of the exit when it is on it."""
        if piece.has_kink and all(abs(piece.t[0] - other) > SAME * self.orbit.end for other in self.takeovers):
            self.takeovers.append(float(0.5 * (piece.t[0] + piece.t[-1])))
            self._check_coupled(piece)
        before = self.phi
        self.pieces.append(piece)
        self.ends.append(before)
        self.phi = before + float(piece.primitive[-1])
        touches = self._touches(piece)
        found = self._left(piece, before, touches)
        if not self.invariant:
            for t in touches:
                if found is None or t < found:
                    check_touching(self.orbit, t)
        if self.invariant or not self.losses or self.kind is ExitKind.AT_LOSS:
            return found
        return self._left_beside(piece, found)

    def _touches(self, piece: ResolvedPanel) -> list[float]:
        """The times on the piece at which the rightmost real part comes up to 0, as resolved, and falls."""
        noise = len(piece.t) * RESOLVED * self.orbit.rate
        slopes = np.zeros(0) if piece.has_kink else _derivative(piece.t, piece.values)
        turns = 1 + np.flatnonzero((slopes[:-1] > 0.0) & (slopes[1:] <= 0.0))
        times = [crossing(piece.t, slopes, 0.0, int(i)) for i in turns]
        return [t for t in times if abs(interpolate(piece.t, piece.values, np.array([t]))[0]) <= noise]

    def _left(self, piece: ResolvedPanel, before: float, touches: list[float]) -> float | None:
        """The time on the piece at which the level is reached, or the rightmost eigenvalue lets orbits leave."""
        phi = before + piece.primitive
        for i in range(1, len(phi)):
            beside = piece.t[i - 1], piece.t[min(i + 1, len(phi) - 1)]
            rises = piece.values[i - 1] < 0.0 <= piece.values[i]
            if rises and not any(beside[0] <= t <= beside[1] for t in touches):
                t = crossing(piece.t, piece.values, 0.0, i)
                self._meet(piece, t, before)
                if self.kind is ExitKind.AT_LOSS:
                    return t
            if self.losses and phi[i] >= self.level and piece.values[i] > 0.0:
                return crossing(piece.t, phi, self.level, i, after=self.losses[-1].t)
        return None

    def _left_beside(self, piece: ResolvedPanel, exit_at: float | None) -> float | None:
        """The time on the piece, before `exit_at`, at which a real loss left of the rightmost eigenvalue is met."""
        first, n = 2 if self.losses[0].kind is LossKind.HOPF else 1, len(self.orbit.branch.system.y)
        if first >= n:
            return exit_at
        real = np.real(self.orbit.eigenvalues(np.array([self.orbit.at(t) for t in piece.t])))
        met = []
        for which in range(first, n):
            values = real[:, which]
            for i in 1 + np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0)):
                met.append((crossing(piece.t, values, 0.0, int(i)), which))
        for t, which in sorted(met):
            if exit_at is not None and t >= exit_at:
                break
            slope = float(interpolate(piece.t, _derivative(piece.t, real[:, which]), np.array([t]))[0])
            loss = passed_loss(self.orbit, t, slope, invariant=False, which=which)
            if loss.limit == 0.0:
                self.losses.append(loss)
                self.kind = ExitKind.AT_LOSS
                return t
            if np.isfinite(loss.limit):
                self.beside.append((which, t, loss.limit))
        return exit_at

    def _check_beside(self, t: float) -> None:
        """Raise `PassageError` where a pair beside the rightmost eigenvalue reaches its limit before the exit."""
        from scipy.integrate import quad

        for which, since, limit in self.beside:
            grown = quad(
                lambda s, k=which: self.orbit.eigenvalues(self.orbit.at(s)[None, :])[0, k].real, since, t
            )[0]
            if grown >= limit:
                raise PassageError(
                    f"a second pair of eigenvalues rises through 0 at t = {since:.6g}, and reaches its buffer point "
                    f"before the exit at t = {t:.6g}: how the branch is left is not decided here.",
                    "Run the full system.",
                )

    def _check_coupled(self, piece: ResolvedPanel) -> None:
        """Raise `PassageError` where what takes over is an eigenvalue of fast variables that the others do not move."""
        orbit, panel = self.orbit, self.orbit.panels[-1]
        matrices = np.array([orbit.fast_jacobian(z) for z in panel.z])
        moved = (matrices != 0.0).any(axis=0) | np.eye(matrices.shape[1], dtype=bool)
        reached = np.linalg.matrix_power((moved | moved.T).astype(float), len(moved)) > 0.0
        groups = np.unique(reached, axis=0, return_inverse=True)[1].ravel()
        count = int(groups.max()) + 1
        if count == 1:
            return

        def rightmost(t: float) -> int:
            g_y = orbit.fast_jacobian(orbit.at(t))
            blocks = [g_y[np.ix_(groups == k, groups == k)] for k in range(count)]
            return int(np.argmax([np.linalg.eigvals(block).real.max() for block in blocks]))

        beside = SAME * (panel.t[-1] - panel.t[0])
        first, last = max(piece.t[0] - beside, panel.t[0]), min(piece.t[-1] + beside, panel.t[-1])
        if rightmost(float(first)) != rightmost(float(last)):
            fast = [y.name for y in orbit.branch.system.y]
            told = "; ".join(
                ", ".join(name for name, g in zip(fast, groups) if g == k) for k in dict.fromkeys(groups)
            )
            raise PassageError(
                f"another eigenvalue takes over at t = {piece.t[0]:.6g}, of fast variables that the others do not move "
                f"({told}), so that each group leaves for itself.",
                "Ask for each group by itself, with the others put in from the branch.",
            )

    def _meet(self, piece: ResolvedPanel, t: float, before: float) -> None:
        slope = float(interpolate(piece.t, _derivative(piece.t, piece.values), np.array([t]))[0])
        loss = passed_loss(self.orbit, t, slope, invariant=self.invariant)
        self.losses.append(loss)
        here = before + float(interpolate(piece.t, piece.primitive, np.array([t]))[0])
        if here + loss.limit < self.level:
            self.level = here + loss.limit
            self.kind = ExitKind.AT_LOSS if loss.limit == 0.0 else ExitKind.BUFFER

    def _finish(self, t: float, kind: ExitKind, status: Status) -> DelayedExit:
        orbit = self.orbit
        small = 1e-14 * (orbit.units + np.abs(self.start))
        phi = [before + piece.primitive for piece, before in zip(self.pieces, self.ends)]
        return DelayedExit(
            branch=orbit.asked,
            start=MappingProxyType(orbit.named(self.start)),
            kind=kind,
            t=t,
            point=MappingProxyType(orbit.named(orbit.at(t), small)),
            losses=tuple(loss for loss in self.losses if loss.t <= t),
            invariant=self.invariant,
            times=np.concatenate([piece.t for piece in self.pieces]),
            phi=np.concatenate(phi),
            eigenvalues=np.concatenate([piece.eigenvalue for piece in self.pieces]),
            takeovers=tuple(other for other in self.takeovers if other <= t),
            status=status,
            _pieces=tuple(self.pieces),
            _phi_ends=tuple(self.ends),
        )


def is_invariant(orbit: SlowOrbit, z: np.ndarray) -> bool:
    """Whether E_y g + epsilon E_x f vanishes at points (m, n) of the branch for epsilon > 0, to rounding."""
    system = orbit.branch.system
    m, slopes, g_y = len(system.x), orbit.slopes(z), orbit.sampler.fast_jacobian(z)
    E_x, E_y = slopes[:, :, :m], slopes[:, :, m:]
    rates = compile_over(system, [*system.f, *system.g])
    for epsilon in (0.37, 0.11):
        f, g = np.split(rates(z, parameter_vector(system, epsilon)), [m], axis=1)
        drift = np.einsum("kij,kj->ki", E_x, f)
        residual = np.einsum("kij,kj->ki", E_y, g) / epsilon + drift
        scale = np.abs(np.einsum("kij,kj->ki", np.abs(E_x), np.abs(f)))
        scale = scale + np.einsum("kij,kj->ki", np.abs(E_y), np.abs(g)) / epsilon
        lengths = orbit.units[m:] + np.abs(z[:, m:])
        noise = 1e-13 * np.einsum("kij,kjl,kl->ki", np.abs(E_y), np.abs(g_y), lengths)
        # The branch counts as invariant when its residual is below this, relative to its terms.
        if (np.abs(residual) > 1e-10 * scale + noise / epsilon).any():
            return False
    return True


def _derivative(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """d/dt of a real part at the nodes of a piece."""
    half = 0.5 * (t[-1] - t[0])
    nodes = (t - t[0]) / half - 1.0
    fitted = np.polynomial.chebyshev.chebfit(nodes, values, len(t) - 1)
    return np.polynomial.chebyshev.chebval(nodes, np.polynomial.chebyshev.chebder(fitted)) / half
