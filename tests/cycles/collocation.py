"""Cycles in 34 digits by Radau's collocation with nine stages, a second route to what is proved about them.

Nothing is shared with the package: nodes and weights are computed here, in balls whose middles are kept.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import comb

import mpmath
from flint import arb, arb_mat, ctx

STAGES = 9
DIGITS = 34
# Of the polynomial of a step the highest coefficient, by Legendre polynomials, relative to the values.
TOLERANCE = 1e-17

# (f, g, f_x, f_y, g_x, g_y) at a point.
Field = Callable[[arb, arb], tuple[arb, arb, arb, arb, arb, arb]]


@dataclass(frozen=True)
class ComputedCycle:
    """The period, the integral of epsilon times the divergence, and the least and largest x and y at nodes."""

    period: float
    divergence: float
    ends: tuple[tuple[float, float], tuple[float, float]]


def _method() -> tuple[list[arb], list[list[arb]], list[arb]]:
    """Nodes, the matrix of Runge and Kutta, and the weights of the divided difference over 0 and the nodes."""
    with mpmath.workdps(DIGITS + 20):
        shifted = [
            [(-1) ** (n + k) * comb(n, k) * comb(n + k, k) for k in range(n, -1, -1)]
            for n in (STAGES, STAGES - 1)
        ]
        roots = mpmath.polyroots(
            [a - b for a, b in zip(shifted[0], [0, *shifted[1]])], maxsteps=500, extraprec=500
        )
        nodes = sorted(mpmath.re(r) for r in roots)
        powers = mpmath.matrix(STAGES, STAGES)
        integrals = mpmath.matrix(STAGES, STAGES)
        for i, c in enumerate(nodes):
            for k in range(STAGES):
                powers[i, k], integrals[i, k] = c**k, c ** (k + 1) / (k + 1)
        matrix = integrals * powers**-1
        all_nodes = [mpmath.mpf(0), *nodes]
        weights = [1 / mpmath.fprod(a - b for b in all_nodes if b != a) for a in all_nodes]
        number = lambda v: arb(mpmath.nstr(v, DIGITS + 10)).mid()  # noqa: E731
        rows = [[number(matrix[i, j]) for j in range(STAGES)] for i in range(STAGES)]
        return [number(c) for c in nodes], rows, [number(w) for w in weights]


class Turns:
    """Steps of x' = f, epsilon y' = g from a point."""

    def __init__(self, field: Field, epsilon: float, start: tuple[float, float]) -> None:
        self.field, self.epsilon = field, arb(epsilon)
        self.nodes, self.matrix, self.weights = _method()
        self.point = [arb(v) for v in start]
        self.before: tuple[list[list[arb]], arb] | None = None
        self.h = arb(epsilon) / 100

    def stages(self, h: arb) -> list[list[arb]] | None:
        """The stages of a step by Newton's method; None where it does not converge."""
        s, e = STAGES, self.epsilon
        values = self._guess(h)
        for _ in range(12):
            rates = [self.field(*value) for value in values]
            matrix, right = arb_mat(2 * s, 2 * s), arb_mat(2 * s, 1)
            for i in range(s):
                sums = [values[i][0] - self.point[0], values[i][1] - self.point[1]]
                for j, (f, g, f_x, f_y, g_x, g_y) in enumerate(rates):
                    a = h * self.matrix[i][j]
                    sums = [(sums[0] - a * f), (sums[1] - a * g / e)]
                    for row, entries in enumerate(((f_x, f_y), (g_x / e, g_y / e))):
                        for column, entry in enumerate(entries):
                            unit = 1 if i == j and row == column else 0
                            matrix[2 * i + row, 2 * j + column] = (unit - a * entry).mid()
                right[2 * i, 0], right[2 * i + 1, 0] = sums[0].mid(), sums[1].mid()
            try:
                change = matrix.solve(right)
            except ZeroDivisionError:
                return None
            values = [
                [(v - change[2 * i + k, 0]).mid() for k, v in enumerate(value)]
                for i, value in enumerate(values)
            ]
            size = max(abs(float(change[i, 0].mid())) for i in range(2 * s))
            if not size < 10.0:
                return None
            # Newton's method squares the error: what is left is below the digits.
            if size < 1e-18:
                return values
        return None

    def _guess(self, h: arb) -> list[list[arb]]:
        # Too far ahead a polynomial says nothing.
        if self.before is None or not 0.0 < float((h / self.before[1]).mid()) < 4.0:
            return [list(self.point) for _ in self.nodes]
        values, width = self.before
        places = [arb(0), *self.nodes]
        found = []
        for c in self.nodes:
            at = 1 + c * h / width
            total = [arb(0), arb(0)]
            product = arb(1)
            for place in places:
                product *= at - place
            for weight, place, value in zip(self.weights, places, values):
                share = (product * weight / (at - place)).mid()
                total = [(t + share * v).mid() for t, v in zip(total, value)]
            found.append(total)
        return found

    def step(self, h: arb) -> tuple[list[list[arb]], float] | None:
        """The values at 0 and at the nodes, and the highest coefficient over the tolerance."""
        found = self.stages(h)
        if found is None:
            return None
        values = [self.point, *found]
        highest = [
            abs(float(sum((w * v[k] for w, v in zip(self.weights, values)), arb(0)).mid())) for k in (0, 1)
        ]
        return values, max(highest) / comb(2 * STAGES, STAGES) / TOLERANCE

    def advance(self) -> tuple[list[list[arb]], arb]:
        """A step that keeps the tolerance: its values and its length."""
        while True:
            found = self.step(self.h)
            if found is None:
                self.h = (self.h / 4).mid()
                continue
            values, error = found
            factor = 0.9 * (1.0 / max(error, 1e-9)) ** (1.0 / (STAGES + 1))
            h, self.h = self.h, (self.h * min(2.0, max(0.2, factor))).mid()
            if error <= 1.0:
                return values, h


