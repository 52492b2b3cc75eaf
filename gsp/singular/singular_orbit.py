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
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.critical_manifold import solve_critical
from gsp.critical.sampling import Sampler
from gsp.critical.sheet_points import place
from gsp.errors import NO_REASON, BranchError, DeclarationError, GspError, HyperbolicityError, Reason, Status
from gsp.hyperbolicity.losses.consequences import OMEGA_0
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.restriction import restrict
from gsp.integration.trajectory import Trajectory, trajectory_of
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.singular.flight import Flight, Flights
from gsp.singular.passage.failure import PassageError
from gsp.singular.passage.fold_passage import ZERO, FoldPassage, passage_at
from gsp.singular.passage.slow_orbit import time_to_move
from gsp.slow.series import expand
from gsp.systems.arguments import check_noun, check_progress, check_whole, shown
from gsp.systems.flow import Point, check_epsilon, complete, in_words
from gsp.systems.system import VectorField

# Slow pieces are followed at this tolerance, each for at most so many times the slow time in which it gets somewhere.
RTOL = 1e-11
ATOL = 0.01 * RTOL
PATIENCE = 1e4
# An orbit closes when a drop lands where an earlier one did, to this, relative to the states' sizes.
CLOSED = 1e-8
# Landing points are shifted by so much, relative to the states' sizes, to carry the shifts of folds around the orbit.
SHIFT = 1e-5


@dataclass(frozen=True, eq=False, repr=False)
class SlowPiece:
    """A piece on an attracting sheet: the reduced `run`, over a slow time `duration`, and the `fold` at its end.

    `fold` is None when the piece ends otherwise; `run.message` says how. The orbit of a field that switches may fly off
    the surface from the fold: `flight` is that, and None where the orbit drops onto another sheet.
    """

    run: Trajectory
    fold: FoldPassage | None
    flight: Flight | None = None

    @property
    def duration(self) -> float:
        """Slow time on the sheet."""
        return float(self.run.t[-1] - self.run.t[0])

    @property
    def landing(self) -> Mapping[str, float] | None:
        """Where the orbit comes down after the fold, by name; None where it does not."""
        if self.flight is not None:
            return self.flight.point
        return self.fold.drop.point if self.fold is not None and self.fold.drop.lands else None

    def __repr__(self) -> str:
        return f"SlowPiece(slow time {self.duration:.8g}, {'to a fold' if self.fold else self.run.status.name})"


@dataclass(frozen=True, eq=False, repr=False)
class SingularOrbit(Drawn, Tabular):
    """Slow `pieces` in order, each but the last followed by the drop from its fold, or by a flight.

    When it `closes`, the last `period_pieces` of them make up the closed orbit, each followed by a drop, and
    `coefficients` = (T_0, T_1, T_2) are those of its period; otherwise they are None. `message` says how it ended.
    """

    branch: Branch
    pieces: tuple[SlowPiece, ...]
    period_pieces: int
    message: Reason
    flights: Flights | None = None

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
        """T_0, T_1 and T_2 of the period T_0 + T_1 epsilon^(2/3) + T_2 epsilon ln epsilon + O(epsilon).

        T_2 is nan where the orbit flies, for how the switch ends on the way is not in it.
        """
        return _period(self) if self.closes else None

    def period(self, epsilon: float) -> float:
        """Slow time around the orbit; nan when it does not close. The error is O(epsilon), or O(epsilon ln epsilon)
        where it flies."""
        small = check_epsilon(epsilon)
        if self.coefficients is None:
            return float("nan")
        leading, first, second = self.coefficients
        logarithmic = 0.0 if self.flies else second * small * float(np.log(small))
        return leading + first * small ** (2.0 / 3.0) + logarithmic

    @property
    def flies(self) -> bool:
        """Whether it leaves the surface of a switch on its way around."""
        return any(piece.flight is not None for piece in self.cycle)

    def __repr__(self) -> str:
        ending = f"closed, {self.period_pieces} drops" if self.closes else "open"
        return f"SingularOrbit({len(self.pieces)} slow pieces, {ending})"

    def __str__(self) -> str:
        lines = [f"singular orbit: {self.message}"]
        for piece in self.cycle or self.pieces:
            if piece.fold is None and piece.run.status.ok:
                # It was followed for that long, and comes to no end.
                continue
            text = f"  slow time {piece.duration:.10g}"
            if piece.fold is not None:
                fold = in_words(piece.fold.point, 8)
                text += f" to the fold at {fold}; "
                text += str(piece.fold.drop) if piece.flight is None else _told(piece.flight)
            lines.append(text)
        if self.coefficients is not None:
            leading, first, second = self.coefficients
            rest = (
                " + O(epsilon ln epsilon)" if self.flies else f" {second:+.8g} epsilon ln epsilon + O(epsilon)"
            )
            lines.append(f"  period {leading:.10g} {first:+.8g} epsilon^(2/3){rest}")
        return "\n".join(lines)


