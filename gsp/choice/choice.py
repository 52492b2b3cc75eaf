"""Model no more than a scene needs: the cheapest of the reduced flows and the full system that meets a tolerance.

The error of every reduced flow is predicted without running the full system over the span (see `prediction`); costs are
measured, that of the full system on a piece. Then the choice is run against the full system on that piece, so that what
was predicted can be seen beside what was measured. Where reducing saves too little the full system is run. All of
it is measured once, and shown wherever the choice is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gsp.algebra.brevity import HALF_LINE
from gsp.choice.candidates import (
    GRID_POINTS,
    INTEGRATION,
    PIECE,
    Candidate,
    ModelKind,
    Trial,
    full_candidate,
    measured_candidate,
    reduced_candidate,
    run_model,
    solved_candidate,
)
from gsp.choice.costs import Cost, cost_beside, timed
from gsp.choice.forecast import Forecast, SurfaceForecast, forecast_of
from gsp.choice.measured_errors import measured_where_untold
from gsp.choice.prediction import CLEARER, SMALLEST_RTOL, Failure
from gsp.choice.verdict import (
    CUT_SHORT,
    Evidence,
    Verdict,
    far_from_origin,
    in_words,
    judge,
    seconds_shown,
    serving_of,
)
from gsp.errors import NO_REASON, DeclarationError, GspError
from gsp.integration.spread_times import spread_times
from gsp.integration.trajectory import Trajectory
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.results.card import Card
from gsp.results.tabular import Tabular
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.slow.sampled_manifold import SampledManifold
from gsp.systems.arguments import check_flag
from gsp.systems.flow import Flow, check_orders
from gsp.systems.region import Interval, shown_within

# Errors on the piece are measured at so many times.
PIECE_POINTS = 33


@dataclass(frozen=True, eq=False, repr=False)
class Choice(Card, Tabular):
    """What to run for a scene at one `epsilon` and `tolerance`, and why.

    Errors are the largest of |difference| over the `names` (the slow variables in standard form, and the fast ones if
    asked for), each relative to its largest value, from the end of the initial `layer` (slow time) on.
    `predicted` is the model's over the span; on the `piece` (t0, t1) it is `predicted_on_piece`, and `measured` there
    against a full run. `speed_up` is full over chosen seconds. `partial` is the reduced flow that serves longest when
    none serves the whole span, for `simulate`; `manifold` is the solved manifold when that was chosen. `verdict` is the
    answer to "may I reduce?", the same wherever it is shown. `fast_error` is what the fast variables of the model it
    speaks of are predicted to be off by behind the layer, and `layer_error` in it; not numbers where there is no such
    model, or where the fast variables are among `names`. Where their series does not converge, `fast_error` is measured
    on `fast_measured` (t0, t1), the part of the piece behind their layer. `ending` says why the series ends
    where it does not tell the error of one of the orders asked for.
    """

    study: Study
    epsilon: float
    tolerance: float
    names: tuple[str, ...]
    model: Candidate
    candidates: tuple[Candidate, ...]
    partial: Candidate | None
    manifold: SampledManifold | None
    layer: float
    piece: Interval
    predicted_on_piece: float
    measured: float
    speed_up: float
    verdict: Verdict
    ending: str = ""
    fast_error: float = float("nan")
    layer_error: float = float("nan")
    fast_measured: Interval | None = None

    @property
    def scene(self) -> Scene:
        """The scene it was made for."""
        return self.study.scene

    @property
    def predicted(self) -> float:
        """The chosen model's predicted error over the span."""
        return self.model.predicted

    @property
    def reason(self) -> str:
        """Why, in the verdict's sentences."""
        return self.verdict.sentences

    def __repr__(self) -> str:
        return (
            f"Choice({self.scene.name or 'scene'}: {self.model.label}, predicted {self.predicted:.2g}, "
            f"measured {self.measured:.2g}, speed-up {self.speed_up:.2g})"
        )

    def __str__(self) -> str:
        lines = [
            str(self.verdict),
            f"  run: {in_words(self.model)}",
            f"  {self.scene.system.epsilon} = {self.epsilon:g}, tolerance {self.tolerance:g} "
            f"on {', '.join(self.names)}, layer over after {self.layer:.3g}",
            f"  {'':2}{'model':<10} {'predicted':>9}  {'run':>9}  {'steps':>7}  {'prepare':>8}",
        ]
        for c in self.candidates:
            mark = "->" if c is self.model else ""
            steps = "" if np.isnan(c.steps) else format(c.steps, ".0f")
            row = (
                f"  {mark:2}{c.label:<10} {_shown(c.predicted):>9}  {seconds_shown(c.seconds):>9}  {steps:>7}  "
            )
            lines.append(f"{row}{seconds_shown(c.preparation):>8}  {c.remark}".rstrip())
        if any(c.share < 1.0 for c in self.candidates):
            lines.append(f"  {CUT_SHORT}")
        begin, end = (shown_within(t, self.scene.span) for t in self.piece)
        lines.append(
            f"  on t = {begin} to {end}: predicted {_shown(self.predicted_on_piece)}, "
            f"measured {_shown(self.measured) or 'nothing, for a run ended early'}"
        )
        # Else the verdict says it.
        if self.ending and any(c.valid for c in self.candidates if c.kind is not ModelKind.FULL):
            lines.append(f"  {self.ending}")
        return "\n".join(lines)


