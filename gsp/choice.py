"""Model no more than a scene needs: the cheapest of the reduced flows and the full system that meets a tolerance.

The error of every reduced flow is predicted without running the full system over the span (see `prediction`), its cost and
that of the full system are measured on pieces; then the choice is run against the full system on a piece, so that
what was predicted can be seen beside what was measured. Where reducing saves too little the answer is not to reduce.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from gsp.errors import DeclarationError, GspError
from gsp.inner import InnerExpansion, expand_inner
from gsp.lowering import compile_flow
from gsp.placement import Placement, place
from gsp.prediction import AHEAD, CLEARER, SMALLEST_RTOL, Failure, Prediction, predict
from gsp.reduced import ReducedFlow, restrict
from gsp.region import Interval
from gsp.scene import Scene
from gsp.series import SeriesManifold, expand
from gsp.trajectory import Trajectory, integrate

# Share of the tolerance left to the integrator; a model has the rest.
INTEGRATION = 0.1
# The layer is over when what is left of it is below this share of the tolerance. It is looked for up to so many fast
# times 1/gap (exp(-60) is far below rounding), at so many places.
LAYER_LEFT, LAYER_TIMES, LAYER_LOOKS = 0.1, 60.0, 600
# A layer that takes more of the span than this leaves nothing to reduce.
LARGEST_LAYER = 0.5
# The full system is measured on this share of the span behind its layer, in two halves; errors at so many times. The
# layer of the full system is over when its integrator does not see it any more, or at this share of the span.
PIECE, PIECE_POINTS = 0.15, 33
LARGEST_LEAD = 0.4
# Errors over the span are looked at on so many times.
GRID_POINTS = 97
# Seconds are the least of so many runs.
RUNS = 5
# Reducing has to save a tenth, or it is not worth a second model: quasi-steady states saved 5 % where flames were
# computed, less than they cost in accuracy. Models within a tenth of one another cost the same.
WORTH_IT = 0.9
# A reduced flow that holds for less than this share of the span does not pay for being switched on and off.
SMALLEST_SHARE = 0.05
MAX_STEPS = 1_000_000


class ModelKind(StrEnum):
    """What can be run for a scene."""

    REDUCED = "reduced"
    FULL = "full"


@dataclass(frozen=True)
class Candidate:
    """One model: its predicted relative error over the span, and what a run over the span costs.

    `order` is that of a reduced flow, else None. `holds_until` is the time up to which the model meets the tolerance and
    stays valid. `seconds`, `steps` and `field_calls` are for the span: of a reduced flow measured as far as it holds, of
    the full system extrapolated from a piece; `preparation` seconds come once, whatever is run afterwards. `valid` says whether the
    model serves the whole span, and if not, `why_not`. The predicted error of the full system is that of its integrator.
    """

    kind: ModelKind
    order: int | None
    predicted: float
    holds_until: float
    seconds: float
    preparation: float
    steps: float
    field_calls: float
    valid: bool
    why_not: str = ""

    @property
    def label(self) -> str:
        """Kind and order."""
        return str(self.kind) if self.order is None else f"{self.kind} {self.order}"


@dataclass(frozen=True, eq=False, repr=False)
class Choice:
    """What to run for a scene at one `epsilon` and `tolerance`, and why.

    Errors are the largest of |difference| over the `names` (the slow variables in standard form, and the fast ones if
    asked for), each relative to its largest value on the span, from the end of the initial `layer` (slow time) on.
    `predicted` is the model's over the span; on the `piece` (t0, t1) it is `predicted_on_piece`, and `measured` there
    against a full run. `speed_up` is full over chosen seconds. `partial` is the reduced flow that serves
    longest when none serves the whole span, for `simulate`. `reason` is one sentence.
    """

    scene: Scene
    epsilon: float
    tolerance: float
    names: tuple[str, ...]
    model: Candidate
    candidates: tuple[Candidate, ...]
    partial: Candidate | None
    layer: float
    piece: Interval
    predicted_on_piece: float
    measured: float
    speed_up: float
    reason: str

    @property
    def predicted(self) -> float:
        """The chosen model's predicted error over the span."""
        return self.model.predicted

    def as_rows(self) -> list[dict[str, object]]:
        """One dictionary per candidate, of numbers and text, for JSON or CSV."""
        return [
            {
                "model": c.label,
                "kind": str(c.kind),
                "order": c.order,
                "chosen": c is self.model,
                "predicted": c.predicted,
                "holds_until": c.holds_until,
                "seconds": c.seconds,
                "preparation": c.preparation,
                "steps": c.steps,
                "field_calls": c.field_calls,
                "valid": c.valid,
                "why_not": c.why_not,
            }
            for c in self.candidates
        ]

    def __repr__(self) -> str:
        return (
            f"Choice({self.scene.name or 'scene'}: {self.model.label}, predicted {self.predicted:.2g}, "
            f"measured {self.measured:.2g}, speed-up {self.speed_up:.2g})"
        )

    def __str__(self) -> str:
        lines = [
            f"{self.model.label}: {self.reason}",
            f"  epsilon = {self.epsilon:g}, tolerance {self.tolerance:g} on {', '.join(self.names)}, "
            f"layer over after {self.layer:.3g}",
            f"  {'':2}{'model':<10} {'predicted':>9}  {'run':>9}  {'steps':>7}  {'prepare':>8}",
        ]
        for c in self.candidates:
            mark = "->" if c is self.model else ""
            lines.append(
                f"  {mark:2}{c.label:<10} {_shown(c.predicted):>9}  {_time(c.seconds):>9}  "
                f"{'' if np.isnan(c.steps) else format(c.steps, '.0f'):>7}  {_time(c.preparation):>8}  {c.why_not}".rstrip()
            )
        lines.append(
            f"  on t = {self.piece[0]:.4g} to {self.piece[1]:.4g}: predicted {_shown(self.predicted_on_piece)}, "
            f"measured {_shown(self.measured)}"
        )
        return "\n".join(lines)