def singular_orbit(
    branch: Branch,
    start: Point,
    *,
    switched: VectorField | None = None,
    progress: Callable[[int], object] | None = None,
    max_pieces: int = 200,
) -> SingularOrbit:
    """The singular orbit from the sheet of `branch` through `start`, which names every state of the system.

    It goes on until it closes up, or until a slow piece ends otherwise than at a generic fold, a drop lands on no
    attracting sheet, or `max_pieces` are used up: `message` says which. `progress` is called with the number of pieces.
    `switched` is the field with a switch phi(s/epsilon) that the system was split from: an orbit that leaves a fold for
    s/epsilon = infinity flies on by what the field is off the surface, until it is back.

    Raises `DeclarationError` for arguments that are not well formed, `BranchError` where the branch has no point,
    `HyperbolicityError` when the sheet does not attract at the start, and what `restrict` and `integrate` raise.

    >>> x, y, epsilon = sp.symbols("x y epsilon")
    >>> system = SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon)
    >>> orbit = singular_orbit(solve_critical(system).branches[0], {"x": 2, "y": 0.6})
    >>> [round(c, 8) for c in orbit.coefficients]
    [1.61370564, 7.01432223, 0.33333333]
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
    branch = branch.in_own_units(_on_sheet(branch, start))
    if switched is not None and not isinstance(switched, VectorField):
        raise DeclarationError(
            "switched is the VectorField that was split.", got=shown(switched), value=switched
        )
    flights = None if switched is None else Flights(switched, system)
    point: Point = start
    pieces: list[SlowPiece] = []
    landings: list[np.ndarray] = []
    back, message = 0, Reason(f"not closed after {max_pieces} slow pieces; raise max_pieces to go on")
    while len(pieces) < max_pieces:
        sheet = _landed_on(branch, point) if pieces else branch
        if sheet is None:
            fact = f"the last drop lands at {in_words(point, 8)}, where the reduced flow has no branch to go on along"
            message = Reason(f"{len(pieces)} slow pieces; {fact}")
            break
        piece, why = _follow(sheet, point, flights)
        pieces.append(piece)
        if progress is not None:
            progress(len(pieces))
        if piece.landing is None:
            message = why or Reason(f"{len(pieces)} slow pieces; {piece.fold and piece.fold.drop}")
            break
        point = piece.landing
        landed = np.array([point[s.name] for s in system.states]) / np.concatenate(branch.scales)
        back = _closed(landings, landed)
        landings.append(landed)
        if back:
            message = Reason(f"closed after {len(pieces)} slow pieces, {back} drops a period")
            break
    return SingularOrbit(branch, tuple(pieces), back, message, flights)


def _on_sheet(branch: Branch, point: Point) -> np.ndarray:
    """The point (n,) of the sheet next to one that names every state, over its slow variables."""
    x, _ = place(branch.system, point)
    return np.concatenate([x, branch.through(point).points(x[None, :])[0]])


def _require_attracting(branch: Branch, start: Point) -> None:
    """The start's sheet attracts over the start: orbits next to any other leave it before a slow time has passed."""
    point = _on_sheet(branch, start)
    values = np.linalg.eigvals(Sampler(branch).fast_jacobian(point[None, :])[0])
    # At a fold one of them is zero to rounding only, of either sign; `integrate` names that start.
    if values.real.max() > ZERO * np.abs(values).max(initial=1.0):
        at = branch.system.place(zip(branch.system.states, point))
        raise HyperbolicityError(
            f"the sheet under the start does not attract: at {at} the fast eigenvalues are "
            f"{np.array2string(values, precision=4)}.",
            "Start next to an attracting sheet; fast variables of the start choose it.",
        )


def _told(flight: Flight) -> str:
    return f"it flies for a slow time {flight.duration:.10g} and comes down at {in_words(flight.point, 8)}"


