"""What a reduced run will be wrong by, and for how long it holds, told without the full system.

The order-N run x_N obeys x_N' = f_0 + ... + epsilon^N f_N from the base point through epsilon^N. Its error e = x_N - x
satisfies e' = D f_red e - epsilon^(N+1) f_(N+1) + O(epsilon^(N+2)), e(t0) = -epsilon^(N+1) b_(N+1) + ..., which is, to
leading order, the equation of x_N - x_(N+1). So the difference of two reduced runs is an asymptotically exact estimate:
the residual of the invariance equation over the gap, carried along by the slow variational equation, with the error of
the start's fast fibre in it. A bound by Gronwall's lemma would always hold, and be of no use on spans of a few times
1/|D f_red|.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import pairwise

import numpy as np

from gsp.algebra.switching_functions import switches
from gsp.critical.sampling import Sampler
from gsp.errors import Status
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.spread_times import spread_times, within_steps
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.scenes.raw_states import BESIDE, RawStates
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study
from gsp.slow.series import SeriesManifold
from gsp.slow.truncation import AHEAD
from gsp.systems.region import Interval, state_sizes
from gsp.systems.tolerances import absolute_tolerance

# A term that happens to vanish says nothing, so the runs of the next two orders are looked at. Where the series ends
# before the second (AHEAD), the first serves alone, unless it is within so many tolerances of the runs themselves.
VANISHED = 30.0
# Times at which a run is looked at, and how often the place where it fails is narrowed down as finely again.
CHECKS, REFINEMENTS = 65, 2
# The runs compared are this much more exact than the error looked for, or than the usual tolerance, and never asked for
# less than rounding.
CLEARER, SMALLEST_RTOL = 1e-3, 1e-13


class Failure(StrEnum):
    """Why a reduced run is not to be followed any further."""

    GAP = "the gap is lost"
    RATE = "the normal rate no longer dominates"
    REGION = "the region is left"
    UNTOLD = "nothing tells its error"
    KINK = "a kink or a jump of the field is crossed"
    ORDER = "the series is past its best order"
    ERROR = "the predicted error passes the tolerance"
    END = "the reduced run ends"


@dataclass(frozen=True, eq=False, repr=False)
class Prediction:
    """Reduced `runs` by order over one span, and what they say about one another.

    `names` are the quantities whose error counts, `least_scale[name]` the least value that they are relative to; `rtol`
    is what the runs were asked for. Errors count from the time `after` on. Up to the time `settled` the solution is not
    near the manifold yet; `landed` (n,) is where its layer leads on M0, if one comes first. `limits` are what a run may
    not leave, and `raw` has them in the states of a field that was split.
    """

    series: SeriesManifold
    epsilon: float
    runs: Mapping[int, Trajectory]
    names: tuple[str, ...]
    region: Mapping[str, Interval]
    limits: Mapping[str, Interval]
    least_scale: Mapping[str, float]
    sampler: Sampler
    rtol: float
    after: float = -np.inf
    settled: float = -np.inf
    landed: np.ndarray | None = None
    raw: RawStates | None = None

    def compared(self, order: int) -> list[int]:
        """The orders whose runs tell the error of this one: itself and the next two, as far as they begin."""
        return [
            k
            for k in range(order, order + AHEAD + 1)
            if k == order or (k in self.runs and self.covered(k) > self.first)
        ]

    def tells(self, order: int, times: np.ndarray) -> bool:
        """Whether the error at `times` is known: a single run ahead that does not differ may just have no term."""
        ahead = len(self.compared(order)) - 1
        if self.is_hidden(order, times):
            return False
        if ahead != 1:
            return ahead > 1
        errors = self.errors(order, times)
        return bool((errors > VANISHED * self.rtol).any())

    def converges(self, order: int, times: np.ndarray) -> bool:
        """Whether each term left out moves the run at `times` (m,) by no more than the term before it.

        The one before order 0 is the quantity itself. Terms that vanish are passed over.
        """
        orders = [k for k in (order - 1,) if k in self.runs] + self.compared(order)
        if times[-1] > min(map(self.covered, orders)):
            return False
        moves = [
            max(float(np.abs(own[name] - other[name]).max()) / self.scale[name] for name in self.names)
            for own, other in pairwise(self.runs[k].sample(times) for k in orders)
        ]
        moves_seen = [move for move in (1.0, *moves) if move > VANISHED * self.rtol]
        return moves_seen == sorted(moves_seen, reverse=True)

    def covered(self, order: int) -> float:
        """The time that the run of this order reaches."""
        return float(self.runs[order].t[-1])

    @property
    def first(self) -> float:
        """Where the runs begin."""
        return float(self.runs[min(self.runs)].t[0])

    @cached_property
    def scale(self) -> dict[str, float]:
        """Largest |value| of each quantity, where errors count, along the run that is told to be the most exact, within
        its steps too.

        That is the one which the run before it differs least from, of those that come furthest and along which the
        quantity is not 0. Where it is 0 to within the runs' own errors along all of them it is the largest in the
        region, and 1 where that is 0 too.
        """
        furthest = max(map(self.covered, self.runs))
        runs = [run for k, run in sorted(self.runs.items()) if self.covered(k) == furthest]
        times = within_steps(runs[0].t)
        times = np.append(min(max(self.after, times[0]), furthest), times[times > self.after])
        sampled, sizes, scale = [run.sample(times) for run in runs], state_sizes(self.region), {}
        for name in self.names:
            values = np.array([run[name] for run in sampled])
            found = np.maximum(np.abs(values).max(axis=1), self.least_scale.get(name, 0.0))
            whole = sizes.get(name, found[0] or 1.0)
            told = np.abs(np.diff(values, axis=0)).max(axis=1, initial=0.0)
            exact = np.nan_to_num(np.append(told[:1], told), nan=np.inf) if told.size else np.zeros(1)
            seen = np.flatnonzero(found > self.rtol * whole)
            scale[name] = float(found[seen[np.argmin(exact[seen])]]) if seen.size else whole
        return scale

    def errors(self, order: int, times: np.ndarray) -> np.ndarray:
        """Predicted relative error (m,) of the run of this order at `times` (m,), infinite where runs have ended."""
        result = np.full(len(times), np.inf)
        compared = [self.runs[k] for k in self.compared(order)]
        alive = times <= min(float(run.t[-1]) for run in compared)
        if not alive.any():
            return result
        own, *others = (run.sample(times[alive]) for run in compared)
        worst = np.zeros(int(alive.sum()))
        for name in self.names:
            for other in others:
                worst = np.maximum(worst, np.abs(own[name] - other[name]) / self.scale[name])
        result[alive] = np.where(np.isfinite(worst), worst, np.inf)
        return result

    def failures(self, order: int, times: np.ndarray, limit: float) -> list[Failure | None]:
        """Why the run of this order does not hold at each of `times`; None where it does."""
        found: list[Failure | None] = [self.end_of(order)] * len(times)
        alive = np.flatnonzero(times <= self.covered(order))
        if not alive.size:
            return found
        z, slow, terms = self._places(self.runs[order], times[alive])
        with np.errstate(all="ignore"):
            eigenvalues = self.sampler.eigenvalues(z)
            gap = -np.nan_to_num(np.real(eigenvalues), nan=np.inf).max(axis=1)
            rates = self.sampler.tangential_rates(z)
            # At the zero of a root, where a run may begin, the rate is infinite for that instant.
            rates[np.isinf(rates) & (times[alive] <= self.settled)] = 0.0
            ratio = gap / (self.epsilon * rates)
        inside = self.inside(self.runs[order], slow)
        if not (inside.all() or self._leaves(order, limit)):
            inside[:] = True
        beyond = times[alive] > self.crossing(order)
        past = self._past_best(order, terms)
        # A run of higher order ends where the series stops being asymptotic; beyond that nothing is predicted.
        past |= times[alive] > min(map(self.covered, self.compared(order)))
        errors = self.errors(order, times[alive])
        for i, place in enumerate(alive):
            found[place] = (
                Failure.GAP
                if not gap[i] > 0.0
                else Failure.RATE
                if ratio[i] <= 1.0
                else Failure.REGION
                if not inside[i]
                else Failure.KINK
                if beyond[i]
                else Failure.ORDER
                if past[i]
                else Failure.ERROR
                if not errors[i] <= limit
                else None
            )
        return found

    def _leaves(self, order: int, limit: float) -> bool:
        """Whether the run of this order is anywhere further out of the region than it may be off."""
        run = self.runs[order]
        times = np.linspace(self.first, self.covered(order), CHECKS)
        return not self.inside(run, self.states(run, times), within=limit).all()

    def states(self, run: Trajectory, times: np.ndarray) -> np.ndarray:
        """The states (m, n) of a run at `times` (m,)."""
        found = run.sample(times)
        return np.stack([found[s.name] for s in self.sampler.system.states], axis=1)

    def inside(self, run: Trajectory, states: np.ndarray, *, within: float = 0.0) -> np.ndarray:
        """Which of `states` (m, n) of a run are within the limits, or no further out than where it begins, or than it
        may be off: a share `within` of what an error is relative to, or of a side where that is not known.

        The region of a field that was split bounds its raw states, whichever of them became fast coordinates.
        Where the layer leads within a limit the run may begin beyond it by as much as the fibre carries the slow
        variables of a base point.
        """
        system, nx = self.sampler.system, len(self.sampler.system.x)
        first = np.array([run[s.name][0] for s in system.states])
        landed = first if self.landed is None else self.landed
        points = np.vstack([landed, np.append(first[:nx], landed[nx:]), states])
        values, region = dict(zip((s.name for s in system.states), points.T)), self.limits
        if self.raw is not None:
            values, region = self.raw.values(points), self.raw.region
        good = np.ones(len(states), dtype=bool)
        for name, (low, high) in region.items():
            (on, carried), later = values[name][:2], values[name][2:]
            slack = max(BESIDE * (high - low), within * self.scale.get(name, high - low))
            if low - slack <= on <= high + slack:
                low, high = min(low, carried), max(high, carried)
            good &= ~((later < low - slack) | (later > high + slack))
        return good

    def holds_until(
        self, order: int, limit: float, *, after: float, last: float
    ) -> tuple[float, Failure | None]:
        """The time up to which the run of this order holds, and why no longer; `last` and None when to the end.

        Looked at on a grid, narrowed down where it fails. The error counts from `after` on.
        """
        low, high = after, min(last, self.covered(order))
        if high <= after:
            return after, self.end_of(order)
        why: Failure | None = None
        for _ in range(1 + REFINEMENTS):
            times = spread_times(self.runs[order], low, high, CHECKS)
            found = self.failures(order, times, limit)
            first = next((i for i, failure in enumerate(found) if failure is not None), None)
            if first is None:
                return (last, None) if high == last else (high, self.end_of(order))
            why = found[first]
            if first == 0:
                break
            low, high = float(times[first - 1]), float(times[first])
        return low, why

    def end_of(self, order: int) -> Failure:
        """What a run of this order that ended early ended of: its series, or what it met."""
        run = self.runs[order]
        # Where a run has no length, it is the series of its base point that leads out of the field's domain.
        begins = order == 0 or run.t[-1] > run.t[0]
        return Failure.END if begins and run.status is not Status.SERIES_ENDS else Failure.ORDER

    def crossing(self, order: int) -> float:
        """When the run of this order first crosses a switching surface of the field; infinite when it does not.

        A series is one on each side, and a run across is off by O(epsilon^2), which no higher order tells. So is one
        that begins across, where the layer has moved the slow variables over it. The error of order 0 is larger than
        that, and is told by the next order all the same, but where M0 jumps, or a slow rate where fast variables say
        when: the full run is off it by the jump over a time of O(epsilon).
        """
        run, low, landed = self.runs[order], float(self.runs[order].t[0]), self.landed
        while self._surfaces is not None:
            before, after, jumps = self._crossed(run, low, self.covered(order), landed)
            if order > 0 or jumps or before == np.inf:
                return before
            low, landed = after, None
        return float("inf")

    def is_hidden(self, order: int, times: np.ndarray) -> bool:
        """Whether the error at `times` is hidden by that of the runs ahead, which is O(epsilon^2) across a kink.

        It is where the next term moves the run by less than the one after it.
        """
        across = any(self.crossing(k) < times[-1] for k in self.compared(order)[1:])
        return across and not self.converges(order, times)

    def _crossed(
        self, run: Trajectory, low: float, high: float, landed: np.ndarray | None
    ) -> tuple[float, float, bool]:
        """Times just before the first crossing, infinite where there is none, and just after; whether M0 jumps, or
        a slow rate on a surface that the fast variables move."""
        assert self._surfaces is not None
        before, sides, leaps, sizes = float("inf"), None, [], np.zeros(0)
        for _ in range(1 + REFINEMENTS):
            # Places at which the sides of switching surfaces are looked at, and again where one is crossed.
            times = np.linspace(low, high, 129)
            places = self._places(run, times)[0]
            if sides is None and landed is not None:
                places, times = np.vstack([landed, places]), np.append(low, times)
            with np.errstate(all="ignore"):
                found = np.sign(self._surfaces(places, self.sampler.p))
            # What begins on a surface is on the side to which it leaves.
            sides = found[(found != 0.0).argmax(axis=0), np.arange(found.shape[1])] if sides is None else sides
            crossed = found * sides < 0.0
            other = np.flatnonzero(crossed.any(axis=1))
            if not other.size:
                break
            before = low = float(times[other[0] - 1])
            high = float(times[other[0]])
            nx, moved = len(self.sampler.system.x), self._moved[crossed[other[0]]].any()
            with np.errstate(all="ignore"):
                values = np.hstack([places[:, nx:], moved * self.sampler.rates(places)[:, :nx]])
            leaps.append(np.abs(np.diff(values[other[0] - 1 : other[0] + 1], axis=0)))
            sizes = sizes if sizes.size else np.abs(values).max(axis=0)
            if low == high:
                break
        if len(leaps) < 2:
            return before, high, False
        # What is continuous changes less over a shorter time, but for rounding.
        jumps = (leaps[-1] > 0.5 * leaps[0]) & (leaps[-1] > self.rtol * sizes)
        return before, high, bool(jumps.any())

    @cached_property
    def _switches(self):
        return [s.surface for s in switches([*self.sampler.f, *self.sampler.g], self.sampler.system.states)]

    @cached_property
    def _surfaces(self):
        """The switching functions of the field over points (m, n), or None for a smooth one."""
        return self.sampler.compiled(self._switches) if self._switches else None

    @cached_property
    def _moved(self) -> np.ndarray:
        """Which of them the fast variables move."""
        return np.array([surface.has(*self.sampler.system.y) for surface in self._switches])

    def _past_best(self, order: int, terms: np.ndarray) -> np.ndarray:
        """Where the `terms` (m, k, n_fast) left out have begun to grow again."""
        # Terms of a series that diverges may be beyond doubles when they are squared.
        with np.errstate(over="ignore", invalid="ignore"):
            sizes = np.hypot.reduce(terms / self.series.branch.scales[1], axis=2)
        # The first two terms left out at each order, as in the errors, or the first where there are no more: one that
        # happens to vanish is not the least.
        ahead = len(self.compared(order)) - 1
        if ahead == 0:
            return np.zeros(len(sizes), dtype=bool)
        left, beyond = sizes[:, 1 : order + 2].copy(), sizes[:, 2 : order + ahead + 1]
        left[:, : beyond.shape[1]] = np.maximum(left[:, : beyond.shape[1]], beyond)
        # At rest all of them vanish, and what they are found to be is rounding.
        left = np.maximum(left, np.finfo(float).eps * np.nan_to_num(sizes[:, :1], posinf=0.0).max(initial=0.0))
        return left[:, order] > left.min(axis=1)

    def _places(self, run: Trajectory, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(x, y) (m, n) on M0 under the run at `times`, (x, y) on M_epsilon, and the terms of the series there."""
        sampled = run.sample(times)
        system = self.series.branch.system
        x, fast = (np.stack([sampled[s.name] for s in part], axis=1) for part in (system.x, system.y))
        coordinates = np.array(sampled.y[: len(self.series.coordinates)].T, order="C")
        with np.errstate(all="ignore"):
            terms = self.series.terms_at(coordinates, self.epsilon)
        return np.hstack([x, terms[:, 0]]), np.hstack([x, fast]), terms


