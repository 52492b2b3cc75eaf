"""Strips about passages through a loss of hyperbolicity, found by doubles: nothing here is believed by the proof.

Coordinates are those of a frame: X moves to the right, and Y points to where orbits go. At a fold both lines are traced
as those about a cycle are. Where two branches meet at (0, 0), V is the distance from the one along which orbits come:

    epsilon V' = V (kappa X + q V + p V^2 + ...) + epsilon rho,    rho > 0.

The lower line is V = m X near (0, 0), 0 < m < rho/f: g is positive beside it on both sides, and at (0, 0) epsilon rho
alone drives orbits up, steeper than the line. The upper one stays above the attracting sheets, or, where none goes on,
turns up before (0, 0).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gsp.cycles.annulus import Strip
from gsp.cycles.enclosed_field import EnclosedField
from gsp.cycles.outline import HALVINGS, Frame, NoOutline, Outline, Outliner, Point
from gsp.cycles.outline import SHARES as LOOKED_AT

# Places X along a line on either side of (0, 0), each so many times nearer to it than the one before.
NEARER = 0.75
# Rates beside a sheet are so many times what is needed against the drift. Distances go so many powers of two down from
# the strip's reach, and up, by steps.
SURPLUS, POWERS = 2.0, np.arange(-60.0, 4.0, 0.25)
# An edge that does not fit is tried so much flatter.
SHARES = (0.0, 0.25, 0.5, 0.75, 0.875)


def fold_strip(field: EnclosedField, frame: Frame, epsilon: float) -> Strip:
    """From the beginning of the frame's sheet to half way up the jump; raises `NoOutline`."""
    outliner = Outliner(field, [frame], epsilon)
    begin = float(frame.sheet[0, 0])
    # Half way up the jump, or up to where the slow rate turns if that comes first.
    level = float(frame.fold[1]) + 0.5 * outliner.way_up(frame)
    lines = []
    for side in (-1.0, 1.0):
        outline = Outline([])
        point = outline.follow(iter([(begin, outliner._offset(0, begin, side))]), frame)
        outline.begins.append(0)
        point = outline.follow(outliner._along(0, point, side, None), frame)
        outline.jumps.append(len(outline.points) - 1)
        outline.follow(outliner._across(0, point, side, level), frame)
        lines.append(outline)
    # A cut is above where the line that goes first leaves the repelling sheet: it is tried at these shares of the jump.
    for share in (0.5, 0.75, 0.875):
        found = _assembled(frame, lines, float(frame.fold[1]) + share * (level - float(frame.fold[1])))
        ends = [line[place] * frame.signs for line, place in zip((found.outer, found.inner), found.cuts[1])]
        along = ends[0] + LOOKED_AT[:, None] * (ends[1] - ends[0])
        if (outliner._parts(frame, along)[1] > 0.0).all():
            return found
    raise NoOutline("the repelling sheet is in the way of every cut")


def _assembled(frame: Frame, lines: list[Outline], *levels: float, cornered: bool = False) -> Strip:
    """A strip between a lower and an upper line, with cuts at levels of Y."""
    for level in levels:
        lines = [line.cut(0, level * frame.fast, frame.fast) for line in lines]
    return strip_between(frame, lines, cornered=cornered)


def strip_between(
    frame: Frame, lines: list[Outline], *, slow_first: bool = True, cornered: bool = False
) -> Strip:
    """A strip between a lower and an upper line with their cuts, and those that join their ends."""
    cuts = [
        (0, 0), *zip(*(line.cuts for line in lines)), (len(lines[0].points) - 1, len(lines[1].points) - 1)
    ]  # fmt: skip
    lower, upper = (np.array(line.points) for line in lines)
    # Turned over, it is the upper line that has the strip on its left.
    if frame.slow * frame.fast < 0.0:
        lower, upper, cuts = upper, lower, [cut[::-1] for cut in cuts]
    return Strip(lower, upper, tuple((int(o), int(i)) for o, i in cuts), slow_first, cornered)


@dataclass(frozen=True)
class Crossing:
    """What is known of the point where branches meet: `along` gives Y of the one that orbits come along over X (k,),
    m = `slope`, `steepness` is kappa/f, the strip goes `reach` to either side, and orbits go on along another sheet
    unless they `escape`.
    """

    frame: Frame
    along: Callable[[np.ndarray], np.ndarray]
    slope: float
    steepness: float
    reach: float
    escapes: bool


