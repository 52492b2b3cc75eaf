"""A canard followed in epsilon, by pseudo-arclength through its folds (Desroches, Krauskopf and Osinga 2010).

The boundary-value problem of a canard, with both ends on their lines of M0, has one solution for one epsilon; with
epsilon among the unknowns it has a curve of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from gsp.collocation.bordered import Conditions, OrbitChange
from gsp.errors import DeclarationError, GspError, Status
from gsp.orbits.canard_orbits.canard import (
    FEWEST,
    MOST,
    PRECISION,
    Canard,
    CanardSolver,
    section_crossing,
)
from gsp.orbits.canard_orbits.collocation import OrbitSegment
from gsp.orbits.canard_orbits.node_units import canard_in, in_own_units, orbit_in
from gsp.orbits.canard_orbits.sheet import CurveEnd
from gsp.results.card import Card
from gsp.systems.arguments import check_each, check_noun, check_whole
from gsp.systems.flow import check_epsilon
from gsp.systems.system import SlowFastSystem
from gsp.tracing.arclength import Arrival, Pace, Stride, Trace, Tracer

# The first, the longest and the shortest step are in arclength, in units of the orbit's extents, the relative time and
# log epsilon. Six Newton steps are aimed at on the mesh of the guess.
PACE = Pace(0.02, 0.4, 1e-7, 6, largest_turn=0.4, growth=1.4)


class FamilyEnd(CurveEnd):
    """Where a family of canards ends."""

    BOUND = "the bound of epsilon was reached"
    POINTS = "the allowed number of points was used up"
    STEPS = "the steps fell below rounding"
    MESH = f"a mesh of {MOST} elements no longer resolves the orbit"


# How a tracer's own endings are told of a family.
ENDS: dict[Enum, FamilyEnd] = {Status.TOO_MANY_POINTS: FamilyEnd.POINTS, Status.STEP_TOO_SMALL: FamilyEnd.STEPS}


@dataclass(frozen=True, eq=False, repr=False)
class CanardFamily(Card):
    """One canard over epsilon, from the end reached downwards to the one reached upwards.

    - `epsilon` (m,), `time` (m,) the slow time from line to line, and `["name"]` (m,) the state in the section, NaN
      where the orbit begins beyond it or ends before;
    - `orbits` (m) are the orbits, `folds` the values of epsilon at which the curve turns round, where two of
      its orbits meet;
    - `ends` say why the curve stops on each side.
    """

    system: SlowFastSystem
    name: str
    epsilon: np.ndarray
    time: np.ndarray
    points: np.ndarray
    orbits: tuple[OrbitSegment, ...]
    folds: tuple[float, ...]
    ends: tuple[FamilyEnd, FamilyEnd]

    def __getitem__(self, name: str) -> np.ndarray:
        names = [s.name for s in self.system.states]
        if name not in names:
            raise GspError(f"{name!r} is no state.", f"The states are {', '.join(names)}.")
        return self.points[:, names.index(name)]

    @property
    def status(self) -> Status:
        """SUCCESS when both bounds were reached."""
        return self.ends[0].status if not self.ends[0].status.ok else self.ends[1].status

    @property
    def message(self) -> str:
        """One line: the range covered, its folds, and why it ends."""
        folds = "".join(f", a fold at {value:.8g}" for value in self.folds)
        return (
            f"{self.name} over {self.system.epsilon} from {self.epsilon.min():.6g} to {self.epsilon.max():.6g} in "
            f"{len(self.epsilon)} points{folds}; below: {self.ends[0].value}; above: {self.ends[1].value}"
        )

    def __len__(self) -> int:
        return len(self.epsilon)

    def __repr__(self) -> str:
        return (
            f"CanardFamily({self.name}, {len(self)} points, {self.system.epsilon} {self.epsilon.min():.4g} to "
            f"{self.epsilon.max():.4g}, {len(self.folds)} folds)"
        )

    def __str__(self) -> str:
        return self.message


def follow_canard(canard: Canard, *, epsilon: tuple[float, float], max_points: int = 400) -> CanardFamily:
    """Follow a canard in epsilon, down and up from its own value, between the bounds `epsilon` = (low, high).

    The lines where it begins and ends, and the section where it is read, stay where they are. `max_points` bounds
    the points of each direction. The curve is followed through folds in epsilon, where two orbits meet.

    Raises `DeclarationError` when the bounds do not enclose the canard's epsilon.
    """
    check_noun(canard, Canard, verb="follow_canard")
    low, high = check_each(epsilon, check_epsilon, what="epsilon", be="a pair (low, high) of bounds", length=2)
    check_whole(max_points, what="max_points", least=2, most=10**9)
    if not low <= canard.epsilon <= high:
        raise DeclarationError(
            f"the bounds enclose the canard's own {canard.frame.system.epsilon} = {canard.epsilon:g}.",
            got=f"({low:g}, {high:g})",
        )
    frame = in_own_units(canard.frame)
    units = frame.units
    follower = _Follower(canard_in(canard, units, frame), (low, high), max_points)
    down, up = follower.trace(-1), follower.trace(1)
    (lower, below, folds_below, first), (upper, above, folds_above, last) = down, up
    orbits = tuple(orbit_in(orbit, units.back) for orbit in (*lower[:0:-1], *upper))
    points = units.back.of(np.array([*below[:0:-1], *above]))
    return CanardFamily(
        system=canard.frame.system,
        name=canard.name,
        epsilon=np.array([orbit.epsilon for orbit in orbits]),
        time=np.array([orbit.time for orbit in orbits]),
        points=points,
        orbits=orbits,
        folds=(*folds_below[::-1], *folds_above),
        ends=(first, last),
    )


@dataclass(frozen=True, eq=False)
class _Direction:
    """A unit tangent of the family: `ends` (8,) of both ends, the time and log epsilon; the orbit's `profile`."""

    ends: np.ndarray
    profile: OrbitSegment
    step: OrbitChange


