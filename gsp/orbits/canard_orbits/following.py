"""A canard followed in epsilon, by pseudo-arclength through its folds (Desroches, Krauskopf and Osinga 2010).

The boundary-value problem of a canard, with both ends on their lines of M0, has one solution for one epsilon; with
epsilon among the unknowns it has a curve of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from gsp.collocation.bordered import Conditions, Step
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
from gsp.results.card import Card
from gsp.roots import root
from gsp.systems.arguments import check_each, check_noun, check_whole
from gsp.systems.flow import check_epsilon
from gsp.systems.system import SlowFastSystem

# Arclength, in units of the orbit's extents, the relative time and log epsilon: first, longest and shortest step.
FIRST, LONGEST, SHORTEST = 0.02, 0.4, 1e-7
# How much the orbit between its ends counts in arclength; where it grows an excursion nothing else changes.
INSIDE = 4.0
# Largest angle between tangents, and Newton steps above which the next step is shorter.
LARGEST_ANGLE, MANY = 0.4, 5
# Longest step across a fold in epsilon, and the share of it to which the fold is located there.
ACROSS, LOCATED = 0.05, 1e-6


class FamilyEnd(StrEnum):
    """Where a family of canards ends."""

    BOUND = "the bound of epsilon was reached"
    POINTS = "the allowed number of points was used up"
    STEPS = "the steps fell below rounding"
    MESH = f"a mesh of {MOST} elements no longer resolves the orbit"

    @property
    def status(self) -> Status:
        """The same as a `Status`."""
        return {
            FamilyEnd.POINTS: Status.TOO_MANY_STEPS,
            FamilyEnd.STEPS: Status.STEP_TOO_SMALL,
            FamilyEnd.MESH: Status.NOT_CONVERGED,
        }.get(self, Status.SUCCESS)


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
            raise GspError(f"{name!r} is no state. The states are {', '.join(names)}.")
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
            f"the bounds enclose the canard's own {canard.frame.system.epsilon} = {canard.epsilon:g}. "
            f"Got ({low:g}, {high:g})."
        )
    follower = _Follower(canard, (low, high), max_points)
    down, up = follower.trace(-1), follower.trace(1)
    orbits = (*down.orbits[:0:-1], *up.orbits)
    points = np.array([*down.points[:0:-1], *up.points])
    return CanardFamily(
        system=canard.frame.system,
        name=canard.name,
        epsilon=np.array([orbit.epsilon for orbit in orbits]),
        time=np.array([orbit.time for orbit in orbits]),
        points=points,
        orbits=orbits,
        folds=(*down.folds[::-1], *up.folds),
        ends=(down.end, up.end),
    )


@dataclass
class _Trace:
    orbits: list[OrbitSegment]
    points: list[np.ndarray]
    folds: list[float]
    end: FamilyEnd = FamilyEnd.POINTS


@dataclass(frozen=True, eq=False)
class _Direction:
    """A unit tangent of the family: `ends` (8,) of both ends, the time and log epsilon; the orbit's `profile`."""

    ends: np.ndarray
    profile: OrbitSegment
    step: Step


