"""Curves of the critical manifold: points in order, stability along them, and the special points between."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeVar

import numpy as np

from gsp.critical.continuation.arclength import Controls, CurveTrace, PointTracer
from gsp.critical.continuation.special_points import ZERO_EIGENVALUE, SpecialPoint
from gsp.critical.layer_problem import LayerProblem
from gsp.critical.loss_kind import LossKind
from gsp.errors import DeclarationError, Status
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.systems.flow import frozen, in_words
from gsp.systems.region import Interval, digits_between, shown_ends

# The name that endings of continuations had before there was one vocabulary.
Ending = Status
# What to do about an ending that reads otherwise for runs.
REMEDIES = {
    Status.STEP_TOO_SMALL: "the curve has an end, a corner or a pole here, or g is not smooth; start on its other side",
    Status.NON_FINITE: "the curve leaves the domain of g; bound it before, or start elsewhere",
    Status.INTERRUPTED: "what was computed before is kept; continue from the last point",
}


@dataclass(frozen=True)
class ContinuationStats:
    """What a continuation cost: accepted and rejected steps, Newton corrections, and points located."""

    steps: int
    rejected: int
    corrections: int
    located: int


@dataclass(frozen=True)
class Stop:
    """How one direction of a curve ended: where, and at whose bound (empty when at none)."""

    ending: Status
    point: Mapping[str, float]
    bound: str = ""


@dataclass(frozen=True)
class Segment:
    """Rows `first` to `last`, both included, with the same number of `unstable` fast eigenvalues."""

    first: int
    last: int
    unstable: int
    kind: str

    @property
    def rows(self) -> slice:
        """The rows as a slice of the curve's arrays."""
        return slice(self.first, self.last + 1)


@dataclass(frozen=True)
class Options:
    """What a continuation was asked for, so that another branch is continued in the same way."""

    bounds: Mapping[str, Interval]
    controls: Controls


class NamedPoints:
    """Points (m, n) on M0 with named columns, in the words of `what`. Frozen in its subclasses."""

    what: ClassVar[str]
    problem: LayerProblem
    points: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns of `points`: slow, fast, then free parameters."""
        return self.problem.names

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free variables."""
        return tuple(s.name for s in self.problem.free)

    def __getitem__(self, name: str) -> np.ndarray:
        """The column of that name, (m,); raises `DeclarationError` for an unknown one."""
        if name not in self.names:
            raise DeclarationError.none_of(
                self.names, name, f'the {self.what} has no column "{name}".', "It has"
            )
        return self.points[:, self.names.index(name)]