def choose(
    scene: Scene | Study,
    *,
    orders: Sequence[int] = (0, 1, 2, 3),
    tolerance: float | None = None,
    epsilon: float | None = None,
    fast: bool = False,
    solve: bool = True,
) -> Choice:
    """The cheapest model of a scene that meets its tolerance, as a `Choice`.

    The candidates are the reduced flows of `orders`, started at the base point of the fast fibre through the scene's
    start, the flow on the solved manifold where none of these is exact enough (with `solve`, for it takes up to
    seconds), and the full system, all integrated with a tenth of `tolerance` (default the scene's, as is `epsilon`).
    With `fast` the errors of the fast variables count as well, outside the layer: within it a reduced flow has no value
    for them, see `composite`. A reduced flow is valid while the branch attracts along it, the normal rate dominates
    the tangential one, the region is not left, no kink of the field is crossed (from order 1 on), and the series is at
    or below its best order.

    A scene that cannot be reduced at all is answered with the full system and the reason. Raises `DeclarationError` for
    arguments that are not well formed.

    >>> from gsp import models
    >>> choose(models.load("linear"), orders=(0,), tolerance=1e-3).candidates[0].valid
    True
    """
    study = study_of(scene, verb="choose").asking(tolerance=tolerance, epsilon=epsilon)
    scene = study.scene
    check_flag(fast, what="fast")
    check_flag(solve, what="solve")
    valid_orders = tuple(sorted(set(check_orders(orders))))
    _check_start(scene)
    rtol = INTEGRATION * scene.tolerance
    try:
        forecast: Forecast | None = forecast_of(study, valid_orders, fast=fast)
        obstacle = NO_REASON
    except GspError as error:
        forecast, obstacle = None, error.reason
    flow, start = _full(scene, forecast)
    layer = forecast.layer if forecast else 0.0
    fast_time = scene.epsilon / forecast.inner.gap if forecast else 0.0
    gone = max(layer, fast_time * np.log(1.0 / rtol))
    whole, piece = full_candidate(flow, start, scene, gone, rtol)
    trials = [reduced_candidate(forecast, n, scene, rtol) for n in valid_orders] if forecast else []
    known = [study.measured.get(n) for n in valid_orders]
    trials = [t if e is None else measured_candidate(t, e, scene) for t, e in zip(trials, known)]
    beside = _OnPiece(scene, forecast, piece)
    trials = [beside.judged(trial) for trial in trials]
    names = _compared(scene, forecast)
    surface = None
    if forecast:
        trials = measured_where_untold(trials, forecast, names)
    if forecast and solve:
        solved, surface = solved_candidate(forecast, [trial.candidate for trial in trials], scene, rtol)
        trials.append(beside.judged(solved, surface))
    *reduced, full = timed([*trials, whole])
    ending = ""
    if forecast and max(forecast.prediction.runs) <= max(valid_orders):
        astray = f"{forecast.astray[:1].upper()}{forecast.astray[1:]}."
        ending = astray if forecast.astray else study.why_shorter(max(valid_orders) + 1)
    model, partial = select(full, reduced, scene.span)
    serving = serving_of(model, reduced)
    fast_error, layer_error = _fast_errors(serving, forecast, surface, gone)
    fast_measured = None
    if forecast and serving and serving.order is not None and np.isfinite(layer_error) and np.isnan(fast_error):
        fast_measured = _behind(gone, piece)
        fast_error = _fast_measured(forecast, serving.order, scene, fast_measured, rtol)
    verdict = judge(
        Evidence(
            scene=scene,
            candidates=(*reduced, full),
            model=model,
            partial=partial,
            layer=layer,
            obstacle=obstacle,
            ending=ending,
            place=_end_of(partial, forecast),
            names=_defined(names, forecast),
            fast_error=fast_error,
            layer_error=layer_error,
            fast_measured=fast_measured,
            far=far_from_origin(forecast.study.system, names, forecast.study.region) if forecast else None,
            limit_ends=_limit_ends(forecast),
        )
    )
    expected, measured = beside.errors(model, surface)
    return Choice(
        study=study,
        epsilon=scene.epsilon,
        tolerance=scene.tolerance,
        names=names,
        model=model,
        candidates=(*reduced, full),
        partial=partial,
        manifold=surface.manifold if surface is not None and model.kind is ModelKind.SOLVED else None,
        layer=layer,
        piece=piece,
        predicted_on_piece=expected,
        measured=measured,
        speed_up=full.seconds / model.seconds,
        verdict=verdict,
        ending=ending,
        fast_error=fast_error,
        layer_error=layer_error,
        fast_measured=fast_measured,
    )


