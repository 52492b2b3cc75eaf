"""From a run to a first guess of a cycle: wait until it comes back to itself in a section found from the run.

The section is where one state crosses the middle of its range upwards, for each state in turn; a lap is as many
crossings as it takes to come back. The run is counted in steps, not in time: that needs no unit of time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import sympy as sp

from gsp.collocation.gauss import gauss
from gsp.errors import GspError, Status
from gsp.integration.methods import Method
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.orbits.periodic.collocation import Cycle, OrbitProblem, with_axis
from gsp.orbits.periodic.mesh import FEWEST, adapted
from gsp.orbits.periodic.newton import scales_of
from gsp.roots import roots
from gsp.systems.flow import Flow, Point

# A lap is a guess when it closes within this share of its amplitude.
CLOSES = 1e-3
# Crossings of the section in a lap at most: mixed-mode orbits have several.
MOST_CROSSINGS = 24
# Places a step at which crossings are looked for.
PLACES = 8
# At rest: the last part of a run moves less than this share of what it did, and of the size of the point.
AT_REST = 1e-7
FOREVER = 1e150
# A relaxation jumps within the share epsilon of its period, and the lap must know when: at 1e-9 its length was off by
# 1e-11, and from 5e-13 downwards Newton's method failed on a third of van der Pol's cycles; near 1e-10 on none of 384
# from 2e-13 to 1e-11. At 1e-11 the steps through the jumps are below the rounding of time.
RTOL = 1e-10
ATOL = 0.01 * RTOL


class OrbitError(GspError):
    """There is no periodic orbit where one was asked for; the message names what was found instead."""


@dataclass(frozen=True, eq=False)
class Lap:
    """One lap of a run, from `start` over `length` in time, both in the run's own direction."""

    run: Trajectory
    start: float
    length: float

    def cycle(self, problem: OrbitProblem, degree: int, *, error: float, most: int) -> Cycle:
        """The lap as a discrete cycle in forward time, on a mesh made for an error in units of its amplitudes."""
        first, last = sorted((self.start, self.start + self.length))
        steps = np.sort(self.run.t)
        inside = steps[(steps > first) & (steps < last)]
        knots = np.concatenate([[0.0], (inside - first) / (last - first), [1.0]])
        # Intervals for each step of the run when it is sampled.
        count = max(4 * (len(knots) - 1), FEWEST)
        mesh = np.unique(np.interp(np.linspace(0.0, len(knots) - 1.0, count + 1), np.arange(len(knots)), knots))
        fine = self._sampled(mesh, degree, first, last)
        return self._sampled(adapted(fine, scales_of(problem, fine), error, most=most), degree, first, last)

    def _sampled(self, mesh: np.ndarray, degree: int, first: float, last: float) -> Cycle:
        places = gauss(degree).places(mesh).ravel()
        values = self.run.at(np.clip(first + places * (last - first), first, last)).T
        # The gap between the ends, spread over the lap.
        values = values - places[:, None] * (self.run.at(last) - self.run.at(first))
        return Cycle(mesh, values.reshape(len(mesh) - 1, degree + 1, -1), last - first)


def settled_lap(
    flow: Flow,
    start: Point,
    epsilon: float | None,
    *,
    closes: float,
    backward: bool,
    max_steps: int,
    progress: Callable[[float], object] | None,
) -> Lap:
    """The last lap of a run that has settled on a cycle, closed within the share `closes` of its amplitude.

    Raises `OrbitError` when the run does something else.
    """

    def found(atol: float) -> tuple[Lap | OrbitError, Trajectory]:
        return _settled(
            flow, start, epsilon, atol, closes=closes, backward=backward, max_steps=max_steps, progress=progress
        )

    lap, run = found(ATOL)
    atol = _finer(run, ATOL)
    while atol is not None:
        again, run = found(atol)
        if isinstance(again, OrbitError) and not isinstance(lap, OrbitError):
            # A state that is 0 but for rounding has no digits to be relative to.
            break
        lap, atol = again, _finer(run, atol)
    if isinstance(lap, OrbitError):
        raise lap
    return lap


