"""Check a proof about relaxation cycles: whole numbers, a parser and derivatives of its own, nothing of the prover.

The file holds the rates f, g and h of x' = f, epsilon y' = g + epsilon h, as expressions of z0 = x, z1 = y and
z2 = epsilon, and annuli. Of each it claims an epsilon_0, bounds of the period and of the integral of epsilon times the
divergence, and whether the cycle is the only one. Nothing is believed; the conditions are those of theorems 7 to 9 of
docs/proofs.md, checked anew:

- both polygons are simple and counterclockwise, one is inside the other, and the cuts meet nothing: exactly;
- orbits cross every edge into the annulus, for every epsilon in (0, epsilon_0], over pieces of the edge;
- f keeps one sign in every other sector and g + epsilon h in the others, over boxes, so that no equilibrium is there;
- sums over strips of the sectors are within the bounds that are claimed.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from gsp.proofs import untrusted
from gsp.proofs.band_checker import BandChecker, Cut, area, orientation, program_of
from gsp.proofs.checked_cycle import CheckedAnnulus, CheckedCycle
from gsp.proofs.programs import IntervalProgram, Rejected

FORMAT = "gsp relaxation cycle 2"


def check(read: Any) -> CheckedCycle:
    """Check the plain values of a file; raises `Rejected` with the reason when the proof does not hold."""
    return untrusted.guarded(lambda: _checked(read))


def _checked(read: Any) -> CheckedCycle:
    untrusted.of_format(read, FORMAT)
    names, program = program_of(read["names"], read["rates"])
    found = tuple(_Annulus(one, program).checked() for one in untrusted.few(read["annuli"], 4, "annuli"))
    return CheckedCycle(names, tuple(read["rates"]), found)


class _Annulus(BandChecker):
    def __init__(self, read: Any, program: IntervalProgram) -> None:
        super().__init__(read, program)
        self.unique = read["unique"]
        if len(self.cuts) % 2:
            raise Rejected("the cuts are an even number of pairs")
        if type(self.unique) is not bool:
            raise Rejected("the cycle is unique or not")
        if self.unique and not self.contraction < 0:
            raise Rejected("a cycle is unique where the integral of the divergence is negative")

    @property
    def sides(self) -> list[tuple[Cut, Cut]]:
        """The last sector ends at the first cut."""
        return list(zip(self.cuts, [*self.cuts[1:], self.cuts[0]]))

    def checked(self) -> CheckedAnnulus:
        self._require_nested()
        for polygon, side in ((self.outer, 1), (self.inner, -1)):
            for one, two in zip(polygon, [*polygon[1:], polygon[0]]):
                self.require_crossed(one, two, side)
        least, most, contraction = self.turn()
        if not (self.period[0] <= least and most <= self.period[1]):
            raise Rejected("the period is not within its bounds")
        if self.unique and not contraction <= self.contraction:
            raise Rejected("the integral of the divergence is not below its bound")
        xs, ys = ([[Fraction(v, self.scale) for v in row] for row in zip(*p)] for p in (self.outer, self.inner))
        sides = tuple(((min(a), min(b)), (max(b), max(a))) for a, b in zip(xs, ys))
        return CheckedAnnulus(
            float(self.epsilon), self.unique, (float(self.period[0]), float(self.period[1])),
            float(self.contraction), tuple(tuple((float(a), float(b)) for a, b in side) for side in sides),
            (len(self.outer), len(self.inner)),
        )  # fmt: skip

    def _require_nested(self) -> None:
        n, m = len(self.outer), len(self.inner)
        segments = [(i, (i + 1) % n) for i in range(n)] + [(n + i, n + (i + 1) % m) for i in range(m)]
        segments += [(o, n + i) for o, i in self.cuts]
        self.require_apart(segments)
        # Where a vertex stands twice two edges have met; two vertices have no area.
        if area(self.outer) <= 0 or area(self.inner) <= 0:
            raise Rejected("the polygons are counterclockwise")
        x, y = self.inner[0]
        crossed = 0
        for one, two in zip(self.outer, [*self.outer[1:], self.outer[0]]):
            if (one[1] > y) != (two[1] > y):
                crossed += orientation(one, two, (x, y)) * (1 if two[1] > one[1] else -1) > 0
        if not crossed % 2:
            raise Rejected("the inner polygon is not inside the outer one")
        for k, places in enumerate(zip(*self.cuts)):
            if sum(b <= a for a, b in zip(places, [*places[1:], places[0]])) != 1:
                raise Rejected(f"the cuts do not follow one another around polygon {k}")
        if any(self.outer[o][1] != self.inner[i][1] for o, i in self.cuts):
            raise Rejected("a cut is not along the slow variable")
