"""The part of checkers that annuli and strips share: their lines, edges and sectors, in whole numbers.

Nothing of the prover is used. Conditions are those of theorems 7 to 10 of docs/proofs.md.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator
from contextlib import suppress
from fractions import Fraction
from itertools import pairwise
from typing import Any

from gsp.proofs import intervals as ia
from gsp.proofs import untrusted
from gsp.proofs.intervals import Interval
from gsp.proofs.programs import IntervalProgram, Rejected

# Bounds: vertices of a line, bits of a coordinate, strips, halvings, and operations on intervals in all.
MOST_VERTICES, MOST_BITS, MOST_STRIPS = 10_000, 256, 5000
DEEPEST, HALVINGS, CLOSER, MOST_OPERATIONS = 20, 9, 5, 60_000_000
# To see whether two edges meet, or where an edge is over a strip, takes as long as so many operations on intervals.
MEETING = 8
Vertex = tuple[int, int]
Segment = tuple[int, int]
Cut = tuple[int, int]


def program_of(names: Any, rates: Any) -> tuple[tuple[str, ...], IntervalProgram]:
    """The names of x, y and epsilon, and the rates f, g and h of x' = f, epsilon y' = g + epsilon h."""
    found = untrusted.names(names)
    if len(found) != 3 or not isinstance(rates, list) or len(rates) != 3:
        raise Rejected("a slow and a fast variable and epsilon have names, and there are three rates")
    return found, IntervalProgram(tuple(rates), 3)


class BandChecker:
    """What is claimed of a band: `outer` has it on the left and `inner` on the right; coordinates are whole, in units
    of 1/`scale`. `slow_first` says whether it is f that keeps its sign in the first sector.
    """

    slow_first = True

    def __init__(self, read: Any, program: IntervalProgram) -> None:
        self.program = program
        self.epsilon = untrusted.number(read["epsilon"])
        if not self.epsilon > 0:
            raise Rejected("epsilon is positive")
        self.small: Interval = (0, ia.of(self.epsilon)[1])
        polygons = [untrusted.numbers(read[key], _even(read[key])) for key in ("outer", "inner")]
        most = max(v.denominator for row in polygons for v in row)
        if max(most, *(abs(v.numerator) for row in polygons for v in row)).bit_length() > MOST_BITS:
            raise Rejected(f"a coordinate has more than {MOST_BITS} bits")
        # Coordinates in units of 1/scale are whole.
        self.scale = most
        whole = [[int(v * most) for v in row] for row in polygons]
        self.outer, self.inner = (list(zip(row[::2], row[1::2])) for row in whole)
        cuts = read["cuts"]
        if not isinstance(cuts, list) or len(cuts) < 2:
            raise Rejected("the cuts are pairs, two at least")
        ends = (len(self.outer) - 1, len(self.inner) - 1)
        self.cuts = [(untrusted.count(o, ends[0]), untrusted.count(i, ends[1])) for o, i in cuts]
        self.strips = untrusted.count(read["strips"], MOST_STRIPS)
        self.contraction = untrusted.number(read["contraction"])
        self.period = untrusted.numbers(read["period"], 2)
        if not self.strips:
            raise Rejected("sectors have strips")
        if not isinstance(read["grids"], list) or len(read["grids"]) != len(self.sides):
            raise Rejected("each sector has its grid")
        self.grids = [
            [v * most for v in untrusted.numbers(row, min(len(row), MOST_STRIPS))] for row in read["grids"]
        ]

    @property
    def sides(self) -> list[tuple[Cut, Cut]]:
        """The two cuts of each sector."""
        raise NotImplementedError

    def is_slow(self, k: int) -> bool:
        """Whether it is f that keeps its sign in a sector."""
        return (k % 2 == 0) == self.slow_first

    def sector(self, k: int) -> list[Vertex]:
        """The polygon between two cuts."""
        (o, i), (p, j) = self.sides[k]
        return _chain(self.outer, o, p) + _chain(self.inner, i, j)[::-1]

    def require_apart(self, segments: list[Segment]) -> None:
        """No two segments between vertices of the two lines meet, but where they share an end."""
        points = self.outer + self.inner
        going: list[Segment] = []
        for one in sorted(segments, key=lambda s: min(points[s[0]][0], points[s[1]][0])):
            left = min(points[one[0]][0], points[one[1]][0])
            going = [s for s in going if max(points[s[0]][0], points[s[1]][0]) >= left]
            self.program.spend(MEETING * len(going), MOST_OPERATIONS)
            if any(_meet(points, one, two) for two in going):
                raise Rejected("two edges or cuts meet")
            going.append(one)

    # -- edges -------------------------------------------------------------------------------------

    def require_crossed(self, one: Vertex, two: Vertex, side: int) -> None:
        """Orbits go to the left (1) or to the right (-1) of an edge: with limit = dx g and slow = dx h - dy f,
        limit >= 0 and limit + epsilon_0 slow > 0.
        """
        dx, dy = two[0] - one[0], two[1] - one[1]
        a = self._real(side * dx), self._real(-side * dy)
        way = self._real(dx), self._real(dy)
        last = ia.of(self.epsilon)

        def turns(box: list[Interval], middle: list[Interval], half: Interval) -> bool:
            values, slopes = self._over(box)
            about = self.program.values(middle)
            rises = [ia.multiply(_along(row, way), half) for row in slopes]
            # Enclosures on the piece, at once and from its middle.
            f, g, h = (ia.common(v, ia.add(m, r)) for v, m, r in zip(values, about, rises))
            limit = ia.multiply(a[0], g)
            total = ia.add(limit, ia.multiply(last, _slow(a, f, h)))
            # From the middle f, g and h move together.
            turned = [
                ia.add(ia.multiply(a[0], by_g), ia.multiply(last, _slow(a, by_f, by_h)))
                for by_f, by_g, by_h in zip(*slopes)
            ]
            sharper = ia.add(ia.multiply(a[0], about[1]), ia.multiply(last, _slow(a, about[0], about[2])))
            sharper = ia.add(sharper, ia.multiply(_along(turned, way), half))
            return limit[0] >= 0 and max(total[0], sharper[0]) > 0

        self.require_pieces(one, two, turns)

    def require_pieces(
        self, one: Vertex, two: Vertex, holds: Callable[[list[Interval], list[Interval], Interval], bool]
    ) -> None:
        """Something `holds` on pieces that make up an edge: of each its box, its middle and half its share."""
        pieces = [(0, 0)]
        while pieces:
            depth, place = pieces.pop()
            parts = 1 << depth
            ends = [
                tuple(Fraction(v, parts) * (q - p) + p for p, q in zip(one, two)) for v in (place, place + 1)
            ]
            box = [ia.hull(self._real(p), self._real(q)) for p, q in zip(*ends)]
            middle = [self._real((p + q) / 2) for p, q in zip(*ends)]
            half = (-(ia.ONE >> (depth + 1)), ia.ONE >> (depth + 1))
            if holds([*box, self.small], [*middle, self.small], half):
                continue
            if depth >= DEEPEST:
                raise Rejected(f"orbits do not cross the edge at {self._shown(one)} as they should")
            pieces += [(depth + 1, 2 * place), (depth + 1, 2 * place + 1)]

    # -- sectors -----------------------------------------------------------------------------------

    def turn(self) -> tuple[Fraction, Fraction, Fraction]:
        """Bounds of the period from below and above, and of the integral from above, in all sectors."""
        least = most = contraction = 0
        for k, cuts in enumerate(self.sides):
            polygon = self.sector(k)
            axis = 0 if self.is_slow(k) else 1
            ends = [sorted((self.outer[o][0], self.inner[i][0])) for o, i in cuts]
            signs = set()
            for left, right, row in self._strips(polygon, axis, self.grids[k]):
                bottom, top = min(v for _, v in row), max(v for _, v in row)
                across = [p[1 - axis] for p in polygon]
                count = max(1, math.ceil((top - bottom) * self.strips / (max(across) - min(across))))
                lines = [bottom + (top - bottom) * Fraction(i, count) for i in range(count + 1)]
                found = [part for a, b in pairwise(lines) for part in self._bounds(axis, left, right, a, b)]
                signs |= {sign for sign, _, _ in found}
                width = self._real(right - left)
                share = max(d[1] for _, _, d in found)
                time = ia.multiply(width, (min(r[0] for _, r, _ in found), max(r[1] for _, r, _ in found)))
                # In fast sectors the time is epsilon times the integral over y.
                times = self.small[1] if axis else ia.ONE
                if not axis and any(a[1] <= left and right <= b[0] for a, b in (ends, ends[::-1])):
                    with suppress(ia.OutOfDomain):
                        time = ia.common(time, self._time(left, right, row))
                    least += ia.ONE * time[0]
                    contraction += max(share * width[0], share * width[1])
                else:
                    contraction += -(-times * max(share, 0) * width[1] >> ia.SHIFT)
                most += times * time[1]
            if len(signs) != 1:
                raise Rejected(f"the {('slow', 'fast')[axis]} rate changes its sign in a sector")
        unit = ia.ONE**2
        return Fraction(least, unit), Fraction(most, unit), Fraction(contraction, unit)

    def _strips(
        self, polygon: list[Vertex], axis: int, grid: list[Fraction]
    ) -> Iterator[tuple[Fraction, Fraction, list[tuple[Fraction, Fraction]]]]:
        """Intervals that cover a sector's axis, each with the ends of the sector's edges over it."""
        along, across = ([p[k] for p in polygon] for k in (axis, 1 - axis))
        if len(grid) < 2 or any(b <= a for a, b in pairwise(grid)):
            raise Rejected("a grid is a row of rising numbers")
        if not (grid[0] <= min(along) and max(along) <= grid[-1]):
            raise Rejected("a grid does not cover its sector")
        rows: list[list[tuple[Fraction, Fraction]]] = [[] for _ in grid[1:]]
        for i in range(len(polygon)):
            (p, q), (r, s) = sorted([(along[i - 1], across[i - 1]), (along[i], across[i])])
            slope = Fraction(s - q, r - p) if p < r else Fraction(0)
            met = range(max(bisect_left(grid, p) - 1, 0), min(bisect_right(grid, r), len(rows)))
            self.program.spend(MEETING * len(met), MOST_OPERATIONS)
            for k in met:
                inside = (max(grid[k], p), min(grid[k + 1], r))
                rows[k] += (
                    [(Fraction(v), q + slope * (v - p)) for v in inside]
                    if p < r
                    else [(Fraction(p), Fraction(v)) for v in (q, s)]
                )
        for left, right, row in zip(grid, grid[1:], rows):
            if row:
                yield left, right, row

    def _time(self, left: Fraction, right: Fraction, row: list[tuple[Fraction, Fraction]]) -> Interval:
        """The integral of 1/|f| over a strip: along a line through its middle, and how far others are from that."""
        first, last = ([v for x, v in row if x == end] for end in (left, right))
        if not first or not last:
            raise Rejected("a strip that orbits pass has two sides")
        start, end = (min(first) + max(first)) / 2, (min(last) + max(last)) / 2
        slope, middle = (end - start) / (right - left), (left + right) / 2
        away = max(abs(v - (start + end) / 2 - slope * (x - middle)) for x, v in row)
        box = [
            ia.hull(self._real(a), self._real(b))
            for a, b in ((left, right), (min(v for _, v in row), max(v for _, v in row)))
        ]
        (f, *_), ((f_x, f_y, _), *_) = self._over([*box, self.small])
        square = ia.power(f, 2)
        by_y = ia.magnitude(ia.divide(f_y, square))
        turned = ia.divide(ia.add(f_x, ia.multiply(ia.of(slope), f_y)), square)
        half, far = self._real((right - left) / 2)[1], self._real(away)[1]
        # In H(m) + H'(xi) (x - m) the second part is at most half^2/2 times the range of H'.
        error = (
            (half * half * (turned[1] - turned[0]) >> 2 * ia.SHIFT + 1)
            + (2 * half * far * by_y >> 2 * ia.SHIFT)
            + 2
        )
        at = self.program.values([self._real(middle), self._real((start + end) / 2), self.small])[0]
        inverse = ia.divide(ia.UNIT, at if at[0] > 0 else ia.negative(at))
        return ia.add(ia.multiply(self._real(right - left), inverse), (-error, error))

    def _bounds(
        self, axis: int, x0: Fraction, x1: Fraction, y0: Fraction, y1: Fraction, depth: int = 0
    ) -> Iterator[tuple[int, Interval, Interval]]:
        """Over boxes that make up one: the sign of the sector's rate, 1/r and (g_y + epsilon (h_y + f_x))/r."""
        box = [ia.hull(self._real(a), self._real(b)) for a, b in ((x0, x1), (y0, y1))]
        values, slopes = self._over([*(box[::-1] if axis else box), self.small])
        rate = values[0] if axis == 0 else ia.add(values[1], ia.multiply(self.small, values[2]))
        sign = (rate[0] > 0) - (rate[1] < 0)
        # A rate that is loosely known is looked at more closely.
        loose = depth < CLOSER and 2 * min(map(abs, rate)) <= ia.magnitude(rate)
        if sign and not loose:
            inverse = ia.divide(ia.UNIT, rate if sign > 0 else ia.negative(rate))
            divergence = ia.add(slopes[1][1], ia.multiply(self.small, ia.add(slopes[2][1], slopes[0][0])))
            yield sign, inverse, ia.multiply(divergence, inverse)
            return
        if depth >= HALVINGS:
            raise Rejected(f"the {('slow', 'fast')[axis]} rate is not seen to keep its sign in a sector")
        x, y = (x0 + x1) / 2, (y0 + y1) / 2
        for a, b in ((x0, x), (x, x1)):
            for c, d in ((y0, y), (y, y1)):
                yield from self._bounds(axis, a, b, c, d, depth + 1)

    # -- numbers -----------------------------------------------------------------------------------

    def _over(self, box: list[Interval]) -> tuple[list[Interval], list[list[Interval]]]:
        """f, g and h with their slopes by x, y and epsilon."""
        self.program.spend(0, MOST_OPERATIONS)
        return self.program.values(box), self.program.derivatives(box)

    def _real(self, value: int | Fraction) -> Interval:
        """A coordinate in units of 1/scale as a number."""
        return ia.of(Fraction(value) / self.scale)

    def _shown(self, point: Vertex) -> str:
        return f"({point[0] / self.scale:.6g}, {point[1] / self.scale:.6g})"


