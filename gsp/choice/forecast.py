"""A scene seen ahead: where reduced runs start, how long the layer lasts, and what the runs will be wrong by."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsp.choice.prediction import CHECKS, CLEARER, SMALLEST_RTOL, Prediction, predict
from gsp.errors import BranchError, DeclarationError, HyperbolicityError
from gsp.fibres.base_points import BasePoint, project
from gsp.fibres.inner_expansion import InnerExpansion
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.spread_times import spread_times, within_steps
from gsp.integration.surface_flow import LARGEST_SIZE, SurfaceFlow, flow_on
from gsp.integration.trajectory import Trajectory, trajectory_of
from gsp.lowering.compiled_flow import compile_flow
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.slow.grids_at_rest import resting_coefficients
from gsp.slow.sampled_manifold import SampledManifold
from gsp.slow.series import LONGEST, SeriesManifold, length
from gsp.slow.solved_manifold import solve_manifold
from gsp.slow.truncation import AHEAD
from gsp.systems.tolerances import absolute_tolerance

# The layer is over when what is left of it is below this share of the tolerance.
LAYER_LEFT = 0.1
# A solved manifold covers the reduced runs and this share of their range on every side.
MARGIN = 0.05

# The stages between a scene and its reduced flows.
READYING = ("splitting", "critical", "branch", "numeric series", "inner")


@dataclass(frozen=True, eq=False)
class Forecast:
    """A scene seen ahead: the series, where each order starts, how long the layer lasts, and the prediction.

    `felt` is the time behind the layer at which most of it is left. `astray` says where the initial layer carries the
    start of the first order that begins beyond the sheet; that order and those above it have no run; or why the layer's
    series ends before it. Empty where all begin on it.
    """

    study: Study
    series: SeriesManifold
    inner: InnerExpansion
    flows: Mapping[int, ReducedFlow]
    starts: Mapping[int, Mapping[str, float]]
    layer: float
    felt: float
    prediction: Prediction
    shared: float
    preparation: Mapping[int, float]
    astray: str

    def times(self, run: Trajectory, count: int) -> np.ndarray:
        """`count` times of a run behind the layer, those at equal parts of its way, and that at which most is felt."""
        last = self.study.scene.span[1]
        behind = spread_times(run, self.prediction.first + self.layer, last, count)
        return np.union1d(behind, min(self.felt, last))

    def fast_errors(self, order: int, times: np.ndarray) -> tuple[float, float]:
        """The fast variables' predicted relative errors: the largest at `times` (m,), and that in the initial layer.

        The first is not a number where their series does not converge along the run.
        """
        fast = self.fast
        fast_times = np.append(0.0, (times - fast.first) / fast.epsilon)
        begun, *left = layer_left(self.inner, fast_times, fast.epsilon, fast.scale)
        converges = fast.converges(order, times)
        return float((fast.errors(order, times) + left).max()) if converges else float("nan"), float(begun)

    @property
    def fast(self) -> Prediction:
        """The prediction for the fast variables."""
        return replace(self.prediction, names=tuple(s.name for s in self.study.system.y))

    def errors(self, order: int, times: np.ndarray) -> np.ndarray:
        """Predicted relative error (m,) at `times` (m,), with what is left of the initial layer."""
        scale, first = self.prediction.scale, self.prediction.first
        left = layer_left(self.inner, (times - first) / self.prediction.epsilon, self.prediction.epsilon, scale)
        return self.prediction.errors(order, times) + left


def forecast_of(scene: Scene | Study, orders: Sequence[int], *, fast: bool = False) -> Forecast:
    """The prediction for a scene, and what it rests on; raises `GspError` where the scene cannot be reduced.

    It is for those of `orders` whose series is there and short enough to run; that of the next two, as far as they are
    too, tells their errors.
    """
    study = study_of(scene)
    scene = study.scene
    series = _readied(study, min(orders), max(orders) + AHEAD)
    highest = series.order
    orders = [n for n in orders if n <= highest]
    # The slow variables feel the layer from order 1 on, however far the series goes.
    inner = study.inner(max(highest, AHEAD))
    # What it takes from the scene on, whoever asked for it first.
    shared = sum(map(study.spent, READYING))
    if inner.direction < 0:
        raise HyperbolicityError(f"the branch {study.branch} repels, and orbits leave it.")
    flows, preparation = {}, {}
    for k in sorted({k for n in orders for k in range(n, min(n + AHEAD, highest) + 1)}):
        begun = time.perf_counter()
        flows[k] = study.reduced(k, reconstructed=False)
        _ = compile_flow(flows[k]).field
        preparation[k] = shared + time.perf_counter() - begun
    starts, astray = {}, ""
    for k in flows:
        if k > inner.order:
            astray = inner.ending
            break
        try:
            starts[k] = _start(study, inner, scene.epsilon, k)
        except BranchError as error:
            if not starts:
                raise
            astray = error.fact
            break
    names = tuple(s.name for s in (study.system.states if fast else study.system.x))
    prediction = predict(
        study,
        series,
        starts,
        flows=flows,
        orders=orders,
        span=scene.span,
        least_scale=dict.fromkeys(names, 0.0),
    )
    settled = scene.span[0] + scene.epsilon / inner.gap * np.log(1.0 / scene.tolerance)
    landed = np.array([float(inner.terms[s.name][0].outer[0]) for s in study.system.states])
    prediction = replace(prediction, settled=settled, landed=landed)
    # The end of the layer is looked for up to sixty fast times 1/gap: exp(-60) is far below rounding.
    tau = np.linspace(0.0, 60.0 / inner.gap, 600)
    remaining, begun, end = _remaining(inner, tau, scene.epsilon), -1, 0
    # What is left behind the layer is relative to how large the states are there, where errors count.
    while begun < end:
        begun = end
        prediction = replace(prediction, after=scene.span[0] + scene.epsilon * float(tau[end]))
        left = _relative(remaining, prediction.scale)
        felt = np.flatnonzero(left > LAYER_LEFT * scene.tolerance)
        end = max(begun, 0 if not felt.size else min(felt[-1] + 1, len(tau) - 1))
    # What it moves slow variables by may be largest after the start.
    most = end + int(np.argmax(left[end:]))
    layer, later = scene.epsilon * float(tau[end]), scene.span[0] + scene.epsilon * float(tau[most])
    return Forecast(study, series, inner, flows, starts, layer, later, prediction, shared, preparation, astray)


def _start(study: Study, inner: InnerExpansion, epsilon: float, order: int) -> dict[str, float]:
    """Base point through epsilon^order, with the point of M0 over it where that chooses the sheet."""
    system, branch = study.system, study.branch
    x = base_start(inner, epsilon, order, names=[s.name for s in system.x])
    if branch.is_explicit:
        return x
    try:
        y = branch.points(np.array([list(x.values())]))[0]
    except BranchError as error:
        begun = system.place({s: study.start[s.name] for s in system.x})
        led = system.place(x)
        raise BranchError(
            f"Through order {order} the initial layer carries {begun} to {led}, where {error.fact}",
            "Start nearer to the branch, or take a smaller epsilon.",
        ) from None
    return {**x, **{s.name: float(value) for s, value in zip(system.y, y)}}


def _readied(study: Study, first: int, last: int) -> SeriesManifold:
    """The series through `last`, or as far as a reduced flow of it can be compiled in a reasonable time."""
    series = study.short_series(last, at_least=first)
    if max(series.sizes) > LONGEST:
        raise HyperbolicityError(
            f"its series is too long to run: through order {first} it has coefficients of {length(series)}, "
            f"more than {LONGEST}."
        )
    return series


def base_start(inner: InnerExpansion, epsilon: float, order: int, *, names: Sequence[str]) -> dict[str, float]:
    """The base point through epsilon^order, in the quantities `names`."""
    base = inner.base
    return {n: sum(float(c) * epsilon**i for i, c in enumerate(base[n][: order + 1])) for n in names}


def layer_left(
    inner: InnerExpansion, tau: np.ndarray, epsilon: float, scale: Mapping[str, float]
) -> np.ndarray:
    """What is left of the layer at fast times `tau` (m,): the largest over the names of `scale`, relative to it."""
    return _relative(_remaining(inner, tau, epsilon), scale)


def _remaining(inner: InnerExpansion, tau: np.ndarray, epsilon: float) -> Mapping[str, np.ndarray]:
    # Slow variables have none at order 0; from a start on a kink it is known at order 1 and no further.
    return inner.layer(tau, epsilon, order=max(inner.order - 1, 1))


def _relative(remaining: Mapping[str, np.ndarray], scale: Mapping[str, float]) -> np.ndarray:
    return np.max([np.abs(remaining[name]) / size for name, size in scale.items()], axis=0)


@dataclass(frozen=True, eq=False)
class SurfaceForecast:
    """The flow on a solved manifold, its start, and two runs that tell its error.

    `shifted` has every fast variable off by the manifold's estimated error, and starts off by the base point's: a bound
    rather than an estimate, for neither error has one sign.
    """

    manifold: SampledManifold
    flow: SurfaceFlow
    start: BasePoint
    run: Trajectory
    shifted: Trajectory
    forecast: Forecast
    preparation: float

    def fast_errors(self, times: np.ndarray) -> tuple[float, float]:
        """As those of an `Forecast`."""
        prediction = self.forecast.prediction
        scale = self.forecast.fast.scale
        begun = layer_left(self.forecast.inner, np.zeros(1), prediction.epsilon, scale)
        return float(self._errors(times, scale).max()), float(begun[0])

    def errors(self, times: np.ndarray) -> np.ndarray:
        """Predicted relative error (m,) at `times` (m,), infinite where a run has ended."""
        return self._errors(times, self.forecast.prediction.scale)

    def _errors(self, times: np.ndarray, scale: Mapping[str, float]) -> np.ndarray:
        forecast = self.forecast
        first, epsilon = forecast.prediction.first, self.manifold.epsilon
        result = np.full(len(times), np.inf)
        alive = times <= min(float(self.run.t[-1]), float(self.shifted.t[-1]))
        own, other = self.run.sample(times[alive]), self.shifted.sample(times[alive])
        result[alive] = np.max([np.abs(own[n] - other[n]) / size for n, size in scale.items()], axis=0)
        return result + layer_left(forecast.inner, (times - first) / epsilon, epsilon, scale)

    def inside(self, times: np.ndarray) -> np.ndarray:
        """Where (m,) the run is on the solved piece."""
        run = self.run.sample(times)
        bounds = self.manifold.region.items()
        return np.all([(run[n] >= low) & (run[n] <= high) for n, (low, high) in bounds], axis=0)

    def within_region(self, times: np.ndarray, limit: float) -> np.ndarray:
        """Where (m,) the run is in the scene's region, fast variables and all, as it is asked of reduced flows.

        All of it is where it is nowhere further out than it may be off: a share `limit` of what errors are relative to.
        """
        prediction, run = self.forecast.prediction, self.run
        whole = prediction.states(run, np.linspace(run.t[0], run.t[-1], CHECKS))
        here = prediction.inside(run, prediction.states(run, times))
        return here | prediction.inside(run, whole, within=limit).all()


def _while_inside(prediction: Prediction, run: Trajectory) -> np.ndarray:
    """Times of a run, and between them, until it leaves the region, where it may begin beside that.

    Nothing is asked of the manifold beyond.
    """
    times = within_steps(run.t)
    inside = prediction.inside(run, prediction.states(run, times))
    leaves = inside[:-1] & ~inside[1:]
    return times[: int(np.argmax(leaves)) + 2] if leaves.any() else times


def surface_forecast_of(scene: Scene, forecast: Forecast) -> SurfaceForecast:
    """The same for the solved manifold under the reduced run; raises `GspError` where it cannot be solved."""
    clock = time.perf_counter()
    branch, prediction = forecast.study.branch, forecast.prediction
    # The start's fibre is over the box too. A series of high order may end early, or err by more than the margin: all
    # runs that come furthest are covered.
    furthest = max(map(prediction.covered, prediction.runs))
    guides = [
        run.sample(_while_inside(prediction, run))
        for k, run in prediction.runs.items()
        if prediction.covered(k) == furthest
    ]
    # A solved manifold is this much more exact than the tolerance.
    tolerance = max(0.1 * scene.tolerance, SMALLEST_RTOL)
    region, least = {}, {}
    for s in forecast.study.system.x:
        ranges = np.array([[run[s.name].min(), run[s.name].max()] for run in guides])
        begun = forecast.study.start[s.name]
        low, high = float(min(begun, ranges[:, 0].min())), float(max(begun, ranges[:, 1].max()))
        margin = MARGIN * ((high - low) or 1.0)
        region[s.name] = (low - margin, high + margin)
        # Beyond the runs by as much as these differ among themselves.
        lower, upper = np.ptp(ranges, axis=0) + tolerance * (high - low)
        least[s.name] = (max(low - lower, low - margin), min(high + upper, high + margin))
    # What would be too large to run on is not solved for, which may take a thousand times as long.
    size = resting_coefficients(branch, region=region, tolerance=tolerance, enough=LARGEST_SIZE)
    if size > LARGEST_SIZE:
        raise DeclarationError(
            f"the interpolant of the critical manifold alone has {size} coefficients, more than {LARGEST_SIZE}.",
            "Loosen the tolerance.",
            limit=LARGEST_SIZE,
        )
    manifold = solve_manifold(branch, region=region, epsilon=scene.epsilon, tolerance=tolerance)
    if manifold.surface is None and least != region:
        # The sheet may end within the margin.
        manifold = solve_manifold(branch, region=least, epsilon=scene.epsilon, tolerance=tolerance)
    if manifold.surface is None:
        raise HyperbolicityError(manifold.message)
    flow = flow_on(manifold)
    _ = compile_flow(flow).field
    try:
        start = project(manifold, forecast.study.start, epsilon=scene.epsilon, numeric=True)
    except HyperbolicityError:
        if manifold.status.ok:
            raise
        raise HyperbolicityError(manifold.message) from None
    preparation = time.perf_counter() - clock
    rtol = max(CLEARER * scene.tolerance, SMALLEST_RTOL)
    atol = absolute_tolerance(rtol, scene.region, scene.start)
    off = {name: value + start.errors[name] for name, value in start.items()}
    run, shifted = (
        trajectory_of(f, start=begin, span=scene.span, rtol=rtol, atol=atol)
        for f, begin in ((flow, start), (flow_on(manifold, shift=manifold.error_estimates), off))
    )
    return SurfaceForecast(manifold, flow, start, run, shifted, forecast, preparation)
