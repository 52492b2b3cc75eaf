"""Check a proof about a passage: whole numbers, a parser and derivatives of its own, nothing of the prover.

A file holds the rates, and a strip or a delay. Of a strip theorem 10 of docs/proofs.md is checked anew:

- its lines are simple and meet nowhere, its cuts meet nothing, its sectors are counterclockwise: exactly;
- where a line goes through (0, 0) as a corner, g and its slopes vanish there: in fractions;
- orbits cross every edge into it and every cut along it, for every epsilon in (0, epsilon_0];
- f and g + epsilon h keep one sign in turn in the sectors, and sums over slices of them are within the bounds.

Of a delay it is theorem 11: sums of bounds of k/f.
"""

from __future__ import annotations

import re
from fractions import Fraction
from itertools import pairwise
from typing import Any

from gsp.proofs import intervals as ia
from gsp.proofs import second_derivatives, untrusted
from gsp.proofs.band_checker import MOST_OPERATIONS, MOST_STRIPS, BandChecker, Cut, Vertex, area, program_of
from gsp.proofs.checked_passage import CheckedDelay, CheckedPassage, CheckedStrip, Side
from gsp.proofs.intervals import Interval
from gsp.proofs.programs import IntervalProgram, Rejected

FORMAT = "gsp passage 1"


def check(read: Any) -> CheckedPassage:
    """Check the plain values of a file; raises `Rejected` with the reason when the proof does not hold."""
    return untrusted.guarded(lambda: _checked(read))


def _checked(read: Any) -> CheckedPassage:
    untrusted.of_format(read, FORMAT)
    origin = tuple(read_fraction(text) for text in read["origin"])
    if len(origin) != 2:
        raise Rejected("an origin has two coordinates")
    if "delay" in read:
        names, _, program = read_field(read)
        found: CheckedStrip | CheckedDelay = DelayChecker(read["delay"], program).checked()
    else:
        names, program = program_of(read["names"], read["rates"])
        found = StripChecker(read["strip"], program).checked()
    return CheckedPassage(names, tuple(read["rates"]), origin, found)


def read_field(read: dict) -> tuple[tuple[str, ...], list, IntervalProgram]:
    """Names, rates and their program of one slow and one fast variable."""
    names, rates = untrusted.names(read["names"]), read["rates"]
    if len(names) != 3 or not isinstance(rates, list) or len(rates) != 2:
        raise Rejected("a slow and a fast variable and epsilon have names, and there are two rates")
    return names, rates, IntervalProgram(tuple(rates), 3)


def read_fraction(text: Any) -> Fraction:
    """A fraction p/q."""
    # Digits of a number of the origin. Fraction itself reads 1e99999999 too, and takes minutes to write out its zeros.
    if not isinstance(text, str) or len(text) > 40 or not re.fullmatch("-?[0-9]+(/[0-9]+)?", text):
        raise Rejected(f"a coordinate of the origin is a fraction. Got {str(text)[:60]!r}")
    return Fraction(text)


