"""A curve {F(u) = 0}, F: R^N -> R^(N-1), by pseudo-arclength: its corrector, bounds, branch points and closing.

Lengths and angles are measured in u/scale, so that the units of a variable do not matter. A step that would jump to
another branch changes the sign of det[F_u; tangent] without a branch point in between; it is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from gsp.errors import Status
from gsp.roots import root
from gsp.tracing import arclength
from gsp.tracing.arclength import Arrival, Pace, Stride
from gsp.tracing.newton import Rules, newton

# Corrections of a step that are aimed at.
AIM = 3
# Largest angle between neighbouring tangents, and the one aimed at, in radians; no pedigree but many curves tried.
LARGEST_ANGLE = 0.3
# Points nearer than this, in scaled units, are one: a curve that comes so near its start is closed.
SAME_PLACE = 1e-6


@dataclass(frozen=True)
class Controls:
    """How far and how finely to continue: steps in units of the scales, points in each direction."""

    step: float
    max_step: float
    max_points: int
    tolerance: float


@dataclass
class Counters:
    """What a continuation cost so far."""

    steps: int = 0
    rejected: int = 0
    corrections: int = 0
    located: int = 0


class CurveEquations(Protocol):
    """A curve {F(u) = 0}: F (N - 1,) and F_u (N - 1, N) at one point."""

    def residual(self, u: np.ndarray) -> np.ndarray: ...

    def jacobian(self, u: np.ndarray) -> np.ndarray: ...


@dataclass
class CurveTrace:
    """One direction of a curve: `points`, unit `tangents` in `scales`, row by row, and how it ended.

    `crossings` are rows that are branch points of the curve, with what the finder returned for them.
    """

    points: list[np.ndarray]
    tangents: list[np.ndarray]
    scales: list[np.ndarray]
    ending: Status = Status.TOO_MANY_POINTS
    bound: str = ""
    crossings: dict[int, object] = field(default_factory=dict)


class OrientedPoint(NamedTuple):
    """A point of a curve, its unit tangent in scaled units, and the sign of det[F_u; tangent]."""

    u: np.ndarray
    tangent: np.ndarray
    sign: int


# (before, after, tangent, short) -> (u, finding) of a branch point between two points, or None when there is none.
Finder = Callable[[np.ndarray, np.ndarray, np.ndarray, bool], tuple[np.ndarray, object] | None]


class PointTracer(arclength.Tracer[OrientedPoint]):
    """Continues one curve; holds its scales, bounds and counters.

    `find`, where it is set, decides about a change of orientation within a step; `refresh` exchanges what F keeps
    fixed, such as borders, at every point reached.
    """

    def __init__(
        self,
        equations: CurveEquations,
        *,
        scales: np.ndarray,
        bounds: np.ndarray,
        names: tuple[str, ...],
        controls: Controls,
        refresh: Callable[[CurveEquations, np.ndarray], CurveEquations] | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        self.equations = equations
        self.scales = scales.copy()
        self.bounds = bounds
        self.names = names
        self.controls = controls
        self.most = controls.max_points
        # The step fails below this share of the largest one.
        self.pace = Pace(controls.step, controls.max_step, 1e-8 * controls.max_step, AIM, 0.12, LARGEST_ANGLE)
        self.refresh = refresh
        self.find: Finder | None = None
        self.progress = progress
        self.counters = Counters()
        self._first_scales = scales.copy()
        self._bounded = np.isfinite(bounds).all(axis=1)
        self._saw_non_finite = False
        self._at_crossing = False
        self._trace = CurveTrace([], [], [])

    # -- one point ---------------------------------------------------------------------------------

    def scaled_jacobian(self, u: np.ndarray) -> np.ndarray:
        """F_u in units of the scales, rows of length one: (N - 1, N)."""
        slope = self.equations.jacobian(u) * self.scales
        size = np.linalg.norm(slope, axis=1, keepdims=True)
        return slope / np.where(size > 0.0, size, 1.0)

    def correct(self, u: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, int] | None:
        """The point of the curve in the plane through u across `normal` (in scaled units), and the corrections."""
        anchor = u

        def step_of(u: np.ndarray) -> np.ndarray:
            value, slope = self.equations.residual(u), self.equations.jacobian(u) * self.scales
            if not (np.isfinite(value).all() and np.isfinite(slope).all()):
                self._saw_non_finite = True
                raise np.linalg.LinAlgError("not finite")
            size = np.linalg.norm(slope, axis=1)
            size[size == 0.0] = 1.0
            matrix = np.vstack([slope / size[:, None], normal])
            return np.linalg.solve(matrix, np.append(value / size, normal @ ((u - anchor) / self.scales)))

        def moved(u: np.ndarray, step: np.ndarray, _: float) -> np.ndarray | None:
            # A correction of so many scales leads nowhere.
            if not float(np.abs(step).max()) < 1e3:
                return None
            self.counters.corrections += 1
            return u - self.scales * step

        def length(step: np.ndarray, _: np.ndarray) -> float:
            return float(np.abs(step).max())

        # That many scales from the origin steps as long as u is rounded are rounding, and longer ones may be.
        tolerance, far = self.controls.tolerance, float(np.abs(u / self.scales).max())
        rules = Rules(8, max(tolerance, np.finfo(float).eps * far), blurred=tolerance * (1.0 + far))
        found = newton(u, step_of, length=length, moved=moved, rules=rules)
        return (found.point, found.iterations) if found.status.ok else None

    def tangent(self, u: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Unit tangent in scaled units with a positive product with `along`; `along` itself at a branch point."""
        unit = np.zeros(len(u))
        unit[-1] = 1.0
        try:
            t = np.linalg.solve(np.vstack([self.scaled_jacobian(u), along]), unit)
        except np.linalg.LinAlgError:
            return along
        size = float(np.linalg.norm(t))
        return t / size if np.isfinite(size) and size < 1e12 else along

    def null_vector(self, u: np.ndarray) -> np.ndarray | None:
        """Unit tangent at u without a direction to follow; None where it is not unique."""
        _, sizes, right = np.linalg.svd(self.scaled_jacobian(u))
        return right[-1] if sizes[-1] > 1e-9 else None

    def orientation(self, u: np.ndarray, tangent: np.ndarray) -> int:
        """Sign of det[F_u; tangent]."""
        sign = float(np.linalg.slogdet(np.vstack([self.scaled_jacobian(u), tangent]))[0])
        return int(sign) if np.isfinite(sign) else 0

    # -- between two points ------------------------------------------------------------------------

    def between(self, a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray | None:
        """The point of the curve across the chord from a to b, at `share` of it; None when Newton fails."""
        chord = (b - a) / self.scales
        found = self.correct(a + share * (b - a), chord / np.linalg.norm(chord))
        return None if found is None else found[0]

    def root(self, a: np.ndarray, b: np.ndarray, test: Callable[[np.ndarray], float]) -> np.ndarray | None:
        """Where `test` changes its sign between a and b, along the chord; None where Newton fails on the way.

        Where it fails at one point, as at a branch point that is met exactly, one beside it is taken.
        """
        met = {0.0: a, 1.0: b}

        def value(share: float) -> float:
            beside = (self.between(a, b, share + offset) for offset in (0.0, -SAME_PLACE, SAME_PLACE))
            u = next((u for u in beside if u is not None), None)
            if u is None:
                return float("nan")
            met[share] = u
            return test(u)

        share = root(value, 0.0, 1.0, ends=(test(a), test(b)))
        return None if share is None else met[share]

    # -- the whole curve ---------------------------------------------------------------------------

    def run(self, start: np.ndarray, tangent: np.ndarray, *, at_crossing: bool = False) -> CurveTrace:
        """Continue from `start` along `tangent`; `at_crossing` says that start is a branch point."""
        trace = CurveTrace([start], [tangent], [self.scales.copy()])
        self._trace, self._at_crossing, self._saw_non_finite = trace, at_crossing, False
        outside = self._outside(start + 1e-3 * self.controls.step * self.scales * tangent)
        if outside is not None and self._on_bound(start, outside):
            trace.ending, trace.bound = Status.BOUND_REACHED, self.names[outside]
            return trace
        sign = 0 if at_crossing else self.orientation(start, tangent)
        followed = arclength.Trace([OrientedPoint(start, tangent, sign)])
        try:
            self.follow(followed, progress=self.progress)
        except KeyboardInterrupt:
            followed.ending = Status.INTERRUPTED
        assert isinstance(followed.ending, Status)
        trace.ending = followed.ending
        self.counters.rejected += followed.rejected
        return trace

    def stuck(self) -> Status:
        """Non-finite where the last point tried was."""
        return Status.NON_FINITE if self._saw_non_finite else Status.STEP_TOO_SMALL

    def predicted(self, here: OrientedPoint, length: float) -> tuple[np.ndarray, np.ndarray]:
        """The point along the tangent, and the tangent."""
        self._saw_non_finite = False
        return here.u + length * self.scales * here.tangent, here.tangent

    def corrected(self, guess: tuple[np.ndarray, np.ndarray], length: float) -> tuple[np.ndarray, int] | None:
        """The point across the tangent, unless it is so far from the guess that it may be on another branch."""
        found = self.correct(*guess)
        # A correction longer than this share of the step may have landed on another branch.
        if found is None or np.linalg.norm((found[0] - guess[0]) / self.scales) > 0.3 * length:
            return None
        return found

    def oriented(
        self, here: OrientedPoint, guess: tuple[np.ndarray, np.ndarray], found: tuple[np.ndarray, int]
    ) -> Stride[OrientedPoint]:
        """The point with its tangent; its sign is found on arrival."""
        along = self.tangent(found[0], here.tangent)
        turn = float(np.arccos(np.clip(along @ here.tangent, -1.0, 1.0)))
        return Stride(OrientedPoint(found[0], along, 0), found[1], turn)

    def arrived(
        self,
        _: arclength.Trace[OrientedPoint],
        here: OrientedPoint,
        stride: Stride[OrientedPoint],
        length: float,
    ) -> Arrival[OrientedPoint] | None:
        """The point, or the bound before it, with the branch point on the way; where the curve closes its start."""
        trace, (u, t, sign) = self._trace, here
        reached, along, place = stride.node
        nodes: list[tuple[OrientedPoint, float]] = []
        stop = self._bound_between(u, reached)
        if stop is not None:
            reached, place = stop
            if reached is None:
                return None
            if np.abs((reached - u) / self.scales).max() < 1e-9:
                # The last point was on the bound by itself.
                trace.points[-1], trace.bound = reached, self.names[place]
                return Arrival([], Status.BOUND_REACHED)
            along = self.tangent(reached, t)
        now = self.orientation(reached, along)
        if sign * now < 0 and self.find is not None:
            # A change of orientation within a step this short, as a share of the largest, is a branch point of
            # higher order.
            crossing = self.find(u, reached, t, length < 1e-6 * self.controls.max_step)
            if crossing is None:
                return None
            if self._at_crossing and self._is_start(trace, crossing[0], t):
                return self._closed(nodes)
            since = trace.points[max(trace.crossings, default=len(trace.points)) :]
            if since and all(self._is_same(u, crossing[0]) for u in since):
                # The last branch point once more: the curve turns back there, as y^2 = x^3 does.
                return None
            trace.crossings[len(trace.points)] = crossing[1]
            nodes.append((self._append(trace, crossing[0], t), 0.0))
        if len(trace.points) > 3 and self._closes(trace, u, reached, along):
            return self._closed(nodes)
        nodes.append((self._append(trace, reached, along), length))
        self.counters.steps += 1
        if stop is not None:
            trace.bound = self.names[place]
            return Arrival(nodes, Status.BOUND_REACHED)
        # A variable so many of its first scales away from the start is on its way to infinity.
        if np.abs((reached - trace.points[0]) / self._first_scales).max() > 1e6:
            return Arrival(nodes, Status.RUNS_AWAY)
        sign = now or sign
        along = self._rescaled(reached, along)
        if self.refresh is not None:
            self.equations = self.refresh(self.equations, reached)
            sign = self.orientation(reached, along)
        return Arrival(nodes, onward=OrientedPoint(reached, along, sign))

    def _closed(self, nodes: list[tuple[OrientedPoint, float]]) -> Arrival[OrientedPoint]:
        trace = self._trace
        return Arrival([*nodes, (self._append(trace, trace.points[0], trace.tangents[0]), 0.0)], Status.CLOSED)

    def _append(self, trace: CurveTrace, u: np.ndarray, t: np.ndarray) -> OrientedPoint:
        trace.points.append(u)
        trace.tangents.append(t)
        trace.scales.append(self.scales.copy())
        return OrientedPoint(u, t, 0)

    def _rescaled(self, u: np.ndarray, t: np.ndarray) -> np.ndarray:
        # A variable without bounds takes its present size as scale when that is twice the old one.
        grown = ~self._bounded & (np.abs(u) > 2.0 * self.scales)
        if not grown.any():
            return t
        raw = t * self.scales
        self.scales[grown] = np.abs(u[grown])
        t = raw / self.scales
        return t / np.linalg.norm(t)

    def _is_same(self, u: np.ndarray, v: np.ndarray) -> bool:
        return bool(np.linalg.norm((u - v) / self.scales) < SAME_PLACE)

    # -- bounds ------------------------------------------------------------------------------------

    def _outside(self, u: np.ndarray) -> int | None:
        beyond = np.maximum(self.bounds[:, 0] - u, u - self.bounds[:, 1]) / self.scales
        worst = int(np.argmax(beyond))
        return worst if beyond[worst] > 0.0 else None

    def _on_bound(self, u: np.ndarray, i: int) -> bool:
        return bool(np.abs(u[i] - self.bounds[i]).min() <= 1e-9 * self.scales[i])

    def _bound_between(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray | None, int] | None:
        """The first point on a bound between a, inside, and b (None where it is lost); None when b is inside too."""
        place = None
        for _ in range(len(a)):
            i = self._outside(b)
            if i is None:
                break
            value = self.bounds[i, 0] if b[i] < self.bounds[i, 0] else self.bounds[i, 1]
            found = self.root(a, b, lambda u, i=i, value=value: float(u[i] - value))
            if found is None and not self._on_bound(a, i):
                return None, i
            b = a.copy() if found is None else found
            b[i], place = value, i
        if place is None:
            return None
        self._saw_non_finite = not np.isfinite(self.equations.residual(b)).all()
        return None if self._saw_non_finite else b, place

    # -- closing -----------------------------------------------------------------------------------

    def _closes(self, trace: CurveTrace, a: np.ndarray, b: np.ndarray, along: np.ndarray) -> bool:
        """Whether the curve passes through its start between a and b, in the direction in which it left."""
        start, chord = trace.points[0], (b - a) / self.scales
        length = float(np.linalg.norm(chord))
        share = float((start - a) / self.scales @ chord) / length**2
        if not -1e-9 <= share <= 1.0 + 1e-9:
            return False
        if np.linalg.norm((start - a) / self.scales - share * chord) > 0.5 * length:
            return False
        through = self.between(a, b, share)
        return through is not None and self._is_start(trace, through, along)

    def _is_start(self, trace: CurveTrace, u: np.ndarray, along: np.ndarray) -> bool:
        first = trace.tangents[0] * trace.scales[0] / self.scales
        aligned = along @ first >= np.cos(2.0 * LARGEST_ANGLE) * np.linalg.norm(first)
        return bool(aligned and np.abs((u - trace.points[0]) / self.scales).max() < SAME_PLACE)
