"""Runs to their first event, where no strip lies unseen between the points that events are looked for at.

A step may be far longer than a strip in which a function of the state alone changes its sign, an icy patch of a road,
say, which moves nothing while the contact holds. The function is enclosed in balls over parts of each step, which are
halved until each keeps clear of zero or shows the strip; up to its middle the run is then made again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import sympy as sp
from flint import arb

from gsp.algebra.precision import precision
from gsp.errors import Status, UnsupportedFunctionError
from gsp.integration.events import Event
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction
from gsp.proofs.equations import without_decimals
from gsp.systems.system import VectorField

# Parts of a step at first, which are halved down to the relative tolerance, and how many halves are looked at in all.
PARTS, MOST = 8, 2000
# A function has a sign where it has it over so much rounding of the states.
ROUNDING = 16 * float(np.finfo(float).eps)


class WatchedRun(NamedTuple):
    """A run to its first event; `is_clear` where enclosures leave no other one on the way."""

    run: Trajectory
    is_clear: bool


def enclosed(field: VectorField, events: Sequence[Event]) -> list[BallFunction] | None:
    """The functions of events that have a direction, negative before them; None where one has no enclosure."""
    values = dict(field.parameters)
    try:
        return [
            BallFunction(
                field.states,
                [without_decimals((e.direction * sp.sympify(e.expression, strict=True)).xreplace(values))],
            )
            for e in events
        ]
    except UnsupportedFunctionError:
        return None


def run_to_event(
    field: VectorField,
    *,
    start: Mapping[str, float],
    span: tuple[float, float],
    rtol: float,
    atol: float,
    events: Sequence[Event],
    functions: Sequence[BallFunction] | None,
) -> WatchedRun:
    """The run of `field` from `start` to the first of the `events`, which end it and are `functions` in balls."""
    options = RunOptions(events=events)
    run = trajectory_of(field, start=start, span=span, rtol=rtol, atol=atol, options=options)
    while functions is not None:
        with precision(balls.PRECISION), np.errstate(all="ignore"):
            strip, is_clear = _strip(functions, run, rtol)
        if strip is None:
            return WatchedRun(run, is_clear)
        before = (span[0], strip)
        again = trajectory_of(field, start=start, span=before, rtol=rtol, atol=atol, options=options)
        if again.status is not Status.EVENT_REACHED:
            break
        # What lies beside the event that ended the run, as near as its place is known, is that event.
        earlier = abs(run.t[-1] - again.t[-1]) > rtol * abs(run.t[-1] - run.t[0])
        run = again
        if not earlier:
            break
    return WatchedRun(run, False)


def _strip(functions: Sequence[BallFunction], run: Trajectory, rtol: float) -> tuple[float | None, bool]:
    """A time in the first strip seen where one of the functions is positive, and whether there is no other place."""
    if run.t.size < 2:
        return None, True
    shares = np.arange(PARTS) / PARTS
    low = (run.t[:-1, None] + np.diff(run.t)[:, None] * shares).ravel()
    high = np.append(low[1:], run.t[-1])
    margin = ROUNDING * np.abs(run.y).max(axis=1)
    begun = _box(run.y[:, 0] - margin, run.y[:, 0] + margin)
    # What is not negative at the start, on a surface that an event has located, lies in a strip once it has been so.
    waiting = [i for i, function in enumerate(functions) if not function(begun)[0] < 0]
    budget = MOST
    for _ in range(int(np.ceil(-np.log2(rtol)))):
        middle = low + 0.5 * (high - low)
        first, at, last = (run.at(t) for t in (low, middle, high))
        # A curve leaves its chord by hardly more than it does in the middle.
        bend = 2.0 * np.abs(at - 0.5 * (first + last))
        left, until = [], dict.fromkeys(waiting, low[0])
        for k in range(len(low)):
            lowest = np.minimum(first[:, k], last[:, k]) - bend[:, k]
            highest = np.maximum(first[:, k], last[:, k]) + bend[:, k]
            box = _box(lowest, highest)
            near = [i for i, function in enumerate(functions) if not function(box)[0] < 0]
            if not near:
                continue
            point = _box(at[:, k] - margin, at[:, k] + margin)
            for i in near:
                if until.get(i) == low[k]:
                    until[i] = high[k]
                elif functions[i](point)[0] > 0:
                    return float(middle[k]), False
            left.append(k)
        budget -= 2 * len(left)
        if not left or budget < 0:
            return None, not left
        low, middle, high = low[left], middle[left], high[left]
        low, high = (np.stack(ends, axis=1).ravel() for ends in ((low, middle), (middle, high)))
    return None, False


def _box(low: np.ndarray, high: np.ndarray) -> list[arb]:
    return [balls.hull(float(a), float(b)) for a, b in zip(low, high)]