def choose(
    scene: Scene,
    *,
    orders: Sequence[int] = (0, 1, 2, 3),
    tolerance: float | None = None,
    epsilon: float | None = None,
    fast: bool = False,
) -> Choice:
    """The cheapest model of a scene that meets its tolerance, as a `Choice`.

    The candidates are the reduced flows of `orders`, started at the base point of the fast fibre through the scene's
    start, and the full system, both integrated with a tenth of `tolerance` (default the scene's, as is `epsilon`).
    With `fast` the errors of the fast variables count as well; within the initial layer a reduced flow has no value for
    them, see `composite`. A reduced flow is valid while the branch attracts along it, the normal rate dominates the
    tangential one, the region is not left, and the series is at or below its best order.

    A scene that cannot be reduced at all is answered with the full system and the reason. Raises
    `DeclarationError` for arguments that are not well formed, and when the full system stops on the piece measured.

    >>> from gsp import models
    >>> choose(models.load("linear"), orders=(0,), tolerance=1e-3).candidates[0].valid
    True
    """
    scene = _asked(scene, tolerance, epsilon)
    wanted = tuple(sorted(set(orders)))
    if not wanted or any(isinstance(n, bool) or not isinstance(n, int) or n < 0 for n in wanted):
        raise DeclarationError(f"orders are non-negative integers. Got {orders!r}. Try (0, 1, 2, 3).")
    rtol = INTEGRATION * scene.tolerance
    try:
        outlook: Outlook | None = foresee(scene, wanted, fast=fast)
        reason = ""
    except GspError as error:
        outlook, reason = None, str(error)
    flow, start = (
        (scene.system, scene.start) if outlook is None else (outlook.placement.system, outlook.placement.start)
    )
    layer = outlook.layer if outlook else 0.0
    flow = compile_flow(flow).flow
    fast_time = scene.epsilon / outlook.inner.gap if outlook else 0.0
    full, piece = _full(flow, start, scene, max(layer, fast_time * np.log(1.0 / rtol)), rtol)
    reduced = [_reduced(outlook, n, scene, rtol) for n in wanted] if outlook else []
    model, partial, reason = select(full, reduced, scene.span, reason)
    names = outlook.prediction.names if outlook else tuple(s.name for s in scene.system.states)
    expected, measured = _measured(model, outlook, flow, start, scene, names, layer, piece, rtol)
    return Choice(
        scene=scene,
        epsilon=scene.epsilon,
        tolerance=scene.tolerance,
        names=names,
        model=model,
        candidates=(*reduced, full),
        partial=partial,
        layer=layer,
        piece=piece,
        predicted_on_piece=expected,
        measured=measured,
        speed_up=full.seconds / model.seconds,
        reason=reason,
    )