def select(full: Candidate, reduced: Sequence[Candidate], span: Interval) -> tuple[Candidate, Candidate | None]:
    """(model, the reduced one that serves part of the span), given every candidate's cost."""
    best = serving_of(full, reduced)
    if best is not None:
        return (full if full.valid and cost_beside(best, full) is not Cost.LESS else best), None
    flows = [c for c in reduced if c.order is not None]
    if not flows:
        return full, None
    furthest = max(c.holds_until for c in flows)
    # Of those that go about as far the most exact.
    longest = [c for c in flows if c.holds_until - span[0] >= 0.9 * (furthest - span[0])][-1]
    served = (longest.holds_until - span[0]) / (span[1] - span[0])
    # A reduced flow that holds for less than this share of the span does not pay for being switched on and off.
    return full, longest if served >= 0.05 else None


def _fast_errors(
    serving: Candidate | None, forecast: Forecast | None, surface: SurfaceForecast | None, gone: float
) -> tuple[float, float]:
    """(behind the initial layer, in it): predicted errors of fast variables that are not among those asked for.

    Their layer is `gone` later than that of the slow variables, which it moves by O(epsilon).
    """
    if serving is None or forecast is None or len(forecast.prediction.names) > len(forecast.study.system.x):
        return float("nan"), float("nan")
    first, last = forecast.study.scene.span
    begun = min(first + gone, last)
    if serving.order is not None:
        run = forecast.prediction.runs[serving.order]
        return forecast.fast_errors(serving.order, spread_times(run, begun, last, GRID_POINTS))
    assert surface is not None
    return surface.fast_errors(spread_times(surface.run, begun, last, GRID_POINTS))


def _fast_measured(forecast: Forecast, order: int, scene: Scene, times: Interval, rtol: float) -> float:
    """The largest relative error of the fast variables of a reduced flow at `times`, against a full run."""
    grid, span = np.linspace(*times, PIECE_POINTS), (scene.span[0], times[1])
    exact = max(CLEARER * scene.tolerance, SMALLEST_RTOL)
    reference = run_model(forecast.study.system, forecast.study.start, scene, span, exact, at=grid)
    own = run_model(forecast.flows[order], forecast.starts[order], scene, span, rtol, at=grid)
    if not (own.status.ok and reference.status.ok):
        return float("nan")
    return max(float(np.abs(own[n] - reference[n]).max()) / size for n, size in forecast.fast.scale.items())


def _behind(layer: float, piece: Interval) -> Interval:
    """The part of the piece behind a layer, or its end where the layer takes most of it."""
    # Only the full system is chosen where the layer takes most of the piece.
    return piece[0] + min(layer, (1.0 - PIECE) * (piece[1] - piece[0])), piece[1]


def _end_of(partial: Candidate | None, forecast: Forecast | None) -> dict[str, float]:
    """Where in the slow variables the partial model holds last."""
    if partial is None or forecast is None or partial.order is None:
        return {}
    run = forecast.prediction.runs[partial.order]
    last = run.sample(min(partial.holds_until, float(run.t[-1])))
    return {s.name: float(last[s.name][0]) for s in forecast.study.system.x}


def _limit_ends(forecast: Forecast | None) -> tuple[float, str] | None:
    """When the run of order 0 ends before the span does, and what it meets; None where it does not, or is not made."""
    run = forecast.prediction.runs.get(0) if forecast else None
    return None if run is None or run.status.ok else (float(run.t[-1]), run.status.meaning)


