"""Critical rates of several states: the unstable set of the start is carried to a section, and matched there.

The rest point where the ramp starts is attracting, so that one orbit leaves it with the phase. The edge state where the
ramp ends has one unstable direction, so that its stable set has one dimension less than the space of states and phase
and divides it. Next to the edge u = w (x - x_1) + c (s - s_1) is the distance from that set, w a left eigenvector of
its growth k. An orbit that passes the edge leaves the section |u| = d after the time T on the side that it ends on, and

    gap(r) = sign(u) exp(-k T)                                                                               (1)

is smooth in r and zero at the critical rates: exp(k T) is what the passage makes of the distance. Its zeros are
bracketed by runs that end differently. Where rounding decides how a run ends, as beside a rest point that no longer
attracts, its sign is that of a coin.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import sympy as sp

from gsp.errors import Status
from gsp.integration.trajectory import Trajectory, trajectory_of
from gsp.roots import root
from gsp.singular.ramps.connection import Connection, zero_error
from gsp.singular.ramps.ramp_run import RATE, leaving
from gsp.singular.ramps.ramped import Place, Ramped
from gsp.systems.system import VectorField

# Runs are this accurate, and errors are told by others that are less so.
FINE, COARSE = 1e-12, 1e-10
# Rates are tried over three decades on both sides of the one at which the ramp is as fast as the field.
DECADES, PER_DECADE = 3, 10
# Times that a run is given to come to rest after the ramp, in slowest time constants.
SETTLING = 40.0
# A run that ends so near to a rest point, by the distance of the two that the edge divides, ends in it.
NEAR = 0.1
# A zero is looked at from these shares of the way between the rates that bracket it: where rounding decides, signs are
# those of a coin.
CLOSER = tuple(10.0**-k for k in range(1, 9))


class Edge(NamedTuple):
    """The edge state: its place, its growth k, left and right eigenvectors with w v = 1, and f_s there."""

    place: Place
    growth: float
    w: np.ndarray
    v: np.ndarray
    drift: float

    def distance(self, x: np.ndarray, s: np.ndarray, speed: float) -> np.ndarray:
        """u of (1) at x (n, m) and s (m,); `speed` is r rho_s at the end."""
        return self.w @ (x - self.place.x[:, np.newaxis]) + self.drift / (self.growth - speed) * (
            s - self.place.s
        )


def edge_at(given: Ramped, place: Place) -> Edge | None:
    """The edge state there; None where not just one direction is unstable."""
    rates = given.at(place.x, place.s)
    values, vectors = np.linalg.eig(rates.f_x)
    real = np.real(values)
    order = np.argsort(real)
    if not (real[order[-1]] > 0.0 and (real[order[:-1]] < 0.0).all()):
        return None
    v, w = np.real(vectors[:, order[-1]]), np.real(np.linalg.inv(vectors)[order[-1]])
    return Edge(place, float(real[order[-1]]), w, v, float(w @ rates.f_s))


@dataclass(frozen=True, eq=False)
class Passage:
    """Runs along a ramp from `begin` past `edge`, at any rate."""

    given: Ramped
    begin: Place
    edge: Edge

    @cached_property
    def units(self) -> np.ndarray:
        """Powers of 2 (n,) in which the states are run, so that one tolerance serves them all."""
        size = np.maximum(np.abs(self.begin.x), np.abs(self.edge.place.x))
        size = np.where(size > 0.0, size, np.abs(self.edge.v))
        return 2.0 ** np.round(np.log2(np.where(size > 0.0, size, 1.0)))

    @cached_property
    def _fields(self) -> tuple[VectorField, VectorField, bool]:
        """The field along the ramp and that where it ends, both in `units`; whether the phase is at rest there.

        Where it is, the ramp is run over time. Where it is not, over s, or over log |s - s_0| where it starts at rest.
        """
        given, phase = self.given, self.given.ramp.phase
        units = [sp.Rational(float(c)) for c in self.units]
        own = {x: c * x for x, c in zip(given.field.states, units)}
        f = {x: rate.xreplace(own) / c for (x, rate), c in zip(given.field.equations.items(), units)}
        first, last = given.ends
        frozen = VectorField(
            {x: rate.xreplace({phase: given.ramp.ends[1]}) for x, rate in f.items()},
            epsilon=None,
            parameters=given.kept,
        )
        rho = given.ramp.profile
        if given.rests_at(last):
            return VectorField({**f, phase: RATE * rho}, epsilon=RATE, parameters=given.kept), frozen, True
        at, pace = phase, sp.S.One
        if given.rests_at(first):
            pace = sp.exp(phase) if last > first else -sp.exp(phase)
            at = given.ramp.ends[0] + pace
        over = {x: (rate / (RATE * rho)).xreplace({phase: at}) * pace for x, rate in f.items()}
        return VectorField({**over, phase: sp.S.One}, epsilon=RATE, parameters=given.kept), frozen, False

    @cached_property
    def settling(self) -> float:
        """The time after the ramp by which a run has come to rest, or never does."""
        last = self.edge.place.s
        places = [self.begin, *(Place(last, x) for x in self.sides if x is not None)]
        return self._patience(places)

    def _patience(self, places: list[Place]) -> float:
        slowest = min(self.edge.growth, *(np.abs(self.given.growth(place)).min() for place in places))
        return 2.0 * SETTLING / float(slowest)

    @cached_property
    def _way(self) -> float:
        """r times the time along a ramp that comes to rest, ample."""
        (first, last), x = self.given.ends, self.begin.x
        return 2.0 * SETTLING / min(self.given.paces(x)) + abs(last - first) / self.given.speed(x)

    def runs(self, rate: float, rtol: float) -> list[Trajectory]:
        """The run along the ramp, and the one after it where the ramp stops; in `units`, over their own times."""
        moving, frozen, rests = self._fields
        first, last = self.given.ends
        names = [x.name for x in self.given.field.states]
        phase = self.given.ramp.phase.name
        x, s = leaving(self.given, self.begin, rate)

        def run(
            flow: VectorField, x: np.ndarray, more: dict[str, float], span: tuple[float, float]
        ) -> Trajectory:
            small = rate if flow.epsilon is not None else None
            start = {**dict(zip(names, x)), **more}
            return trajectory_of(flow, start=start, span=span, epsilon=small, rtol=rtol, atol=1e-2 * rtol)

        if rests:
            time = self._way / rate
            return [run(moving, x / self.units, {phase: s}, (0.0, time + self.settling))]
        if self.given.rests_at(first):
            s, last = float(np.log(abs(s - first))), float(np.log(abs(last - first)))
        ramp = run(moving, x / self.units, {phase: s}, (s, last))
        if ramp.status is not Status.SUCCESS:
            return [ramp]
        after = run(frozen, ramp.y[: len(names), -1], {}, (0.0, self.settling))
        return [ramp, after]

    def orbit(self, rate: float) -> tuple[np.ndarray, np.ndarray]:
        """x (k, n) over the phase (k,) along the ramp at that rate."""
        run = self.runs(rate, FINE)[0]
        n, first = len(self.units), self.given.ends[0]
        s = run.y[n]
        if not self._fields[2] and self.given.rests_at(first):
            s = first + np.sign(self.given.ends[1] - first) * np.exp(s)
        return (self.units[:, np.newaxis] * run.y[:n]).T, s

    @cached_property
    def sides(self) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Where orbits next to the edge go on its lower and upper side; None where they come to no rest."""
        rests = [self._rest(run) for run in self._beside]
        return rests[0], rests[1]

    @cached_property
    def _beside(self) -> list[Trajectory]:
        """Runs from beside the edge along its unstable direction, on the lower and the upper side.

        As far from it along its stable ones, towards the start, lest they stay on a plane that is invariant, from which
        runs of ramps part.
        """
        names = [x.name for x in self.given.field.states]
        span = (0.0, 2.0 * self._patience([self.begin]))
        edge, aside = self.edge, self.begin.x - self.edge.place.x
        aside = aside - edge.v * (edge.w @ aside)
        # Orbits beside the edge begin by this away from it.
        along, across = (d * 1e-6 / (np.abs(d / self.units).max() or 1.0) for d in (edge.v, aside))
        starts = ((edge.place.x + across + sign * along) / self.units for sign in (-1.0, 1.0))
        return [
            trajectory_of(
                self._fields[1], start=dict(zip(names, start)), span=span, rtol=FINE, atol=1e-2 * FINE
            )
            for start in starts
        ]

    def _rest(self, run: Trajectory) -> np.ndarray | None:
        """The rest point at which a run has arrived, which attracts; None where it goes on, or diverges."""
        if run.status is not Status.SUCCESS:
            return None
        x = self.units * run.y[: len(self.units), -1]
        at = self.given.rest_point(x, self.edge.place.s)
        if at is None or not (self.given.growth(Place(self.edge.place.s, at)) < 0.0).all():
            return None
        # One that turns or drifts far away is as near to some rest point by its distance from the edge.
        whole = min(self._apart(x, self.edge.place.x), self._apart(self.begin.x, self.edge.place.x) or np.inf)
        return at if self._apart(at, x) <= NEAR * whole else None

    def ending(self, last: Trajectory) -> int:
        """-1 or 1 for the sides of the edge on which a run ends, 0 for elsewhere."""
        if last.status is Status.SUCCESS:
            side = self.side_of(self.units * last.y[: len(self.units), -1])
            if side or self._rest(last) is not None:
                return side
        # One that comes to no rest ends where orbits beside the edge do so in the same way.
        alike = [
            s for s, run in zip((-1, 1), self._beside) if self._rest(run) is None and run.status is last.status
        ]
        if len(alike) == 2:
            x = self.units * last.y[: len(self.units), -1]
            return int(np.sign(self.edge.w @ (x - self.edge.place.x)))
        return alike[0] if alike else 0

    def side_of(self, x: np.ndarray) -> int:
        """The side of the edge whose rest point is next to x, 0 where neither is."""
        for sign, rest in zip((-1, 1), self.sides):
            if rest is not None and self._apart(x, rest) <= NEAR * self._apart(self.edge.place.x, rest):
                return sign
        return 0

    def _apart(self, x: np.ndarray, y: np.ndarray) -> float:
        return float(np.abs((x - y) / self.units).max())

    def gap(self, rate: float, rtol: float = FINE) -> float:
        """(1) up to a factor; NaN where the run ends on neither side."""
        runs = self.runs(rate, rtol)
        side = self.ending(runs[-1])
        if side == 0:
            return np.nan
        n, (_, end) = len(self.units), self.given.ends
        rests = self._fields[2]
        speed = rate * self.given.at(self.edge.place.x, end).rho_s if rests else 0.0
        last = runs[-1]
        if not rests and len(runs) == 1:
            return float(side)

        def distance(y: np.ndarray) -> np.ndarray:
            s = y[n] if rests else np.full(y.shape[1], end)
            return self.edge.distance(self.units[:, np.newaxis] * y[:n], s, speed)

        u = np.abs(distance(last.y))
        within = np.flatnonzero(u <= self.section)
        if not len(within) or within[-1] + 1 == len(u):
            return float(side)
        i = within[-1]

        def beyond(t: float) -> float:
            y = np.array(last.at(t))
            return float(np.log(np.abs(distance(y.reshape(-1, 1))[0]) / self.section))

        at = root(beyond, float(last.t[i]), float(last.t[i + 1]))
        time = (float(last.t[i]) if at is None else at) - last.t[0]
        # Its sign is the side, which a long time does not take away.
        return side * max(float(np.exp(-self.edge.growth * time)), np.finfo(float).tiny)

    @cached_property
    def section(self) -> float:
        """d of (1): a quarter of the way to the nearer of the rest points on both sides."""
        at = self.edge.place
        ways = [abs(float(self.edge.w @ (rest - at.x))) for rest in self.sides if rest is not None]
        ways.append(abs(float(self.edge.w @ (self.begin.x - at.x))) or np.inf)
        finite = [d for d in ways if 0.0 < d < np.inf]
        return 0.25 * min(finite) if finite else float(np.abs(self.edge.w) @ self.units)