def select(
    full: Candidate, reduced: Sequence[Candidate], span: Interval, obstacle: str = ""
) -> tuple[Candidate, Candidate | None, str]:
    """(model, the reduced one that serves part of the span, one sentence), given every candidate's cost.

    `obstacle` says why there are no reduced candidates.
    """
    if not reduced:
        return full, None, f"the full system, for it cannot be reduced here: {obstacle}"
    valid = [c for c in reduced if c.valid]
    if not valid:
        longest = max(reduced, key=lambda c: (c.holds_until, -c.predicted))
        served = (longest.holds_until - span[0]) / (span[1] - span[0])
        where = f"{longest.label} comes nearest, and there {longest.why_not}"
        if served < SMALLEST_SHARE:
            return full, None, f"the full system, for no reduced flow meets the tolerance: {where}"
        text = f"the full system, for no reduced flow holds over the whole span: {where}; simulate() uses it till then"
        return full, longest, text
    cheapest = min(c.seconds for c in valid)
    # Sorted by order: of equals the simplest.
    best = next(c for c in valid if WORTH_IT * c.seconds <= cheapest)
    ratio = full.seconds / best.seconds
    if best.seconds > WORTH_IT * full.seconds:
        return (
            full,
            None,
            f"do not reduce: the full system is as cheap, {best.label} would be {ratio:.2g} times as fast",
        )
    saved = full.seconds - best.seconds
    runs = max(1.0, np.ceil((best.preparation - full.preparation) / saved))
    return (
        best,
        None,
        f"the cheapest that meets the tolerance, {ratio:.2g} times as fast as the full system; "
        f"its preparation pays after {runs:.0f} run{'s' if runs > 1 else ''}",
    )


# -- what the reduced flows promise ------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Outlook:
    """A scene seen ahead: the series, where each order starts, how long the layer lasts, and the prediction."""

    placement: Placement
    series: SeriesManifold
    inner: InnerExpansion
    flows: Mapping[int, ReducedFlow]
    starts: Mapping[int, Mapping[str, float]]
    layer: float
    prediction: Prediction
    preparation: Mapping[int, float]

    def errors(self, order: int, times: np.ndarray) -> np.ndarray:
        """Predicted relative error (m,) at `times` (m,), with what is left of the initial layer."""
        scale, first = self.prediction.scale, self.prediction.first
        left = layer_left(self.inner, (times - first) / self.prediction.epsilon, self.prediction.epsilon, scale)
        return self.prediction.errors(order, times) + left


def foresee(scene: Scene, orders: Sequence[int], *, fast: bool = False) -> Outlook:
    """The prediction for a scene, and what it rests on; raises `GspError` where the scene cannot be reduced."""
    begun = time.perf_counter()
    placement = place(scene)
    highest = max(orders) + AHEAD
    # A start names its sheet, which is found sooner than by following one from a seed.
    branch = replace(placement.branch, seed=None)
    series = expand(branch, order=highest, symbolic=False)
    inner = expand_inner(
        placement.branch,
        {**placement.start, **scene.reconstruction_start},
        order=highest,
        fast_order=highest - 1,
        reconstruction=scene.reconstruction,
    )
    shared = time.perf_counter() - begun
    if inner.direction < 0:
        raise DeclarationError(f"the branch {placement.branch} repels, and orbits leave it")
    flows, preparation = {}, {}
    for k in sorted({n + ahead for n in orders for ahead in range(AHEAD + 1)}):
        begun = time.perf_counter()
        compiled = compile_flow(restrict(series, order=k))
        compiled.field  # noqa: B018
        # Of equal flows the one that was compiled: looking up another compares long expressions.
        flows[k] = compiled.flow
        preparation[k] = shared + time.perf_counter() - begun
    starts = {k: _start(placement, inner, scene.epsilon, k) for k in flows}
    names = tuple(s.name for s in (placement.system.states if fast else placement.system.x))
    prediction = predict(
        series,
        starts,
        flows=flows,
        orders=orders,
        span=scene.span,
        epsilon=scene.epsilon,
        tolerance=scene.tolerance,
        region=placement.region,
        names=names,
    )
    tau = np.linspace(0.0, LAYER_TIMES / inner.gap, LAYER_LOOKS)
    left = layer_left(inner, tau, scene.epsilon, prediction.scale)
    felt = np.flatnonzero(left > LAYER_LEFT * scene.tolerance)
    layer = 0.0 if not felt.size else scene.epsilon * float(tau[min(felt[-1] + 1, len(tau) - 1)])
    return Outlook(placement, series, inner, flows, starts, layer, prediction, preparation)


