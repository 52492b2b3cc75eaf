"""The runs that are compared: at one epsilon the full system's, on or off the slow manifold, and the reduced ones'.

On a repelling branch both run backward in time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gsp.algebra.switching_functions import switches
from gsp.critical.sampling import Sampler
from gsp.errors import DeclarationError, GspError, Status
from gsp.fibres.inner_expansion import InnerExpansion
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.spread_times import spread_times
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.lowering.compiled_flow import parameter_vector
from gsp.lowering.compiled_function import compile_over
from gsp.nested.nesting import Nesting
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study
from gsp.slow.series import SeriesManifold, best_sum
from gsp.systems.flow import Flow
from gsp.systems.system import VectorField
from gsp.systems.tolerances import absolute_tolerance

# The grid on which errors are measured, and the tolerances of the runs compared.
GRID_POINTS = 49
RTOL = 1e-12
# A second full run at this many times the tolerance shows how far the reference itself can be trusted: its error is
# about proportional to the tolerance, so so many times smaller than the difference, and never below rounding.
CHECK = 10.0
ROUNDING = 4 * np.finfo(float).eps


@dataclass(frozen=True)
class RunErrors:
    """At one epsilon: the errors by name and the status of each order's run, the claims' errors, the reference's own.

    `errors` are absolute, `sizes` the largest values of the reference, `claimed` and `floor` relative to them. `moved`
    are the quantities that the lowest order moves, `crossed` the functions of which the reference crosses a zero where
    the field is not smooth.
    """

    errors: Mapping[int, Mapping[str, float]]
    sizes: Mapping[str, float]
    moved: Sequence[str]
    statuses: Mapping[int, Status]
    claimed: Mapping[str, float]
    floor: float
    crossed: Sequence[str] = ()


@dataclass(frozen=True)
class ComparedRuns:
    """What runs at each epsilon: the full system, of which `slow` is compared, the flow of each order, the claims."""

    scene: Scene
    full: Flow
    slow: Sequence[str]
    flows: Mapping[int, ReducedFlow]
    rivals: Mapping[str, VectorField]
    series: SeriesManifold
    inner: InnerExpansion | None
    direction: int
    nesting: Nesting | None

    def at(
        self, epsilon: float, origin: Mapping[str, float], ran: Callable[[], object] = lambda: None
    ) -> RunErrors:
        """The errors at one epsilon of runs from over `origin`; `ran` is called after that of each flow."""
        scene, slow = self.scene, self.slow
        start, slow_start, grid = self._beginning(epsilon, origin)
        if not np.isfinite([*start.values(), *slow_start.values()]).all():
            # At so large an epsilon the series leads out of the domain of what it stands in.
            nothing = float("nan")
            for _ in self.flows:
                ran()
            return RunErrors(
                dict.fromkeys(self.flows, dict.fromkeys(slow, nothing)),
                dict.fromkeys(slow, 0.0),
                slow,
                dict.fromkeys(self.flows, Status.SERIES_ENDS),
                dict.fromkeys(self.rivals, nothing),
                ROUNDING,
            )
        reference = run_on(self.full, start, scene, epsilon, grid)
        check = run_on(self.full, start, scene, epsilon, grid, loosened=CHECK)
        runs = {}
        for n, flow in self.flows.items():
            runs[n] = run_on(flow, slow_start, scene, epsilon, grid)
            ran()
        claimed = {}
        for name, rival in self.rivals.items():
            names = [z.name for z in rival.states]
            there = {z: float(reference[z][0]) for z in names}
            run = run_on(rival, there, scene, epsilon, grid, begin=float(grid[0]))
            claimed[name] = largest_error(run, reference, names)
        sizes = _sizes(reference, slow)
        lowest, nothing = runs[min(runs)], np.sqrt(np.finfo(float).eps)
        return RunErrors(
            {n: _errors(run, reference, slow) for n, run in runs.items()},
            sizes,
            [name for name in slow if np.abs(lowest[name]).max(initial=0.0) > nothing * sizes[name]],
            {n: reference.status if run.status.ok else run.status for n, run in runs.items()},
            claimed,
            max(largest_error(check, reference, slow) / CHECK, ROUNDING),
            surfaces_crossed(self.full, reference, epsilon),
        )

    def _beginning(
        self, epsilon: float, origin: Mapping[str, float]
    ) -> tuple[Mapping[str, float], Mapping[str, float], np.ndarray]:
        """Where the full run begins, where the reduced ones do, and the times at which they are compared."""
        first, last = self.scene.span
        if self.inner is None:
            start = slow_start = on_manifold(self.series, origin, epsilon)
            last = first + self.direction * (last - first)
        else:
            start = origin
            slow_start = {
                n: sum(float(c) * epsilon**k for k, c in enumerate(b)) for n, b in self.inner.base.items()
            }
            first += layer_time(self.inner, self.scene, epsilon, max(self.flows))
        begin = start if self.nesting is None else self.nesting.whole(start, epsilon)
        times = np.linspace(min(first, last), max(first, last), GRID_POINTS)
        if self._lowest is not None:
            times = spread_times(self._lowest, min(first, last), max(first, last), GRID_POINTS)
        return begin, slow_start, times if last > first else times[::-1].copy()

    @cached_property
    def _lowest(self) -> Trajectory | None:
        """A run of lowest order from the scene's start, whose way spreads the times: the same at every epsilon, lest
        its power be that of the times. None for a start on a loss or in other names.
        """
        flow, scene = self.flows[min(self.flows)], self.scene
        epsilon = None if flow.epsilon is None else scene.epsilon
        last = scene.span[0] + self.direction * (scene.span[1] - scene.span[0])
        try:
            start = {name: scene.start[name] for name in self.slow}
            return trajectory_of(
                flow, start=start, span=(scene.span[0], last), epsilon=epsilon, rtol=RTOL,
                atol=absolute_tolerance(RTOL, scene.region, scene.start),
            )  # fmt: skip
        except (GspError, KeyError):
            return None


def on_manifold(series: SeriesManifold, start: Mapping[str, float], epsilon: float) -> dict[str, float]:
    """The point of M_epsilon over the slow part of `start`, by the series at its optimal order."""
    system = series.branch.system
    x = {s.name: start[s.name] for s in system.x}
    y = best_sum(series, x, epsilon)[0][0]
    return {**x, **{s.name: float(value) for s, value in zip(system.y, y)}}


def sense(study: Study) -> int:
    """-1 where the branch repels: only backward in time does a full run stay on its slow manifold; else 1."""
    x = np.array([[study.start[s.name] for s in study.system.x]])
    y = study.branch.points(x)
    eigenvalues = Sampler(study.branch).eigenvalues(np.hstack([x, y]))
    return -1 if (np.real(eigenvalues) > 0).all() else 1


def layer_time(inner: InnerExpansion, scene: Scene, epsilon: float, highest: int) -> float:
    """Slow time until the layer is out of the way of the errors measured."""
    # With a correction errors are measured after (M + 3) epsilon/gap ln(1/epsilon), M the highest power of
    # epsilon corrected for: what is left of the layer is then epsilon^2 times smaller than the smallest error
    # expected.
    power = min(highest, inner.order) + 3
    time = power * epsilon / inner.gap * max(float(np.log(1.0 / epsilon)), 1.0)
    length = scene.span[1] - scene.span[0]
    if time > 0.5 * length:
        raise DeclarationError(
            f"the initial layer takes {time:.3g} of slow time at {scene.system.epsilon} = {epsilon:g} (gap "
            f"{inner.gap:.3g}), more than half of the span {scene.span}.",
            "Take smaller epsilons or a longer span.",
        )
    return time


def run_on(
    flow,
    start,
    scene: Scene,
    epsilon: float,
    grid,
    *,
    loosened: float = 1.0,
    begin: float | None = None,
) -> Trajectory:
    """A run over `grid`, from `begin` or the scene's first time, at the tolerances that are compared."""
    # A run that leaves a manifold of saddle type ends somewhere; it is not followed for ever.
    return trajectory_of(
        flow,
        start=start,
        span=(scene.span[0] if begin is None else begin, float(grid[-1])),
        epsilon=None if flow.epsilon is None else epsilon,
        rtol=RTOL * loosened,
        atol=absolute_tolerance(RTOL * loosened, scene.region, scene.start),
        at=grid,
        options=RunOptions(stops_at_times=True, max_steps=100_000),
    )


