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

# What takes so many times as long as the quickest, in so many runs, is dear whatever slows the machine. It is run no
# more.
DEAR, SURE = 100.0, 2

clock = time.perf_counter
RESOLUTION = time.get_clock_info("perf_counter").resolution


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


def cheapest(serving: Sequence[Candidate]) -> Candidate | None:
    """The first of those that serve, the simplest first, that no other is clearly cheaper than; None of none."""
    dear = (any(cost_beside(other, one) is Cost.LESS for other in serving) for one in serving)
    return next((one for one, is_dear in zip(serving, dear) if not is_dear), None)


def timed(trials: Sequence[Trial]) -> list[Candidate]:
    """The candidates of `trials` with their timings, seconds over the span.

    The runs are taken in turn: what slows the machine for a while slows every model.
    """
    rounds: list[list[list[float]]] = [[] for _ in trials]
    repeated = range(len(trials))
    for k in range(RUNS * MEASUREMENTS):
        if k == SURE:
            least = [min(map(sum, own)) for own in rounds]
            quickest = min((seconds for seconds in least if seconds > 0.0), default=0.0)
            repeated = [i for i, seconds in enumerate(least) if seconds <= DEAR * quickest]
        for i in repeated:
            rounds[i].append([_seconds(run) for run in trials[i].runs])
    return [
        replace(trial.candidate, timings=_timings(trial, own)) if trial.runs else trial.candidate
        for trial, own in zip(trials, rounds)
    ]


def _timings(trial: Trial, rounds: Sequence[Sequence[float]]) -> tuple[float, ...]:
    """What a run costs by each measurement; what is dear counts alike in all of them."""
    parts = [rounds[k * RUNS : (k + 1) * RUNS] or rounds for k in range(MEASUREMENTS)]
    return tuple(trial.cost(*(min(seconds) for seconds in zip(*part))) for part in parts)


def _seconds(run: Callable[[], object]) -> float:
    """The least of what some runs take: several where they are so quick that an interruption is felt."""
    least = spent = 0.0
    # A run that is over in a millisecond is repeated until one has passed, sixteen times at the most.
    for k in range(16):
        begun = clock()
        run()
        taken = clock() - begun
        least, spent = (min(least, taken) if k else taken), spent + taken
        if spent >= 1e-3:
            break
    # Costs are divided by one another, and a clock that is coarse or stands still says 0.
    return max(least, RESOLUTION)