def _finer(run: Trajectory, atol: float) -> float | None:
    """An absolute tolerance that counts for no state of the run; None where `atol` does not."""
    sizes = np.abs(run.y).max(axis=1)
    least = float(sizes[sizes > 0.0].min(initial=np.inf))
    finer = max(0.01 * RTOL * least, np.finfo(float).tiny)
    return finer if atol > RTOL * least and finer < atol else None


def _settled(
    flow: Flow,
    start: Point,
    epsilon: float | None,
    atol: float,
    *,
    closes: float,
    backward: bool,
    max_steps: int,
    progress: Callable[[float], object] | None,
) -> tuple[Lap | OrbitError, Trajectory]:
    """The lap, or why there is none, and the last run."""
    # Each run begins at the start again: a reduced flow takes no other point than its own kind of start.
    # Steps between two looks at the run; a relaxation oscillation takes about 200 a lap.
    steps = min(1500, max_steps)
    while True:
        run = trajectory_of(
            flow.about_centres, start=flow.from_centres(start), span=(0.0, -FOREVER if backward else FOREVER),
            epsilon=epsilon, rtol=RTOL, atol=atol,
            options=RunOptions(method=Method.RADAU13 if flow.is_stiff else Method.DOP853, max_steps=steps),
        )  # fmt: skip
        # Below its tolerance a state is 0 as far as the run knows.
        ends = [0.0 if abs(v) <= atol else float(v) for v in run.at(run.t[-1])]
        last = flow.place(zip(flow.states, ends + flow.centre))
        crossed = _crossed(run)
        if crossed is not None:
            axis = flow.centres.get(crossed, sp.S.Zero)
            return OrbitError(
                f"the run from start crosses {crossed} = {axis}, which no orbit does here: {crossed - axis} falls "
                f"below what the run holds, {atol:.0e}.",
                f"Take ln({crossed - axis}) for a state in its place.",
                got=f"start {flow.place(start)}",
            ), run
        # A cycle is run around for ever: a run that gets through is on none.
        lap = None if run.status.ok else _closed_lap(run, closes, atol)
        if lap is not None:
            return lap, run
        # Where a run ends early its steps shrink, and it moves little in them.
        if (run.status.ok or run.status is Status.TOO_MANY_STEPS) and _at_rest(run, atol):
            return OrbitError(
                f"there is no cycle here: the run from start settles at the equilibrium {last}.",
                "Start elsewhere, change a parameter, or continue cycles from a Hopf point of this "
                "equilibrium.",
                got=f"start {flow.place(start)}",
            ), run
        if run.status is not Status.TOO_MANY_STEPS:
            how = (
                "there is no cycle here: the run from start leaves for infinity"
                if run.status.ok
                else f"no cycle was found: the run from start ends with {run.status.name}, {run.status.meaning}"
            )
            if run.status is Status.STEP_TOO_SMALL:
                how += ". It blows up there, or jumps within the rounding of time, as relaxation oscillations do at an "
                how += "epsilon of about 1e-14 and below; then raise epsilon"
            other = "integrate forward" if backward else "backward=True for a repelling cycle"
            return OrbitError(
                f"{how}.",
                f"Start elsewhere, or {other}.",
                got=f"{last} after {run.stats.steps} steps",
            ), run
        if progress is not None:
            progress(steps / max_steps)
        if steps >= max_steps:
            # Chaos settles nowhere, but comes back now and then: whether in its very last lap is chance.
            lap = _closed_lap(run, closes, atol, last=False)
            if lap is not None:
                return lap, run
            return OrbitError(
                f"the run from start has not come back to itself after {steps} steps.",
                f"It is at {last}. Raise max_steps, or give the period with a start near the cycle; "
                "a torus never closes, and chaos seldom.",
            ), run
        steps = min(2 * steps, max_steps)