def predict(
    study: Study,
    series: SeriesManifold,
    starts: Mapping[int, Mapping[str, float]],
    *,
    flows: Mapping[int, ReducedFlow],
    orders: Sequence[int],
    span: Interval,
    least_scale: Mapping[str, float],
    sampler: Sampler | None = None,
) -> Prediction:
    """Reduced runs of `orders` and the next two, order k from `starts[k]`, and what to expect of the names in
    `least_scale`, relative to that at least.

    Where `starts` end before order max(orders) + 2 an error is told by one run ahead or by none.
    Nothing of the full system is run.
    """
    epsilon, region = study.scene.epsilon, study.region
    needed = sorted({k + ahead for k in orders for ahead in range(AHEAD + 1) if k + ahead in starts})
    # At a looser tolerance too, or an error would be told at one tolerance and be the runs' own at the next.
    rtol = max(CLEARER * min(study.scene.tolerance, Scene.tolerance), SMALLEST_RTOL)
    atol = absolute_tolerance(rtol, region, *starts.values())
    # At a fold a reduced flow turns back on itself, and an integrator would chatter there for ever.
    runs = {
        k: trajectory_of(
            flows[k],
            start=starts[k],
            span=span,
            epsilon=epsilon,
            rtol=rtol,
            atol=atol,
            options=RunOptions(max_steps=20_000),
        )
        for k in needed
    }
    return Prediction(
        series,
        epsilon,
        runs,
        tuple(least_scale),
        region,
        study.scene.limits,
        least_scale,
        sampler or Sampler(series.branch),
        rtol,
        raw=None if study.splitting is None else RawStates(study.splitting, study.scene.limits),
    )
