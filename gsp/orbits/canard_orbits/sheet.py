"""A sheet of the slow manifold up to the section through a folded node, as a family of orbit segments.

Each segment joins a line on M0 with the section; together they form a curve of solutions of one boundary-value
problem, followed by pseudo-arclength in where they begin, where they end and how long they take (Desroches,
Krauskopf and Osinga, SIAM J. Appl. Dyn. Syst. 7 (2008) 1131-1162; Nonlinearity 23 (2010) 739-765). Beside the
strong canard their beginnings differ by exp(-c/epsilon) only, and their ends by everything that is seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, StrEnum

import numpy as np

from gsp.collocation.bordered import Conditions, OrbitChange
from gsp.errors import Status
from gsp.integration.methods import Method
from gsp.integration.trajectory import RunOptions, trajectory_of
from gsp.orbits.canard_orbits.collocation import Collocation, OrbitSegment, sampled
from gsp.orbits.canard_orbits.frame import FoldedNodeFrame, Plane
from gsp.orbits.canard_orbits.line import SheetLine, SheetNotFound, crossing_times
from gsp.tracing.arclength import Arrival, Pace, Stride, Trace, Tracer

# Elements of a segment to begin with, and at most.
ELEMENTS, MOST_ELEMENTS = 40, 480
# Interpolation error of a segment, as a share of its extent; at the elements' ends it is far below.
PRECISION = 1e-7
# Steps in units of the frame: the first, the longest, and the shortest before giving up.
FIRST, LONGEST, SHORTEST = 0.02, 10.0, 1e-9
# The curve is left where its fast variable is this many local widths from the node.
WINDOW = 10.0
# Inwards it is left when it moves by less than this share of the width in a step, STILL times.
RESOLUTION, STILL = 1e-8, 3
# Segments a direction, and elements of all Newton steps a sheet, at most; 800 segments of a sheet that turns 27 times
# take 330 000.
SEGMENTS, WORK = 1500, 600_000
# A first segment is not taken beyond this, in local units.
FURTHEST = 1.5


# A direction of a singular problem.
NOWHERE = np.zeros(0)


class CurveEnd(StrEnum):
    """Where a curve of orbits ends."""

    @property
    def status(self) -> Status:
        """The same as a `Status`."""
        return _STATUS.get(self.name, Status.SUCCESS)


class SheetEnd(CurveEnd):
    """Where the curve of a sheet ends."""

    WINDOW = "it leaves the window about the node"
    LINE = "its line meets the section"
    STILL = "it stands still, at the weak canard"
    PASSED = "it has passed the weak canard, and the slow flow runs along its line"
    TURNED = "it has passed the weak canard, and turns back"
    SINGULAR = "its boundary-value problem is singular"
    STEPS = "its steps fell below rounding"
    SEGMENTS = "the allowed number of segments was used up"
    WORK = "the allowed number of Newton steps was used up"


# What ends a curve is a success unless it is here.
_STATUS = {
    "SINGULAR": Status.SINGULAR_JACOBIAN,
    "STEPS": Status.STEP_TOO_SMALL,
    "MESH": Status.NOT_CONVERGED,
    "POINTS": Status.TOO_MANY_STEPS,
    "SEGMENTS": Status.TOO_MANY_STEPS,
    "WORK": Status.TOO_MANY_STEPS,
}


@dataclass(frozen=True, eq=False, repr=False)
class Sheet:
    """One sheet's curve in the section, from near the weak canard outwards.

    - `segments` are its orbits, in the direction of time, and `ends` (k, 2) where they meet the section: the other
      slow variable and the fast one; `slopes` (k - 1, 2, 2) their derivatives by arclength at the two ends of each
      step, of the `lengths` (k - 1,);
    - `line` is where on M0 they begin (or end, on the repelling sheet), `contraction` the powers of e by which orbits
      approach the sheet between it and the node along the strong singular canard;
    - `inner` and `outer` say how the curve ends on each side.
    """

    attracting: bool
    line: Plane
    section: Plane
    contraction: float
    segments: tuple[OrbitSegment, ...]
    ends: np.ndarray
    lengths: np.ndarray
    slopes: np.ndarray
    inner: SheetEnd
    outer: SheetEnd

    @property
    def status(self) -> Status:
        """SUCCESS when the whole curve about the node was found."""
        return self.inner.status if not self.inner.status.ok else self.outer.status

    def interpolated(self, i: int, s: float) -> tuple[np.ndarray, np.ndarray]:
        """Place (2,) and derivative by s of the cubic Hermite interpolant from end i (s = 0) to i + 1 (s = 1)."""
        p, q = self.ends[i], self.ends[i + 1]
        u, v = self.lengths[i] * self.slopes[i]
        place = (
            p * (1 + 2 * s) * (1 - s) ** 2
            + u * s * (1 - s) ** 2
            + q * s * s * (3 - 2 * s)
            + v * s * s * (s - 1)
        )
        slope = 6 * s * (s - 1) * (p - q) + u * (1 - s) * (1 - 3 * s) + v * s * (3 * s - 2)
        return place, slope

    def chords(self, number: int) -> np.ndarray:
        """Places (k - 1, number + 1, 2) on the interpolant between each end and the next."""
        share = np.linspace(0.0, 1.0, number + 1)
        places = [self.interpolated(i, s)[0] for i in range(len(self.lengths)) for s in share]
        return np.array(places).reshape(-1, number + 1, 2)

    def curve(self) -> np.ndarray:
        """Places (m, 2) along the whole curve, from the innermost outwards."""
        return self.chords(6).reshape(-1, 2)

    def __repr__(self) -> str:
        kind = "attracting" if self.attracting else "repelling"
        return f"Sheet({kind}, {len(self.segments)} segments, {self.status.name})"


# How a tracer's own endings are told of a sheet.
ENDS: dict[Enum, SheetEnd] = {Status.TOO_MANY_POINTS: SheetEnd.SEGMENTS, Status.STEP_TOO_SMALL: SheetEnd.STEPS}


@dataclass(frozen=True, eq=False)
class _SheetNode:
    """A segment with its tangent: `normal` (7,) of its beginning, its end and its time, `tangent` the whole change.

    `before` is the slope of the curve in the section at the segment before, by the arclength of the step from there,
    and `after` its slope here.
    """

    segment: OrbitSegment
    normal: np.ndarray
    tangent: OrbitChange
    before: np.ndarray
    after: np.ndarray


class SheetBuilder(Tracer[_SheetNode]):
    """Builds one sheet: `attracting` from its line forward in time to the section, else backward."""

    def __init__(self, frame: FoldedNodeFrame, section: Plane, *, attracting: bool, line: Plane | None) -> None:
        self.frame = frame
        self.section = section
        self.attracting = attracting
        self.side = 1 if attracting else -1
        self.other = 1 - section.index
        self.solver = Collocation(frame.system)
        self.start = SheetLine(frame, self.side, line)
        self.line = self.start.plane
        mu = frame.rates[1] / frame.rates[0]
        # From one segment to the next a turn of a fifth of a radian is aimed at, and half a radian is the most. The
        # curves turn by about 1 - mu between gamma_0 and gamma_w: where that is small both are less, a tenth at least.
        sharpness = float(np.clip(10.0 * (1.0 - mu), 0.1, 1.0))
        self.pace = Pace(
            FIRST,
            LONGEST,
            SHORTEST,
            turn=0.2 * sharpness,
            largest_turn=0.5 * sharpness,
            growth=1.5,
        )
        self.most = SEGMENTS
        self._inwards, self._still, self._allowed = False, 0, 0
        # The angle by which the curve has turned in its own sense, its greatest value and the node that has it. Its
        # sense inwards is that of the line g = 0 in the section, followed from this sheet over the fold.
        self._sense = self.side * np.sign(frame.gradient(frame.point)[self.other])
        self._turned, self._most_turned, self._innermost = 0.0, 0.0, 0
        # In the section the other slow variable varies as g does.
        across = frame.depth / abs(frame.gradient(frame.point)[self.other])
        scale = np.array([frame.unit, frame.unit, frame.width])
        self.scale = np.array([across, frame.width])
        # Beginnings and lengths of time count less: they run far while the curve in the section does not.
        ends = scale.copy()
        ends[self.other] = across
        self.weights = np.concatenate([0.01 / scale**2, 1.0 / ends**2, [0.01 / self.frame.time**2]])

    def build(self) -> Sheet:
        first = self._first()
        if first is None:
            raise SheetNotFound(
                f"no orbit from {self.start.in_words()} on the {self.start.kind} sheet meets the section near the "
                f"folded node at {self.frame.system.epsilon} = {self.frame.epsilon:g}."
            )
        inner = self._trace(first, inwards=True)
        if inner.ending is SheetEnd.TURNED:
            # gamma_w may lie between the node that has turned most and the next.
            del inner.nodes[self._innermost + 2 :], inner.lengths[self._innermost + 1 :]
        outer = self._trace(first, inwards=False)
        segments = [node.segment for node in (*inner.nodes[:0:-1], *outer.nodes)]
        steps = [*inner.lengths[::-1], *outer.lengths]
        starts = [(-node.after, -node.before) for node in inner.nodes[:0:-1]]
        starts += [(node.before, node.after) for node in outer.nodes[1:]]
        ends = np.array([self._free_end(o)[[self.other, 2]] for o in segments])
        slopes = np.array([[a, b] for a, b in starts]).reshape(-1, 2, 2)
        return Sheet(
            attracting=self.attracting,
            line=self.line,
            section=self.section,
            contraction=self.start.contraction,
            segments=tuple(segments),
            ends=ends,
            lengths=np.array(steps),
            slopes=slopes,
            inner=_sheet_end(inner.ending),
            outer=_sheet_end(outer.ending),
        )

    # -- the first segment -------------------------------------------------------------------------

    def _first(self) -> OrbitSegment | None:
        """A segment inside the funnel, from the line to a section point near the node."""
        found, best = None, FURTHEST
        for z, time in self.start.starts():
            guess = self._shoot(z, time)
            if guess is not None and self._away(guess) < best:
                segment = self.polished(guess)
                found, best = (found, best) if segment is None else (segment, self._away(segment))
            # A first segment is good when it comes this near the node, in local units.
            if best <= 0.3 or self.solver.work > WORK // 2:
                break
        return found

    def _away(self, orbit: OrbitSegment) -> float:
        """How far from the node an orbit meets the section, in local units."""
        off = (self._free_end(orbit) - self.frame.point)[[self.other, 2]]
        return float(np.abs(off / self.scale).max())

    def _shoot(self, z: np.ndarray, time: float) -> OrbitSegment | None:
        """The orbit of the full flow from z to where it first crosses the section near the node."""
        frame = self.frame
        run = trajectory_of(
            frame.system, start=dict(zip([s.name for s in frame.system.states], z)),
            span=(0.0, self.side * (2.0 * time + 4.0 * frame.time)),
            epsilon=frame.epsilon, rtol=1e-9, atol=1e-11, options=RunOptions(method=Method.RADAU9),
        )  # fmt: skip
        for k, end in crossing_times(run, self.section):
            if abs(run.at(end)[2] - frame.point[2]) <= FURTHEST * frame.width:
                steps = np.append(run.t[: k + 1], end)
                return sampled(run, steps if self.attracting else steps[::-1], elements=ELEMENTS)
        return None

    def polished(self, guess: OrbitSegment, *, precision: float = PRECISION) -> OrbitSegment | None:
        """The segment with the time of the guess, on a mesh of its own."""

        def problem(orbit: OrbitSegment) -> Conditions:
            conditions = self._base(orbit)
            conditions.across[3, 0], conditions.target[3] = 1.0, guess.time - orbit.time
            return conditions

        orbit: OrbitSegment | None = guess
        for _ in range(2):
            if orbit is not None:
                orbit = self.solver.solve(orbit.adapted(precision, ELEMENTS, MOST_ELEMENTS), problem)
        return orbit

    # -- the boundary-value problem ----------------------------------------------------------------

    def _line_end(self, orbit: OrbitSegment) -> np.ndarray:
        return orbit.start if self.attracting else orbit.end

    def _free_end(self, orbit: OrbitSegment) -> np.ndarray:
        return orbit.end if self.attracting else orbit.start

    def _base(self, orbit: OrbitSegment) -> Conditions:
        """On M0 and on the line at one end, in the section at the other; the last row is left free."""
        left, right, target = np.zeros((4, 3)), np.zeros((4, 3)), np.zeros(4)
        near, far = (left, right) if self.attracting else (right, left)
        z = self._line_end(orbit)
        near[0], target[0] = self.frame.gradient(z), -self.frame.g(z)
        near[1, self.line.index], target[1] = 1.0, self.line.value - z[self.line.index]
        far[2, self.section.index] = 1.0
        target[2] = self.section.value - self._free_end(orbit)[self.section.index]
        return Conditions(left, right, np.zeros((4, 1)), target)

    def _across(self, conditions: Conditions, normal: np.ndarray, value: float) -> Conditions:
        """The last row: a step along `normal` (7,) of length `value`, in the weights of arclength."""
        near, far = (
            (conditions.left, conditions.right) if self.attracting else (conditions.right, conditions.left)
        )
        row = normal * self.weights
        near[3], far[3], conditions.across[3, 0], conditions.target[3] = row[:3], row[3:6], row[6], value
        return conditions

    def _coordinates(self, orbit: OrbitSegment) -> np.ndarray:
        return np.concatenate([self._line_end(orbit), self._free_end(orbit), [orbit.time]])

    # -- continuation ------------------------------------------------------------------------------

    def _trace(self, first: OrbitSegment, *, inwards: bool) -> Trace[_SheetNode]:
        """Follow the family from `first`; inwards is along the line away from the strong canard, over the funnel."""
        node = self._node(first, None)
        if node is None:
            return Trace(
                [_SheetNode(first, NOWHERE, OrbitChange(*3 * (NOWHERE,)), NOWHERE, NOWHERE)],
                ending=SheetEnd.SINGULAR,
            )
        away = self._line_end(first) - self.start.beginning
        if ((self.weights[:3] * away) @ node.normal[:3] > 0.0) != inwards:
            node = replace(node, normal=-node.normal, tangent=node.tangent.times(-1.0))
        self._inwards, self._still, self._allowed = inwards, 0, self.solver.work + WORK // 2
        self._turned, self._most_turned, self._innermost = 0.0, 0.0, 0
        trace = Trace([node])
        self.follow(trace)
        return trace

    def spent(self) -> SheetEnd | None:
        """The end of the work that one direction is allowed."""
        return SheetEnd.WORK if self.solver.work > self._allowed else None

    def predicted(self, here: _SheetNode, length: float) -> tuple[OrbitSegment, _SheetNode] | None:
        """The segment moved along the tangent, and where from."""
        guess = here.segment.moved(here.tangent, length)
        return (guess, here) if guess.time > 0.0 else None

    def corrected(
        self, guess: tuple[OrbitSegment, _SheetNode], length: float
    ) -> tuple[OrbitSegment, int, float] | None:
        """The segment across the tangent, on the mesh of the guess and then on its own."""
        orbit, here = guess
        anchor, normal = self._coordinates(here.segment), here.normal

        def problem(orbit: OrbitSegment) -> Conditions:
            gone = (self.weights * normal) @ (self._coordinates(orbit) - anchor)
            return self._across(self._base(orbit), normal, length - float(gone))

        before = self.solver.iterations
        found = self.solver.solve(orbit, problem, limit=8)
        if found is None:
            return None
        found = self.solver.solve(found.adapted(PRECISION, ELEMENTS, MOST_ELEMENTS), problem, limit=8)
        return None if found is None else (found, self.solver.iterations - before, length)

    def oriented(
        self, here: _SheetNode, guess: tuple[OrbitSegment, _SheetNode], found: tuple[OrbitSegment, int, float]
    ) -> Stride[_SheetNode] | None:
        """The segment with its tangent; the turn is that of the curve in the section."""
        node = self._node(found[0], here.normal)
        if node is None:
            return None
        before, after = (v[[3 + self.other, 5]] / self.scale for v in (here.normal, node.normal))
        size = np.linalg.norm(before) * np.linalg.norm(after)
        turn = float(np.arccos(np.clip(before @ after / size, -1.0, 1.0))) if size > 0.0 else 0.0
        # Where the curve stands still its direction is noise.
        moves = np.linalg.norm(before) * found[2] >= RESOLUTION
        return Stride(node, found[1], turn if moves else 0.0)

    def arrived(
        self, trace: Trace[_SheetNode], here: _SheetNode, stride: Stride[_SheetNode], length: float
    ) -> Arrival[_SheetNode]:
        """The segment, and the ending where the curve leaves the window, stands still or has come by its line."""
        taken = stride.node.segment
        moved = np.abs((self._free_end(taken) - self._free_end(here.segment))[[self.other, 2]]) / self.scale
        self._still = self._still + 1 if moved.max() < RESOLUTION else 0
        ending = self._ending(taken)
        if self._inwards and ending is None:
            if self._still >= STILL:
                ending = SheetEnd.STILL
            elif moved.max() >= RESOLUTION and self._turns_back(stride.node, len(trace.nodes)):
                ending = SheetEnd.TURNED
        return Arrival([(stride.node, length)], ending)

    def _turns_back(self, node: _SheetNode, number: int) -> bool:
        """Whether the curve, with this node and its number, turns back by BACK."""
        (u, v), (a, b) = node.before / self.scale, node.after / self.scale
        self._turned += self._sense * float(np.arctan2(u * b - v * a, u * a + v * b))
        if self._turned > self._most_turned:
            self._most_turned, self._innermost = self._turned, number
        # A curve that turns back by a right angle has its innermost orbit behind it: beyond the funnel, as where
        # another folded singularity bounds it, it unwinds.
        return self._most_turned - self._turned >= np.pi / 2.0

    def _ending(self, orbit: OrbitSegment) -> SheetEnd | None:
        if abs(self._free_end(orbit)[2] - self.frame.point[2]) > WINDOW * self.frame.width:
            return SheetEnd.WINDOW
        # A segment this short, in local units of time, ends the curve.
        if orbit.time < 0.05 * self.frame.time:
            return SheetEnd.LINE
        return None if self.start.enters(self._line_end(orbit)) else SheetEnd.PASSED

    def _node(self, orbit: OrbitSegment, along: np.ndarray | None) -> _SheetNode | None:
        """A segment with the unit tangent (7,) of the family, on the side of `along`; None where it is singular."""
        normal = np.eye(7)[6] if along is None else along
        conditions = self._across(self._base(orbit), normal, 1.0)
        conditions.target[:3] = 0.0
        try:
            step = self.solver.linear(orbit, conditions, tangent=True)
        except np.linalg.LinAlgError:
            return None
        ends = (step.states[0], step.states[-1]) if self.attracting else (step.states[-1], step.states[0])
        vector = np.concatenate([*ends, step.parameters])
        size = float(np.sqrt(vector @ (self.weights * vector)))
        vector, place = vector / size, [3 + self.other, 5]
        inside = vector @ (self.weights * normal)
        return _SheetNode(orbit, vector, step.times(1.0 / size), normal[place], vector[place] / inside)


def _sheet_end(ending: Enum) -> SheetEnd:
    found = ENDS.get(ending, ending)
    assert isinstance(found, SheetEnd)
    return found