@dataclass(frozen=True, eq=False, repr=False)
class NamedCurve(NamedPoints):
    """What curves of M0 and of folds have in common: an order, special points, ends and a card."""

    what = "curve"
    problem: LayerProblem
    options: Options
    points: np.ndarray
    arclength: np.ndarray
    scales: Mapping[str, float]
    special: tuple[SpecialPoint, ...]
    stops: tuple[Stop, ...]
    stats: ContinuationStats
    message: str

    @property
    def status(self) -> Status:
        """How the curve ended: the worse of its two ends."""
        return next((stop.ending for stop in self.stops if not stop.ending.ok), self.stops[-1].ending)

    @property
    def is_closed(self) -> bool:
        """Whether the last point is the first again."""
        return self.stops[-1].ending is Status.CLOSED

    def __len__(self) -> int:
        return len(self.points)

    def of_kind(self, kind: LossKind) -> tuple[SpecialPoint, ...]:
        """The special points of one kind, in the order of the curve."""
        return tuple(point for point in self.special if point.kind is kind)

    def __repr__(self) -> str:
        kinds = [point.kind.value for point in self.special]
        counted = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
        tail = f", {counted}" if counted else ""
        name = type(self).__name__
        return f"{name}({len(self)} points in {', '.join(self.names)}, {self.status.name}{tail})"

    def described(self, region: Mapping[str, Interval] | None = None) -> str:
        """The card, its special points outside `region` last and called so."""
        title, rows = self._headed()
        ranges, inside, outside = [], [], []
        for name in self.names:
            ends = self._told(name, self[name].min()), self._told(name, self[name].max())
            # Nearer than points of the curve are known, its ends are one value.
            apart = ends[1] - ends[0] > self.options.controls.tolerance * max(map(abs, ends))
            low, high = shown_ends(ends if apart else (ends[0], ends[0]))
            ranges.append(f"  {name} = {low} throughout" if low == high else f"  {name} from {low} to {high}")
        for point in self.special:
            told = replace(point, point={name: self._told(name, value) for name, value in point.point.items()})
            if point.is_in(region or {}):
                inside.append(f"  {told}")
            else:
                outside.append(f"  outside the region: {told}")
        return "\n".join([title, *ranges, *rows, *inside, *outside, f"  {self.message}"])

    def _told(self, name: str, value: float) -> float:
        """The value of a variable; 0 where it is rounding of what bounds it."""
        rounding = np.finfo(float).eps * np.abs(self.options.bounds.get(name, (0.0, 0.0))).max()
        return 0.0 if abs(value) <= rounding else float(value)

    def _headed(self) -> tuple[str, Sequence[str]]:
        """The title of the card and the rows that are this curve's own."""
        raise NotImplementedError

    def __str__(self) -> str:
        return self.described()


@dataclass(frozen=True, eq=False, repr=False)
class CriticalCurve(NamedCurve, Drawn, Tabular):
    """A curve of M0, g(x, y, 0) = 0, through its folds.

    `points` (m, n) have the columns `names`, and `curve["v"]` is one of them; `eigenvalues` (m, n_fast) are those
    of g_y, the rightmost first, `unstable` (m,) counts those to the right of the axis. `arclength` (m,) is in units
    of the scales in use there, of which `scales` are the largest. Special points are rows of the curve too
    (`special[i].row`), `segments` the runs of constant stability, `stops` the ends, `others` the branches that
    were switched to, when that was asked for.
    """

    eigenvalues: np.ndarray
    unstable: np.ndarray
    segments: tuple[Segment, ...]
    others: tuple[CriticalCurve, ...] = ()

    def _headed(self) -> tuple[str, Sequence[str]]:
        rows = [
            f"  {segment.kind} ({segment.unstable} unstable) from row {segment.first} to {segment.last}"
            for segment in self.segments
        ]
        return f"curve of the critical manifold over {', '.join(self.free)}", rows


Curve = TypeVar("Curve", bound=NamedCurve)

# -- assembling ------------------------------------------------------------------------------------


def stability(eigenvalues: np.ndarray, special: Sequence[int]) -> tuple[np.ndarray, tuple[Segment, ...]]:
    """Unstable count (m,) and the runs of it; an eigenvalue on the axis at a `special` row counts as stable.

    A row at which g_y is not finite, as at the end of a root's domain, counts like the one before.
    """
    known = np.flatnonzero(np.isfinite(eigenvalues).all(axis=1))
    before = known[np.maximum(np.searchsorted(known, np.arange(len(eigenvalues)), side="right") - 1, 0)]
    count = (np.real(eigenvalues[before]) > 0.0).sum(axis=1)
    rows = np.array(sorted(special), dtype=int)
    size = np.abs(eigenvalues[rows]).max(axis=1, keepdims=True, initial=0.0)
    count[rows] = (np.real(eigenvalues[rows]) > ZERO_EIGENVALUE * size).sum(axis=1)
    fast, marked = eigenvalues.shape[1], set(rows.tolist())
    segments: list[Segment] = []

    def close(first: int, last: int, unstable: int) -> None:
        kind = "attracting" if unstable == 0 else "repelling" if unstable == fast else "saddle"
        segments.append(Segment(first, last, unstable, kind))

    first, current = 0, -1
    for row in range(len(count)):
        if row in marked:
            continue
        if current >= 0 and count[row] != current:
            # A special point belongs to both runs; without one between them neither reaches the other.
            shared = row - 1 in marked
            close(first, row - 1, current)
            first = row - 1 if shared else row
        current = int(count[row])
    close(first, len(count) - 1, current if current >= 0 else int(count[-1]))
    return count, tuple(segments)