class CrossingOutliner(Outliner):
    """Strips through a point where branches meet."""

    def __init__(self, field: EnclosedField, crossing: Crossing, epsilon: float) -> None:
        self.field, self.frames, self.epsilon = field, [crossing.frame], epsilon
        self.values = (epsilon, 0.0) if field.depends_on_epsilon else (epsilon,)
        self.crossing, self.frame = crossing, crossing.frame
        turn = float(np.sqrt(epsilon / crossing.steepness))
        self.delays = [min(turn, crossing.reach)]
        # The last place is at this share of the scale (epsilon f/kappa)^(1/2).
        last = 0.25 * turn / crossing.reach
        count = 2 + max(0, int(np.ceil(np.log(last) / np.log(NEARER))))
        near = crossing.reach * NEARER ** np.arange(count)
        self.left = self._divided((-near).tolist(), lambda x: 0.0)
        self.right = near[::-1].tolist()
        if not crossing.escapes:
            self.right = self._divided(self.right, lambda x: self._zero(x, 1.0))

    def _divided(self, places: list[float], sheet: Callable[[float], float]) -> list[float]:
        """Places X with more between them, so that chords of a sheet stay near to it."""

        def over(x: float) -> float:
            return float(self.crossing.along(np.array([x]))[0]) + sheet(x)

        found = places[:1]
        for one, two in pairwise(places):
            parts = 1
            # A piece of a line is divided into so many at most.
            while parts < 256:
                x = one + (two - one) / parts * np.array([0.0, 0.5, 1.0])
                a, b, c = (over(v) for v in x.tolist())
                near = min(
                    self._distance(float(x[1]), sheet(float(x[1])), 1.0), self.crossing.slope * abs(x[1])
                )
                if not abs(b - 0.5 * (a + c)) > 0.25 * near:
                    break
                parts *= 2
            found += np.linspace(one, two, parts + 1)[1:].tolist()
        return found

    def strip(self) -> Strip:
        """The strip with its cuts; raises `NoOutline`."""
        if self.crossing.escapes:
            level = self._zero(self.left[0], 1.0)
            if not np.isfinite(level):
                raise NoOutline("no repelling sheet bounds what comes in")
            lines = self._escape(level)
            levels = (0.5 * level,)
        else:
            lines, levels = self._exchange(), ()
        found = []
        for side, points in zip((-1.0, 1.0), lines):
            outline = Outline([])
            outline.begins.append(0)
            outline.follow(self._joined(points, side), self.frame)
            found.append(outline)
        return _assembled(self.frame, found, *levels, cornered=True)

    def _comes_in(self) -> list[Point]:
        """The lower line (X, V) up to (0, 0)."""
        m, points = self.crossing.slope, []
        for x in self.left:
            below = self._zero(x, -1.0)
            points.append((x, -min(m * abs(x), 0.5 * below, self._distance(x, 0.0, 1.0))))
        return [*points, (0.0, 0.0)]

    def _exchange(self) -> tuple[list[Point], list[Point]]:
        m = self.crossing.slope
        lower = self._comes_in()
        upper = [(x, self._distance(x, 0.0, 1.0)) for x in self.left]
        before = 0.0
        for x in self.right:
            sheet = self._zero(x, 1.0)
            rising = max(sheet - before, 0.0) / (x - lower[-1][0])
            line = min(m * x, 0.5 * sheet)
            near = sheet - self._distance(x, sheet, -1.0, rising)
            lower.append((x, self._risen(lower[-1], x, line, max(line, near))))
            upper.append((x, sheet + self._distance(x, sheet, 1.0)))
            before = sheet
        if not np.isfinite([v for _, v in upper]).all():
            raise NoOutline("no sheet attracts beside where the branches meet")
        return self._in_y(lower), self._stepped(self._in_y(upper))

    def _stepped(self, points: list[Point]) -> list[Point]:
        """An upper line over these points: up along the fast direction, then over, for a chord could cut the sheet; and
        down as far as an edge goes.
        """
        line = points[:1]
        for x, y in points[1:]:
            before = line[-1]
            if y > before[1]:
                line += [(before[0], y), (x, y)]
                continue
            ends = [(x, y + share * (before[1] - y)) for share in SHARES]
            line.append(next((end for end in ends if self._fits(self.frame, before, end, 1.0)), (x, before[1])))
        return line

    def _risen(self, before: Point, x: float, least: float, most: float) -> float:
        """The largest V over X up to which an edge of the lower line goes."""
        (start,) = self._in_y([before])
        # From (0, 0) the line itself: there it may not be steeper.
        for share in () if before[0] == 0.0 else SHARES:
            v = most + share * (least - most)
            if self._fits(self.frame, start, self._in_y([(x, v)])[0], -1.0):
                return v
        return least

    def _escape(self, level: float) -> tuple[list[Point], list[Point]]:
        m = self.crossing.slope
        start = next((x for x in self.right if self._is_steep(x, m * x)), None)
        if start is None:
            raise NoOutline("orbits do not rise from where the branches meet")
        lower = self._in_y([*self._comes_in(), *((x, m * x) for x in self.right if x <= start)])
        lower += self._across(0, lower[-1], -1.0, level)
        upper: list[Point] = []
        for x in self.left:
            (point,) = self._in_y([(x, min(self._distance(x, 0.0, 1.0), 0.5 * self._zero(x, 1.0)))])
            if upper and not self._fits(self.frame, upper[-1], point, 1.0):
                break
            upper.append(point)
        return lower, [*upper, (upper[-1][0], level)]

    def _is_steep(self, x: float, v: float) -> bool:
        """Whether orbits rise more steeply than the lower line."""
        f, g = self._at(self.frame, self._in_y([(x, v)]))[:2]
        return bool((g > SURPLUS * self.crossing.slope * self.epsilon * f).all())

    def _distance(self, x: float, sheet: float, way: float, rising: float = 0.0) -> float:
        """How far above (1) or below (-1) V = `sheet` the fast rate outdoes epsilon times the drift towards there; the
        line that is followed is steeper than the branch by `rising`. Infinite where it does nowhere.
        """
        step = self.crossing.reach * 2.0 ** float(POWERS[0])
        y, ahead = self.crossing.along(np.array([x, x + step]))
        slope = rising + (ahead - y) / step
        distances = self.crossing.slope * self.crossing.reach * 2.0**POWERS
        f, g, h = self._parts(
            self.frame, np.column_stack([np.full(len(POWERS), x), y + sheet + way * distances])
        )
        drift = np.maximum(way * (h - slope * f), 0.0) + np.abs(h)
        serves = (-way * g > SURPLUS * self.epsilon * drift).reshape(len(self.values), -1).all(axis=0)
        return float(distances[int(np.argmax(serves))]) if serves.any() else np.inf

    def _in_y(self, points: list[Point]) -> list[Point]:
        """From (X, V) to (X, Y)."""
        x = np.array([p[0] for p in points])
        y = self.crossing.along(x)
        return [(float(a), float(b + p[1]) if a or p[1] else 0.0) for a, b, p in zip(x, y, points)]

    def _zero(self, x: float, way: float) -> float:
        """How far from V = 0 in a direction g changes its sign first; infinite where it is not seen to."""
        distances = self.crossing.slope * abs(x) * 2.0 ** (0.4 * POWERS + 10.0)
        y = float(self.crossing.along(np.array([x]))[0])

        def g(v: np.ndarray) -> np.ndarray:
            points = np.column_stack([np.full(len(v), x), y + way * v])
            return self._parts(self.frame, points)[1, : len(v)]

        signs = np.sign(g(distances))
        change = np.flatnonzero(signs != signs[0])
        if not change.size:
            return np.inf
        low, high = distances[change[0] - 1], distances[change[0]]
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if np.sign(g(np.array([middle]))[0]) == signs[0] else (low, middle)
        return float(high)

    def _joined(self, points: list[Point], side: float) -> Iterator[Point]:
        """The points, where edges between them fit."""
        yield points[0]
        for one, two in pairwise(points):
            if (0.0, 0.0) not in (one, two) and not self._fits(self.frame, one, two, side):
                where = tuple(float(v) for v in np.array(one) * self.frame.signs)
                raise NoOutline(f"no edge goes on from {where}, from where the branches meet")
            yield two