def _slow(a: tuple[Interval, Interval], f: Interval, h: Interval) -> Interval:
    """dx h - dy f, where a is (dx, -dy)."""
    return ia.add(ia.multiply(a[0], h), ia.multiply(a[1], f))


def _along(slopes: list[Interval], way: tuple[Interval, Interval]) -> Interval:
    """The derivative along a way."""
    return ia.add(ia.multiply(slopes[0], way[0]), ia.multiply(slopes[1], way[1]))


def _even(row: Any) -> int:
    if not isinstance(row, list) or len(row) % 2 or len(row) > 2 * MOST_VERTICES:
        raise Rejected(f"a polygon is a row of at most {MOST_VERTICES} pairs of coordinates")
    return len(row)


def _chain(polygon: list[Vertex], first: int, last: int) -> list[Vertex]:
    """From one vertex to another, both with it, going round."""
    return polygon[first : last + 1] if first <= last else polygon[first:] + polygon[: last + 1]


def orientation(a: Vertex, b: Vertex, c: Vertex) -> int:
    """The sign of the area of a triangle."""
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return (area > 0) - (area < 0)


def area(polygon: list[Vertex]) -> int:
    return sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(polygon, [*polygon[1:], polygon[0]]))


def _meet(points: list[Vertex], one: Segment, two: Segment) -> bool:
    """Whether two segments share a point, other than an end that is the same vertex."""
    a, b, c, d = (points[i] for i in (*one, *two))
    shared = set(one) & set(two)
    if shared:
        s = points[shared.pop()]
        p, q = (b if a == s else a), (d if c == s else c)
        ahead = (p[0] - s[0]) * (q[0] - s[0]) + (p[1] - s[1]) * (q[1] - s[1])
        return orientation(p, s, q) == 0 and ahead > 0
    if any(max(a[k], b[k]) < min(c[k], d[k]) or max(c[k], d[k]) < min(a[k], b[k]) for k in (0, 1)):
        return False
    return orientation(a, b, c) * orientation(a, b, d) <= 0 and orientation(c, d, a) * orientation(c, d, b) <= 0
