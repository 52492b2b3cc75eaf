"""Runs along a ramp at one rate, and on where it ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import sympy as sp

from gsp.errors import Status
from gsp.integration.events import Event
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.results.card import Card
from gsp.results.tabular import Tabular
from gsp.singular.ramps.ramped import Place, Ramped
from gsp.systems.region import balancing_units, in_units, powers_of_two
from gsp.systems.system import VectorField

RATE = sp.Symbol("rate")


@dataclass(frozen=True, eq=False, repr=False)
class RampRun(Card, Tabular):
    """A run from the start of a ramp at one `rate`: x (m, n) and the phase (m,) over t (m,), 0 half way along."""

    ramped: Ramped
    rate: float
    t: np.ndarray
    phase: np.ndarray
    x: np.ndarray
    status: Status

    def moved_to(self, asked: Ramped) -> RampRun:
        """The same as a run of `asked`, where this is one about its centres."""
        s, x = asked.centre
        return replace(self, ramped=asked, phase=self.phase + s, x=self.x + x)

    def __repr__(self) -> str:
        return f"RampRun(rate={self.rate:g}, t={self.t[0]:g}..{self.t[-1]:g}, {self.status.name})"

    def __getitem__(self, name: str) -> np.ndarray:
        """A state or a parameter that moves, (m,), by name."""
        for i, state in enumerate(self.ramped.field.states):
            if state.name == name:
                return self.x[:, i]
        return self.ramped.moved(self.phase)[name]


def leaving(
    given: Ramped, begin: Place, rate: float, follows: Sequence[bool] | None = None
) -> tuple[np.ndarray, float]:
    """(x, s) where a run starts: at the end, or along the unstable set from it where the phase is at rest.

    States that `follows` names stay on f = 0, as fast ones do at epsilon = 0.
    """
    first, last = given.ends
    if not given.rests_at(first):
        return begin.x, first
    at = given.at(begin.x, first)
    paces = np.full(len(at.f), rate * at.rho_s) * (1.0 if follows is None else ~np.array(follows))
    slope = np.linalg.solve(np.diag(paces) - at.f_x, at.f_s)
    # A run leaves a phase at rest by this share of the way along the unstable set, whose curvature is its
    # square.
    step = 1e-8 * (last - first)
    return begin.x + slope * step, first + step


def run_ramp(
    given: Ramped,
    begin: Place,
    rate: float,
    *,
    after: float,
    points: int = 600,
    rtol: float = 1e-10,
    level: tuple[int, float] | None = None,
) -> RampRun:
    """The run at `rate` from the rest point `begin`, for the time `after` beyond the ramp, unless it diverges.

    With a `level`, the number of a state and a value, it ends where that is reached, with EVENT_REACHED.
    """
    (first, last), phase, states = given.ends, given.ramp.phase, given.field.states
    names, n = [x.name for x in states], len(states)
    units = np.ones(n) if level is None else _units(given, begin, level)
    equations = in_units(given.field.equations, dict(zip(states, units)))
    moving = VectorField({**equations, phase: RATE * given.ramp.profile}, epsilon=RATE, parameters=given.kept)
    x, s = leaving(given, begin, rate)
    # Phases that never arrive are followed to this share of the way from their end.
    share = 1e-4 if given.rests_at(last) else 0.0
    end, middle = (first + part * (last - first) for part in (1.0 - share, 0.5))
    passed = (
        []
        if level is None
        else [Event(states[level[0]] - sp.Float(level[1] / units[level[0]], 17), terminal=True, name="level")]
    )
    ramping = (
        *passed,
        Event(phase - sp.Float(end, 17), terminal=True, name="end"),
        Event(phase - sp.Float(middle, 17), name="half way"),
    )

    def run(flow: VectorField, start: dict[str, float], time: float, events: tuple[Event, ...]) -> Trajectory:
        small = rate if flow.epsilon is not None else None
        options = RunOptions(events=events)
        return trajectory_of(flow, start, (0.0, time), small, rtol, 1e-2 * rtol, options=options)

    def reached(found: Trajectory) -> bool:
        return level is not None and len(found.events["level"].times) > 0

    along = run(moving, {**dict(zip(names, x / units)), phase.name: s}, given.longest(begin.x) / rate, ramping)
    halves = along.events["half way"].times
    origin = float(halves[0]) if len(halves) else float(along.t[-1])
    # From where something is to be seen: the phase leaves its end.
    early = along.t[0] if not given.rests_at(first) else origin - (origin - along.t[0]) * 0.5
    times = np.linspace(float(early), float(along.t[-1]), points)
    values = np.array(along.at(times))
    t, rows, s_values, status = times - origin, values[:n], values[n], along.status
    if status is Status.SUCCESS or (status is Status.EVENT_REACHED and not reached(along)):
        flow = moving if share else VectorField(
            {x: rate.xreplace({phase: given.ramp.ends[1]}) for x, rate in equations.items()},
            epsilon=None, parameters=given.kept,
        )  # fmt: skip
        begun = dict(zip(names, along.y[:n, -1])) | ({phase.name: float(along.y[n, -1])} if share else {})
        on = run(flow, begun, after, tuple(passed))
        later = np.linspace(0.0, float(on.t[-1]), points)[1:]
        more = np.array(on.at(later))
        t = np.concatenate([t, later + t[-1]])
        rows = np.concatenate([rows, more[:n]], axis=1)
        s_values = np.concatenate([s_values, more[n] if share else np.full(len(later), last)])
        status = on.status
    return RampRun(given, rate, t, s_values, rows.T * units, status)


def _units(given: Ramped, begin: Place, level: tuple[int, float]) -> np.ndarray:
    """Powers of 2 (n,) in which the states are run to a level: the way of its state, and of the others what they do."""
    state, value = level
    found = balancing_units(given.at(begin.x, begin.s).f_x)
    return powers_of_two(found / found[state] * (abs(value - begin.x[state]) or 1.0))
