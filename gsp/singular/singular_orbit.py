"""Relaxation orbits in the limit: slow pieces on attracting sheets, joined by drops from folds.

The singular orbit follows the reduced flow of order 0 until it meets a fold, drops along the layer flow at constant x,
and goes on from where it lands. When it closes up and each fold on the way is generic, a relaxation orbit of the full
system lies within O(epsilon^(2/3)) of it (Szmolyan and Wechselberger, Journal of Differential Equations 200 (2004)
69-104; the planar case is E. F. Mishchenko's). Its period follows from the passage of each fold
(`passage.fold_passage`): the slow variables drop later by Delta x = x_1 epsilon^(2/3) + q epsilon ln epsilon, and the
fold takes the slow time

    Omega_0 (ab)^(-1/3) epsilon^(2/3) + (b c/a^2 - d/(2a))/(3b) epsilon ln epsilon + O(epsilon),

whence the period T = T_0 + T_1 epsilon^(2/3) + T_2 epsilon ln epsilon + O(epsilon), the shifts Delta x carried around
the orbit by the slow flow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.critical_manifold import solve_critical
from gsp.critical.sampling import Sampler
from gsp.errors import NO_REASON, BranchError, GspError, HyperbolicityError, Reason, Status
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.restriction import restrict
from gsp.integration.trajectory import Trajectory, trajectory_of
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.singular.passage.failure import PassageError
from gsp.singular.passage.fold_passage import FoldPassage, fold_passage, omega0
from gsp.slow.series import expand
from gsp.systems.arguments import check_noun, check_progress, check_whole
from gsp.systems.flow import Point, check_epsilon, complete, values_by_name

# Slow pieces are followed at this tolerance, each for at most so much slow time.
RTOL = 1e-11
ATOL = 0.01 * RTOL
PATIENCE = 1e4
# An orbit closes when a drop lands where an earlier one did, to this, relative to 1 + |x|.
CLOSED = 1e-8
MAX_PIECES = 200
# A fast eigenvalue is zero below this, relative to the largest or to 1.
ZERO = 1e-8
# Landing points are shifted by so much, relative to 1 + |x|, to carry the shifts of folds around the orbit.
SHIFT = 1e-5


@dataclass(frozen=True, eq=False, repr=False)
class SlowPiece:
    """A piece on an attracting sheet: the reduced `run`, over a slow time `duration`, and the `fold` at its end.

    `fold` is None when the piece ends otherwise; `run.message` says how.
    """

    run: Trajectory
    fold: FoldPassage | None

    @property
    def duration(self) -> float:
        """Slow time."""
        return float(self.run.t[-1] - self.run.t[0])

    def __repr__(self) -> str:
        return f"SlowPiece(slow time {self.duration:.8g}, {'to a fold' if self.fold else self.run.status.name})"


@dataclass(frozen=True, eq=False, repr=False)
class SingularOrbit(Drawn, Tabular):
    """Slow `pieces` in order, each but the last followed by the drop from its fold.

    When it `closes`, the last `period_pieces` of them make up the closed orbit, each followed by a drop, and
    `coefficients` = (T_0, T_1, T_2) are those of its period; otherwise they are None. `message` says how it ended.
    """

    branch: Branch
    pieces: tuple[SlowPiece, ...]
    period_pieces: int
    message: Reason

    @property
    def closes(self) -> bool:
        """Whether it is a closed orbit, after what leads to it."""
        return self.period_pieces > 0

    @property
    def cycle(self) -> tuple[SlowPiece, ...]:
        """The pieces of the closed orbit; empty when it does not close."""
        return self.pieces[len(self.pieces) - self.period_pieces :] if self.closes else ()

    @cached_property
    def coefficients(self) -> tuple[float, float, float] | None:
        """T_0, T_1 and T_2 of the period T_0 + T_1 epsilon^(2/3) + T_2 epsilon ln epsilon + O(epsilon)."""
        return _period(self.branch, self.cycle) if self.closes else None

    def period(self, epsilon: float) -> float:
        """Slow time around the orbit, the error being O(epsilon); nan when it does not close."""
        small = check_epsilon(epsilon)
        if self.coefficients is None:
            return float("nan")
        leading, first, second = self.coefficients
        return leading + first * small ** (2.0 / 3.0) + second * small * float(np.log(small))

    def __repr__(self) -> str:
        ending = f"closed, {self.period_pieces} drops" if self.closes else "open"
        return f"SingularOrbit({len(self.pieces)} slow pieces, {ending})"

    def __str__(self) -> str:
        lines = [f"singular orbit: {self.message}"]
        for piece in self.cycle or self.pieces:
            text = f"  slow time {piece.duration:.10g}"
            if piece.fold is not None:
                fold = ", ".join(f"{n} = {v:.8g}" for n, v in piece.fold.point.items())
                text += f" to the fold at {fold}; {piece.fold.drop}"
            lines.append(text)
        if self.coefficients is not None:
            leading, first, second = self.coefficients
            lines.append(
                f"  period {leading:.10g} {first:+.8g} epsilon^(2/3) {second:+.8g} epsilon ln epsilon + O(epsilon)"
            )
        return "\n".join(lines)


def singular_orbit(
    branch: Branch,
    start: Point,
    *,
    progress: Callable[[int], object] | None = None,
    max_pieces: int = MAX_PIECES,
) -> SingularOrbit:
    """The singular orbit from the sheet of `branch` through `start`, which names every state of the system.

    It goes on until it closes up, or until a slow piece ends otherwise than at a generic fold, a drop lands on no
    attracting sheet, or `max_pieces` are used up: `message` says which. `progress` is called with the number of pieces.

    Raises `DeclarationError` for arguments that are not well formed, `BranchError` where the branch has no point,
    `HyperbolicityError` when the sheet does not attract at the start, and what `restrict` and `integrate` raise.

    >>> x, y, epsilon = sp.symbols("x y epsilon")
    >>> system = SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon)
    >>> orbit = singular_orbit(solve_critical(system).branches[0], {"x": 2, "y": 0.6})
    >>> [round(c, 9) for c in orbit.coefficients]
    [1.613705639, 7.014322231, 0.333333333]
    """
    check_noun(branch, Branch, verb="singular_orbit")
    check_whole(
        max_pieces, what="max_pieces", least=1, most=10**9, be="a positive integer",
        remedy="The default serves most uses.",
    )  # fmt: skip
    check_progress(progress)
    system = branch.system
    complete(start, system.states, what="start")
    _require_attracting(branch, start)
    point: Point = start
    pieces: list[SlowPiece] = []
    landings: list[np.ndarray] = []
    while len(pieces) < max_pieces:
        piece, why = _follow(_landed_on(branch, point) if pieces else branch, point)
        pieces.append(piece)
        if progress is not None:
            progress(len(pieces))
        if piece.fold is None or not piece.fold.drop.lands:
            message = why or Reason(f"{len(pieces)} slow pieces; {piece.fold and piece.fold.drop}")
            return SingularOrbit(branch, tuple(pieces), 0, message)
        point = piece.fold.drop.point
        landed = np.array([point[s.name] for s in system.states])
        back = _closed(landings, landed)
        landings.append(landed)
        if back:
            message = Reason(f"closed after {len(pieces)} slow pieces, {back} drops a period")
            return SingularOrbit(branch, tuple(pieces), back, message)
    message = Reason(f"not closed after {max_pieces} slow pieces; raise max_pieces to go on")
    return SingularOrbit(branch, tuple(pieces), 0, message)


def _require_attracting(branch: Branch, start: Point) -> None:
    """The start's sheet attracts over the start: orbits next to any other leave it before a slow time has passed."""
    system = branch.system
    given = values_by_name(start, what="start")
    x = np.array([[given[s.name] for s in system.x]])
    point = np.concatenate([x, branch.through(start).points(x)], axis=1)
    values = np.linalg.eigvals(Sampler(branch).fast_jacobian(point)[0])
    # At a fold one of them is zero to rounding only, of either sign; `integrate` names that start.
    if values.real.max() > ZERO * np.abs(values).max(initial=1.0):
        place = ", ".join(f"{s.name} = {v:.6g}" for s, v in zip(system.states, point[0]))
        raise HyperbolicityError(
            f"the sheet under the start does not attract: at {place} the fast eigenvalues are "
            f"{np.array2string(values, precision=4)}.",
            "Start next to an attracting sheet; fast variables of the start choose it.",
        )