class StripChecker(BandChecker):
    """What is claimed of a strip."""

    def __init__(self, read: Any, program: IntervalProgram) -> None:
        self.slow_first, self.cornered = read["slow_first"], read["cornered"]
        if type(self.slow_first) is not bool or type(self.cornered) is not bool:
            raise Rejected("the slow rate is first or not, and a strip is cornered or not")
        super().__init__(read, program)

    @property
    def sides(self) -> list[tuple[Cut, Cut]]:
        """Each sector leads from one cut to the next."""
        return list(pairwise(self.cuts))

    def checked(self) -> CheckedStrip:
        """Check all of it."""
        self._require_strip()
        if self.cornered:
            self._require_corner()
        for line, side in ((self.outer, 1), (self.inner, -1)):
            for one, two in pairwise(line):
                self.require_crossed(one, two, side)
        for o, i in self.cuts:
            self.require_crossed(self.outer[o], self.inner[i], -1)
        least, most, contraction = self.turn()
        if not (self.period[0] <= least and most <= self.period[1]):
            raise Rejected("the time is not within its bounds")
        if not contraction <= self.contraction:
            raise Rejected("the integral of the divergence is not below its bound")
        return CheckedStrip(
            float(self.epsilon), self._section(0), self._section(-1),
            (float(self.period[0]), float(self.period[1])), float(self.contraction),
        )  # fmt: skip

    def _section(self, place: int) -> tuple[Side, Side]:
        # Coordinates are doubles.
        (a, b), (c, d) = (
            sorted(float(Fraction(v, self.scale)) for v in pair)
            for pair in zip(self.outer[place], self.inner[place])
        )
        return (a, b), (c, d)

    def _require_strip(self) -> None:
        n, m = len(self.outer), len(self.inner)
        if min(n, m) < 2:
            raise Rejected("the lines have at least two vertices")
        if self.cuts[0] != (0, 0) or self.cuts[-1] != (n - 1, m - 1):
            raise Rejected("the first cut and the last join the ends of the lines")
        if any(b <= a for one, two in pairwise(self.cuts) for a, b in zip(one, two)):
            raise Rejected("the cuts do not follow one another along both lines")
        segments = [*pairwise(range(n)), *pairwise(range(n, n + m)), *((o, n + i) for o, i in self.cuts)]
        self.require_apart(segments)
        if any(area(self.sector(k)) <= 0 for k in range(len(self.sides))):
            raise Rejected("the sectors are counterclockwise")

    # -- where branches meet -----------------------------------------------------------------------

    def _require_corner(self) -> None:
        """At (0, 0) g vanishes and so do its slopes; it does not depend on epsilon."""
        none = [Fraction(0)] * 3
        for k in range(2):
            way = [Fraction(int(i == k)) for i in range(3)]
            if any(second_derivatives.exactly(self.program, 1, none, way)[:2]):
                raise Rejected("the fast rate and its slopes do not vanish where branches meet")
        if self._holds_epsilon(self.program.outputs[1]):
            raise Rejected("the fast rate depends on epsilon where branches meet")

    def _holds_epsilon(self, place: int) -> bool:
        holds = [False, False, True]
        for name, one, two in self.program.code:
            operands = 0 if name in ("constant", "pi", "E") else 2 if name in ("+", "-", "*", "/") else 1
            holds.append(any(holds[part] for part in (one, two)[:operands]))
        return holds[place]

    def require_crossed(self, one: Vertex, two: Vertex, side: int) -> None:
        """At a corner limit >= 0 where its second derivative along the edge is, and slow > 0 is asked for."""
        if not (self.cornered and (0, 0) in (one, two)):
            return super().require_crossed(one, two, side)
        dx, dy = (self._real(v) for v in (two[0] - one[0], two[1] - one[1]))
        sign = side * ((two[0] > one[0]) - (two[0] < one[0]))
        self.require_pieces(one, two, lambda box, *_: self._turns_from_corner(box, (dx, dy), sign, side))
        return None

    def _turns_from_corner(
        self, box: list[Interval], way: tuple[Interval, Interval], sign: int, side: int
    ) -> bool:
        bend = second_derivatives.along(self.program, 1, box, [*way, ia.ZERO])[2]
        f, _, h = self.program.values(box)
        slow = ia.subtract(ia.multiply(way[0], h), ia.multiply(way[1], f))
        return (bend[0] >= 0 if sign > 0 else bend[1] <= 0) and (slow[0] > 0 if side > 0 else slow[1] < 0)


