"""What holds in the sectors of an annulus or a strip, in balls: theorem 9 of docs/proofs.md.

In turn the slow and the fast rate keep their sign, so that no equilibrium is in it, and bounds hold of the time and of
the divergence around each closed orbit, or along each orbit that passes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from heapq import heapify, heappop, heappush
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from flint import arb

from gsp.cycles.annulus import Band
from gsp.cycles.enclosed_field import EnclosedField
from gsp.proofs import balls

# Ends along the sector's axis, then across it.
Box = tuple[float, float, float, float]


class NotProved(Exception):
    """A condition was not decided; the text says which."""


@dataclass(frozen=True)
class Turn:
    """Bounds for every closed orbit in an annulus, or every orbit through a strip, and every epsilon: of its `period`,
    the slow time that it takes, and of the integral of epsilon times the divergence over it.
    """

    period: tuple[float, float]
    contraction: float


def turn_of(field: EnclosedField, band: Band, epsilon: float, fineness: int) -> Turn:
    """Bounds over 2 `fineness` strips of each sector, of as many as `fineness` boxes; raises `NotProved` where its rate
    is not proved to have one sign.
    """
    least = most = contraction = arb(0)
    small = balls.hull(0.0, epsilon)
    for k, sector in enumerate(band.sectors):
        slow = band.is_slow(k)
        axis = 0 if slow else 1
        height, signs = float(np.ptp(sector[:, 1 - axis])) / fineness, set()
        # In fast sectors times are epsilon times the integral over y.
        share = arb(1) if slow else arb(epsilon)
        for strip in slices(band, k, fineness):
            sign, time, divergence = _Sliced(field, axis, small, strip, height).integrals()
            signs.add(sign)
            most += share * time[1]
            if strip.is_passed:
                least += time[0]
                contraction += divergence
            elif divergence > 0:
                contraction += share * divergence
        if len(signs) != 1:
            raise NotProved("a rate changes its sign in a sector")
    return Turn((balls.below(least), balls.above(most)), balls.above(contraction))


@dataclass(frozen=True)
class Slice:
    """A strip of a sector across its axis: `box` holds what is in it, and `row` are places on the sector's border, with
    the other coordinate between two doubles. Every closed orbit passes the whole strip when `is_passed`.
    """

    box: Box
    row: list[tuple[float, float, float]]
    is_passed: bool


def slices(band: Band, k: int, fineness: int) -> Iterator[Slice]:
    """Strips that cover a sector, across the slow variable in slow ones and the fast one in others."""
    slow, grid = band.is_slow(k), band.grid(k, fineness)
    ends = band.ends(k)
    for left, right, row in zip(grid, grid[1:], _clipped(band.sectors[k], 0 if slow else 1, grid)):
        # It lies between the cuts, wherever a closed orbit crosses them.
        passed = slow and any(one[1] <= left and right <= two[0] for one, two in (ends, ends[::-1]))
        yield Slice((left, right, min(low for _, low, _ in row), max(high for _, _, high in row)), row, passed)


class _Part(NamedTuple):
    """A box whose rate has a `sign`: doubles above and below 1/r, and one above (g_y + epsilon (h_y + f_x))/r. It has
    been quartered so often, and its rate may be loosely known.
    """

    divergence: float
    slowest: float
    fastest: float
    sign: int
    box: Box
    quartered: int
    is_loose: bool


@dataclass(frozen=True)
class _Sliced:
    """A strip of a sector with its rate r, f for `axis` 0 and g + epsilon h for 1, epsilon in a ball. Boxes are cut
    across down to `height`.
    """

    field: EnclosedField
    axis: int
    epsilon: arb
    one: Slice
    height: float

    def integrals(self) -> tuple[int, tuple[arb, arb], arb]:
        """The sign of the rate, and over the strip bounds of the integrals of 1/r, from below and above, and of (g_y +
        epsilon (h_y + f_x))/r, from above.
        """
        parts = self.parts()
        signs = {part.sign for part in parts}
        if len(signs) != 1:
            raise NotProved("a rate changes its sign in a sector")
        (sign,) = signs
        left, right, *_ = self.one.box
        width = arb(right) - arb(left)
        time = (width * min(part.fastest for part in parts), width * max(part.slowest for part in parts))
        if self.one.is_passed:
            found = self.along(left, right, self.one.row, sign)
            if found.is_finite():
                time = (time[0].max(found.lower()), time[1].min(found.upper()))
        return sign, time, width * max(part.divergence for part in parts)

    def parts(self) -> list[_Part]:
        """Parts that make up the strip. One on which a bound of all of them hangs is halved across down to `height`,
        and then quartered where its rate is loosely known; raises `NotProved` where one has no sign.
        """
        parts = list(self._signed(self.one.box, 0))
        for tried, bound in enumerate((attrgetter("divergence"), attrgetter("slowest"))):
            # In fast sectors only positive bounds of the divergence count.
            enough = 0.0 if self.axis == 1 and not tried else -math.inf
            waiting = [(-bound(part), part) for part in parts]
            heapify(waiting)
            while -waiting[0][0] > enough and (self._is_tall((worst := waiting[0][1]).box) or worst.is_loose):
                heappop(waiting)
                for part in self._divided(worst.box, worst.quartered):
                    heappush(waiting, (-bound(part), part))
            parts = [part for _, part in waiting]
        return parts

    def _divided(self, box: Box, quartered: int) -> Iterator[_Part]:
        x0, x1, y0, y1 = box
        u, v = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
        tall = self._is_tall(box)
        for a, b in ((x0, x1),) if tall else ((x0, u), (u, x1)):
            for c, d in ((y0, v), (v, y1)):
                yield from self._signed((a, b, c, d), quartered + (not tall))

    def _signed(self, box: Box, quartered: int) -> Iterator[_Part]:
        """The box, or parts of it whose rates have signs."""
        if self._is_smooth:
            rate, divergence = self._within(*box[:2])(balls.hull(*box[2:]))
            smooth = rate.is_finite() and divergence.is_finite()
        else:
            f, g, h, f_x, _, _, g_y, _, h_y = found = self._whole(box)
            rate, divergence = g + self.epsilon * h if self.axis else f, g_y + self.epsilon * (h_y + f_x)
            smooth = all(v.is_finite() for v in found)
        sign = 1 if rate > 0 else -1 if rate < 0 else 0
        if sign and smooth:
            inverse = balls.quotient(arb(1), sign * rate)
            share = balls.above(balls.product(divergence, inverse))
            # A box is quartered five times where its rate is not between its largest modulus and half of it,
            # and eight times where it is not yet of one sign.
            loose = quartered < 5 and not sign * rate > 0.5 * abs(rate).upper()
            yield _Part(share, balls.above(inverse), balls.below(inverse), sign, box, quartered, loose)
        elif quartered < 8:
            yield from self._divided(box, quartered)
        else:
            raise NotProved(
                f"the {'fast' if self.axis else 'slow'} rate is not proved to keep its sign in a sector"
            )

    @cached_property
    def _is_smooth(self) -> bool:
        """Whether all is finite over the whole strip: then the field is smooth in it."""
        return all(v.is_finite() for v in self._whole(self.one.box))

    def _whole(self, box: Box) -> list[arb]:
        along, across = balls.hull(*box[:2]), balls.hull(*box[2:])
        return self.field.with_slopes(*((across, along) if self.axis else (along, across)), self.epsilon)

    def _within(self, left: float, right: float) -> Callable[[arb], tuple[arb, arb]]:
        """The rate and the divergence over a part of the strip's length."""
        if (left, right) not in self._known:
            self._known[left, right] = self.field.divergence(self.axis, balls.hull(left, right), self.epsilon)
        return self._known[left, right]

    @cached_property
    def _known(self) -> dict[tuple[float, float], Callable[[arb], tuple[arb, arb]]]:
        return {}

    def _is_tall(self, box: Box) -> bool:
        return box[3] - box[2] > self.height

    def along(self, left: float, right: float, row: list[tuple[float, float, float]], sign: int) -> arb:
        """The integral of 1/r over x, in a slow sector: along a line through the middle of the strip, from its middle,
        and how far other orbits are away from it. `row` are places on the sector's border.
        """
        sides = [[v for x, low, high in row if x == end for v in (low, high)] for end in (left, right)]
        if not all(sides):
            return balls.UNDEFINED
        first, last = (0.5 * (min(side) + max(side)) for side in sides)
        slope, middle = (arb(last) - arb(first)) / (arb(right) - arb(left)), (arb(left) + arb(right)) / 2
        centre, half = (arb(first) + arb(last)) / 2, (arb(right) - arb(left)) / 2
        away = arb(0)
        for x, low, high in row:
            line = centre + slope * (arb(x) - middle)
            away = away.max(abs(arb(low) - line)).max(abs(arb(high) - line))
        box = balls.hull(left, right), balls.hull(min(v for _, v, _ in row), max(v for _, _, v in row))
        f, _, _, f_x, f_y, *_ = self.field.with_slopes(*box, self.epsilon)
        by_y = f_y / balls.power(f, 2)
        turned = -sign * (f_x + slope * f_y) / balls.power(f, 2)
        at = sign / self.field.over(middle, centre, self.epsilon)[0]
        # Of H(x) = H(m) + H'(xi) (x - m) the second part is at most half^2/2 times the range of H'.
        bend = half**2 / 2 * (turned.upper() - turned.lower())
        error = (bend + 2 * half * away * abs(by_y)).upper()
        return 2 * half * at + error * balls.hull(-1.0, 1.0)


def _clipped(sector: np.ndarray, axis: int, grid: list[float]) -> list[list[tuple[float, float, float]]]:
    """Over each interval of the grid the ends of the sector's edges there: their coordinate along the axis, and the
    other one between two doubles.
    """
    found: list[list[tuple[float, float, float]]] = [[] for _ in grid[1:]]
    places = np.array(grid)
    for one, two in zip(sector, np.roll(sector, -1, axis=0)):
        (a, c), (b, d) = sorted([(float(p[axis]), float(p[1 - axis])) for p in (one, two)])
        first = max(int(np.searchsorted(places, a, side="left")) - 1, 0)
        last = min(int(np.searchsorted(places, b, side="right")), len(found))
        values = {a: (c, c), b: (d, d)}
        for i in range(first, last):
            for end in (max(a, grid[i]), min(b, grid[i + 1])):
                if end not in values:
                    exact = arb(c) + (arb(end) - arb(a)) / (arb(b) - arb(a)) * (arb(d) - arb(c))
                    values[end] = (balls.below(exact), balls.above(exact))
                found[i].append((end, *values[end]))
            if a == b:
                found[i] += [(a, c, c), (b, d, d)]
    return found