def surfaces_crossed(flow: Flow, run: Trajectory, epsilon: float) -> list[str]:
    """The switching functions of the rates that change their signs along the run."""
    return surfaces_between(flow, run.y.T, epsilon) if run.status.ok else []


def surfaces_between(flow: Flow, states: np.ndarray, epsilon: float) -> list[str]:
    """The switching functions of the rates that have both signs at `states` (m, n)."""
    found = switches(flow.rates, flow.states)
    if not found:
        return []
    function = compile_over(flow, tuple(switch.surface for switch in found))
    signs = np.sign(function(states, parameter_vector(flow, None if flow.epsilon is None else epsilon)))
    crossed = (signs.min(axis=0) < 0.0) & (signs.max(axis=0) > 0.0)
    return [str(switch.surface) for switch, is_crossed in zip(found, crossed) if is_crossed]


def _sizes(run: Trajectory, names: Sequence[str]) -> dict[str, float]:
    """Largest |value| of each quantity over the grid."""
    return {name: float(np.abs(run[name]).max(initial=0.0)) for name in names}


def relative(errors: Mapping[str, float], sizes: Mapping[str, float]) -> float:
    """The largest of the errors by name, each relative to its size; a size of 0 counts as 1."""
    return max((error / (sizes[name] or 1.0) for name, error in errors.items()), default=0.0)


def _errors(run: Trajectory, reference: Trajectory, names: Sequence[str]) -> dict[str, float]:
    """Largest |difference| of each quantity over the grid."""
    if not (run.status.ok and reference.status.ok):
        return dict.fromkeys(names, float("nan"))
    return {name: float(np.abs(run[name] - reference[name]).max()) for name in names}


def largest_error(run: Trajectory, reference: Trajectory, names: Sequence[str]) -> float:
    """Largest |difference| over the grid and the quantities `names`, each relative to its largest value."""
    return relative(_errors(run, reference, names), _sizes(reference, names))
