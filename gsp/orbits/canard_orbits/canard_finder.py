"""The canards of a folded node where the curves of two sheets cross in a section, each solved as an orbit and named."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsp.orbits.canard_orbits.canard import (
    Canard,
    CanardKind,
    CanardSolver,
    SectionCrossing,
    crossings,
    deviation,
    guess_at,
    half_turns,
    named_point,
    section_crossing,
    split,
)
from gsp.orbits.canard_orbits.collocation import OrbitSegment
from gsp.orbits.canard_orbits.frame import FoldedNodeFrame, Plane
from gsp.orbits.canard_orbits.sheet import Sheet, SheetBuilder, SheetEnd

# The innermost crossing is the weak canard when it is this near to the innermost orbits of both sheets, in local
# widths over so many local units on each side of the section.
WEAK_DISTANCE, WEAK_REACH = 1e-5, 2.0
# Ends of curves beyond the weak canard, and of those that leave without having come to it.
BEYOND, AWAY = {SheetEnd.PASSED, SheetEnd.TURNED}, {SheetEnd.WINDOW, SheetEnd.LINE}
# Curves that touch at a crossing are seen to make angles up to 0.017 there, at mu = 1/2, 1/3, ..., 1/10, and others one
# of 0.06 at mu = 0.249.
TOUCHING = 0.03
# Elements of all Newton steps for the crossings, at most; 31 crossings at 28 canards take 120 000.
WORK = 500_000


@dataclass(frozen=True, eq=False)
class _SolvedCanard:
    """A crossing with its orbit, the share of its time at the section, and the state there."""

    crossing: SectionCrossing
    orbit: OrbitSegment
    share: float
    state: np.ndarray


class CanardFinder:
    """Solves the crossings of two sheets and names them."""

    def __init__(
        self, frame: FoldedNodeFrame, section: Plane, builders: list[SheetBuilder], sheets: list[Sheet]
    ) -> None:
        self.frame, self.section, self.builders, self.sheets = frame, section, builders, sheets
        self.lines = (builders[0].line, builders[1].line)
        self.solver = CanardSolver(frame, self.lines)
        self.scale = builders[0].scale
        self.columns = [builders[0].other, 2]
        # How many crossings were left because rounding hides their turns; what the search met.
        self.unresolved, self.touching, self.exhausted = 0, False, False
        # Whether Newton's method met rounding before it met its own tolerance at the weak canard.
        self.unsettled = False

    def find(self) -> list[Canard]:
        """The canards, from the strong one inwards."""
        crossed, complete = crossings(*self.sheets)
        solved: list[_SolvedCanard] = []
        self.exhausted = not complete
        for crossing in crossed:
            if self.solver.solver.work > WORK:
                self.exhausted = True
                break
            each = self._solved(crossing, self.solver.solve(guess_at(crossing, *self.sheets)))
            solved += [] if each is None else [each]
        axis, weak = self._axis(solved, None if self.exhausted else crossed[-1] if crossed else None)
        canards, index = [], -1
        known = [] if weak is None else [weak]
        for each in solved:
            # Two crossings this near each other, in local units, are one to rounding.
            if any(self._apart(each.state, other.state) < 1e-7 for other in known):
                continue
            known.append(each)
            turns = half_turns(each.orbit, each.share, axis, self.section, self.frame.width)
            if turns is None:
                self.unresolved += 1
                continue
            # A crossing that was missed shows in the turns; turns that rounding or a bent axis hides, in the order.
            index = max(index + 1, (turns - 1) // 2)
            kind = CanardKind.STRONG if index == 0 else CanardKind.SECONDARY
            canards.append(self._canard(each, kind, index, turns))
        return canards if weak is None else [*canards, self._canard(weak, CanardKind.WEAK, None, None)]

    def _apart(self, one: np.ndarray, other: np.ndarray) -> float:
        """How far apart two states of the section are, in local units."""
        return float(np.abs((one - other)[self.columns] / self.scale).max())

    def _solved(self, crossing: SectionCrossing, orbit: OrbitSegment | None) -> _SolvedCanard | None:
        if orbit is None:
            return None
        near = self.sheets[0].segments[crossing.attracting[0]].time / orbit.time
        met = section_crossing(orbit, self.section, near)
        # Newton's method may leave for another canard: it is found at its own crossing.
        off = np.inf if met is None else np.abs((met[1][self.columns] - crossing.place) / self.scale).max()
        return None if met is None or off > 0.1 else _SolvedCanard(crossing, orbit, *met)

    def _axis(
        self, solved: list[_SolvedCanard], innermost: SectionCrossing | None
    ) -> tuple[tuple[OrbitSegment, OrbitSegment], _SolvedCanard | None]:
        """The weak canard up to the section and beyond: the innermost crossing, or the sheets' innermost orbits."""
        passed = any(sheet.inner in BEYOND for sheet in self.sheets)
        weak = self._unsettled(solved, innermost) if passed and innermost is not None else None
        if weak is not None:
            self._take_unsettled(innermost)
            return split(weak.orbit, weak.share), weak
        inner = []
        for builder, sheet in zip(self.builders, self.sheets):
            segment = sheet.segments[0]
            # Interpolation error of the orbits that stand for the axis.
            inner.append(builder.polished(segment, precision=1e-10) or segment)
        axis = (inner[0], inner[1])
        if not solved or any(sheet.inner in AWAY for sheet in self.sheets):
            return axis, None
        last = solved[-1]
        if passed and not (self._is_at(last, innermost) and self._is_innermost(last)):
            return axis, None
        if len(solved) == 1 and self._is_strong(last):
            return axis, None
        if not passed and not self._is_along(last, axis):
            return axis, self._between_ends(axis, innermost)
        return split(last.orbit, last.share), last

    def _is_along(self, solved: _SolvedCanard, axis: tuple[OrbitSegment, OrbitSegment]) -> bool:
        """Whether a canard runs along the sheets' innermost orbits."""
        off = deviation(solved.orbit, solved.share, axis, self.section, WEAK_REACH * self.frame.unit)
        return off <= WEAK_DISTANCE * self.frame.width

    def _between_ends(
        self, axis: tuple[OrbitSegment, OrbitSegment], innermost: SectionCrossing | None
    ) -> _SolvedCanard | None:
        """The weak canard where both curves stand still at it before they cross there."""
        place = np.mean([sheet.ends[0] for sheet in self.sheets], axis=0)
        at_ends = SectionCrossing(place, (0, 0.0), (0, 0.0))
        guess = guess_at(at_ends, *self.sheets)
        for solve in (self.solver.solve, self.solver.settled):
            found = self._solved(at_ends, solve(guess))
            if found is not None and self._is_along(found, axis):
                if solve == self.solver.settled:
                    self._take_unsettled(innermost)
                return found
        return None

    def _take_unsettled(self, innermost: SectionCrossing | None) -> None:
        """Newton's method does not settle at a canard: because the curves touch there, or for rounding alone."""
        self.unsettled = True
        self.touching = innermost is not None and self._angle(innermost) <= TOUCHING

    def _angle(self, crossing: SectionCrossing) -> float:
        """The angle at which the curves cross, in local units."""
        places = (crossing.attracting, crossing.repelling)
        ways = [sheet.interpolated(*place)[1] / self.scale for sheet, place in zip(self.sheets, places)]
        first, second = (way / np.linalg.norm(way) for way in ways)
        return float(np.arcsin(min(1.0, abs(first[0] * second[1] - first[1] * second[0]))))

    def _is_innermost(self, solved: _SolvedCanard) -> bool:
        """Whether a canard is where the curves would cross next to their inner ends, and no secondary one before.

        It is at the ends, or straight on from them the curves meet nearer to it than the ways there are long.
        """
        here = solved.state[self.columns] / self.scale
        ends = [sheet.ends[0] / self.scale for sheet in self.sheets]
        if max(float(np.linalg.norm(end - here)) for end in ends) <= WEAK_DISTANCE:
            return True
        if not all(len(sheet.slopes) for sheet in self.sheets):
            return False
        first, second = (
            way / np.linalg.norm(way) for way in (s.slopes[0, 0] / self.scale for s in self.sheets)
        )
        try:
            steps = np.linalg.solve(np.stack([first, -second], axis=1), ends[1] - ends[0])
        except np.linalg.LinAlgError:
            return False
        return bool(np.linalg.norm(ends[0] + steps[0] * first - here) <= np.abs(steps).sum())

    def _is_at(self, solved: _SolvedCanard, innermost: SectionCrossing | None) -> bool:
        """Whether a canard is that of the innermost crossing, which curves that touch may have several of."""
        if innermost is None:
            return False
        off = np.abs((solved.state[self.columns] - innermost.place) / self.scale).max()
        # A solved crossing this near the innermost one, in local units, is the same canard; there the curves
        # touch.
        return solved.crossing is innermost or bool(off < 1e-2)

    def _is_strong(self, solved: _SolvedCanard) -> bool:
        """Whether a canard passes the node rather along its strong direction than along its weak one."""
        frame, index = self.frame, self.section.index
        sigma = np.linspace(0.0, 1.0, 20 * len(solved.orbit.mesh))
        states = solved.orbit.at(sigma) - frame.point
        near = np.abs(states[:, index]) <= WEAK_REACH * abs(frame.strong[index])
        strong, weak = (v[2] / v[index] for v in (frame.strong, frame.weak))
        slope = float(np.polyfit(states[near, index], states[near, 2], 1)[0])
        return abs(slope - strong) < abs(slope - weak)

    def _unsettled(self, solved: list[_SolvedCanard], innermost: SectionCrossing) -> _SolvedCanard | None:
        """The canard of the innermost crossing when Newton's method found none there."""
        if solved and self._is_at(solved[-1], innermost):
            return None
        return self._solved(innermost, self.solver.settled(guess_at(innermost, *self.sheets)))

    def _canard(self, solved: _SolvedCanard, kind: CanardKind, index: int | None, turns: int | None) -> Canard:
        orbit = solved.orbit
        finer = self.solver.finer(orbit, settles=not (kind is CanardKind.WEAK and self.unsettled))
        again = None if finer is None else section_crossing(finer, self.section, solved.share)
        error = np.inf if again is None else self._apart(again[1], solved.state)
        gap = (solved.state[self.columns] - solved.crossing.place) / self.scale
        return Canard(
            system=self.frame.system,
            epsilon=self.frame.epsilon,
            kind=kind,
            index=index,
            half_turns=turns,
            point=named_point(self.frame, solved.state),
            time_before=solved.share * orbit.time,
            time_after=(1.0 - solved.share) * orbit.time,
            crossing_gap=float(np.abs(gap).max()),
            residual=self.solver.solver.defect(orbit),
            error=error,
            orbit=orbit,
            attracting_line=self.lines[0],
            repelling_line=self.lines[1],
            section=self.section,
            frame=self.frame,
        )
