"""The slow pieces of singular orbits: the reduced flow of order 0 on a sheet up to a fold, and what follows there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.critical_manifold import solve_critical
from gsp.critical.sampling import Sampler
from gsp.critical.sheet_points import place
from gsp.errors import NO_REASON, BranchError, Reason, Status
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.restriction import restrict
from gsp.integration.trajectory import Trajectory, trajectory_of
from gsp.singular.flight import Flight, Flights
from gsp.singular.passage.failure import PassageError
from gsp.singular.passage.fold_passage import FoldPassage, passage_at
from gsp.singular.passage.slow_orbit import time_to_move
from gsp.slow.series import expand
from gsp.systems.flow import Point, in_words

# Slow pieces are followed at this tolerance, each for at most so many times the slow time in which it gets somewhere.
RTOL = 1e-11
ATOL = 0.01 * RTOL
PATIENCE = 1e4
# An orbit closes when a drop lands where an earlier one did, to this, relative to the states' sizes.
CLOSED = 1e-8


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


def on_sheet(branch: Branch, point: Point) -> np.ndarray:
    """The point (n,) of the sheet next to one that names every state, over its slow variables."""
    x, _ = place(branch.system, point)
    return np.concatenate([x, branch.through(point).points(x[None, :])[0]])


def follow_piece(branch: Branch, point: Point, flights: Flights | None) -> tuple[SlowPiece, Reason]:
    """The slow piece from `point`, and why it does not end in a fold passage (empty when it does)."""
    longest = longest_on(branch, point)
    run = run_on(branch, point, longest)
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
    return SlowPiece(run, passage, flight_from(passage, passage.point, flights, longest)), NO_REASON


def flight_from(
    passage: FoldPassage, point: Mapping[str, float], flights: Flights | None, longest: float
) -> Flight | None:
    """The flight from a point beside the fold; None where the drop lands on a sheet, or it does not come back."""
    if flights is None or passage.drop.lands:
        return None
    (fast,) = (y.name for y in passage.system.y)
    return flights.after(point, beyond=passage.drop.point[fast], longest=longest, rtol=RTOL)


def landed_on(branch: Branch, point: Point) -> Branch | None:
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


def run_on(branch: Branch, point: Point, longest: float) -> Trajectory:
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


def longest_on(branch: Branch, point: Point) -> float:
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
    return Sampler(branch).rates(on_sheet(branch, point)[None, :])[0, : len(branch.system.x)]
