"""A solution of x' = R(x) enclosed, by Taylor's theorem along the flow in ball arithmetic.

A step of length h goes along the Taylor polynomial from a point; the coefficient of order K over a box that holds the
solution bounds the rest, and the logarithmic norm of D R over the box how far the old error has spread.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import sympy as sp
from flint import arb

from gsp.algebra.differentiation import jacobian
from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction
from gsp.slow_tubes.isolation import norm
from gsp.slow_tubes.series_function import SeriesFunction

# Coefficients of a step, the last of them for the rest.
ORDER = 14
# The rest of a step is to be of this size, a rounding of PRECISION bits and no more.
REST = 1e-17
# A box that does not hold its own image is widened so often, by this factor.
WIDENINGS, WIDER = 20, 1.3


@dataclass(frozen=True, eq=False)
class ValidatedStep:
    """The solution for t in [`start`, `end`]: within `radius` of the `polynomials` in t - start, inside `box`."""

    start: float
    end: float
    polynomials: tuple[tuple[arb, ...], ...]
    radius: arb
    box: tuple[arb, ...]

    def over(self, low: float | arb, high: float | arb) -> list[arb]:
        """A box (n,) that holds the solution between two times of the step."""
        span = (arb(low) - arb(self.start)).union(arb(high) - arb(self.start))
        spread = balls.hull(-1.0, 1.0) * self.radius
        return [_horner(p, span) + spread for p in self.polynomials]


def solution_steps(
    field: Sequence[sp.Expr], x: Sequence[sp.Symbol], start: Sequence[arb], end: float
) -> Iterator[ValidatedStep]:
    """Steps of x' = `field`(x) from x(0) in the balls `start` to the time `end`, fewer where the next is not proved.

    Raises `UnsupportedFunctionError` for a function without an enclosure.
    """
    series = SeriesFunction(x, field)
    slopes = BallFunction(x, list(jacobian(field, x)))
    value = BallFunction(x, list(field))
    n = len(x)
    point = [arb(b.mid()) for b in start]
    radius = norm([b - m for b, m in zip(start, point)])
    t = 0.0
    while t < end:
        taylor = _solution(series, point)
        steepest = max(balls.magnitude(c[ORDER - 1]) for c in taylor)
        length = (REST / steepest) ** (1.0 / (ORDER - 1)) if steepest > 0.0 else end
        box = None
        # A step shorter than this share of the span ends the proof.
        while length > 1e-9 * end and box is None:
            after = min(end, t + length)
            # t + length is rounded; the step is as long as the two doubles are apart.
            step = balls.above(arb(after) - arb(t))
            box = _box(value, taylor, point, radius, step)
            length = 0.5 * length
        if box is None:
            return
        rest = [c[ORDER] for c in _solution(series, box)]
        polynomials = tuple((*c[:ORDER], r) for c, r in zip(taylor, rest))
        over = slopes(box)
        growth = (log_norm([over[i * n : (i + 1) * n] for i in range(n)]) * arb(step)).exp()
        spread = (radius * growth.union(arb(1))).upper()
        yield ValidatedStep(t, after, polynomials, spread, tuple(box))
        reached = [_horner(p, arb(after) - arb(t)) for p in polynomials]
        point = [arb(b.mid()) for b in reached]
        radius = (spread + norm([b - m for b, m in zip(reached, point)])).upper()
        t = after


def log_norm(matrix: list[list[arb]]) -> arb:
    """An upper bound of the logarithmic 2-norm of every matrix in a ball matrix, by rows of the symmetric part."""
    largest = None
    for i, row in enumerate(matrix):
        total = row[i].upper()
        for k in range(len(row)):
            if k != i:
                total = (total + ((row[k] + matrix[k][i]) / 2).abs_upper()).upper()
        largest = total if largest is None or not total <= largest else largest
    assert largest is not None
    return largest


def _box(
    value: BallFunction, taylor: list[list[arb]], point: list[arb], radius: arb, length: float
) -> list[arb] | None:
    """A box that every solution from `radius` about `point` stays in for `length`: it holds its own Picard image."""
    span, spread = balls.hull(0.0, length), balls.hull(-1.0, 1.0) * radius
    box = [_horner(c[:ORDER], span) + spread for c in taylor]
    for _ in range(WIDENINGS):
        wide = [
            b + balls.hull(-1.0, 1.0) * (arb(b.rad()) * (WIDER - 1.0) + arb(1e-15) * (1 + b.abs_upper()))
            for b in box
        ]
        rates = value(wide)
        image = [p + spread + span * rate for p, rate in zip(point, rates)]
        if all(i.is_finite() and w.contains_interior(i) for i, w in zip(image, wide)):
            return image
        if not all(i.is_finite() for i in image):
            return None
        box = [w.union(i) for w, i in zip(wide, image)]
    return None


def _horner(coefficients: Sequence[arb], at: arb) -> arb:
    total = coefficients[-1]
    for c in coefficients[-2::-1]:
        total = total * at + c
    return total


def _solution(function: SeriesFunction, point: Sequence[arb]) -> list[list[arb]]:
    """Taylor coefficients (n, ORDER + 1) in time of the solution of x' = `function`(x) through `point`."""
    coefficients = [[p] for p in point]
    for k in range(ORDER):
        for c, v in zip(coefficients, function(coefficients, k + 1)):
            c.append(v[k] / (k + 1))
    return coefficients