def _follow(branch: Branch, point: Point) -> tuple[SlowPiece, Reason]:
    """The slow piece from `point`, and why it does not end in a fold passage (empty when it does)."""
    flow = _reduced(branch, point)
    run = _run(flow, branch, point)
    if run.status is not Status.FOLD_REACHED:
        if run.status.ok:
            why = Reason(f"no fold within a slow time of {PATIENCE:g}: the slow flow settles")
            return SlowPiece(run, None), why
        return SlowPiece(run, None), Reason(f"the slow flow ends otherwise than at a fold: {run.message}")
    fold = {s.name: float(run[s.name][-1]) for s in branch.system.states}
    try:
        return SlowPiece(run, fold_passage(branch.system, fold)), NO_REASON
    except PassageError as error:
        return SlowPiece(run, None), error.reason


def _landed_on(branch: Branch, point: Point) -> Branch:
    """`branch` when the point of M0 lies on it, otherwise the branch of M0 that it lies on."""
    given = values_by_name(point, what="point")
    x, y = (np.array([given[s.name] for s in states]) for states in (branch.system.x, branch.system.y))
    try:
        distance = np.abs(branch.through(point).points(x[None, :])[0] - y).max()
    except BranchError:
        distance = float("inf")
    if distance <= CLOSED * (1.0 + np.abs(y).max()):
        return branch
    return solve_critical(branch.system).nearest(point)


