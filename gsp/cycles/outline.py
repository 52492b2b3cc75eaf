"""Polygons about a singular orbit, found by doubles: nothing here is believed by the proof.

Each slow piece has coordinates (X, Y) = (tau x, J y) in which it moves to the right and its fold throws upwards:
what the orbit surrounds is above. A curve that all orbits cross inwards for every epsilon in (0, epsilon_0] has a
direction outside both of (0, g), the limit, and (epsilon_0 f, g). The outer polygon therefore follows, a share of
the way, the orbits of epsilon_0 while f > 0 and the fast direction where f < 0; the inner one the other way round.
Along an attracting sheet both stay at a small distance from it, or as far away as epsilon_0 asks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gsp.cycles.annulus import Annulus
from gsp.cycles.enclosed_field import EnclosedField
from gsp.singular.singular_orbit import SingularOrbit

Point = tuple[float, float]
# Polygons follow orbits to this share of their slope, edges are accepted with this share to spare.
FOLLOWED, SPARE = 0.9, 0.02
# Points of an edge that are looked at, edges of a polygon, halvings of an edge.
LOOKED, MOST_EDGES, HALVINGS = 33, 3000, 40
SHARES = np.linspace(0.0, 1.0, LOOKED)


class NoOutline(Exception):
    """No polygon was found; the text says where."""


@dataclass(frozen=True)
class Frame:
    """A slow piece in its coordinates: `sheet` (k, 2) from left to right, its `fold`, and its sizes (2,)."""

    slow: float
    fast: float
    sheet: np.ndarray
    fold: np.ndarray
    late: float
    sizes: np.ndarray

    @property
    def signs(self) -> np.ndarray:
        """What multiplies (x, y)."""
        return np.array([self.slow, self.fast])


def frames_of(orbit: SingularOrbit) -> list[Frame]:
    """The frames of the slow pieces of a closed orbit; raises `NoOutline` where they do not surround anything."""
    (x,), (y,) = orbit.branch.system.x, orbit.branch.system.y
    found = []
    for piece in orbit.cycle:
        if piece.fold is None or piece.flight is not None or not piece.fold.drop.lands:
            raise NoOutline("a slow piece ends otherwise than at a fold with a drop")
        fold = np.array([piece.fold.point[x.name], piece.fold.point[y.name]])
        lands = np.array([piece.fold.drop.point[x.name], piece.fold.drop.point[y.name]])
        run = np.column_stack([piece.run[x.name], piece.run[y.name]])
        slow, fast = np.sign(fold[0] - run[0, 0]), np.sign(lands[1] - fold[1])
        signs = np.array([slow, fast])
        sizes = np.array([abs(fold[0] - run[0, 0]), abs(lands[1] - fold[1])])
        late = abs(float(piece.fold.leading[0]))
        found.append(Frame(float(slow), float(fast), run * signs, fold * signs, late, sizes))
    if any(one.fast == two.fast for one, two in zip(found, [*found[1:], found[0]])):
        raise NoOutline("two drops follow one another in the same direction")
    return found


class Outliner:
    """Polygons for `epsilon` about the orbit with these frames."""

    def __init__(self, field: EnclosedField, frames: Sequence[Frame], epsilon: float) -> None:
        self.field, self.frames, self.epsilon = field, frames, epsilon
        # Where the rates depend on epsilon an edge is to fit both ends.
        self.values = (epsilon, 0.0) if field.depends_on_epsilon else (epsilon,)
        # How much later than in the limit the folds are left, as a share of the pieces: the size of the annulus.
        share = min(0.05, *(f.late * epsilon ** (2.0 / 3.0) / f.sizes[0] for f in frames))
        self.distance = 0.4 * share
        self.delays = [min(f.late * epsilon ** (2.0 / 3.0), float(f.sizes[0])) for f in frames]
        # How far before the folds the inner polygon leaves the sheets: where the repelling one is not yet near f = 0.
        self.before = [min(0.2 * share * f.sizes[0], self._room(f)) for f in frames]

    def annulus(self) -> Annulus:
        """The annulus, with its cuts; raises `NoOutline`."""
        outer, inner = self._closed(outer=True), self._closed(outer=False)
        polygons = [outer, inner]
        for k, frame in enumerate(self.frames):
            for level in self._levels(frame, *(p.jump(k) for p in polygons)):
                polygons = [p.cut(k, level * frame.fast, frame.fast) for p in polygons]
        return _assembled(*polygons, flip=self.frames[0].slow * self.frames[0].fast < 0.0)

    # -- once round --------------------------------------------------------------------------------

    def _closed(self, *, outer: bool) -> Outline:
        first = self.frames[0]
        begin = float(first.fold[0] - 0.5 * first.sizes[0])
        side = -1.0 if outer else 1.0
        more = 0.1 * self.distance * first.sizes[1]
        y = self._offset(0, begin, side) + side * more
        for _ in range(4):
            outline = self._turn((begin, y), side)
            end = outline.points[-1][1] * first.fast
            if side * (y - end) > 0.0:
                return outline
            y = end + side * more
        raise NoOutline("the polygon does not close")

    def _turn(self, start: Point, side: float) -> Outline:
        outline = Outline([])
        point = outline.follow(iter([start]), self.frames[0])
        for k in range(len(self.frames)):
            outline.begins.append(len(outline.points) - 1)
            point = outline.follow(self._along(k, point, side, None), self.frames[k])
            outline.jumps.append(len(outline.points) - 1)
            x, y = outline.follow(self._across(k, point, side), self.frames[k])
            # The next piece is turned by half a turn.
            point = -x, -y
        outline.follow(self._along(0, point, side, start[0]), self.frames[0])
        return outline

    def _along(self, k: int, start: Point, side: float, last: float | None) -> Iterator[Point]:
        """Along the sheet to X = `last`; unless that is given, to the fold and, outside, past it."""
        frame = self.frames[k]
        end = last
        if end is None and side > 0.0:
            end = float(frame.fold[0] - 1.01 * self.before[k])
        point, h = start, frame.sizes[0] / 32.0
        if end is not None and point[0] >= end:
            raise NoOutline("a drop lands behind the next fold")

        def ahead(h: float) -> Point | None:
            x, y = point
            if side < 0.0:
                # Past the fold the slope grows as fast as the square of Y: short steps follow it.
                h = min(h, max(self.delays[k] / 8.0, frame.fold[0] - self.delays[k] - x))
            to = x + h if end is None else min(x + h, end)
            h = to - x
            values = self._at(frame, np.column_stack([x + SHARES * h, np.full(LOOKED, y)]))
            with np.errstate(all="ignore"):
                slopes = FOLLOWED * values[1] / (self.epsilon * values[0])
            # Where the line at Y leaves the sheet's side its slope says nothing.
            followed = y + h * float(min(slopes.max(), 0.0) if side > 0.0 else max(slopes.min(), 0.0))
            beside = self._offset(k, to, side)
            return to, (max(followed, beside) if side > 0.0 else min(followed, beside))

        for _ in range(MOST_EDGES):
            if side < 0.0 and end is None:
                f, g = self._at(frame, [point])[:2, 0]
                steep = g * frame.sizes[0] > self.epsilon * f * frame.sizes[1]
                if point[1] >= frame.fold[1] or (steep and point[0] > frame.fold[0]):
                    return
            point, h = self._step(frame, point, ahead, h, side)
            h = min(h, frame.sizes[0] / 8.0)
            yield point
            if end is not None and point[0] >= end:
                return
        raise NoOutline(f"more than {MOST_EDGES} edges")

    def _across(self, k: int, start: Point, side: float, level: float = np.inf) -> Iterator[Point]:
        """From the fold to the next sheet, or to Y = `level`, by steps of Y."""
        frame, after = self.frames[k], self.frames[(k + 1) % len(self.frames)]
        point, h = start, frame.sizes[1] / 32.0
        # Near the fold orbits turn up within a height that goes with the root of the delay.
        least = frame.sizes[1] * min(1.0 / 256.0, (self.delays[k] / frame.sizes[0]) ** 0.5 / 64.0)

        def up(h: float) -> Point | None:
            x, y = point
            h = min(h, level - y)
            values = self._at(frame, np.column_stack([np.full(LOOKED, x), y + SHARES * h]))
            with np.errstate(all="ignore"):
                slow = np.where(side * values[0] < 0.0, self.epsilon * values[0] / (FOLLOWED * values[1]), 0.0)
            if not np.isfinite(slow).all() or (values[1][slow != 0.0] <= 0.0).any():
                return None
            # The steepest part of an edge decides: it is not to be much steeper than the mean where that is seen, in a
            # slope that moves a jump by a twentieth of its delay.
            steepest = np.abs(slow).max()
            if steepest > max(1.3 * np.abs(slow).mean(), 0.05 * self.delays[k] / frame.sizes[1]) and h > least:
                return None
            return x + h * float(slow[np.abs(slow).argmax()]), level if h == level - y else y + h

        for _ in range(MOST_EDGES):
            if side < 0.0 and np.isinf(level):
                beyond = -self._offset((k + 1) % len(self.frames), -point[0], side)
                if self._fits(frame, point, (point[0], beyond), side):
                    yield point[0], beyond
                    return
            before = point
            point, h = self._step(frame, point, up, h, side)
            h = min(h, frame.sizes[1] / 8.0)
            yield point
            if point[1] >= level:
                return
            flat = abs(point[0] - before[0]) * frame.sizes[1] > (point[1] - before[1]) * frame.sizes[0]
            if np.isfinite(level):
                continue
            if side > 0.0 and (flat or self._arrived(k, point)):
                return
            if point[1] > -after.fold[1] + 4.0 * frame.sizes[1]:
                raise NoOutline("a jump meets no sheet")
        raise NoOutline(f"more than {MOST_EDGES} edges")

    def _arrived(self, k: int, point: Point) -> bool:
        """Whether a jump has come as near to the next sheet as the polygon stays to it."""
        if not self._at(self.frames[k], [point])[0, 0] < 0.0:
            return False
        try:
            return -point[1] <= self._offset((k + 1) % len(self.frames), -point[0], 1.0)
        except NoOutline:
            return False

    def _step(
        self, frame: Frame, point: Point, ahead: Callable[[float], Point | None], h: float, side: float
    ) -> tuple[Point, float]:
        """The next vertex, as far as an edge fits, and how far to try then."""
        for halved in range(HALVINGS):
            to = ahead(h)
            if to is not None and self._fits(frame, point, to, side):
                return to, h * (1.0 if halved else 2.0)
            h *= 0.5
        raise NoOutline(f"no edge goes on from {tuple(float(v) for v in np.array(point) * frame.signs)}")

    def _fits(self, frame: Frame, one: Point, two: Point, side: float) -> bool:
        """Whether orbits cross the edge as they should, at its points that are looked at."""
        a, b = np.array(one), np.array(two)
        if not np.isfinite(b).all() or not (np.abs(b - a) < 9.0 * frame.sizes).all():
            return False
        f, g, h = self._parts(frame, a + SHARES[:, None] * (b - a))
        limit = -side * (b[0] - a[0]) * g
        slow = side * self.epsilon * ((b[1] - a[1]) * f - (b[0] - a[0]) * h)
        total = limit + slow
        return bool((total > SPARE * (np.abs(limit) + np.abs(slow))).all() and (limit >= 0.0).all())

    def _at(self, frame: Frame, points: Sequence | np.ndarray) -> np.ndarray:
        """f and g in the frame's coordinates, at all points for one epsilon and then for the other."""
        z = np.asarray(points) * frame.signs
        found = [self.field.nearby(z, small)[:2] for small in self.values]
        return np.concatenate(found, axis=1) * frame.signs[:, None]

    def _parts(self, frame: Frame, points: np.ndarray) -> np.ndarray:
        """f, g and h in the frame's coordinates, at all points for one epsilon and then for the other."""
        found = [self.field.nearby(points * frame.signs, small)[[0, 7, 8]] for small in self.values]
        return np.concatenate(found, axis=1) * np.array([frame.slow, frame.fast, frame.fast])[:, None]

    def _offset(self, k: int, x: float, side: float) -> float:
        """Y at a small distance from the sheet over X: below it (-1) or above (1); past the fold it is infinite."""
        frame = self.frames[k]
        if x > frame.fold[0] - self.before[k]:
            return np.inf
        found = []
        for small in self.values:
            y, (f, _, _, _, g_x, slope, bend, *_) = self._sheet(frame, x, small)
            distance = self.distance * frame.sizes[1]
            # Orbits come back to the sheet on such a way: edges that followed them would be no longer.
            way = small * abs(f / slope)
            if way * MOST_EDGES < frame.sizes[0]:
                # So far orbits lag behind a sheet that goes away from them.
                rise = -g_x / slope * frame.slow * frame.fast
                distance = max(distance, -side * rise * way / FOLLOWED**2)
            if bend != 0.0:
                # g_y has another value as far away as slope/bend: half way to the repelling sheet it is zero.
                distance = min(distance, 0.3 * abs(slope / bend))
            found.append(y + side * distance)
        return max(found) if side > 0.0 else min(found)

    def _sheet(self, frame: Frame, x: float, epsilon: float) -> tuple[float, list[float]]:
        """Y of the sheet over X, by Newton's method from the orbit, and the field's values and slopes there."""
        at = frame.sheet[:, 0]
        y = float(np.interp(x, at, frame.sheet[:, 1]))
        for _ in range(60):
            values = self.field.nearby([np.array([x, y]) * frame.signs], epsilon)[:, 0]
            g, slope = values[1] * frame.fast, values[5]
            # The repelling sheet is above.
            step = -g / slope if slope < 0.0 else -frame.sizes[1]
            most = 0.05 * float(frame.sizes[1])
            step = min(max(float(step), -most), most)
            y += step
            # What is left is the square of that.
            if abs(step) <= 1e-8 * frame.sizes[1]:
                return y, values.tolist()
        raise NoOutline(f"no attracting sheet over {x * frame.slow:.6g}")

    def _room(self, frame: Frame) -> float:
        """How far before the fold the repelling sheet has gone a quarter of the way on which f > 0 beyond the fold."""
        way = self.way_up(frame)
        if not way > 0.0:
            raise NoOutline("the slow rate changes its sign at a fold")
        values = self.field.nearby([frame.fold * frame.signs], self.epsilon)[:, 0]
        return float(abs(values[6] / (2.0 * values[4])) * (0.25 * way) ** 2)

    def way_up(self, frame: Frame) -> float:
        """How far above the fold the slow rate turns; the whole jump where it does not before."""
        line = frame.fold + np.linspace(0.0, 1.0, 1025)[:, None] * [0.0, frame.sizes[1]]
        f = self._at(frame, line)[0, : len(line)]
        return float(line[int(np.argmax(f < 0.0)) if (f < 0.0).any() else -1, 1] - frame.fold[1])

    # -- cuts --------------------------------------------------------------------------------------

    def _levels(self, frame: Frame, outer: np.ndarray, inner: np.ndarray) -> tuple[float, float]:
        """Y of the two cuts across a jump: f > 0 up to the first, f < 0 from the second on, and g > 0 between."""
        first, second, repelled = [], [], [float(frame.fold[1])]
        for points in (outer, inner):
            mine = _refined(points * frame.signs)
            values = self._at(frame, mine)
            for f, g in np.split(values, len(self.values), axis=1):
                change = int(np.argmax(f < 0.0))
                first.append(mine[:change, 1].max(initial=-np.inf))
                second.append(mine[change:, 1].min())
                repelled += mine[:change, 1][g[:change] <= 0.0].tolist()
        lands = frame.fold[1] + frame.sizes[1]
        fold, low, high = max(repelled), min(first), max(second)
        if not fold < low <= high < lands:
            raise NoOutline("no room for cuts")
        return self._best_levels(frame, (outer * frame.signs, inner * frame.signs), (fold, low, high, lands))

    def _best_levels(
        self, frame: Frame, lines: tuple[np.ndarray, np.ndarray], ends: tuple[float, float, float, float]
    ) -> tuple[float, float]:
        """Levels between the first two and between the last two `ends`, where bounds of the divergence are least: it
        is bounded by the rate f outside them, over the whole width of the annulus, and by g between them.
        """
        fold, low, high, lands = ends
        # Away from the zeros of f and g, which strips of some width must not meet.
        shares = np.linspace(0.2, 0.8, 32)
        y = np.concatenate([fold + shares * (low - fold), high + shares * (lands - high)])
        x = [np.interp(y, np.maximum.accumulate(line[:, 1]), line[:, 0]) for line in lines]
        width = np.abs(x[0] - x[1])
        points = [np.column_stack([x[0] + share * (x[1] - x[0]), y]) for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
        found = np.stack([self.field.nearby(line * frame.signs, self.epsilon) for line in points], axis=2)
        f, g, f_x, g_y = found[0], found[1] * frame.fast, found[2], found[5]
        # The time counts a little too.
        weight = np.maximum(g_y + self.epsilon * f_x, 0.0) + 0.05 * np.abs(g_y[-1]).max()
        with np.errstate(all="ignore"):
            by_f = (weight / np.abs(f)).max(axis=1)
            by_g = np.where(g > 0.0, self.epsilon * weight / g, np.inf).max(axis=1)
        steps = np.diff(y, append=lands)
        before = width[:32] * np.maximum.accumulate(by_f[:32]) + np.cumsum((by_g * steps)[:32][::-1])[::-1]
        after = width[32:] * np.maximum.accumulate(by_f[32:][::-1])[::-1] + np.cumsum((by_g * steps)[32:])
        if not (np.isfinite(before).any() and np.isfinite(after).any()):
            raise NoOutline("no room for cuts")
        return float(y[int(np.nanargmin(before))]), float(y[32 + int(np.nanargmin(after))])


def _refined(points: np.ndarray) -> np.ndarray:
    """The vertices of a line with 15 points more on every edge."""
    shares = np.arange(16)[:, None] / 16.0
    return np.vstack([*(a + shares * (b - a) for a, b in pairwise(points)), points[-1]])


class Outline:
    """A polygon as it is traced: vertices (x, y), where pieces and jumps begin, and which vertices are on cuts."""

    def __init__(self, points: list[Point]) -> None:
        self.points = points
        self.begins: list[int] = []
        self.jumps: list[int] = []
        self.cuts: list[int] = []

    def follow(self, points: Iterator[Point], frame: Frame) -> Point:
        """Add vertices in the coordinates of a frame; returns the last."""
        last = (0.0, 0.0)
        for last in points:
            self.points.append((last[0] * frame.slow, last[1] * frame.fast))
        return last

    def jump(self, k: int) -> np.ndarray:
        """The vertices from where a jump begins to where the next one does, or the end."""
        ends = [*self.jumps, len(self.points) - 1]
        return np.array(self.points[ends[k] : ends[k + 1] + 1])

    def cut(self, k: int, level: float, up: float) -> Outline:
        """With a vertex where piece `k` or its jump first passes y = `level`, going up (1) or down (-1)."""
        for i in range(self.begins[k], len(self.points) - 1):
            (x, y), (u, v) = self.points[i], self.points[i + 1]
            if up * (y - level) <= 0.0 < up * (v - level):
                at = u if x == u else x + (level - y) / (v - y) * (u - x)
                new = Outline([*self.points[: i + 1], (at, level), *self.points[i + 1 :]])
                new.begins, new.jumps = ([j + (j > i) for j in places] for places in (self.begins, self.jumps))
                new.cuts = [*self.cuts, i + 1]
                return new
        raise NoOutline("a cut misses the polygon")


def _assembled(outer: Outline, inner: Outline, *, flip: bool) -> Annulus:
    """Counterclockwise, each vertex once, with the cuts in the order of the outer polygon."""
    polygons, places = [], []
    for one in (outer, inner):
        points = np.array(one.points)
        new = np.concatenate([[True], (points[1:] != points[:-1]).any(axis=1)])
        at = np.cumsum(new)[one.cuts] - 1
        points = points[new]
        polygons.append(points[::-1] if flip else points)
        places.append((len(points) - 1 - at)[::-1] if flip else at)
    (first, *others) = [(int(o), int(i)) for o, i in zip(*places)]
    # The first sector is a slow one.
    return Annulus(polygons[0], polygons[1], (*others, first))