def _start(placement: Placement, inner: InnerExpansion, epsilon: float, order: int) -> dict[str, float]:
    """Base point through epsilon^order, with the point of M0 over it where that chooses the sheet."""
    system, branch = placement.system, placement.branch
    x = {
        s.name: sum(float(c) * epsilon**i for i, c in enumerate(inner.base[s.name][: order + 1]))
        for s in system.x
    }
    if branch.is_explicit:
        return x
    y = branch.points(np.array([list(x.values())]))[0]
    return {**x, **{s.name: float(value) for s, value in zip(system.y, y)}}


def layer_left(
    inner: InnerExpansion, tau: np.ndarray, epsilon: float, scale: Mapping[str, float]
) -> np.ndarray:
    """What is left of the layer at fast times `tau` (m,): the largest over the names of `scale`, relative to it."""
    left = inner.layer(tau, epsilon, order=max(inner.order - 1, 0))
    return np.max([np.abs(left[name]) / size for name, size in scale.items()], axis=0)


def _reduced(outlook: Outlook, order: int, scene: Scene, rtol: float) -> Candidate:
    prediction = outlook.prediction
    first, last = scene.span
    after = first + outlook.layer
    limit = (1.0 - INTEGRATION) * scene.tolerance
    predicted, holds, why = float("inf"), first, ""
    if outlook.layer > LARGEST_LAYER * (last - first):
        why = f"the initial layer takes {outlook.layer:.3g} of the span"
    else:
        holds, failure = prediction.holds_until(order, limit, after=after, last=last)
        # Infinite where a run has ended; then the reason says more.
        predicted = float(outlook.errors(order, np.linspace(after, last, GRID_POINTS)).max())
        if failure is Failure.END:
            why = f"{failure} at t = {holds:.4g}: {prediction.runs[order].status.meaning}"
        elif failure is not None:
            why = f"{failure} at t = {holds:.4g}"
        elif predicted > limit:
            why = f"{Failure.ERROR}"
    # Beyond the time that it holds it may chatter at a fold; a run of no length has no cost.
    end = last if not why else max(holds, first + PIECE * (last - first))
    end = min(end, prediction.covered(order))
    seconds, run = _timed(lambda: _run(outlook.flows[order], outlook.starts[order], scene, (first, end), rtol))
    share = (end - first) / (last - first)
    return Candidate(
        ModelKind.REDUCED,
        order,
        predicted,
        holds,
        seconds / share,
        outlook.preparation[order],
        run.stats.steps / share,
        run.stats.field_calls / share,
        not why,
        why,
    )


# -- what the full system costs ----------------------------------------------------------------------------