def thresholds(
    passage: Passage, way: list[Place]
) -> tuple[tuple[bool, bool], list[Connection], list[tuple[float, float]]]:
    """Whether slow ramps tip, and fast ones, the connections between the start of `way` and the edge, and the rates
    between which runs end differently without one.

    A ramp tips that ends on another side of the edge than the branch of the start does, or than fast ramps do where
    that branch is lost on the way.
    """
    tried = passage.given.natural(passage.begin) * np.logspace(-DECADES, DECADES, 2 * DECADES * PER_DECADE + 1)
    ends = [passage.ending(passage.runs(rate, FINE)[-1]) for rate in tried]
    home = passage.side_of(way[-1].x) if way[-1].s == passage.edge.place.s else ends[-1]
    found, unmatched = [], []
    for a, b, i, j in zip(tried, tried[1:], ends, ends[1:]):
        one = matched(passage, a, b) if i * j < 0 else None
        found += [one] if one is not None else []
        unmatched += [(float(a), float(b))] if one is None and i != j else []
    return (ends[0] != home, ends[-1] != home), found, unmatched


def matched(passage: Passage, a: float, b: float) -> Connection | None:
    """The connection at a rate between a and b, whose runs end on different sides."""
    fine = root(passage.gap, a, b)
    # Where no run passes near the edge, the ends differ by something else, and so they do where rounding decides.
    if fine is None or abs(passage.gap(fine)) == 1.0 or not _changes_once(passage, fine, b - a):
        return None
    x, s = passage.orbit(fine)
    return Connection(fine, zero_error(passage.gap, fine, COARSE), s, x)


def _changes_once(passage: Passage, zero: float, way: float) -> bool:
    """Whether the gap has one sign on each side of its zero, however near; also of one next to an end of the way."""
    left, right = ({np.sign(passage.gap(zero + share * side)) for share in CLOSER} for side in (-way, way))
    return len(left) == len(right) == 1 and left != right