def computed_cycle(
    field: Field, epsilon: float, start: tuple[float, float], level: float, turns: int = 2
) -> ComputedCycle:
    """The last of some turns from `start`, between passages of x = `level` in the direction of the start."""
    ctx.prec, before = int(DIGITS * 3.33), ctx.prec
    try:
        return _turned(Turns(field, epsilon, start), level, turns)
    finally:
        ctx.prec = before


def passed(
    field: Field, epsilon: float, start: tuple[float, float], axis: int, level: float
) -> tuple[float, float, float]:
    """From `start` to where x (axis 0) or y (1) first is `level`: the time, the other coordinate there, and the
    integral of epsilon times the divergence.
    """
    ctx.prec, before = int(DIGITS * 3.33), ctx.prec
    try:
        run = Turns(field, epsilon, start)
        way = 1 if run.point[axis] < level else -1
        time, divergence = arb(0), arb(0)
        while True:
            point = list(run.point)
            values, h = run.advance()
            arrived = way * (values[-1][axis] - level) >= 0
            for _ in range(8 if arrived else 0):
                rate = run.field(*values[-1])[axis] / (run.epsilon if axis else 1)
                h = (h - (values[-1][axis] - level) / rate).mid()
                stages = run.stages(h)
                assert stages is not None
                values = [point, *stages]
            time = (time + h).mid()
            for weight, value in zip(run.matrix[-1], values[1:]):
                _, _, f_x, _, _, g_y = run.field(*value)
                divergence = (divergence + h * weight * (g_y + run.epsilon * f_x)).mid()
            run.before, run.point = (values, h), list(values[-1])
            if arrived:
                return float(time.mid()), float(values[-1][1 - axis].mid()), float(divergence.mid())
    finally:
        ctx.prec = before


def _turned(run: Turns, level: float, turns: int) -> ComputedCycle:
    way = 1 if run.field(*run.point)[0] > 0 else -1
    passed, time, divergence = 0, arb(0), arb(0)
    seen: list[list[arb]] = []
    last = run.matrix[-1]
    while True:
        point = list(run.point)
        values, h = run.advance()
        if way * (point[0] - level) < -1e-20 and way * (values[-1][0] - level) >= 0:
            for _ in range(6):
                # Newton's method for the length of the step that ends on the section.
                h = (h - (values[-1][0] - level) / run.field(*values[-1])[0]).mid()
                stages = run.stages(h)
                assert stages is not None
                values = [point, *stages]
            passed += 1
        time = (time + h).mid()
        for weight, value in zip(last, values[1:]):
            _, _, f_x, _, _, g_y = run.field(*value)
            divergence = (divergence + h * weight * (g_y + run.epsilon * f_x)).mid()
        seen += values
        run.before, run.point = (values, h), list(values[-1])
        if abs(float((values[-1][0] - level).mid())) < 1e-25:
            if passed > turns:
                ends = tuple(
                    (min(float(v[k].mid()) for v in seen), max(float(v[k].mid()) for v in seen)) for k in (0, 1)
                )
                return ComputedCycle(float(time.mid()), float(divergence.mid()), (ends[0], ends[1]))
            time, divergence, seen = arb(0), arb(0), []
