"""What candidates cost: all of them timed in turn, twice over, and one is cheaper that is cheaper both times."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import StrEnum

from gsp.choice.candidates import Candidate, Trial

# Seconds are the least of so many runs in each of so many measurements.
RUNS, MEASUREMENTS = 3, 2
# Reducing has to save a tenth, or it is not worth a second model: quasi-steady states saved 5 % where flames were
# computed, less than they cost in accuracy. Models within a tenth of one another cost the same.
WORTH_IT = 0.9

clock = time.perf_counter


class Cost(StrEnum):
    """What a run of one model costs beside that of another."""

    LESS = "takes less time"
    SAME = "takes about the same time"
    MORE = "takes longer"


def cost_beside(model: Candidate, other: Candidate) -> Cost:
    """What `model` costs beside `other`: less or more where every measurement says so by a tenth, else the same."""
    pairs = list(zip(model.timings, other.timings, strict=True))
    if all(own <= WORTH_IT * its for own, its in pairs):
        return Cost.LESS
    return Cost.MORE if all(its <= WORTH_IT * own for own, its in pairs) else Cost.SAME


def timed(trials: Sequence[Trial]) -> list[Candidate]:
    """The candidates of `trials` with their timings, seconds over the span.

    The runs are taken in turn: what slows the machine for a while slows every model.
    """
    measurements = [_measurement(trials) for _ in range(MEASUREMENTS)]
    return [
        replace(trial.candidate, timings=timings) if trial.runs else trial.candidate
        for trial, timings in zip(trials, zip(*measurements))
    ]


def _measurement(trials: Sequence[Trial]) -> list[float]:
    rounds = [[[_seconds(run) for run in trial.runs] for trial in trials] for _ in range(RUNS)]
    return [
        trial.cost(*(min(seconds) for seconds in zip(*own))) if trial.runs else float("nan")
        for trial, own in zip(trials, zip(*rounds))
    ]


def _seconds(run: Callable[[], object]) -> float:
    begun = clock()
    run()
    return clock() - begun
