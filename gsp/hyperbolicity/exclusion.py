"""What lies between samples: losses are excluded box by box in ball arithmetic, as far as a small budget goes.

Over each box a tube holds one smooth root with the spectrum of its fast Jacobian (`gsp.proofs`). That the root is the
branch is checked at one point, by doubles, as the samples are. What is left is sampled once more, and said.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import sympy as sp

from gsp.algebra.precision import precision
from gsp.algebra.vanishing import has_simple_roots
from gsp.critical.sampling import Sampler
from gsp.critical.sheet_points import LARGE
from gsp.errors import UnsupportedFunctionError
from gsp.proofs import balls
from gsp.proofs.covering import Covering, Part, cover, share_of, sharpen
from gsp.proofs.equations import EnclosedEquations
from gsp.proofs.tubes import Box, middle_of
from gsp.systems.region import ImageBox, Interval, shown_region
from gsp.systems.scattered_points import halton

# Ball operations of one evaluation, times boxes, that are spent: up to half a second. The number of boxes is held
# between two, and while each doubling decides much of what is left it grows LONGER times.
OPERATIONS, FEWEST, MOST, LONGER = 20_000, 16, 512, 8
# Points that are sampled in what is left, and in each box of it.
POINTS, POINTS_PER_BOX = 512, 64
# A sample belongs to a tube when it misses it by less, relative to 1 + |y|: samples are found to 1e-12.
BESIDE = 1e-9
# A share of a side below rounding of the region is not cut, and a share of the region below it is no finding.
ROUNDING = float(np.finfo(float).eps)
# A point without a branch counts when the branch is missing this far on both sides too, relative to the region: a
# removable singularity is no hole.
ASIDE = 1e-7


@dataclass(frozen=True, eq=False)
class Exclusion:
    """Where between samples a loss is excluded: over the whole region but the boxes `left`, `share` of its volume.

    `tried` boxes were looked at, and |Re lambda| is at least `gap` over those that are not left.
    `reason` says why nothing could be, when that is so. With `by_discriminant` g is a polynomial in one fast variable
    whose discriminant vanishes nowhere over the region, so that no eigenvalue does; `gap` is 0 where boxes remain.
    With `drops_rounding` the region is covered but for boxes that are no place in doubles: a zero may lie in one.
    """

    tried: int
    left: tuple[Mapping[str, Interval], ...]
    share: float
    reason: str = ""
    gap: float = math.inf
    # Further points (k, n) of the branch, the samples that they were followed from, and (sample, x) without a point.
    points: np.ndarray = field(default_factory=lambda: np.empty((0, 0)), repr=False)
    origins: np.ndarray = field(default_factory=lambda: np.empty((0, 0)), repr=False)
    ends: tuple[tuple[np.ndarray, np.ndarray], ...] = field(default=(), repr=False)
    by_discriminant: bool = False
    drops_rounding: bool = False

    @property
    def is_complete(self) -> bool:
        """Whether a loss is excluded all over the region."""
        return not self.left

    @property
    def distance(self) -> float:
        """How far from the imaginary axis every eigenvalue is at least, at every point of the region; 0 where a part
        of it, however small, has no enclosure.
        """
        return self.gap if self.is_complete and not self.drops_rounding and np.isfinite(self.gap) else 0.0

    def __str__(self) -> str:
        if self.reason:
            return f"between them nothing is excluded: {self.reason}"
        if self.is_complete and self.by_discriminant and not self.gap:
            return "between them the discriminant of g, which vanishes nowhere, leaves no loss"
        if self.is_complete:
            boxes = "1 box" if self.tried == 1 else f"{self.tried} boxes"
            return f"between them enclosures over {boxes} leave no loss"
        ends = {
            n: (min(box[n][0] for box in self.left), max(box[n][1] for box in self.left)) for n in self.left[0]
        }
        over = "the whole region" if self.share == 1.0 else f"a share of {self.share:.2g} of the region"
        return f"between them a loss is not excluded over {over}, {shown_region(ends)}"


def exclude(sampler: Sampler, box: Mapping[str, Interval], z: np.ndarray) -> Exclusion:
    """Exclude losses of a branch between its samples `z` (m, n), which are of one type and without a loss.

    Ctrl-C goes on upwards.
    """
    system = sampler.system
    names = [s.name for s in system.x]
    whole: Box = tuple(box[name] for name in names)
    if sampler.is_large:
        reason = f"enclosures are sought for {LARGE} fast variables at most, and there are {len(system.y)}"
        return Exclusion(0, (dict(zip(names, whole)),), 1.0, reason)
    # In the branch's units, or the least radius of a tube and the condition of a basis would depend on the states'.
    units = [sp.Rational(*float(unit).as_integer_ratio()) for unit in sampler.branch.scales[1]]
    inner = {**system.parameters, **{y: unit * y for y, unit in zip(system.y, units)}}
    g = [e.xreplace(inner) / unit for e, unit in zip(sampler.g, units)]
    try:
        # Overflow is no bound, and what is no bound excludes nothing.
        with precision(balls.PRECISION), np.errstate(all="ignore"):
            equations = EnclosedEquations(system.x, system.y, g)
            most = min(max(OPERATIONS // equations.operations, FEWEST), MOST)
            search = _ExclusionSearch(sampler, equations, whole, z)
            never_zero = len(g) == 1 and has_simple_roots(g[0], system.y[0], dict(zip(system.x, whole)))
            # Then no more is sought than a bound on the gap.
            search.run(most, 1 if never_zero else LONGER)
            points, origins, ends = search.sampled(box)
    except UnsupportedFunctionError as error:
        everything = (dict(zip(names, whole)),)
        return Exclusion(0, everything, 1.0, error.fact)
    left = tuple(dict(zip(names, part)) for part in search.left)
    share = min(sum(share_of(part, whole) for part in search.left), 1.0)
    gap = search.gap
    drops_rounding = bool(left) and share <= ROUNDING
    if drops_rounding:
        # No place of the region in doubles but its end.
        left, share = (), 0.0
    if never_zero and left:
        left, share, gap = (), 0.0, 0.0
    return Exclusion(search.tried, left, share, "", gap, points, origins, ends, never_zero, drops_rounding)


class _ExclusionSearch:
    """Coverings of the sheets that the samples lie on."""

    def __init__(self, sampler: Sampler, equations: EnclosedEquations, whole: Box, z: np.ndarray) -> None:
        self.sampler, self.equations, self.whole, self.z = sampler, equations, whole, z
        self.nx = len(whole)
        self.units = sampler.branch.scales[1]
        # The samples' fast variables in units, and how large each is: what rounding is measured by.
        self.y = z[:, self.nx :] / self.units
        self.sizes = np.abs(self.y).max(axis=0)
        self.widths = np.array([high - low for low, high in whole])
        self.left: list[Box] = []
        # Places (k, n_slow) that are worth a sample, each with a sample of its sheet.
        self.places: list[np.ndarray] = []
        self.starts: list[np.ndarray] = []
        self.tried = 0
        self.gap = math.inf

    def run(self, most: int, longer: int) -> None:
        """Cover sheet after sheet until every sample lies on one, or a budget ends: `most` boxes, `longer` times it."""
        middle = middle_of(self.whole)
        pending = np.ones(len(self.z), dtype=bool)
        # Sheets that are followed when none is singled out.
        for _ in range(4):
            if not pending.any():
                return
            if self.tried >= most:
                break
            sample = self.z[self._nearest(middle[None, :], np.flatnonzero(pending))[0]]
            y, good = self.sampler.over(middle[None, :], sample[None, :])
            if not good[0]:
                break
            covering = cover(
                self.equations,
                self.whole,
                y[0] / self.units,
                most_boxes=most - self.tried,
                at_most=longer * most - self.tried,
                least=ROUNDING,
            )
            if covering.interrupted:
                raise KeyboardInterrupt
            sharpen(self.equations, covering, most_boxes=most - self.tried)
            self.tried += covering.tried
            if covering.gap < self.gap:
                self.gap = covering.gap
            pending &= ~self._taken(covering, pending)
        if pending.any():
            self.left.append(self.whole)

    def _taken(self, covering: Covering, pending: np.ndarray) -> np.ndarray:
        """Which samples the covering speaks about; what it leaves is noted."""
        parts = list(covering.root.leaves())
        on, over = self._samples_in(parts)
        sheet = np.flatnonzero(on if on.any() else pending)
        counts = [
            p.piece.spectrum.counts for p in parts if p.piece is not None and p.piece.spectrum is not None
        ]
        usual = max(counts, key=counts.count) if counts else None
        middles = np.array([middle_of(part.box) for part in parts])
        starts = self.z[self._nearest(middles, sheet)]
        y, good = self.sampler.over(middles, starts)
        for part, start, here, found in zip(parts, starts, y, good):
            x = middle_of(part.box)
            piece = part.piece
            if piece is not None and found and piece.spectrum is not None and piece.spectrum.counts == usual:
                margin = piece.tube.radius + BESIDE * self.sizes
                if (np.abs(here / self.units - piece.tube.centre) <= margin).all():
                    self._look(x[None, :], start)
                    continue
            self.left.append(part.box)
            if part.suspect is not None:
                self._look(part.suspect[None, :], start)
            self._look(x[None, :], start)
        one_sheet = self.sampler.branch.is_explicit or self.sampler.branch.seed is not None
        return np.ones(len(self.z), dtype=bool) if one_sheet else on | over

    def _look(self, x: np.ndarray, start: np.ndarray) -> None:
        self.places.append(x)
        self.starts.append(np.broadcast_to(start, (len(x), len(start))))

    def _samples_in(self, parts: Sequence[Part]) -> tuple[np.ndarray, np.ndarray]:
        """Which samples lie in tubes, and which over boxes without one."""
        x, y = self.z[:, : self.nx], self.y
        on, over = np.zeros(len(x), dtype=bool), np.zeros(len(x), dtype=bool)
        for part in parts:
            low, high = np.array(part.box).T
            inside = ((x >= low) & (x <= high)).all(axis=1)
            if part.piece is None:
                over |= inside
                continue
            tube = part.piece.tube
            off = np.abs(y[inside] - tube.centre - (x[inside] - tube.middle) @ tube.slope.T)
            on[inside] |= (off <= tube.radius + BESIDE * self.sizes).all(axis=1)
        return on, over

    def _nearest(self, x: np.ndarray, among: np.ndarray) -> np.ndarray:
        """The rows of the samples nearest to `x` (k, n_slow), of those in `among`."""
        scaled = self.z[among, : self.nx] / self.widths
        return among[[int(np.argmin(np.abs(scaled - point).sum(axis=1))) for point in x / self.widths]]

    def sampled(
        self, box: Mapping[str, Interval]
    ) -> tuple[np.ndarray, np.ndarray, tuple[tuple[np.ndarray, np.ndarray], ...]]:
        """The branch at the places worth a sample and at more points of what is left."""
        if self.left:
            count = max(1, min(POINTS // len(self.left), POINTS_PER_BOX))
            unit = halton(self.nx, count)
            for part in self.left:
                low, high = np.array(part).T
                x = low + unit * (high - low)
                start = self.z[self._nearest(middle_of(part)[None, :], np.arange(len(self.z)))[0]]
                self._look(x, start)
        if not self.places:
            return self.z[:0], self.z[:0], ()
        x, starts = np.vstack(self.places), np.vstack(self.starts)
        y, good = self.sampler.over(x, starts)
        points, origins = np.hstack([x, y])[good], starts[good]
        kept = self.sampler.inside(points, box) & self._is_exact(points)
        ends = np.flatnonzero(~good)
        if isinstance(box, ImageBox) and len(ends):
            ends = ends[self.sampler.counted(x[ends], box)]
            # The straight way from a farther sample may leave the image.
            beside = self.z[self._nearest(x[ends], np.arange(len(self.z)))]
            ends = ends[~self.sampler.over(x[ends], beside)[1]]
        for side in (-ASIDE, ASIDE):
            beside = np.clip(x[ends] + side * self.widths, *np.array(self.whole).T)
            ends = ends[~self.sampler.over(beside, starts[ends])[1]]
        return points[kept], origins[kept], tuple((starts[i], x[i]) for i in ends)

    def _is_exact(self, points: np.ndarray) -> np.ndarray:
        """At which points the fast Jacobian in doubles is what it is in balls, to rounding."""
        jacobians = self.sampler.fast_jacobian(points) * (self.units / self.units[:, None])
        matrices = jacobians.reshape(len(points), -1)
        # What rounding does to a Jacobian at a sample, relative to the largest entry; more is cancellation, and
        # no sample.
        margin = 1e-6 * float(np.abs(matrices[np.isfinite(matrices)]).max(initial=0.0))
        exact = np.array(np.isfinite(matrices).all(axis=1))
        for i in np.flatnonzero(exact):
            place = [*points[i, : self.nx], *(points[i, self.nx :] / self.units)]
            place = [balls.exact(float(v)) for v in place]
            entries = self.equations.derivative(place[: self.nx], place[self.nx :])
            exact[i] = all(
                balls.magnitude(entry - balls.exact(float(v))) <= margin
                for entry, v in zip(entries, matrices[i])
            )
        return exact
