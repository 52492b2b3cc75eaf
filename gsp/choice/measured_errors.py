"""What reduced flows are off by over the whole span, measured against a full run, where that is not predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsp.choice.candidates import (
    GRID_POINTS,
    INTEGRATION,
    Candidate,
    Trial,
    left_to_model,
    measured_candidate,
    run_model,
)
from gsp.choice.forecast import Forecast
from gsp.choice.prediction import Failure
from gsp.errors import GspError
from gsp.integration.spread_times import spread_times
from gsp.scenes.study import Study

# Runs that are compared: far finer than any tolerance.
RTOL = 1e-10


def measured_errors(
    study: Study, candidates: Sequence[Candidate], names: Sequence[str], layer: float
) -> dict[int, float]:
    """The largest error of the states `names` over the span behind the `layer`, relative to how large each is there, by
    order.

    Without flows whose runs take more steps than the full run calls its field: reducing to them saves nothing; and
    empty where the full run does not reach its end.
    """
    scene = study.scene
    first, last = scene.span
    if not layer < last - first:
        return {}
    full = run_model(study.system, study.start, scene, scene.span, INTEGRATION * scene.tolerance)
    times = spread_times(full, first + layer, last, GRID_POINTS)
    exact = run_model(study.system, study.start, scene, scene.span, RTOL, at=times)
    if not exact.status.ok:
        return {}
    found = {}
    for c in candidates:
        if c.order is None or (c.order and not c.follows):
            continue
        try:
            start = study.slow_start(c.order)
        except GspError:
            # The series of the layer ends before this order: it has no place to begin.
            continue
        own = run_model(
            study.reduced(c.order, reconstructed=False),
            start,
            scene,
            scene.span,
            RTOL,
            at=times,
            max_steps=exact.stats.field_calls,
        )
        if own.status.ok:
            gaps = [np.abs(own[x] - exact[x]).max() / (np.abs(exact[x]).max() or 1.0) for x in names]
            found[c.order] = float(max(gaps))
    return found


def measured_where_untold(trials: Sequence[Trial], forecast: Forecast, names: Sequence[str]) -> list[Trial]:
    """The same; where nothing is predicted to serve, and the errors of some are not told, those are measured."""
    untold = [t.candidate for t in trials if t.candidate.failure is Failure.UNTOLD]
    if not untold or any(trial.candidate.valid for trial in trials):
        return list(trials)
    scene = forecast.study.scene
    errors = measured_errors(forecast.study, untold, names, forecast.layer)
    # What passes it stays as it was: how far it would have held is told there.
    serving = {order: error for order, error in errors.items() if error <= left_to_model(scene.tolerance)}
    return [
        measured_candidate(t, serving[t.candidate.order], scene) if t.candidate.order in serving else t
        for t in trials
    ]