def _follow(branch: Branch, point: Point, flights: Flights | None) -> tuple[SlowPiece, Reason]:
    """The slow piece from `point`, and why it does not end in a fold passage (empty when it does)."""
    longest = _longest(branch, point)
    run = _run(branch, point, longest)
    if run.status is not Status.FOLD_REACHED:
        if run.status.ok:
            last = {s.name: float(run[s.name][-1]) for s in branch.system.states}
            if _is_at_rest(branch, run, longest):
                return SlowPiece(run, None), Reason(f"the slow flow comes to rest at {in_words(last, 8)}")
            return SlowPiece(run, None), Reason(f"no fold within a slow time of {longest:g}")
        return SlowPiece(run, None), Reason(f"the slow flow ends otherwise than at a fold: {run.message}")
    ends = np.array([run[s.name] for s in branch.system.states])
    # A root in h_0 may not be real within rounding of the fold.
    end = ends[:, np.isfinite(ends).all(axis=0)][:, -1]
    fold = dict(zip((s.name for s in branch.system.states), end.tolist()))
    try:
        passage = passage_at(branch.system, fold, sizes=branch.units)
    except PassageError as error:
        return SlowPiece(run, None), error.reason
    return SlowPiece(run, passage, _flown(passage, passage.point, flights, longest)), NO_REASON


def _flown(
    passage: FoldPassage, point: Mapping[str, float], flights: Flights | None, longest: float
) -> Flight | None:
    """The flight from a point beside the fold; None where the drop lands on a sheet, or it does not come back."""
    if flights is None or passage.drop.lands:
        return None
    (fast,) = (y.name for y in passage.system.y)
    return flights.after(point, beyond=passage.drop.point[fast], longest=longest, rtol=RTOL)


def _landed_on(branch: Branch, point: Point) -> Branch | None:
    """`branch` when the point of M0 lies on it, otherwise the branch of M0 that it lies on.

    None where there is none, as on zeros of g at which a slow rate has a pole.
    """
    x, y = place(branch.system, point)
    for found in (lambda: branch, lambda: solve_critical(branch.system).nearest(point)):
        try:
            sheet = replace(found(), units=branch.units)
            distance = np.abs((sheet.through(point).points(x[None, :])[0] - y) / branch.scales[1]).max()
        except BranchError:
            continue
        if distance <= CLOSED:
            return sheet
    return None


def _run(branch: Branch, point: Point, longest: float) -> Trajectory:
    """The reduced flow of order 0 from a point on its sheet."""
    system, sheet = branch.system, branch.through(point)
    x, _ = place(system, point)

    def flow(of: Branch) -> ReducedFlow:
        return restrict(expand(of, order=0, symbolic=False))

    run = trajectory_of(
        flow(sheet.about_centres),
        start={s.name: v - float(system.centres.get(s, 0)) for s, v in zip(system.x, x)},
        span=(0.0, longest),
        # Order 0 does not depend on epsilon; the value is asked for all the same.
        epsilon=1.0,
        rtol=RTOL,
        atol=ATOL * float(min(branch.units or (1.0,))),
    )
    if not system.centres:
        return run
    # Near a fold what rounds x moves y by its root.
    moved = flow(sheet)
    centre = np.array([float(system.centres.get(s, 0)) for s in moved.manifold.coordinates])
    return run.moved_to(moved, centre, system.place(system.centres))


def _longest(branch: Branch, point: Point) -> float:
    """How long a piece from `point` is followed, in slow time; one that stands still gets nowhere in any."""
    x, _ = place(branch.system, point)
    moves = time_to_move(x - branch.system.centre[: len(x)], _slow_rates(branch, point), branch.scales[0])
    return PATIENCE * (moves if np.isfinite(moves) else 1.0)


def _is_at_rest(branch: Branch, run: Trajectory, longest: float) -> bool:
    """Whether a run ends at rest: as long once more would not move it by a share of what it has moved."""
    states = np.array([run[s.name] for s in branch.system.x])
    point = {s.name: float(run[s.name][-1]) for s in branch.system.states}
    moved = np.ptp(states, axis=1) / PATIENCE + CLOSED * branch.scales[0]
    return bool((np.abs(_slow_rates(branch, point)) * longest <= moved).all())


def _slow_rates(branch: Branch, point: Point) -> np.ndarray:
    return Sampler(branch).rates(_on_sheet(branch, point)[None, :])[0, : len(branch.system.x)]


def _closed(landings: list[np.ndarray], landed: np.ndarray) -> int:
    """How many drops ago an orbit landed at the same point, in the branch's units; 0 for never."""
    ago = enumerate(reversed(landings), start=1)
    return next((back for back, earlier in ago if np.abs(earlier - landed).max() <= CLOSED), 0)


