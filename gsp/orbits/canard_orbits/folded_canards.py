"""The canards of a folded node: two sheets up to a section, where their curves cross, and each crossing as an orbit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sympy as sp

from gsp.errors import GspError, Status
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
from gsp.orbits.canard_orbits.frame import FoldedNodeFrame, Plane, frame_at, line_of, section_of
from gsp.orbits.canard_orbits.line import SheetNotFound
from gsp.orbits.canard_orbits.node_units import canard_in, in_own_units, plane_in, sheet_in
from gsp.orbits.canard_orbits.sheet import Sheet, SheetBuilder, SheetEnd
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.singular.singularities.folded_singularities import FoldedSingularity
from gsp.systems.arguments import check_noun
from gsp.systems.flow import check_epsilon
from gsp.systems.system import SlowFastSystem

State = Mapping[str, float] | Mapping[sp.Symbol, float]

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


class CanardOrbitError(GspError):
    """Canards that cannot be sought, because no orbit joins the lines and the section."""


@dataclass(frozen=True, eq=False, repr=False)
class CanardOrbits(Drawn, Tabular):
    """The canards of a folded node at one epsilon: `canards` from the strong one inwards, the weak one last.

    - `attracting` and `repelling` are the sheets' curves in the section, `section` its (name, value);
    - `expected` is how many secondary canards there are as epsilon goes to 0, `missing` their names and
      gamma_0's that were not found here; the number holds in the limit only, and there may be more here;
    - `touching` tells that the curves touch at the weak canard, as where 1/mu is a whole number: it is known to
      the root of rounding only, see its `error`;
    - `exhausted` tells that the work allowed for the crossings was used up before the innermost;
    - `unresolved` is the number of crossings about the weak canard whose turns rounding hides;
    - `status` and `message` say how the curves ended, and why canards are missing.
    """

    system: SlowFastSystem
    singularity: FoldedSingularity
    epsilon: float
    canards: tuple[Canard, ...]
    attracting: Sheet
    repelling: Sheet
    expected: int
    unresolved: int
    touching: bool
    exhausted: bool
    frame: FoldedNodeFrame

    @property
    def section(self) -> tuple[str, float]:
        plane = self.attracting.section
        return self.system.states[plane.index].name, plane.value

    @property
    def status(self) -> Status:
        """SUCCESS when both curves were followed to their natural ends, and all their crossings looked at."""
        if self.exhausted and self.attracting.status.ok and self.repelling.status.ok:
            return Status.TOO_MANY_STEPS
        return self.attracting.status if not self.attracting.status.ok else self.repelling.status

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of gamma_0 and the secondary canards of the limit that were not found."""
        found = {canard.index for canard in self.canards}
        return tuple(_name(k) for k in range(self.expected + 1) if k not in found)

    @property
    def message(self) -> str:
        """One line: what was found, what the theory of the limit expects, and why they differ."""
        turning = [c for c in self.canards if c.index is not None]
        usual = sum(c.index is not None and c.index <= self.expected for c in turning)
        text = f"{usual} of {self.expected + 1} canards that turn"
        epsilon = f"{self.system.epsilon} = {self.epsilon:g}"
        found = [c.index for c in turning if c.index is not None]
        is_weak_known = any(c.kind is CanardKind.WEAK for c in self.canards)
        outer = [k for k in range(min(found, default=self.expected + 1)) if k <= self.expected]
        if outer:
            text += f"; {_names(outer)} do{'es' * (len(outer) == 1)} not cross the section at {epsilon}"
            text += " between the lines, or only outside the window"
        inner = list(range(max(found, default=self.expected) + 1, self.expected + 1))
        if inner:
            where = "within rounding of the weak canard" if is_weak_known else "beyond the ends of the curves"
            text += f"; {_names(inner)}: {where}, or none at {epsilon}"
        between = [k for k in range(min(found, default=0), max(found, default=0)) if k not in found]
        if between:
            text += f"; {', '.join(map(_name, between))}: no crossing was found between their neighbours"
        extra = [k for k in found if k > self.expected]
        if extra:
            text += f"; {_names(extra)} beyond the number of the limit"
        odd = [c.index for c in turning if c.index is not None and c.half_turns != 2 * c.index + 1]
        if odd:
            text += (
                f"; {', '.join(map(_name, odd))} named by their order: their half-turns do not tell them apart"
            )
        if self.unresolved:
            text += f"; {self.unresolved} more crossing{'s' * (self.unresolved > 1)} within rounding of the weak canard"
        ends = {self.attracting.inner, self.repelling.inner}
        if ends & (BEYOND | AWAY) and not is_weak_known:
            text += "; the curves do not cross at gamma_w before they end"
            if SheetEnd.PASSED in ends:
                text += f", where the slow flow runs along a line: lines in {self.section[0]} may reach it"
        if self.touching:
            text += "; the curves touch at gamma_w, as for whole 1/mu: its place is known to the root of rounding only"
        if self.exhausted:
            text += "; the work allowed for the crossings was used up before the innermost"
        for sheet in (self.attracting, self.repelling):
            # Fewer powers of e between a line and the node are said in the message.
            if sheet.contraction < 15.0:
                side = "attracting" if sheet.attracting else "repelling"
                text += (
                    f"; the line on the {side} sheet counts: orbits beside the strong canard come nearer by "
                )
                text += f"{sheet.contraction:.1f} powers of e only"
            if not sheet.status.ok:
                bad = [end for end in (sheet.inner, sheet.outer) if not end.status.ok]
                text += f"; {sheet!r}: {', '.join(bad)}"
        return text

    def __getitem__(self, name: str) -> Canard:
        """A canard by name: gamma_0, xi_1, ..., gamma_w."""
        for canard in self.canards:
            if canard.name == name:
                return canard
        raise GspError(
            f"there is no canard {name!r} here.",
            f"Those found are {', '.join(c.name for c in self.canards) or 'none'}.",
        )

    def __len__(self) -> int:
        return len(self.canards)

    def __repr__(self) -> str:
        names = [c.name for c in self.canards]
        shown = ", ".join(names) if len(names) < 6 else f"{names[0]}, {names[1]}, ..., {names[-1]}"
        return f"CanardOrbits({len(names)} at {self.system.epsilon} = {self.epsilon:g}: {shown})"

    def __str__(self) -> str:
        name, value = self.section
        others = [s.name for s in self.system.states if s.name != name]
        width = max([7, *(len(c.name) for c in self.canards)])
        lines = [
            f"canards of the folded node at {self.system.epsilon} = {self.epsilon:g}, "
            f"mu = {float(sp.N(self.singularity.mu)):.6g}, in the section {name} = {value:.6g}",
            f"  {'':{width}}  {others[0]:>15}  {others[1]:>15}  half-turns  {'error':>7}",
        ]
        for c in self.canards:
            turns = "" if c.half_turns is None else str(c.half_turns)
            place = "  ".join(f"{c.point[n]:15.10f}" for n in others)
            lines.append(f"  {c.name:{width}}  {place}  {turns:>10}  {c.error:7.0e}")
        lines.append(f"  {self.message}")
        return "\n".join(lines)