def _full(flow, start, scene: Scene, layer: float, rtol: float) -> tuple[Candidate, Interval]:
    """The full system, its cost extrapolated from the layer and a piece of the span behind it."""
    first, last = scene.span
    begun = time.perf_counter()
    compiled = compile_flow(flow)
    compiled.field, compiled.jacobian  # noqa: B018
    preparation = time.perf_counter() - begun
    over = first + min(layer, LARGEST_LEAD * (last - first))
    middle, end = (over + share * PIECE * (last - over) for share in (0.5, 1.0))
    seconds, run = _timed(lambda: _run(flow, start, scene, (first, end), rtol))
    shorter, half = _timed(lambda: _run(flow, start, scene, (first, middle), rtol))
    if not run.status.ok:
        raise DeclarationError(
            f"the full system does not reach t = {end:.6g}: {run.message}. Shorten the span or move the start."
        )
    done = run.stats.steps
    more = _density(run.t, middle) * (last - end)
    # The cost of a call is not paid again, that of a step is.
    extra = max(done - half.stats.steps, 1)
    each = float(np.clip((seconds - shorter) / extra, 0.1 * seconds / done, seconds / done))
    total = done + more
    candidate = Candidate(
        ModelKind.FULL,
        None,
        rtol,
        last,
        seconds + each * more,
        preparation,
        total,
        run.stats.field_calls * total / done,
        True,
    )
    return candidate, (first, end)


def _density(times: np.ndarray, middle: float) -> float:
    """Steps per unit of time from `middle` on; the last one, which was cut at the end, counts for its share."""
    lengths = np.diff(times)
    if len(lengths) > 1:
        lengths[-1] = max(lengths[-1], lengths[-2])
    begins, ends = times[:-1], times[1:]
    counted = np.clip((ends - np.maximum(begins, middle)) / lengths, 0.0, 1.0)
    return float(counted.sum()) / (times[-1] - middle)


def _measured(
    model: Candidate,
    outlook: Outlook | None,
    flow,
    start,
    scene: Scene,
    names: Sequence[str],
    layer: float,
    piece: Interval,
    rtol: float,
) -> tuple[float, float]:
    """(predicted, measured) error of the model on the piece, the layer left out."""
    grid = np.linspace(min(piece[0] + layer, piece[1]), piece[1], PIECE_POINTS)
    reference = _run(flow, start, scene, piece, max(CLEARER * scene.tolerance, SMALLEST_RTOL), at=grid)
    if model.kind is ModelKind.FULL or outlook is None:
        own = _run(flow, start, scene, piece, rtol, at=grid)
        predicted = rtol
        scale = {name: float(np.abs(reference[name]).max()) or 1.0 for name in names}
    else:
        order = model.order
        assert order is not None
        own = _run(outlook.flows[order], outlook.starts[order], scene, piece, rtol, at=grid)
        predicted = float(outlook.errors(order, grid).max())
        scale = outlook.prediction.scale
    if not (own.status.ok and reference.status.ok):
        return predicted, float("nan")
    measured = max(float(np.abs(own[name] - reference[name]).max()) / scale[name] for name in names)
    return predicted, measured


def _run(flow, start, scene: Scene, span: Interval, rtol: float, *, at=None) -> Trajectory:
    return integrate(
        flow,
        start=start,
        span=span,
        epsilon=scene.epsilon,
        rtol=max(rtol, SMALLEST_RTOL),
        atol=1e-2 * max(rtol, SMALLEST_RTOL),
        at=at,
        max_steps=MAX_STEPS,
    )


def _timed(run: Callable[[], Trajectory]) -> tuple[float, Trajectory]:
    best, found = float("inf"), None
    for _ in range(RUNS):
        begun = time.perf_counter()
        found = run()
        best = min(best, time.perf_counter() - begun)
    assert found is not None
    return best, found


def _asked(scene: Scene, tolerance: float | None, epsilon: float | None) -> Scene:
    if not isinstance(scene, Scene):
        raise DeclarationError(
            f"choose takes a Scene. Got {type(scene).__name__}. Use gsp.models.load(name) or gsp.load(path)."
        )
    if tolerance is None and epsilon is None:
        return scene
    return replace(
        scene,
        tolerance=scene.tolerance if tolerance is None else tolerance,
        epsilon=scene.epsilon if epsilon is None else epsilon,
    )


def _shown(error: float) -> str:
    return "" if not np.isfinite(error) else f"{error:.1e}"


def _time(seconds: float) -> str:
    return f"{1e6 * seconds:.3g} us" if seconds < 1e-3 else f"{1e3 * seconds:.3g} ms"