def _period(orbit: SingularOrbit) -> tuple[float, float, float]:
    """T_0, T_1, T_2: with the landing points shifted by Delta x at every fold, x -> P x + Delta x around the cycle.

    A shift xi of the landing point before a piece changes its duration by tau . xi and where it leaves the fold to
    P xi + Delta; a flight makes Q of that shift, and changes by sigma times it. The closed orbit solves
    xi_(k+1) = Q_k (P_k xi_k + Delta_k) cyclically.
    """
    branch, cycle = orbit.branch, orbit.cycle
    m, count = len(branch.system.x), len(cycle)
    folds = [piece.fold for piece in cycle]
    transfers, gradients = zip(*(_sensitivity(branch, piece) for piece in (cycle[-1], *cycle[:-1])))
    flown, delays = zip(*(_flight_sensitivity(branch, piece, orbit.flights) for piece in cycle))
    total = sum(piece.duration + (piece.flight.duration if piece.flight else 0.0) for piece in cycle)
    result = [total]
    for shifts, times in (
        ([f.leading for f in folds if f], [OMEGA_0 * (f.a * f.b) ** (-1.0 / 3.0) for f in folds if f]),
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
            matrix[rows, columns] -= flown[before] @ transfers[before]
            right[rows] += flown[before] @ shifts[before]
        try:
            xi = np.linalg.solve(matrix, right).reshape(count, m)
        except np.linalg.LinAlgError:
            raise GspError(
                "closed singular orbits fill a family here: to first order a shift of the landing point "
                "comes back as it was.",
                "The period of the full system is not that of one of them.",
            ) from None
        left = (delay @ (P @ x + shift) for delay, P, x, shift in zip(delays, transfers, xi, shifts))
        result.append(float(sum(times) + sum(g @ x for g, x in zip(gradients, xi)) + sum(left)))
    return result[0], result[1], float("nan") if orbit.flies else result[2]


def _flight_sensitivity(
    branch: Branch, piece: SlowPiece, flights: Flights | None
) -> tuple[np.ndarray, np.ndarray]:
    """Q (m, m) and sigma (m,): how landing point and duration of a flight move with where it leaves the fold."""
    assert piece.fold is not None
    names = [s.name for s in piece.fold.system.x]
    m = len(names)
    if piece.flight is None:
        return np.eye(m), np.zeros(m)
    fold, longest = piece.fold, PATIENCE * piece.flight.duration

    def end(beside: Mapping[str, float]) -> tuple[np.ndarray, float]:
        flight = _flown(fold, beside, flights, longest)
        if flight is None:
            raise GspError(
                "a flight beside this one does not come back.", "The period is not to be expanded here."
            )
        return np.array([flight.point[n] for n in names]), flight.duration

    return _slopes(branch, fold.point, end)


def _sensitivity(branch: Branch, before: SlowPiece) -> tuple[np.ndarray, np.ndarray]:
    """P (m, m) and tau (m,): how the end and the duration of the next piece move with where the one `before` lands.

    For one slow variable the folds stay where they are, and tau = -1/f.
    """
    landing = before.landing
    assert landing is not None
    sheet = _landed_on(branch, landing)
    assert sheet is not None

    def end(beside: Mapping[str, float]) -> tuple[np.ndarray, float]:
        run = _run(sheet, beside, _longest(sheet, beside))
        if run.status is not Status.FOLD_REACHED:
            raise GspError(
                f"the slow flow from {beside} ends otherwise than its neighbour: {run.message}.",
                "The closed orbit passes too near to a boundary of the fold's basin for its period to be expanded.",
            )
        return np.array([run[s.name][-1] for s in sheet.system.x]), float(run.t[-1] - run.t[0])

    return _slopes(sheet, landing, end)


def _slopes(
    branch: Branch,
    point: Mapping[str, float],
    end: Callable[[Mapping[str, float]], tuple[np.ndarray, float]],
) -> tuple[np.ndarray, np.ndarray]:
    """How the slow variables (m,) of an `end`, and its time, move with those of `point`: (m, m) and (m,)."""
    m = len(branch.system.x)
    transfer, delay = np.zeros((m, m)), np.zeros(m)
    for i, (s, scale) in enumerate(zip(branch.system.x, branch.scales[0])):
        h = SHIFT * float(scale)
        (up, late), (down, early) = (end({**point, s.name: point[s.name] + step}) for step in (h, -h))
        transfer[:, i], delay[i] = (up - down) / (2.0 * h), (late - early) / (2.0 * h)
    return transfer, delay
