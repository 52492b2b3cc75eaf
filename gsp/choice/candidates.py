"""The models that a scene could be run with: what each is predicted to be wrong by, and what it costs."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from gsp.choice.forecast import Forecast, SurfaceForecast, surface_forecast_of
from gsp.choice.prediction import CHECKS, REFINEMENTS, SMALLEST_RTOL, Failure, Prediction
from gsp.errors import GspError, Status
from gsp.integration.methods import SOLVERS, Method, choose_method
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.lowering.compiled_flow import compile_flow
from gsp.scenes.scene import Scene
from gsp.systems.flow import Flow
from gsp.systems.region import Interval, shown_within
from gsp.systems.tolerances import absolute_tolerance

# Share of the tolerance that is the integrator's; a model has the rest.
INTEGRATION = 0.1
# A layer that takes more of the span than this leaves nothing to reduce.
LARGEST_LAYER = 0.5
# The full system is measured on this share of the span behind its layer, in two halves. Its layer is over when its
# integrator does not see it any more, or at the largest share above.
PIECE = 0.15
# A run of so few steps is made over the span: these take no longer than a few calls.
FEW_STEPS = 100
# Errors over the span are looked at on so many times.
GRID_POINTS = 97
MAX_STEPS = 1_000_000


class ModelKind(StrEnum):
    """What can be run for a scene."""

    REDUCED = "reduced"
    SOLVED = "solved"
    FULL = "full"


def left_to_model(tolerance: float) -> float:
    """What a model may be off by, predicted or measured: the integrator has the rest."""
    return (1.0 - INTEGRATION) * tolerance


def limit_passed(error: float, tolerance: float) -> str:
    """What an error passes that is more than a model may be off by."""
    if not error <= tolerance:
        return "the tolerance"
    return f"the {left_to_model(tolerance):.3g} that the integrator leaves of the tolerance"


def _passing(predicted: float, tolerance: float) -> str:
    """That a predicted error is more than a model may be off by."""
    return f"the predicted error passes {limit_passed(predicted, tolerance)}"


def label_of(kind: ModelKind, order: int | None) -> str:
    """Kind and order."""
    return str(kind) if order is None else f"{kind} {order}"


@dataclass(frozen=True)
class Candidate:
    """One model: its predicted relative error over the span, and what a run over the span costs.

    `order` is that of a reduced flow, else None. `holds_until` is the time up to which the model meets the tolerance
    and stays valid. `timings` are the seconds of a run by each measurement, and `seconds` the least of them. They,
    `steps` and `field_calls` are for the span: of a reduced flow measured, of the full system extrapolated from a
    piece; of a reduced flow whose run ends early, and `ended` says where, they are as far as it holds, for a `share` of
    the span. `preparation` seconds come once, whatever is run afterwards.
    `valid` says whether the model serves the whole span, and if not, `why_not`, with the `failure` of its run. The
    predicted error of the full system is that of its integrator. A model that was not looked at has nan, and so has a
    full run that ends early. Where a full run over the span was made, for nothing else tells the error, it is that
    against it: `is_measured`. `unseen` says that no run was seen to reach the end to which the cost is extrapolated.
    """

    kind: ModelKind
    order: int | None
    predicted: float = float("nan")
    holds_until: float = float("nan")
    timings: tuple[float, ...] = ()
    preparation: float = float("nan")
    steps: float = float("nan")
    field_calls: float = float("nan")
    valid: bool = False
    why_not: str = ""
    failure: Failure | None = None
    is_measured: bool = False
    unseen: str = ""
    share: float = 1.0
    ended: str = ""

    @property
    def seconds(self) -> float:
        """The least of the timings; nan where it was not timed."""
        return min(self.timings, default=float("nan"))

    @property
    def remark(self) -> str:
        """Why it does not serve, that its error was measured, or what was not seen; else empty."""
        if not self.valid:
            return self.why_not
        return "measured over the span" if self.is_measured else self.unseen

    @property
    def follows(self) -> bool:
        """Whether the rest follows an attracting slow manifold to the end, if one that leaves the region."""
        return self.valid or self.failure in (Failure.ERROR, Failure.UNTOLD, Failure.REGION)

    @property
    def label(self) -> str:
        """Kind and order."""
        return label_of(self.kind, self.order)


@dataclass(frozen=True)
class Trial:
    """A candidate that is still to be timed: its `runs`, and the `cost` of one over the span by what they take.

    Without runs it has no cost.
    """

    candidate: Candidate
    runs: tuple[Callable[[], Trajectory], ...] = ()
    cost: Callable[..., float] = float


def reduced_candidate(forecast: Forecast, order: int, scene: Scene, rtol: float) -> Trial:
    """The reduced flow of `order`, predicted."""
    prediction = forecast.prediction
    first, last = scene.span
    if order not in prediction.runs:
        why = f"not looked at: the series is run through order {max(prediction.runs)} only"
        return Trial(Candidate(ModelKind.REDUCED, order, holds_until=first, why_not=why))
    status, reached = prediction.runs[order].status, prediction.covered(order)
    after = first + forecast.layer
    limit = left_to_model(scene.tolerance)
    predicted, holds, why = float("inf"), first, ""
    failure: Failure | None = None
    if forecast.layer > LARGEST_LAYER * (last - first):
        length = last - first
        part = "the whole span" if forecast.layer >= length else "more than half of the span"
        why = f"the initial layer takes {part}: {forecast.layer:.3g} of {length:.3g}"
    else:
        holds, failure = prediction.holds_until(order, limit, after=after, last=last)
        # Infinite where a run has ended; then the reason says more.
        times = forecast.times(prediction.runs[order], GRID_POINTS)
        predicted = float(forecast.errors(order, times).max())
        is_estimated = prediction.tells(order, times)
        if failure in (None, Failure.ERROR) and not is_estimated:
            failure = Failure.UNTOLD
            why = f"{failure}: {_untold(prediction, order, times)}"
        elif failure is Failure.END:
            why = f"{failure} at t = {shown_within(min(holds, reached), scene.span)}: {status.meaning}"
        elif failure is not None:
            told = _passing(predicted, scene.tolerance) if failure is Failure.ERROR else failure
            if failure is Failure.REGION and holds == after:
                told = "the slow manifold is outside the region"
            why = f"{told} at t = {shown_within(holds, scene.span)}"
        elif predicted > limit:
            failure = Failure.ERROR
            why = _passing(predicted, scene.tolerance)
        if not is_estimated:
            predicted, holds = float("nan"), first
        elif prediction.crossing(order) < last:
            predicted = float("nan")
    # Beyond a fold it would chatter; a run of no length has no cost.
    whole = status.ok
    ended = "" if whole else f"its run ends at t = {shown_within(reached, scene.span)}: {status.meaning}"
    end = last if whole else min(max(holds, first + PIECE * (last - first)), reached)
    # A run over a smaller share of the span is no run.
    if not end - first > 1e-3 * (last - first):
        why = why or f"it ends as it begins: {status.meaning}"
        return Trial(
            Candidate(
                ModelKind.REDUCED, order, predicted, holds,
                preparation=forecast.preparation[order], why_not=why, failure=failure,
            )
        )  # fmt: skip

    def again() -> Trajectory:
        return run_model(forecast.flows[order], forecast.starts[order], scene, (first, end), rtol)

    share, run = (end - first) / (last - first), again()
    candidate = Candidate(
        ModelKind.REDUCED, order, predicted, holds, (), forecast.preparation[order],
        run.stats.steps, run.stats.field_calls, not why, why, failure, share=share, ended=ended,
    )  # fmt: skip
    return Trial(candidate, (again,))


def _untold(prediction: Prediction, order: int, times: np.ndarray) -> str:
    """Why no run tells the error of this order."""
    if prediction.is_hidden(order, times):
        return "across a kink of the field the next order moves the run by less than the one after it"
    last = prediction.compared(order)[-1]
    if last == order:
        return "no higher order is run"
    return f"the term of order {last} moves the run by no more than its own error, and no higher order is run"


def solved_candidate(
    forecast: Forecast, reduced: Sequence[Candidate], scene: Scene, rtol: float
) -> tuple[Trial, SurfaceForecast | None]:
    """The flow on the solved manifold: tried when no reduced flow is exact enough, for it takes seconds to solve."""

    def left_out(why: str) -> tuple[Trial, None]:
        return Trial(Candidate(ModelKind.SOLVED, None, holds_until=scene.span[0], why_not=why)), None

    serving = next((c for c in reduced if c.valid), None)
    if serving is not None:
        return left_out(f"not solved: {serving.label} is exact enough")
    if not any(
        c.failure is Failure.UNTOLD
        or (c.failure in (Failure.ERROR, Failure.ORDER) and np.isfinite(c.predicted))
        for c in reduced
    ):
        return left_out("not solved: no reduced flow shows where, to the end of the span")
    try:
        surface = surface_forecast_of(scene, forecast)
    except GspError as error:
        return left_out(error.reason)
    last = scene.span[1]
    times = forecast.times(surface.run, GRID_POINTS)
    predicted, limit = float(surface.errors(times).max()), left_to_model(scene.tolerance)

    def again() -> Trajectory:
        return run_model(surface.flow, surface.start, scene, scene.span, rtol)

    run = again()
    why, failure = "", None
    if not run.status.ok:
        failure = Failure.END
        why = f"{failure} at t = {shown_within(run.t[-1], scene.span)}: {run.status.meaning}"
    elif not surface.within_region(times, limit).all():
        failure = Failure.REGION
        left = _last_good(lambda t: surface.within_region(t, limit), times)
        why = f"{failure} at t = {shown_within(left, scene.span)}"
    elif not surface.inside(times).all():
        why = "the run leaves the piece of the manifold that was solved"
    elif not predicted <= limit:
        failure = Failure.ERROR
        why = _passing(predicted, scene.tolerance)
    holds = _held(surface, times, limit) if why else last
    preparation = forecast.shared + surface.preparation
    candidate = Candidate(
        ModelKind.SOLVED, None, predicted, holds, (), preparation,
        float(run.stats.steps), float(run.stats.field_calls), not why, why, failure,
    )  # fmt: skip
    return Trial(candidate, (again,)), surface


def _held(surface: SurfaceForecast, times: np.ndarray, limit: float) -> float:
    """The time up to which the run on the solved manifold is inside and its error is within `limit`."""

    def holds(t: np.ndarray) -> np.ndarray:
        return surface.inside(t) & surface.within_region(t, limit) & (surface.errors(t) <= limit)

    alive = times[times <= surface.run.t[-1]]
    return _last_good(holds, alive) if alive.size else float(times[0])


def _last_good(good: Callable[[np.ndarray], np.ndarray], times: np.ndarray) -> float:
    """The last time up to which all are `good`, the first where none is; looked at between `times` where they fail."""
    for _ in range(1 + REFINEMENTS):
        first = int(np.argmin(np.append(good(times), False)))
        if first in (0, len(times)):
            return float(times[-1 if first else 0])
        times = np.linspace(times[first - 1], times[first], CHECKS)
    return float(times[0])


def measured_candidate(trial: Trial, error: float, scene: Scene) -> Trial:
    """The trial with its error over the span, which was measured: it goes before what is predicted of it.

    What leaves the region that was asked about does not serve, however small its error is.
    """
    candidate = trial.candidate
    serves = error <= left_to_model(scene.tolerance)
    # Beside a tolerance that is not passed, what is.
    passed = f", and passes {limit_passed(error, scene.tolerance)}" if error <= scene.tolerance else ""
    if not candidate.follows or (serves and candidate.failure is Failure.REGION):
        return trial
    found = replace(
        candidate,
        predicted=error,
        is_measured=True,
        valid=serves,
        holds_until=scene.span[1] if serves else candidate.holds_until,
        why_not="" if serves else f"its error, measured over the span, is {error:.1e}{passed}",
        failure=None if serves else Failure.ERROR,
    )
    return replace(trial, candidate=found)


def full_candidate(flow: Flow, start, scene: Scene, layer: float, rtol: float) -> tuple[Trial, Interval]:
    """The full system, its cost that of a run, or extrapolated from the layer and a piece of the span behind it."""
    first, last = scene.span
    begun = time.perf_counter()
    compiled = compile_flow(flow)
    # Over a short piece the default could be another method than over the span, with steps of another kind.
    method = choose_method(compiled, max(rtol, SMALLEST_RTOL))
    # The code of a step is built here, once.
    SOLVERS[method].program(compiled)
    preparation = time.perf_counter() - begun
    over = first + min(layer, LARGEST_LAYER * (last - first))
    middle, end = (over + share * PIECE * (last - over) for share in (0.5, 1.0))

    def until(t: float, most: int = MAX_STEPS) -> Trajectory:
        return run_model(flow, start, scene, (first, t), rtol, method=method, max_steps=most)

    run = until(end)

    def ended(short: Trajectory) -> tuple[Trial, Interval]:
        # What it would cost to the end is not known, nor is it off by anything there.
        candidate = Candidate(
            ModelKind.FULL, None, holds_until=float(short.t[-1]), preparation=preparation, why_not=short.message
        )
        return Trial(candidate), (first, end)

    if not run.status.ok:
        return ended(run)
    done = run.stats.steps
    # The same steps, none shortened to end with the piece: one that was halved there foretold twice as many.
    attempts = done + run.stats.rejected
    free = run_model(flow, start, scene, (first, last), rtol, method=method, max_steps=attempts).t
    more = len(free) - 1 + _density(free, middle) * (last - free[-1]) - done
    total = done + more
    # What such a run takes beside the call itself is little, and no difference of two pieces tells it.
    if total <= FEW_STEPS:
        whole = until(last)
        if not whole.status.ok:
            return ended(whole)
        candidate = Candidate(
            ModelKind.FULL, None, rtol, last, (), preparation, whole.stats.steps, whole.stats.field_calls, True,
        )  # fmt: skip
        return Trial(candidate, (lambda: until(last),)), (first, end)
    most, unseen = int(np.ceil(total)), ""
    there = {s.name: float(run[s.name][-1]) for s in flow.states}
    # Whether a longer one gets to the end is looked at with this tolerance, which takes fewer steps.
    ahead = run_model(flow, there, scene, (end, last), max(rtol, 1e-3), method=method, max_steps=most)
    if not ahead.status.ok:
        # Coarse runs go astray too: where a run ends is said by one as exact as those that are foretold.
        whole = until(last, 2 * most)
        if whole.status is Status.TOO_MANY_STEPS:
            there_yet = shown_within(whole.t[-1], scene.span)
            unseen = f"if it reaches the end: after {2 * most} steps it is at t = {there_yet}"
        elif not whole.status.ok:
            return ended(whole)
    # The cost of a call is not paid again, that of a step is.
    extra = max(done - until(middle).stats.steps, 1)

    def over_the_span(whole: float, half: float) -> float:
        each = float(np.clip((whole - half) / extra, 0.1 * whole / done, whole / done))
        return whole + each * more

    candidate = Candidate(
        ModelKind.FULL, None, rtol, last, (), preparation, total, run.stats.field_calls * total / done, True,
        unseen=unseen,
    )  # fmt: skip
    return Trial(candidate, (lambda: until(end), lambda: until(middle)), over_the_span), (first, end)


def _density(times: np.ndarray, middle: float) -> float:
    """Steps per unit of time from `middle` on, where the first counts for its share."""
    begins, ends = times[:-1], times[1:]
    counted = np.clip((ends - middle) / (ends - begins), 0.0, 1.0)
    return float(counted.sum()) / (times[-1] - middle)


def run_model(
    flow: Flow, start, scene: Scene, span: Interval, rtol: float, *,
    at=None, method: Method | None = None, max_steps: int = MAX_STEPS,
) -> Trajectory:  # fmt: skip
    rtol = max(rtol, SMALLEST_RTOL)
    return trajectory_of(
        flow,
        start=start,
        span=span,
        epsilon=None if flow.epsilon is None else scene.epsilon,
        rtol=rtol,
        atol=absolute_tolerance(rtol, scene.region, scene.start),
        at=at,
        options=RunOptions(stops_at_times=at is not None, method=method, max_steps=max_steps),
    )