class DelayChecker:
    """What is claimed of a delay: |v| <= `width`, or 0 <= v <= `width` where it is `above`, along `grid`, kept to one
    of its places and left by another.
    """

    def __init__(self, read: Any, program: IntervalProgram) -> None:
        self.program = program
        self.epsilon, self.width = untrusted.number(read["epsilon"]), untrusted.number(read["width"])
        if not (self.epsilon > 0 and self.width > 0):
            raise Rejected("epsilon and the width are positive")
        self.above = read["above"]
        if type(self.above) is not bool:
            raise Rejected("orbits are above the sheet or on both sides")
        row = read["grid"]
        self.grid = untrusted.numbers(row, min(len(row), MOST_STRIPS))
        rising = self.grid[-1] > self.grid[0]
        if len(self.grid) < 2 or any((b > a) != rising or a == b for a, b in pairwise(self.grid)):
            raise Rejected("a grid is a row of rising or of falling numbers")
        self.way = 1 if rising else -1
        self.kept = untrusted.count(read["kept"], len(self.grid) - 1)
        self.left = None if read["left"] is None else untrusted.count(read["left"], len(self.grid) - 1)
        self.growth = Fraction(0)
        self.time, self.depth = untrusted.numbers(read["time"], 2), untrusted.number(read["depth"])
        if not self.kept or (self.left is not None and self.left <= self.kept):
            raise Rejected("orbits stay for a while, and leave after it")

    def checked(self) -> CheckedDelay:
        """Check all of it."""
        least, most, depth = self.bounds()
        if not (self.time[0] <= least and most <= self.time[1] and self.depth <= depth):
            raise Rejected("the time or the depth is not within its bounds")
        return CheckedDelay(
            float(self.epsilon), float(self.width), float(self.grid[0]), float(self.grid[self.kept]),
            None if self.left is None else float(self.grid[self.left]), (float(self.time[0]), float(self.time[1])),
            float(self.depth), self.above,
        )  # fmt: skip

    def bounds(self) -> tuple[Fraction, Fraction, Fraction]:
        """Of the time to `kept` and to `left`, and of the depth; raises `Rejected` where orbits are not seen to stay
        and to leave. Sets `growth`, which bounds the integral of v k_v + epsilon f_x on the way.
        """
        upper, lower, deepest, least, most, growth = 0, 0, 0, 0, 0, 0
        for i in range(1, 1 + (self.left or self.kept)):
            self.program.spend(0, MOST_OPERATIONS)
            change, crude, time, grown = self._strip(self.grid[i - 1], self.grid[i])
            # Between the places of the grid the sum is below its start plus what it may gain.
            stays = crude[1] < 0 if i == 1 else upper + max(crude[1], 0) < 0
            upper, lower = upper + change[1], lower + change[0]
            most, growth = most + time[1], growth + max(grown, 0)
            if i <= self.kept:
                if not (stays and upper < 0):
                    raise Rejected(f"orbits are not seen to stay at {float(self.grid[i]):.6g}")
                least, deepest = least + time[0], min(deepest, upper)
        if self.left is not None and not lower > 0:
            raise Rejected(f"orbits are not seen to have left at {float(self.grid[self.left]):.6g}")
        self.growth = Fraction(growth, ia.ONE)
        return Fraction(least, ia.ONE), Fraction(most, ia.ONE), Fraction(-deepest, ia.ONE)

    def _strip(self, one: Fraction, two: Fraction) -> tuple[Interval, Interval, Interval, int]:
        """The integral of k/|f| over a strip as it is known at best, its crude bounds of any part, the time, and an
        upper bound of the integral of v k_v + epsilon f_x.
        """
        low, high = min(one, two), max(one, two)
        w = ia.of(high - low)
        small = (0, ia.of(self.epsilon)[1])
        width = ia.of(self.width)[1]
        tube = (0 if self.above else -width, width)
        box = [ia.hull(ia.of(low), ia.of(high)), tube, small]
        f, k = self.program.values(box)
        if not (f[0] > 0 if self.way > 0 else f[1] < 0):
            raise Rejected("the slow rate is not seen to keep its sign along the sheet")
        by_f, by_k = self.program.derivatives(box)
        ratio = ia.divide(k, f)
        by_x, by_v = (ia.divide(ia.subtract(by_k[i], ia.multiply(ratio, by_f[i])), f) for i in (0, 1))
        values = self.program.values([ia.of((low + high) / 2), ia.ZERO, small])
        at = ia.divide(values[1], values[0])
        half = ia.of((high - low) / 2)[1]
        # |v| times the slope from v = 0, and half^2/2 times the range of the slope by x.
        error = (half * half * (by_x[1] - by_x[0]) >> 2 * ia.SHIFT + 1) + 2
        error += ia.multiply(w, ia.multiply((0, width), (0, ia.magnitude(by_v))))[1]
        sign = ia.of(Fraction(self.way))
        change = ia.add(ia.multiply(sign, ia.multiply(w, at)), (-error, error))
        crude = ia.multiply(sign, ia.multiply(w, ratio))
        time = ia.divide(w, ia.multiply(sign, f))
        grown = ia.multiply(ia.add(ia.multiply(tube, by_k[1]), ia.multiply(small, by_f[0])), time)[1]
        return ia.common(change, crude), crude, time, grown
