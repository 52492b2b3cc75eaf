"""The search for a tube in one basis: sampling proposes widths and slopes, `isolation` proves them."""

from __future__ import annotations

import heapq
import itertools
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from flint import arb

from gsp.proofs import balls
from gsp.proofs.tubes import Box, halved
from gsp.slow_tubes.adapted_basis import AdaptedBasis
from gsp.slow_tubes.invariance import Invariance
from gsp.slow_tubes.isolation import NARROWEST, Isolation, Tally, norm
from gsp.slow_tubes.solved_flow import SolvedFlow

# The width of a tube is found to this share.
NARROW = 1.005
# A collar, where one is needed, takes this share of a side of the region at most, both ends together: something is
# left, also where a file claims a tenth more, and half of the side in a search for the largest epsilon. It is then
# made narrower, down to a share of that, the last time by more than FINEST.
COLLAR, HALF, FINEST = 0.9, 0.5, 1.1
# The boundary over which the orbits that stay by themselves do so: backward ones where all fast directions are stable,
# forward ones where all are unstable.
KEEPING: dict[tuple[int, ...], str] = {(-1,): "overflowing", (1,): "inflowing"}
# A step to a larger epsilon may take so many boxes, or this many times what the first one took.
STEP_BOXES, STEP_SHARE = 256, 2
# Samples in the region that propose a width, those that rule a slope out, and boxes that bound a supremum to SUPREMUM
# of itself, that of |f| to FASTEST.
SAMPLES, CORNERS, SUPREMUM, FASTEST, SUPREMUM_BOXES = 81, 9, 0.005, 0.05, 4_000


@dataclass(frozen=True, eq=False)
class Cones:
    """Cone conditions of one `slope`, proved for epsilon from `low` to `high`.

    The slow field f may be cut off by any factor chi from 0 to 1 with |grad chi| |f| <= `collar`.
    """

    low: float
    high: float
    slope: float
    collar: float
    # Of the slope among those that were tried: steeper ones fail for larger epsilon too.
    place: int


@dataclass(frozen=True, eq=False)
class ProvedTube:
    """A tube that was proved: up to `epsilon`, `widths` of the blocks, the `cones` from 0 to epsilon or none.

    The theorem is about each epsilon by itself, so that cones of different slopes may follow one another.
    """

    problem: TubeSearch
    epsilon: float
    widths: np.ndarray
    cones: tuple[Cones, ...]
    # Boxes that its first step took.
    tried: int
    # A bound of the width of the collar, for every epsilon; it is not looked for at once.
    collar: float = math.nan

    @property
    def is_kept(self) -> bool:
        """Whether the cones hold without a cut-off, because the orbits they are about stay over the region."""
        return bool(self.cones) and all(cone.collar == 0.0 for cone in self.cones)


