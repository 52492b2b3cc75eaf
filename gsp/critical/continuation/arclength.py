"""Pseudo-arclength continuation of a curve {F(u) = 0}, F: R^N -> R^(N-1), through its folds (Keller 1977).

Predictor along the tangent, corrector by Newton's method in the plane across it, steps chosen by the number of
corrections and the angle between tangents. Lengths and angles are measured in u/scale, so that the units of a
variable do not matter. A step that would jump to another branch changes the sign of det[F_u; tangent] without a
branch point in between; it is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from gsp.errors import Status
from gsp.roots import root

# Corrections of a step: at most this many, and this many aimed at.
CORRECTIONS = 8
AIM = 3
# Largest angle between neighbouring tangents, and the one aimed at, in radians; no pedigree but many curves tried.
LARGEST_ANGLE = 0.3
AIM_ANGLE = 0.12
# A correction longer than this share of the step may have landed on another branch.
LONGEST_CORRECTION = 0.3
# The step fails below this share of the largest one.
SMALLEST = 1e-8
# A change of orientation within a step this short, as a share of the largest, is a branch point of higher order.
UNRESOLVED = 1e-6
# A variable without bounds takes its present size as scale when that is this many times the old one.
OUTGROWN = 2.0
# The curve is closed when it comes this near its start, in scaled units.
SAME_PLACE = 1e-6
# A variable this many times its first scale is on its way to infinity.
FAR = 1e6


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


class Equations(Protocol):
    """A curve {F(u) = 0}: F (N - 1,) and F_u (N - 1, N) at one point."""

    def residual(self, u: np.ndarray) -> np.ndarray: ...

    def jacobian(self, u: np.ndarray) -> np.ndarray: ...


@dataclass
class Trace:
    """One direction of a curve: `points`, unit `tangents` in `scales`, row by row, and how it ended.

    `crossings` are rows that are branch points of the curve, with what the finder returned for them.
    """

    points: list[np.ndarray]
    tangents: list[np.ndarray]
    scales: list[np.ndarray]
    ending: Status = Status.TOO_MANY_POINTS
    bound: str = ""
    crossings: dict[int, object] = field(default_factory=dict)


# (before, after, tangent, short) -> (u, finding) of a branch point between two points, or None when there is none.
Finder = Callable[[np.ndarray, np.ndarray, np.ndarray, bool], tuple[np.ndarray, object] | None]


class Tracer:
    """Continues one curve; holds its scales, bounds and counters.

    `find` decides about a change of orientation within a step; `refresh` exchanges what F keeps fixed, such as
    borders, at every point reached.
    """

    def __init__(
        self,
        equations: Equations,
        *,
        scales: np.ndarray,
        bounds: np.ndarray,
        names: tuple[str, ...],
        controls: Controls,
        refresh: Callable[[Equations, np.ndarray], Equations] | None = None,
        find: Finder | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        self.equations = equations
        self.scales = scales.copy()
        self.bounds = bounds
        self.names = names
        self.controls = controls
        self.refresh = refresh
        self.find = find
        self.progress = progress
        self.counters = Counters()
        self._first_scales = scales.copy()
        self._bounded = np.isfinite(bounds).all(axis=1)
        self._saw_non_finite = False

    # -- one point ---------------------------------------------------------------------------------

    def scaled_jacobian(self, u: np.ndarray) -> np.ndarray:
        """F_u in units of the scales, rows of length one: (N - 1, N)."""
        slope = self.equations.jacobian(u) * self.scales
        size = np.linalg.norm(slope, axis=1, keepdims=True)
        return slope / np.where(size > 0.0, size, 1.0)

    def correct(self, u: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, int] | None:
        """The point of the curve in the plane through u across `normal` (in scaled units), and the corrections."""
        anchor, u = u, u.copy()
        for k in range(CORRECTIONS):
            value, slope = self.equations.residual(u), self.equations.jacobian(u) * self.scales
            if not (np.isfinite(value).all() and np.isfinite(slope).all()):
                self._saw_non_finite = True
                return None
            size = np.linalg.norm(slope, axis=1)
            size[size == 0.0] = 1.0
            matrix = np.vstack([slope / size[:, None], normal])
            right = np.append(value / size, normal @ ((u - anchor) / self.scales))
            try:
                step = np.linalg.solve(matrix, right)
            except np.linalg.LinAlgError:
                return None
            length = float(np.abs(step).max())
            if not length < 1e3:
                return None
            u = u - self.scales * step
            self.counters.corrections += 1
            if length <= self.controls.tolerance * (1.0 + float(np.abs(u / self.scales).max())):
                return u, k + 1
        return None

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
        """Where `test` changes its sign between a and b, along the chord; None where Newton fails on the way."""
        met = {0.0: a, 1.0: b}

        def value(share: float) -> float:
            u = self.between(a, b, share)
            if u is None:
                return float("nan")
            met[share] = u
            return test(u)

        share = root(value, 0.0, 1.0, ends=(test(a), test(b)))
        return None if share is None else met[share]

    # -- the whole curve ---------------------------------------------------------------------------

    def run(self, start: np.ndarray, tangent: np.ndarray, *, at_crossing: bool = False) -> Trace:
        """Continue from `start` along `tangent`; `at_crossing` says that start is a branch point."""
        trace = Trace([start], [tangent], [self.scales.copy()])
        try:
            self._run(trace, at_crossing)
        except KeyboardInterrupt:
            trace.ending = Status.INTERRUPTED
        return trace

    def _run(self, trace: Trace, at_crossing: bool) -> None:
        controls = self.controls
        u, t = trace.points[0], trace.tangents[0]
        sign = 0 if at_crossing else self.orientation(u, t)
        outside = self._outside(u + 1e-3 * controls.step * self.scales * t)
        if outside is not None and self._on_bound(u, outside):
            trace.ending, trace.bound = Status.BOUND_REACHED, self.names[outside]
            return
        h = min(controls.step, controls.max_step)
        while len(trace.points) < controls.max_points:
            if h < SMALLEST * controls.max_step:
                trace.ending = Status.NON_FINITE if self._saw_non_finite else Status.STEP_TOO_SMALL
                return
            self._saw_non_finite = False
            step = self._step(u, t, h)
            if step is None:
                self.counters.rejected += 1
                h *= 0.5
                continue
            reached, along, corrections, angle = step
            stop = self._bound_between(u, reached)
            if stop is not None:
                reached, place = stop
                if np.abs((reached - u) / self.scales).max() < 1e-9:
                    # The last point was on the bound by itself.
                    trace.ending, trace.bound, trace.points[-1] = (
                        Status.BOUND_REACHED,
                        self.names[place],
                        reached,
                    )
                    return
                along = self.tangent(reached, t)
            now = self.orientation(reached, along)
            if sign * now < 0 and self.find is not None:
                crossing = self.find(u, reached, t, h < UNRESOLVED * controls.max_step)
                if crossing is None:
                    self.counters.rejected += 1
                    h *= 0.5
                    continue
                if at_crossing and self._is_start(trace, crossing[0], t):
                    self._append(trace, trace.points[0], trace.tangents[0])
                    trace.ending = Status.CLOSED
                    return
                trace.crossings[len(trace.points)] = crossing[1]
                self._append(trace, crossing[0], t)
            if len(trace.points) > 3 and self._closes(trace, u, reached, along):
                self._append(trace, trace.points[0], trace.tangents[0])
                trace.ending = Status.CLOSED
                return
            self._append(trace, reached, along)
            self.counters.steps += 1
            if self.progress is not None:
                self.progress(len(trace.points) / controls.max_points)
            if stop is not None:
                trace.ending, trace.bound = Status.BOUND_REACHED, self.names[place]
                return
            if np.abs(reached / self._first_scales).max() > FAR:
                trace.ending = Status.RUNS_AWAY
                return
            u, t, sign = reached, along, now or sign
            growth = min(2.0 ** ((AIM - corrections) / 2.0), AIM_ANGLE / max(angle, 1e-3))
            h = min(h * float(np.clip(growth, 0.5, 2.0)), controls.max_step)
            t = self._rescaled(u, t)
            if self.refresh is not None:
                self.equations = self.refresh(self.equations, u)
                sign = self.orientation(u, t)
        trace.ending = Status.TOO_MANY_POINTS

    def _append(self, trace: Trace, u: np.ndarray, t: np.ndarray) -> None:
        trace.points.append(u)
        trace.tangents.append(t)
        trace.scales.append(self.scales.copy())

    def _step(self, u: np.ndarray, t: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray, int, float] | None:
        predicted = u + h * self.scales * t
        found = self.correct(predicted, t)
        if found is None:
            return None
        reached, corrections = found
        if np.linalg.norm((reached - predicted) / self.scales) > LONGEST_CORRECTION * h:
            return None
        along = self.tangent(reached, t)
        angle = float(np.arccos(np.clip(along @ t, -1.0, 1.0)))
        return None if angle > LARGEST_ANGLE else (reached, along, corrections, angle)

    def _rescaled(self, u: np.ndarray, t: np.ndarray) -> np.ndarray:
        grown = ~self._bounded & (np.abs(u) > OUTGROWN * self.scales)
        if not grown.any():
            return t
        raw = t * self.scales
        self.scales[grown] = np.abs(u[grown])
        t = raw / self.scales
        return t / np.linalg.norm(t)

    # -- bounds ------------------------------------------------------------------------------------

    def _outside(self, u: np.ndarray) -> int | None:
        beyond = np.maximum(self.bounds[:, 0] - u, u - self.bounds[:, 1]) / self.scales
        worst = int(np.argmax(beyond))
        return worst if beyond[worst] > 0.0 else None

    def _on_bound(self, u: np.ndarray, i: int) -> bool:
        return bool(np.abs(u[i] - self.bounds[i]).min() <= 1e-9 * self.scales[i])

    def _bound_between(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, int] | None:
        """The first point on a bound between a, inside, and b; None when b is inside too."""
        place = None
        for _ in range(len(a)):
            i = self._outside(b)
            if i is None:
                break
            value = self.bounds[i, 0] if b[i] < self.bounds[i, 0] else self.bounds[i, 1]
            found = self.root(a, b, lambda u, i=i, value=value: float(u[i] - value))
            b = a.copy() if found is None else found
            b[i], place = value, i
        return None if place is None else (b, place)

    # -- closing -----------------------------------------------------------------------------------

    def _closes(self, trace: Trace, a: np.ndarray, b: np.ndarray, along: np.ndarray) -> bool:
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

    def _is_start(self, trace: Trace, u: np.ndarray, along: np.ndarray) -> bool:
        first = trace.tangents[0] * trace.scales[0] / self.scales
        aligned = along @ first >= np.cos(2.0 * LARGEST_ANGLE) * np.linalg.norm(first)
        return bool(aligned and np.abs((u - trace.points[0]) / self.scales).max() < SAME_PLACE)