def oriented(tangent: np.ndarray, upright: float, direction: int) -> np.ndarray:
    """The tangent along which the first unknown grows, or the steepest one where it hardly does; or against it."""
    leading = 0 if abs(tangent[0]) > upright else int(np.argmax(np.abs(tangent)))
    return tangent * np.sign(tangent[leading]) * (direction or 1)


def curve_of(
    kind: type[Curve],
    problem: LayerProblem,
    options: Options,
    tracer: PointTracer,
    traces: Sequence[CurveTrace],
    located: tuple[np.ndarray, tuple[SpecialPoint, ...], np.ndarray],
    **own: Any,
) -> Curve:
    """The curve that the traces make once the special points have been `located`: (points, special, arclength).

    `own` are the fields that curves of this `kind` alone have; arrays are frozen.
    """
    points, special, arclength = located
    # What is rounding of a scale is 0.
    rounding = np.finfo(float).eps * tracer.scales
    shown = [np.where(np.abs(p.unknowns) <= rounding, 0.0, p.unknowns) for p in special]
    special = tuple(replace(p, point=problem.point(u)) for p, u in zip(special, shown))
    ends = [(trace.ending, trace.points[-1], trace.bound) for trace in traces]
    counters = tracer.counters
    return kind(
        problem=problem,
        options=options,
        points=frozen(problem.rows(points)),
        arclength=frozen(arclength),
        scales=dict(zip((s.name for s in problem.unknowns), map(float, tracer.scales))),
        special=special,
        stops=tuple(Stop(ending, problem.point(end), bound) for ending, end, bound in ends),
        stats=ContinuationStats(counters.steps, counters.rejected, counters.corrections, counters.located),
        message=say(problem, len(points), ends, special, tracer.scales),
        **{name: frozen(value) if isinstance(value, np.ndarray) else value for name, value in own.items()},
    )


def say(
    problem: LayerProblem,
    count: int,
    stops: Sequence[tuple[Status, np.ndarray, str]],
    special: Sequence[SpecialPoint],
    scales: np.ndarray,
) -> str:
    """The closing message: how many points, how each end ended and where."""
    texts = []
    for ending, u, bound in stops:
        names = [bound] if bound else [s.name for s in problem.unknowns]
        point = problem.point(u)
        sizes = zip(problem.unknowns, u.tolist(), scales.tolist())
        digits = {s.name: digits_between((value, value + size)) for s, value, size in sizes}
        text = f"{ending.name} at {in_words([(name, point[name]) for name in names], more=digits)}"
        if not ending.ok:
            values = problem.eigenvalues(u[None, :])[0]
            if np.isfinite(values).all():
                text += f", fast eigenvalue {values[np.argmin(np.abs(values))].real:.2g}"
            distances = [np.linalg.norm((p.unknowns - u) / scales) for p in special]
            # A stop is said to be close to a special point within this distance, in scaled units.
            if distances and min(distances) < 0.05:
                close = special[int(np.argmin(distances))]
                first = problem.unknowns[0].name
                text += f"; close to the {close.kind} at {in_words([(first, close[first])], more=digits)}"
            text += f" ({ending.meaning}; {REMEDIES.get(ending, ending.remedy)})"
        texts.append(text)
    if len(texts) == 2:
        return f"stopped after {count} points: backward {texts[0]}; forward {texts[1]}"
    return f"stopped after {count} points: {texts[0]}"


def uninterrupted(curve: CriticalCurve) -> CriticalCurve:
    """`curve` for a verb that goes on from it: where Ctrl-C ended it, Ctrl-C ends the verb too."""
    if curve.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return curve