def folded_canards(
    singularity: FoldedSingularity,
    *,
    epsilon: float,
    section: State | None = None,
    attracting: State | None = None,
    repelling: State | None = None,
) -> CanardOrbits:
    """The canards through a folded node, as orbits, for one fast and two slow variables.

    The attracting slow manifold is extended by orbit segments from a line on the attracting sheet of M0 forward to a
    section, the repelling one backward; their curves in the section turn about the weak canard, and where they cross
    there is a canard: gamma_0, the strong one, after one half-turn, the secondary xi_k after 2 k + 1 (Wechselberger,
    SIAM J. Appl. Dyn. Syst. 4 (2005) 101-139). Each is solved as one orbit from line to line.

    `section` fixes a slow variable near the node, by default the one that is the faster there beside its size.
    `attracting` and `repelling` fix one state on a line of M0 each; by default the fast variable, where orbits
    beside the strong canard have come nearer to the slow manifold by 40 powers of e. Another line moves the canards
    by exp(-c/epsilon).

    Raises `FoldedError` for a folded singularity without canards that turn, and for more than two slow variables;
    `CanardOrbitError` when no orbit joins a line with the section.

    >>> x, z, y, eps = sp.symbols("x z y epsilon")
    >>> system = SlowFastSystem(
    ...     slow={x: 3*z/20 - 13*y/10, z: 1}, fast={y: x + y**2}, epsilon=eps)
    >>> from gsp import folded_singularities
    >>> node, = folded_singularities(system, region={"y": (-1, 1)})
    >>> folded_canards(node, epsilon=0.01)
    CanardOrbits(3 at epsilon = 0.01: gamma_0, xi_1, gamma_w)
    """
    check_noun(singularity, FoldedSingularity, verb="folded_canards")
    model = frame_at(singularity, epsilon=check_epsilon(epsilon))
    frame = in_own_units(model)
    plane = plane_in(section_of(model, section), frame.units)
    lines = [
        None if line is None else plane_in(line_of(model, line, what=what), frame.units)
        for line, what in ((attracting, "attracting"), (repelling, "repelling"))
    ]
    try:
        builders = [
            SheetBuilder(frame, plane, attracting=side, line=line) for side, line in zip((True, False), lines)
        ]
        sheets = [builder.build() for builder in builders]
    except SheetNotFound as error:
        raise CanardOrbitError(
            f"{error} Take a smaller {frame.system.epsilon}, or another line nearer to the fold, on the same sheet."
        ) from None
    finder = _Finder(frame, plane, builders, sheets)
    back = frame.units.back
    return CanardOrbits(
        system=model.system,
        singularity=singularity,
        epsilon=model.epsilon,
        canards=tuple(canard_in(canard, back, model) for canard in finder.find()),
        attracting=sheet_in(sheets[0], back),
        repelling=sheet_in(sheets[1], back),
        expected=singularity.secondary_canards,
        unresolved=finder.unresolved,
        touching=finder.touching,
        exhausted=finder.exhausted,
        frame=model,
    )


@dataclass(frozen=True, eq=False)
class _SolvedCanard:
    """A crossing with its orbit, the share of its time at the section, and the state there."""

    crossing: SectionCrossing
    orbit: OrbitSegment
    share: float
    state: np.ndarray


class _Finder:
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


def _names(indices: list[int]) -> str:
    ends = [_name(indices[0]), _name(indices[-1])]
    return ends[0] if len(indices) == 1 else f"{ends[0]} to {ends[1]}"


def _name(index: int) -> str:
    return "gamma_0" if index == 0 else f"xi_{index}"