class TubeSearch:
    """Tubes in one basis."""

    def __init__(
        self,
        invariance: Invariance | SolvedFlow,
        basis: AdaptedBasis,
        region: Box,
        tally: Tally,
        *,
        first: float = 0.0,
    ) -> None:
        self.invariance, self.basis, self.region, self.tally = invariance, basis, region, tally
        # The least epsilon that is asked for.
        self.first = first
        # The tube that was last proved isolating, and for which epsilon.
        self._isolating: tuple[tuple[float, ...], float, float] | None = None

    def over(self, low: float, high: float, tally: Tally | None = None) -> Isolation:
        """The tests over the region for epsilon from `low` to `high`."""
        return Isolation(self.invariance, self.basis, (*self.region, (low, high)), tally or self.tally)

    def _samples(self, epsilons: tuple[float, ...], samples: int = SAMPLES) -> list[np.ndarray]:
        count = max(2, round(samples ** (1.0 / len(self.region))))
        axes = [np.linspace(low, high, count) for low, high in self.region]
        return [np.array(point) for point in itertools.product(*axes, epsilons)]

    @cached_property
    def _first_left_out(self) -> np.ndarray | None:
        """Widths (blocks,) of the tube that epsilon = 0 asks for: those of the first term left out."""
        return self.over(0.0, 0.0).shape(self._samples((0.0,)))

    def within(self, epsilon: float, ratio: float, known: ProvedTube | None = None) -> ProvedTube | None:
        """A tube of `ratio` times the first term left out, with cones, for all epsilon up to `epsilon`.

        `known` is one of the same ratio up to a smaller epsilon; only what lies beyond it is proved then, and a step
        that takes many more boxes than the first one is at the border.
        """
        shape = self._first_left_out
        if shape is None:
            return None
        widths = ratio * shape
        is_kept = (known is None or known.is_kept) and self.leaves_interior(self.boundary(epsilon, widths))
        if known is not None and known.is_kept and not is_kept:
            # That the slow flow needs no cut-off is proved for a smaller epsilon only.
            known = None
        if known is None:
            tally, low, cones = self.tally, self.first, ()
        else:
            most = min(self.tally.most, max(STEP_BOXES, STEP_SHARE * known.tried))
            tally, low, cones = Tally(most, shown=self.tally.shown), known.epsilon, known.cones
        before = tally.tried
        isolation = self.over(low, epsilon, tally)
        first = 0 if known is None else known.cones[-1].place
        isolates = self._isolates(isolation, widths)
        found = self._cones(isolation, widths, 0.0 if is_kept else HALF, first) if isolates else None
        tried = tally.tried - before
        if tally is not self.tally:
            self.tally.tried += tried
        if found is None:
            return None
        # Of the first step: a budget that grew from step to step would end with all boxes at the border.
        return ProvedTube(self, epsilon, widths, (*cones, found), tried if known is None else known.tried)

    def _isolates(self, isolation: Isolation, widths: np.ndarray) -> bool:
        """Whether the tube is isolating; it is so for fewer epsilon than it was proved for."""
        low, high = isolation.region[-1]
        if self._isolating is not None:
            proved, least, most = self._isolating
            if proved == tuple(widths) and least <= low and high <= most:
                return True
        if not isolation.faces(widths):
            return False
        self._isolating = (tuple(widths), low, high)
        return True

    def least(self, epsilon: float, known: ProvedTube | None = None) -> ProvedTube | None:
        """The narrowest tube found up to `epsilon`, with cones if they can be had; `known` is one with them."""
        isolation = self.over(self.first, epsilon)
        shape = isolation.shape(self._samples((self.first, 0.5 * (self.first + epsilon), epsilon)))
        if shape is None:
            return known
        low, high = 1.0, math.inf
        # Shares of the least tube that sampling suggests, tried in this order.
        for share in (1.005, 1.02, 1.05, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0):
            if isolation.faces(share * shape):
                high = share
                break
            low = share
        if high == math.inf:
            return known
        while high > low * NARROW:
            self.tally.shown.bracketed(low, high, NARROW)
            middle = math.sqrt(low * high)
            if isolation.faces(middle * shape):
                high = middle
            else:
                low = middle
        widths = high * shape
        if known is not None and (widths <= known.widths).all():
            # What holds all over a tube holds in every narrower one.
            return replace(known, widths=widths)
        if known is not None and widths.max() > known.widths.max():
            return known
        is_kept = self.leaves_interior(self.boundary(epsilon, widths))
        found = self._cones(isolation, widths, 0.0 if is_kept else COLLAR)
        if known is not None and found is None:
            return known
        return ProvedTube(self, epsilon, widths, () if found is None else (found,), self.tally.tried)

    def why_none(self, epsilon: float, small: str, names: Sequence[str]) -> str:
        """Why no tube may have been proved isolating, where, and what to change: by samples at an `epsilon`, which is
        called `small`, over sides with these `names`.
        """
        isolation = self.over(epsilon, epsilon)
        rates = [(isolation.decay(point), point.tolist()) for point in self._samples((epsilon,))]
        # A rate that is not known, NaN, is none.
        rate, at = min((rate if rate > 0.0 else -math.inf, at) for rate, at in rates)
        place = ", ".join(f"{name} = {v:.6g}" for name, v in zip(names, at))
        if rate > 0.0:
            return (
                "no tube was proved isolating: what the series leaves over is too large for the fast directions, which "
                f"are weakest near {place}, with a rate of about {rate:.3g}. "
                f"Lower {small}, or shrink the region"
            )
        return (
            f"no tube was proved isolating: near {place} a fast direction does not shrink, or grow, as in the middle "
            f"of the region, or nothing is known of it, at {small} = {epsilon:g}. "
            "Take a region without this place" + (f", or lower {small}" if epsilon else "")
        )

    def leaves_interior(self, boundary: str) -> bool:
        """Whether the orbits that the cones are about stay over the region of themselves, with such a `boundary`."""
        return KEEPING.get(tuple(sorted(set(self.basis.signs)))) == boundary

    def _cones(self, isolation: Isolation, widths: np.ndarray, share: float, first: int = 0) -> Cones | None:
        """Cones that hold with a collar of a `share` of the region, None where none do; of the slopes to try the
        `first` are passed over.
        """
        low, epsilon = isolation.region[-1]
        collar = 0.0
        if share > 0.0:
            narrowest = min(high - low for low, high in self.region[: self.invariance.slow])
            # Where nothing moves any cut-off does.
            collar = max(2.0 * self.fastest(isolation, widths) / (share * narrowest), sys.float_info.min)
        points = self._samples((epsilon,))
        slaved, pull = isolation.steepness(points), isolation.pull(points)
        # Slopes of the cones as shares of that at which z changes the slow rates as fast as it decays, and of the slope
        # of the slaved z, which is rounding beside the first of them where z changes no slow rate.
        # The steep ones come first: they hang least on how rho bends, and take the fewest boxes.
        steepest = 1.0 / pull if pull > 0.0 else slaved / sys.float_info.epsilon or 1.0
        slopes = [s * steepest for s in (1.0, 0.5, 0.25)] + [
            s * slaved for s in (16.0, 4.0, 2.0) if slaved > 0.0
        ]
        slopes = slopes[min(first, len(slopes) - 1) :]
        for place, slope in enumerate(slopes, start=first):
            if self._hold(isolation, widths, slope, collar):
                return Cones(low, epsilon, slope, collar, place)
        return None

    def _hold(self, isolation: Isolation, widths: np.ndarray, slope: float, collar: float) -> bool:
        """Whether cones hold; those that fail at a point are not tried on boxes."""
        points = self._samples((isolation.region[-1][1],), CORNERS)
        return all(
            Isolation(self.invariance, self.basis, tuple((float(v), float(v)) for v in point), Tally(1)).cones(
                widths, slope, collar
            )
            for point in points
        ) and isolation.cones(widths, slope, collar)

    def boundary(self, epsilon: float, widths: np.ndarray) -> str:
        """What the slow flow is proved to do at the sides of the region."""
        isolation = self.over(self.first, epsilon)
        ways = set()
        for axis in range(self.invariance.slow):
            for upper in (False, True):
                ways.add(isolation.side(axis, upper, widths))
                if len(ways) > 1:
                    return "mixed"
        return {1: "overflowing", -1: "inflowing", 0: "mixed"}[ways.pop()]

    def sides_of(self, tube: ProvedTube) -> str:
        """What the slow flow is proved to do at the sides, for all epsilon and over the whole tube."""
        if tube.is_kept:
            # It was proved with the last cones, from 0 on and over a tube that was no narrower.
            return KEEPING[self.basis.signs[:1]]
        return self.boundary(tube.epsilon, tube.widths)

    def narrowed(self, tube: ProvedTube) -> ProvedTube:
        """The tube with a collar as narrow as can be had; 0 where there need be none, nan without cones."""
        if tube.is_kept or not tube.cones:
            return replace(tube, collar=0.0 if tube.is_kept else math.nan)
        tally = Tally(min(self.tally.most, max(STEP_BOXES, STEP_SHARE * tube.tried)), shown=self.tally.shown)
        cones, width = [], 0.0
        # From the largest epsilon on, where the rates are nearest to one another.
        for cone in reversed(tube.cones):
            part = self.over(cone.low, cone.high, tally)
            fastest, steep, factor = self.fastest(part, tube.widths), cone.collar, 2.0
            while factor > FINEST and fastest > width * steep and steep * NARROWEST < cone.collar:
                if self._hold(part, tube.widths, cone.slope, factor * steep):
                    steep *= factor
                else:
                    factor = math.sqrt(factor)
            cones.insert(0, replace(cone, collar=steep))
            width = max(width, balls.magnitude(arb(fastest) / arb(steep)))
        self.tally.tried += tally.tried
        return replace(tube, cones=tuple(cones), collar=width)

    def fastest(self, isolation: Isolation, widths: np.ndarray) -> float:
        """A bound of |f| in the tube."""

        def speed(box: list[arb]) -> arb:
            isolation.tally.shown.looked()
            return norm(isolation.rates(box, widths))

        return supremum(speed, isolation.region, FASTEST)

    def half_widths(self, widths: np.ndarray) -> list[float]:
        """Bounds (m,) of |P z| in the tube, for each fast variable."""
        m = self.invariance.m

        def row(j: int) -> Callable[[list[arb]], arb]:
            def extent(x: list[arb]) -> arb:
                turning = self.invariance.turning([*x, arb(0)])
                return sum(
                    (
                        norm([turning[j * m + k] for k in block]) * arb(float(width))
                        for block, width in zip(self.basis.blocks, widths)
                    ),
                    balls.ZERO,
                )

            return extent

        return [supremum(row(j), self.region) for j in range(m)]


def supremum(function: Callable[[list[arb]], arb], region: Box, share: float = SUPREMUM) -> float:
    """A bound of a function of balls over a box, within a `share` of the largest value found or as near as
    `SUPREMUM_BOXES` boxes bring it.
    """

    def over(box: Box) -> float:
        value = balls.magnitude(function([balls.hull(low, high) for low, high in box]))
        return value if value == value else math.inf

    sides = [high - low for low, high in region]
    heap = [(-over(region), 0, region)]
    found = 0.0
    for count in range(1, SUPREMUM_BOXES):
        top, _, box = heap[0]
        if -top <= (1.0 + share) * found or -top == 0.0:
            break
        heapq.heappop(heap)
        axis = max(range(len(box)), key=lambda k: (box[k][1] - box[k][0]) / sides[k])
        for i, half in enumerate(halved(box, axis)):
            for corner in (0, 1):
                at = over(tuple((ends[corner], ends[corner]) for ends in half))
                found = max(found, at if at < math.inf else 0.0)
            heapq.heappush(heap, (-over(half), 2 * count + i, half))
    return -heap[0][0]