def _full(scene: Scene, forecast: Forecast | None) -> tuple[Flow, Mapping[str, float]]:
    """The full system and its start, in standard form where there is a forecast."""
    if forecast is None:
        return scene.system, scene.start
    return forecast.study.system, forecast.study.start


def _compared(scene: Scene, forecast: Forecast | None) -> tuple[str, ...]:
    """The names of the states whose errors count."""
    return forecast.prediction.names if forecast else tuple(s.name for s in scene.system.states)


def _defined(names: Sequence[str], forecast: Forecast | None) -> list[str]:
    """The same, slow coordinates that a splitting made with what they are, p = b + c, where that is short to read."""
    splitting = forecast.study.splitting if forecast else None
    made = {} if splitting is None else {s.name: e for s, e in splitting.coordinates.items() if e != s}
    shown = {name: f"{name} = {e}" for name, e in made.items()}
    return [shown[n] if n in shown and len(shown[n]) < HALF_LINE else n for n in names]


@dataclass(frozen=True, eq=False)
class _OnPiece:
    """Models beside the full system on a piece of the span, the layer left out; `forecast` as far as there is one."""

    scene: Scene
    forecast: Forecast | None
    piece: Interval

    @property
    def grid(self) -> np.ndarray:
        return np.linspace(*_behind(self.forecast.layer if self.forecast else 0.0, self.piece), PIECE_POINTS)

    @cached_property
    def reference(self) -> Trajectory:
        """The full system, far more exact than what is measured against it."""
        rtol = max(CLEARER * self.scene.tolerance, SMALLEST_RTOL)
        return run_model(*_full(self.scene, self.forecast), self.scene, self.piece, rtol, at=self.grid)

    def errors(self, model: Candidate, surface: SurfaceForecast | None) -> tuple[float, float]:
        """(predicted, measured) error of a model."""
        scene, forecast, reference = self.scene, self.forecast, self.reference
        (flow, start), names = _full(scene, forecast), _compared(scene, forecast)
        rtol = INTEGRATION * scene.tolerance
        if model.kind is ModelKind.FULL or forecast is None:
            predicted = rtol
            # A run that ends early may have no row on the piece; nothing is measured then.
            scale = {name: float(np.abs(reference[name]).max(initial=0.0)) or 1.0 for name in names}
        elif model.kind is ModelKind.SOLVED:
            assert surface is not None
            flow, start = surface.flow, surface.start
            predicted = float(surface.errors(self.grid).max())
            scale = forecast.prediction.scale
        else:
            order = model.order
            assert order is not None
            flow, start = forecast.flows[order], forecast.starts[order]
            predicted = model.predicted if model.is_measured else float(forecast.errors(order, self.grid).max())
            scale = forecast.prediction.scale
        own = run_model(flow, start, scene, self.piece, rtol, at=self.grid)
        if not (own.status.ok and reference.status.ok):
            return predicted, float("nan")
        return predicted, max(float(np.abs(own[n] - reference[n]).max()) / scale[n] for n in names)

    def judged(self, trial: Trial, surface: SurfaceForecast | None = None) -> Trial:
        """The trial, no longer valid if it is off by more than the tolerance here, whatever was predicted."""
        if not trial.candidate.valid:
            return trial
        _, measured = self.errors(trial.candidate, surface)
        if not measured > self.scene.tolerance:
            return trial
        begin, end = (shown_within(t, self.scene.span) for t in (self.reference.t[0], self.piece[1]))
        found = replace(
            trial.candidate,
            predicted=float("nan"),
            holds_until=self.piece[0],
            valid=False,
            why_not=f"it is off by {measured:.1e} on t = {begin} to {end}, more than was predicted",
            failure=Failure.UNTOLD,
        )
        return replace(trial, candidate=found)


def _check_start(scene: Scene) -> None:
    flow, start = scene.system, scene.system.initial(scene.start)
    rates = compile_flow(flow).rates(np.array([start]), parameter_vector(flow, scene.epsilon))[0]
    bad = [s.name for s, rate in zip(flow.states, rates) if not np.isfinite(rate)]
    if bad:
        place = ", ".join(f"{s.name} = {value:g}" for s, value in zip(flow.states, start))
        raise DeclarationError(
            f"the field is not finite at the scene's start: the rate of {', '.join(bad)} is not.",
            "Move the start into the field's domain.",
            got=place,
        )


def _shown(error: float) -> str:
    return f"{error:.1e}" if np.isfinite(error) else ""