def _reduced(branch: Branch, point: Point) -> ReducedFlow:
    return restrict(expand(branch.through(point), order=0, symbolic=False))


def _run(flow: ReducedFlow, branch: Branch, point: Point) -> Trajectory:
    slow = {s.name for s in branch.system.x}
    start = values_by_name(point, what="start")
    return trajectory_of(
        flow,
        start={name: value for name, value in start.items() if name in slow},
        span=(0.0, PATIENCE),
        # Order 0 does not depend on epsilon; the value is asked for all the same.
        epsilon=1.0,
        rtol=RTOL,
        atol=ATOL,
    )


def _closed(landings: list[np.ndarray], landed: np.ndarray) -> int:
    """How many drops ago an orbit landed at the same point; 0 for never."""
    for back, earlier in enumerate(reversed(landings), start=1):
        if np.abs(earlier - landed).max() <= CLOSED * (1.0 + np.abs(landed).max()):
            return back
    return 0


def _period(branch: Branch, cycle: tuple[SlowPiece, ...]) -> tuple[float, float, float]:
    """T_0, T_1, T_2: with the landing points shifted by Delta x at every fold, x -> P x + Delta x around the cycle.

    A shift xi of the landing point before a piece changes its duration by tau . xi and the next landing point by P xi;
    the closed orbit solves xi_(k+1) = P_k xi_k + Delta_k cyclically.
    """
    m, count = len(branch.system.x), len(cycle)
    folds = [piece.fold for piece in cycle]
    transfers, gradients = zip(*(_sensitivity(branch, cycle[k - 1], cycle[k]) for k in range(count)))
    total = sum(piece.duration for piece in cycle)
    result = [total]
    for shifts, times in (
        ([f.leading for f in folds if f], [omega0() * (f.a * f.b) ** (-1.0 / 3.0) for f in folds if f]),
        (
            [f.logarithmic for f in folds if f],
            [(f.b * f.c / f.a**2 - f.d / (2.0 * f.a)) / (3.0 * f.b) for f in folds if f],
        ),
    ):
        matrix = np.eye(count * m)
        right = np.zeros(count * m)
        for k in range(count):
            # xi_k is the shift at the beginning of piece k, made by the fold of piece k - 1.
            before = (k - 1) % count
            rows, columns = slice(k * m, k * m + m), slice(before * m, before * m + m)
            matrix[rows, columns] -= transfers[before]
            right[rows] += shifts[before]
        try:
            xi = np.linalg.solve(matrix, right).reshape(count, m)
        except np.linalg.LinAlgError:
            raise GspError(
                "closed singular orbits fill a family here: to first order a shift of the landing point "
                "comes back as it was.",
                "The period of the full system is not that of one of them.",
            ) from None
        result.append(float(sum(times) + sum(g @ x for g, x in zip(gradients, xi))))
    return result[0], result[1], result[2]


def _sensitivity(branch: Branch, before: SlowPiece, piece: SlowPiece) -> tuple[np.ndarray, np.ndarray]:
    """P (m, m) and tau (m,): how the fold at the end of `piece` and its duration move with the landing point.

    For one slow variable the folds stay where they are, and tau = -1/f.
    """
    assert before.fold is not None
    assert piece.fold is not None
    landing = before.fold.drop.point
    names = [s.name for s in branch.system.x]
    m = len(names)
    branch = _landed_on(branch, landing)
    transfer, gradient = np.zeros((m, m)), np.zeros(m)
    for i, name in enumerate(names):
        ends, durations = [], []
        h = SHIFT * (1.0 + abs(landing[name]))
        for sign in (1.0, -1.0):
            moved: Mapping[str, float] = MappingProxyType({**landing, name: landing[name] + sign * h})
            run = _run(_reduced(branch, moved), branch, moved)
            if run.status is not Status.FOLD_REACHED:
                raise GspError(
                    f"the slow flow from {dict(moved)} ends otherwise than its neighbour: {run.message}.",
                    "The closed orbit passes too near to a boundary of the fold's basin for its period to "
                    "be expanded.",
                )
            ends.append(np.array([run[n][-1] for n in names]))
            durations.append(run.t[-1] - run.t[0])
        transfer[:, i] = (ends[0] - ends[1]) / (2.0 * h)
        gradient[i] = (durations[0] - durations[1]) / (2.0 * h)
    return transfer, gradient