def given_lap(flow: Flow, start: Point, epsilon: float | None, period: float) -> Lap:
    """The lap of that length from `start`; raises `OrbitError` when the run does not get through it."""

    def found(atol: float) -> Trajectory:
        return trajectory_of(
            flow.about_centres, start=flow.from_centres(start), span=(0.0, period),
            epsilon=epsilon, rtol=RTOL, atol=atol,
            options=RunOptions(method=Method.RADAU13 if flow.is_stiff else Method.DOP853),
        )  # fmt: skip

    run = found(ATOL)
    atol = _finer(run, ATOL)
    while atol is not None:
        again = found(atol)
        if run.status.ok and not again.status.ok:
            break
        run, atol = again, _finer(again, atol)
    if not run.status.ok:
        raise OrbitError(
            "the run from start does not last one period.", "Move the start or the period.", got=run.message
        )
    return Lap(run, 0.0, period)


def _crossed(run: Trajectory) -> sp.Symbol | None:
    """The first state that changes its sign along the run though no orbit crosses its axis; None where none does."""
    found: dict[int, sp.Symbol] = {}
    for symbol, has_axis, values in zip(run.flow.states, with_axis(run.flow), run.y):
        # Of its size until then: what has crossed runs away from its axis.
        beyond = -np.sign(values[0]) * values > RTOL * np.maximum.accumulate(np.abs(values))
        if beyond.any() and has_axis:
            found.setdefault(int(np.argmax(beyond)), symbol)
    return found[min(found)] if found else None


def _at_rest(run: Trajectory, atol: float) -> bool:
    count = run.y.shape[1]
    # Of a run that got through, the later half of its time; of others, which know no last time, of their steps.
    later = np.searchsorted(np.abs(run.t), 0.5 * abs(run.t[-1])) if run.status.ok else count // 2
    half = run.y[:, min(int(later), count - 2) :]
    moved, size = np.ptp(half, axis=1), np.ptp(run.y, axis=1) + np.abs(half).max(axis=1)
    return bool((moved <= AT_REST * size + atol).all())


def _closed_lap(run: Trajectory, closes: float, atol: float, *, last: bool = True) -> Lap | None:
    """A lap of the run's second half that closes, its `last` or any, in the section with the shortest one."""
    t = run.t[len(run.t) // 2 :]
    if len(t) < 4 or not np.isfinite(t).all():
        return None
    # A run that comes to rest takes ever longer steps, which a section has nothing to say about.
    share = np.arange(PLACES) / PLACES
    times = np.append((t[:-1, None] + share * np.diff(t)[:, None]).ravel(), t[-1])
    states = run.at(times)
    low, high = states.min(axis=1), states.max(axis=1)
    found: Lap | None = None
    for k in range(len(states)):
        if high[k] - low[k] <= AT_REST * max(abs(low[k]), abs(high[k])):
            continue
        lap = _lap_in_section(run, times, states, k, 0.5 * (low[k] + high[k]), closes, atol, last=last)
        if lap is not None and (found is None or abs(lap.length) < abs(found.length) * (1.0 - 1e-3)):
            found = lap
    return found


def _lap_in_section(
    run: Trajectory, times, states, k: int, level: float, closes: float, atol: float, *, last: bool = True
) -> Lap | None:
    above = states[k] > level
    places = np.flatnonzero(above[1:] & ~above[:-1])
    if len(places) < 2:
        return None
    ends = states[k, places] - level, states[k, places + 1] - level
    b = roots(lambda t: run.at(t)[k] - level, times[places], times[places + 1], ends=ends)
    points = run.at(b)
    # What counts for nothing: the run's own errors.
    still = AT_REST * np.abs(states).max(axis=1)
    whole = np.ptp(states, axis=1) + still
    for laps in range(1, min(MOST_CROSSINGS, len(places) - 1) + 1):
        gaps = np.abs(points[:, laps:] - points[:, :-laps])
        # No lap has more than the amplitude of the whole.
        near = np.flatnonzero((gaps <= closes * whole[:, None] + 10.0 * atol).all(axis=0))
        for j in near[near == gaps.shape[1] - 1] if last else near[::-1]:
            amplitude = np.ptp(states[:, places[j] + 1 : places[j + laps] + 1], axis=1)
            if (gaps[:, j] <= closes * (amplitude + still) + 10.0 * atol).all():
                return Lap(run, float(b[j]), float(b[j + laps] - b[j]))
    return None