@dataclass(frozen=True, eq=False)
class _FamilyNode:
    """An orbit of the family, its tangent, and its place in the section (3,), NaN where it does not come there."""

    orbit: OrbitSegment
    along: _Direction
    point: np.ndarray


class _Follower(Tracer[_FamilyNode]):
    """Pseudo-arclength in the whole orbit, its time, and log epsilon."""

    pace = PACE

    def __init__(self, canard: Canard, bounds: tuple[float, float], max_points: int) -> None:
        self.canard, self.bounds, self.most = canard, bounds, max_points
        self.problem = CanardSolver(
            canard.frame, (canard.attracting_line, canard.repelling_line), epsilon_free=True
        )
        self.solver = self.problem.solver
        self.extent = np.maximum(np.ptp(canard.orbit.states, axis=0), 1e-8)
        self.folds: list[float] = []
        self._share = 0.0

    def trace(self, direction: int) -> tuple[list[OrbitSegment], list[np.ndarray], list[float], FamilyEnd]:
        """One direction: -1 with falling epsilon at first, 1 with growing. Orbits, points, folds and the end."""
        first = self.canard.orbit
        start = np.array([self.canard.point[s.name] for s in self.canard.frame.system.states])
        self._share, self.folds = self.canard.time_before / first.time, []
        along = self._tangent(first, None)
        if along is None:
            return [first], [start], [], FamilyEnd.STEPS
        trace = Trace(
            [_FamilyNode(first, self._scaled(along, np.sign(along.ends[7] * direction) or 1.0), start)]
        )
        self.follow(trace)
        end = ENDS.get(trace.ending, trace.ending)
        assert isinstance(end, FamilyEnd)
        return [node.orbit for node in trace.nodes], [node.point for node in trace.nodes], self.folds, end

    def predicted(self, here: _FamilyNode, length: float) -> tuple[OrbitSegment, _FamilyNode] | None:
        """The orbit moved along the tangent, and where from."""
        guess = here.orbit.moved(here.along.step, length)
        return (guess, here) if min(guess.time, guess.epsilon) > 0.0 else None

    def corrected(
        self, guess: tuple[OrbitSegment, _FamilyNode], length: float
    ) -> tuple[OrbitSegment, int] | None:
        """The orbit across the tangent, on the mesh of the guess and then on its own."""
        orbit, here = guess
        anchor, along = self._coordinates(here.orbit), here.along

        def problem(orbit: OrbitSegment) -> Conditions:
            conditions = self._conditions(orbit, along, 0.0)
            moved = orbit.states - here.orbit.at(orbit.mesh)
            inside = (along.profile.at(orbit.mesh) * moved / self.extent**2).sum(axis=1)
            gone = along.ends @ (self._coordinates(orbit) - anchor) + self._weights(orbit.mesh) @ inside
            conditions.target[4] = length - gone
            return conditions

        before = self.solver.iterations
        found = self.solver.solve(orbit, problem, limit=10)
        corrections = self.solver.iterations - before
        found = self._remeshed(found, problem)
        return None if found is None else (found, corrections)

    def oriented(
        self, here: _FamilyNode, guess: tuple[OrbitSegment, _FamilyNode], found: tuple[OrbitSegment, int]
    ) -> Stride[_FamilyNode] | None:
        """The orbit with its tangent; where it passes the section is found on arrival."""
        along = self._tangent(found[0], here.along)
        if along is None:
            return None
        cosine = self._product(along, here.along, found[0].mesh)
        return Stride(
            _FamilyNode(found[0], along, here.point), found[1], float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        )

    def arrived(
        self, trace: Trace[_FamilyNode], here: _FamilyNode, stride: Stride[_FamilyNode], length: float
    ) -> Arrival[_FamilyNode] | None:
        """The orbit, or the one on the bound of epsilon before it; a fold on the way is located."""
        found, new = stride.node.orbit, stride.node.along
        ends = float(here.along.ends[7]), float(new.ends[7])
        turns = ends[0] * ends[1] < 0.0
        # A fold in epsilon is stepped across by this at most.
        if turns and length > 0.05:
            return None
        if turns:
            fold = self.located(here, length, lambda node: float(node.along.ends[7]), ends, apart=1e-6 * length)
            self.folds.append(float((here if fold is None else fold[0]).orbit.epsilon))
        low, high = self.bounds
        beyond = not low < found.epsilon < high
        if beyond:
            found = self._at(here.orbit, found, low if found.epsilon <= low else high) or found
        met = section_crossing(found, self.canard.section, self._share)
        self._share = self._share if met is None else met[0]
        node = _FamilyNode(found, new, np.full(3, np.nan) if met is None else met[1])
        ending = FamilyEnd.BOUND if beyond else FamilyEnd.MESH if found.elements_for(PRECISION) > MOST else None
        return Arrival([(node, length)], ending)

    # -- one step ----------------------------------------------------------------------------------

    def _coordinates(self, orbit: OrbitSegment) -> np.ndarray:
        ends = np.concatenate([orbit.start / self.extent, orbit.end / self.extent])
        return np.append(ends, [orbit.time / self.canard.orbit.time, np.log(orbit.epsilon)])

    def _weights(self, mesh: np.ndarray) -> np.ndarray:
        """INSIDE times the trapezium rule on a mesh (m + 1,)."""
        weights = np.zeros(len(mesh))
        weights[:-1] += 0.5 * np.diff(mesh)
        weights[1:] += 0.5 * np.diff(mesh)
        # How much the orbit between its ends counts in arclength; where it grows an excursion nothing else changes.
        return 4.0 * weights

    def _product(self, one: _Direction, other: _Direction, mesh: np.ndarray) -> float:
        """The inner product of arclength, on a mesh."""
        inside = (one.profile.at(mesh) * other.profile.at(mesh) / self.extent**2).sum(axis=1)
        return float(one.ends @ other.ends + self._weights(mesh) @ inside)

    def _conditions(self, orbit: OrbitSegment, along: _Direction | None, value: float) -> Conditions:
        """The canard's conditions and a step of length `value` along a direction; along log epsilon without one."""
        four = self.problem.conditions(orbit)
        ends = np.eye(8)[7] if along is None else along.ends
        row = ends / np.concatenate([self.extent, self.extent, [self.canard.orbit.time, orbit.epsilon]])
        inner = np.zeros_like(orbit.states)
        if along is not None:
            inner = self._weights(orbit.mesh)[:, None] * along.profile.at(orbit.mesh) / self.extent**2
        across = np.zeros((5, 2))
        across[4] = row[6:]
        return Conditions(
            np.vstack([four.left, row[:3]]),
            np.vstack([four.right, row[3:6]]),
            across,
            np.append(four.target, value),
            inner[None],
        )

    def _tangent(self, orbit: OrbitSegment, along: _Direction | None) -> _Direction | None:
        """The unit tangent at an orbit, on the side of `along`; None where the problem is singular."""
        conditions = self._conditions(orbit, along, 1.0)
        conditions.target[:4] = 0.0
        try:
            step = self.solver.linear(orbit, conditions, tangent=True)
        except np.linalg.LinAlgError:
            return None
        ends = np.concatenate([step.states[0] / self.extent, step.states[-1] / self.extent])
        ends = np.append(ends, step.parameters / [self.canard.orbit.time, orbit.epsilon])
        direction = _Direction(ends, replace(orbit, states=step.states, stages=step.stages), step)
        size = self._product(direction, direction, orbit.mesh)
        return self._scaled(direction, 1.0 / float(np.sqrt(size)))

    def _scaled(self, along: _Direction, factor: float) -> _Direction:
        step = along.step.times(factor)
        return _Direction(
            factor * along.ends, replace(along.profile, states=step.states, stages=step.stages), step
        )

    def _remeshed(
        self, found: OrbitSegment | None, problem: Callable[[OrbitSegment], Conditions]
    ) -> OrbitSegment | None:
        if found is None:
            return None
        return self.solver.solve(found.adapted(PRECISION, FEWEST, MOST), problem, limit=10)

    def _at(self, here: OrbitSegment, there: OrbitSegment, value: float) -> OrbitSegment | None:
        """The orbit between two at a value of epsilon."""

        def problem(orbit: OrbitSegment) -> Conditions:
            return self._conditions(orbit, None, (value - orbit.epsilon) / orbit.epsilon)

        share = (value - here.epsilon) / (there.epsilon - here.epsilon)
        guess = replace(here.blended(there, share), epsilon=value)
        return self._remeshed(self.solver.solve(guess, problem), problem)