class _Follower:
    """Pseudo-arclength in the whole orbit, its time, and log epsilon."""

    def __init__(self, canard: Canard, bounds: tuple[float, float], max_points: int) -> None:
        self.canard, self.bounds, self.max_points = canard, bounds, max_points
        self.problem = CanardSolver(
            canard.frame, (canard.attracting_line, canard.repelling_line), epsilon_free=True
        )
        self.solver = self.problem.solver
        self.extent = np.maximum(np.ptp(canard.orbit.states, axis=0), 1e-8)

    def trace(self, direction: int) -> _Trace:
        """One direction: -1 with falling epsilon at first, 1 with growing."""
        first = self.canard.orbit
        start = np.array([self.canard.point[s.name] for s in self.canard.frame.system.states])
        trace = _Trace([first], [start], [])
        share = self.canard.time_before / first.time
        along = self._tangent(first, None)
        if along is not None and along.ends[7] * direction < 0.0:
            along = self._scaled(along, -1.0)
        step = FIRST
        while along is not None and len(trace.orbits) < self.max_points:
            here = trace.orbits[-1]
            found, steps = self._advance(here, along, step)
            new = None if found is None else self._tangent(found, along)
            if found is None or new is None or self._product(new, along, found.mesh) < np.cos(LARGEST_ANGLE):
                step *= 0.5
                if step < SHORTEST:
                    trace.end = FamilyEnd.STEPS
                    return trace
                continue
            turns = along.ends[7] * new.ends[7] < 0.0
            if turns and step > ACROSS:
                step *= 0.5
                continue
            if turns:
                trace.folds.append(self._fold(here, along, new, step))
            low, high = self.bounds
            if not low < found.epsilon < high:
                found = self._at(here, found, low if found.epsilon <= low else high) or found
                trace.end = FamilyEnd.BOUND
            met = section_crossing(found, self.canard.section, share)
            share = share if met is None else met[0]
            trace.orbits.append(found)
            trace.points.append(np.full(3, np.nan) if met is None else met[1])
            if trace.end is FamilyEnd.BOUND:
                return trace
            if found.elements_for(PRECISION) > MOST:
                trace.end = FamilyEnd.MESH
                return trace
            along = new
            step = min(LONGEST, step * (1.4 if steps <= MANY else 0.7))
        if along is None:
            trace.end = FamilyEnd.STEPS
        return trace

    # -- one step ----------------------------------------------------------------------------------

    def _coordinates(self, orbit: OrbitSegment) -> np.ndarray:
        ends = np.concatenate([orbit.start / self.extent, orbit.end / self.extent])
        return np.append(ends, [orbit.time / self.canard.orbit.time, np.log(orbit.epsilon)])

    def _weights(self, mesh: np.ndarray) -> np.ndarray:
        """INSIDE times the trapezium rule on a mesh (m + 1,)."""
        weights = np.zeros(len(mesh))
        weights[:-1] += 0.5 * np.diff(mesh)
        weights[1:] += 0.5 * np.diff(mesh)
        return INSIDE * weights

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
            np.append(four.wanted, value),
            inner[None],
        )

    def _tangent(self, orbit: OrbitSegment, along: _Direction | None) -> _Direction | None:
        """The unit tangent at an orbit, on the side of `along`; None where the problem is singular."""
        conditions = self._conditions(orbit, along, 1.0)
        conditions.wanted[:4] = 0.0
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

    def _advance(self, here: OrbitSegment, along: _Direction, step: float) -> tuple[OrbitSegment | None, int]:
        anchor = self._coordinates(here)

        def problem(orbit: OrbitSegment) -> Conditions:
            conditions = self._conditions(orbit, along, 0.0)
            inside = (along.profile.at(orbit.mesh) * (orbit.states - here.at(orbit.mesh)) / self.extent**2).sum(
                axis=1
            )
            gone = along.ends @ (self._coordinates(orbit) - anchor) + self._weights(orbit.mesh) @ inside
            conditions.wanted[4] = step - gone
            return conditions

        before = self.solver.iterations
        guess = here.moved(along.step, step)
        found = self.solver.solve(guess, problem, limit=10) if min(guess.time, guess.epsilon) > 0.0 else None
        steps = self.solver.iterations - before
        if found is None:
            return None, steps
        elements = int(np.clip(found.elements_for(PRECISION), FEWEST, MOST))
        return self.solver.solve(found.adapted(elements), problem, limit=10), steps

    def _at(self, here: OrbitSegment, there: OrbitSegment, value: float) -> OrbitSegment | None:
        """The orbit between two at a value of epsilon."""

        def problem(orbit: OrbitSegment) -> Conditions:
            return self._conditions(orbit, None, (value - orbit.epsilon) / orbit.epsilon)

        share = (value - here.epsilon) / (there.epsilon - here.epsilon)
        other = there.on(here.mesh)
        guess = OrbitSegment(
            mesh=here.mesh,
            states=(1 - share) * here.states + share * other.states,
            stages=(1 - share) * here.stages + share * other.stages,
            time=(1 - share) * here.time + share * there.time,
            epsilon=value,
        )
        found = self.solver.solve(guess, problem)
        if found is None:
            return None
        elements = int(np.clip(found.elements_for(PRECISION), FEWEST, MOST))
        return self.solver.solve(found.adapted(elements), problem)

    def _fold(self, here: OrbitSegment, along: _Direction, new: _Direction, step: float) -> float:
        """Epsilon where it turns, on the curve between `here` and one step on: its tangent's component is 0.

        Where the curve cannot be followed in between, the last epsilon that was reached on the way.
        """
        best = float(here.epsilon)

        def component(length: float) -> float:
            nonlocal best
            found, _ = self._advance(here, along, length)
            tangent = None if found is None else self._tangent(found, along)
            if found is None or tangent is None:
                return float("nan")
            best = float(found.epsilon)
            return float(tangent.ends[7])

        ends = float(along.ends[7]), float(new.ends[7])
        root(component, 0.0, step, ends=ends, apart=LOCATED * step)
        return best
