"""Critical rates of one state: connections found by Newton's method from several guesses."""

from __future__ import annotations

from functools import partial
from itertools import product

import numpy as np
import sympy as sp

from gsp.integration.trajectory import trajectory_of
from gsp.roots import ROUNDING
from gsp.singular.ramps.connection import SAME, Connection, RampEnds, connection
from gsp.singular.ramps.ramped import SHORTEST, Place, Ramped
from gsp.systems.system import VectorField

# Newton's method starts at these shares of the rate at which the ramp is as fast as the field.
SHARES = np.logspace(-2.0, 2.0, 9)
# A rest point that is followed away and back is found again to this share of the way.
RETURNED = 1e-9
# Tolerance of a run to the next branch.
RTOL = 1e-8


def thresholds(given: Ramped, way: list[Place], edge: Place) -> tuple[tuple[bool, bool], list[Connection]]:
    """Whether slow ramps tip, and fast ones, and the connections from the start of `way` to `edge`, by their rates."""
    begin, end = way[0], slow_end(given, way, edge.s)
    side = np.sign((end if way[-1].s == edge.s else begin.x[0]) - edge.x[0])
    tips = bool(side * (end - edge.x[0]) < 0.0), bool(side * (begin.x[0] - edge.x[0]) < 0.0)
    return tips, _connections(given, way, edge, odd=tips[0] != tips[1])


def slow_end(given: Ramped, way: list[Place], last: float) -> float:
    """Where slow ramps end: past a fold on the next branch, and so on; infinite where there is none."""
    first = way[0].s
    while way[-1].s != last:
        # Just beyond the fold, where its two rest points are gone.
        s = way[-1].s + SHORTEST**0.5 * (last - first)
        if (s - last) * (last - first) >= 0.0:
            return float(way[-1].x[0])
        x = _next_rest(given, way[-1], s)
        if not np.isfinite(x):
            return x
        way = given.followed(Place(s, np.array([x])), last)
    return float(way[-1].x[0])


def comes_back(given: Ramped, way: list[Place], last: float) -> bool:
    """Whether slow ramps that leave their branch end where they began."""
    begin, moved = way[0].x[0], np.ptp([place.x[0] for place in way])
    # Both are known to what Newton's method leaves of them.
    return bool(abs(slow_end(given, way, last) - begin) <= RETURNED * moved + 8.0 * ROUNDING * abs(begin))


def _next_rest(given: Ramped, begin: Place, s: float) -> float:
    """The rest point to which x' = f(x, s) leads from where it has just lost one; infinite where it leads away."""
    phase, (state,) = given.ramp.phase, given.field.states
    rate = given.field.rates[0].xreplace({phase: sp.Float(s, 17)})
    still = VectorField({state: rate}, epsilon=None, parameters=given.kept)
    x, time = float(begin.x[0]), 1.0
    for _ in range(64):
        run = trajectory_of(still, {state.name: x}, (0.0, time), None, RTOL, RTOL * (abs(x) or 1.0))
        if not run.status.ok:
            return float(np.sign(run.y[0, -1] - x) * np.inf)
        reached = float(run.y[0, -1])
        rest = given.rest_point(np.array([reached]), s)
        # A run has come to a rest point when it is this near, as a share of the way.
        if rest is not None and abs(rest[0] - reached) <= 1e-4 * abs(rest[0] - begin.x[0]):
            return float(rest[0])
        x, time = reached, 2.0 * time
    return float(np.sign(x - begin.x[0]) * np.inf)


def _connections(given: Ramped, way: list[Place], edge: Place, odd: bool) -> list[Connection]:
    """From straight lines, and from the branch of the start followed by that of the edge, as of slow ramps.

    It ends when the count is `odd` as it should be, and, where none is found, after more than straight lines.
    """
    first, last, begin = way[0].s, edge.s, way[0]

    def rates(x: np.ndarray, at: np.ndarray) -> np.ndarray:
        found = given.rates(x[:, np.newaxis], at)
        return np.column_stack([found.f[:, 0], found.f_x[:, 0, 0], found.rho])

    ends = RampEnds((first, float(begin.x[0])), (last, float(edge.x[0])))
    natural = given.natural(begin)
    back = [edge]
    found: list[Connection] = []
    # A guess of the orbit is a straight line, or the branch of the start, then that of the edge; it changes at one of
    # so many parts of the way, more of them until the number of rates is odd or even as the limits ask for.
    for number in (0, 4, 16):
        if number and len(back) == 1:
            back = given.followed(edge, first)
        for shape, share in product(_shapes(way, back, number), SHARES):
            one = connection(rates, ends, natural * share, partial(_through, shape), found)
            if one is not None and all(abs(one.rate - c.rate) > SAME * c.rate for c in found):
                found.append(one)
        if len(found) % 2 == odd and (found or number):
            break
    return sorted(found, key=lambda c: c.rate)


def _shapes(way: list[Place], back: list[Place], number: int) -> list[np.ndarray]:
    """Places (k, 2) of (s, x): the straight line, or changes from `way` to `back` at `number` parts of the way."""
    first, last = way[0].s, back[0].s
    shapes = []
    for share in (np.arange(number) + 1.0) / (number + 1.0):
        at = first + share * (last - first)
        before = [(p.s, p.x[0]) for p in way if abs(p.s - first) <= abs(at - first)]
        after = [(p.s, p.x[0]) for p in back if abs(p.s - last) < abs(at - last)]
        shapes.append(np.array([*before, *reversed(after)]))
    return shapes or [np.array([(p.s, p.x[0]) for p in (way[0], back[0])])]


def _through(places: np.ndarray, at: np.ndarray) -> np.ndarray:
    """x at s along straight lines between `places` (k, 2) of (s, x)."""
    return np.interp(at, *places[np.argsort(places[:, 0])].T)
