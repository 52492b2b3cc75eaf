"""Backward shadowing: the full flow forward until the initial layer is over, the slow flow back to the start's time.

Whatever lies on the fast fibre of b approaches the slow solution through b like exp(-gap t/epsilon). Once that is
below rounding, the full solution *is* a slow one, and following the slow flow back from there gives b.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import sympy as sp

from gsp.critical.branch import Branch
from gsp.critical.common_units import common_units
from gsp.errors import BranchError, HyperbolicityError, Status, UnsupportedFunctionError
from gsp.fibres.decaying_signals import chebyshev
from gsp.fibres.inner_expansion import Problem
from gsp.fibres.layer_orbit import Landing, land
from gsp.integration.trajectory import Method, RunOptions, Trajectory, trajectory_of
from gsp.lowering.compiled_flow import parameter_vector
from gsp.lowering.compiled_function import compile_over
from gsp.lowering.tape import write_tape
from gsp.slow.sampled_manifold import SampledManifold
from gsp.slow.series import best_sum, expand
from gsp.slow.slow_points import climb
from gsp.systems.flow import Point
from gsp.systems.region import in_units
from gsp.systems.system import SlowFastSystem, VectorField

# Fast times 1/gap of the first run. The base point is found from two times; their difference is an error estimate.
LAYER_TIMES = 50.0
# Distance from the slow manifold, relative to 1 + |y|, at which the layer counts as over; or ten errors of h.
NEAR = 1e-12
# Estimated error, relative to 1 + |b|, above which there is no base point to speak of.
LOST = 1e-2

Surface = Callable[[np.ndarray], tuple[np.ndarray, float]]


@dataclass(frozen=True)
class Shadow:
    """A base point by shadowing: `values` by name, estimates of their `errors`, and the slow `time` shadowed."""

    start: dict[str, float]
    values: dict[str, float]
    errors: dict[str, float]
    time: float
    status: Status


def shadow(
    branch: Branch,
    start: Point,
    *,
    epsilon: float,
    reconstruction: Mapping[sp.Symbol, sp.Expr],
    surface: SampledManifold | None = None,
) -> Shadow:
    """The base point of the fibre through `start`; `surface` is a solved manifold, or None for pointwise values.

    Raises `BranchError` when the solution does not come near the slow manifold or leaves it at once,
    `HyperbolicityError` when epsilon is too large for the base point to mean anything, and as `land` does.
    """
    problem = Problem.declare(branch, start, reconstruction)
    x0, y0 = (np.array([problem.start[s.name] for s in part]) for part in (problem.system.x, problem.system.y))
    landing = land(branch, x0, y0)
    if landing.direction < 0:
        problem = problem.reversed()
    return _Shadowing(problem, epsilon, landing, surface).found()


class _Shadowing:
    """What `shadow` does with a `problem` whose layer `landing` ends: all is about the `centre` of the system and in
    common `units` of the states.

    What is told is in those of the problem.
    """

    def __init__(
        self, problem: Problem, epsilon: float, landing: Landing, surface: SampledManifold | None
    ) -> None:
        self.problem, self.epsilon = problem, epsilon
        self.layer_time = epsilon / landing.gap
        self.states = (*problem.system.states, *problem.driven)
        system = problem.system
        nx, n = len(system.x), len(system.states)
        given = np.array([problem.start[s.name] for s in self.states])
        rates = compile_over(
            system, (*system.f, *problem.driven_rates), arguments=(*system.x, *problem.driven, *system.y)
        )
        landed = np.concatenate([given[:nx], given[n:], landing.point])
        # How far the slow variables come in the time that is looked at: a start may be at 0.
        way = rates(landed[None, :], parameter_vector(system, epsilon))[0] * LAYER_TIMES * self.layer_time
        way = np.where(np.isfinite(way), way, 0.0)
        # How far a state is from the origin is no size of what it does.
        own, centre = problem.branch.about_centres, system.centre
        self.centre = np.concatenate([centre, np.zeros(len(problem.driven))])
        states = np.array([given[:n] - centre, [*way[:nx], *(landing.point - centre[nx:])]])
        driven = np.maximum(np.abs(given[n:]), np.abs(way[nx:]))
        self.units = common_units(own.system, states, driven)
        self.start = (given - self.centre) / self.units
        branch = own.moved_into(self.units[:n])
        self.surface = surface
        near = (landing.point - centre[nx:]) / self.units[nx:n]
        self.height = _height(branch, epsilon, near, surface, system, self.units[:n])
        there = {s: s + c for s, c in system.centres.items()}
        given_rates = {s: rate.xreplace(there) for s, rate in zip(problem.driven, problem.driven_rates)}
        driven_rates = in_units(given_rates, dict(zip(self.states, self.units)))
        self.slow = _ShadowingFlow(branch.system, driven_rates, epsilon, self.height)
        self.flow = VectorField(
            {**dict(zip(system.states, branch.system.rates)), **driven_rates},
            epsilon=system.epsilon,
            parameters=system.parameters,
        )

    def found(self) -> Shadow:
        time = LAYER_TIMES * self.layer_time
        for _ in range(4):
            run = trajectory_of(
                self.flow,
                start=dict(zip((s.name for s in self.states), map(float, self.start))),
                span=(0.0, time),
                epsilon=self.epsilon,
                rtol=2e-14,
                atol=1e-17,
                at=np.linspace(0.0, time, 101)[1:],
                options=RunOptions(method=Method.DOP853),
            )
            pair = self._landed(run)
            if pair is not None:
                break
            time *= 2.0
        else:
            raise BranchError(
                f"the full system from {self.problem.place()} at {self._small()} is still away from the slow "
                f"manifold of {self.problem.branch} at time {run.t[-1]:.4g}, {self._state(run, -1)}.",
                "The start is outside its basin; move it, or take a smaller epsilon.",
            )
        slow = [self.states.index(s) for s in self.problem.slow]
        ends, units = run.y[slow], self.units[slow]
        *times, distance = pair
        (first, defect), (second, _) = (self.slow.back(ends[:, i], float(run.t[i])) for i in times)
        # What is left of the layer would still move the slow variables by f_y distance epsilon/gap.
        defect += self.slow.by_height(ends[:, times[0]]) * distance * self.layer_time
        scale = 1.0 + float(np.abs(first).max())
        estimates = np.maximum(np.maximum(np.abs(first - second), defect), 4 * np.finfo(float).eps * scale)
        if not estimates.max() <= LOST * scale:
            raise HyperbolicityError(
                f"the base point of {self.problem.place()} is determined only to {(estimates * units).max():.2g} at "
                f"{self._small()}: the slow manifold of {self.problem.branch} is not separated from its "
                "neighbours any more.",
                "Take a smaller epsilon.",
            )
        values, errors = (
            {s.name: float(v) for s, v in zip(self.problem.slow, part * units + origin)}
            for part, origin in ((first, self.centre[slow]), (estimates, 0.0))
        )
        if self.surface is not None:
            # Refuses a base point off its piece.
            self.surface.evaluate(np.array([values[s.name] for s in self.problem.system.x]))
        return Shadow(self.problem.start, values, errors, float(run.t[times[0]]), Status.SUCCESS)

    def _landed(self, run: Trajectory) -> tuple[int, int, float] | None:
        """Indices of two times at which the run is on the slow manifold, having stayed there, and its distance at the
        first (or the error of h); None when it ends before.

        A run that leaves again, at a fold say, may come back later to the same sheet; that is not this fibre. Where it
        leaves the solved piece before, they are the last two on it, and what is left of the layer is the distance.
        """
        system = self.problem.system
        x, y, _ = np.split(run.y.T, [len(system.x), len(system.states)], axis=1)
        over, last, left, distance = None, None, 0.0, 0.0
        for i, covered in enumerate(self._covers(x)):
            if not covered:
                if last is None:
                    continue
                # Of what is left of the layer the distance tells.
                return (
                    (last, max(last - 1, 0), distance) if over is None or over == last else (over, last, left)
                )
            try:
                h, error = self.height(x[i : i + 1])
            except BranchError as reason:
                raise BranchError(f"{self._leaving(run, i)} {reason}") from None
            last, distance = i, float(np.linalg.norm(y[i] - h[0]))
            limit = max(NEAR * (1.0 + float(np.linalg.norm(h))), 10.0 * error)
            if over is None and distance <= limit:
                over, left = i, max(distance, error)
            # A thousand such distances away it has left again.
            elif over is not None and distance > 1e3 * limit:
                raise BranchError(self._leaving(run, i))
            if over is not None:
                # The second time is later by a factor and by so many layer times at least.
                later = max(1.3 * run.t[over], run.t[over] + 6.0 * self.layer_time)
                if run.t[i] >= later:
                    return over, i, left
        if not run.status.ok:
            raise BranchError(f"{self._leaving(run, len(run.t) - 1)} It {run.message}.")
        return None

    def _covers(self, x: np.ndarray) -> np.ndarray:
        """Which of the places x (m, n_slow), in units, a solved manifold covers; without one all."""
        if self.surface is None:
            return np.ones(len(x), dtype=bool)
        return np.all(self.surface.covers(x * self.units[: x.shape[1]] + self.centre[: x.shape[1]]), axis=1)

    def _small(self) -> str:
        return f"{self.problem.branch.system.epsilon} = {self.epsilon:g}"

    def _leaving(self, run: Trajectory, i: int) -> str:
        return (
            f"the full system from {self.problem.place()} at {self._small()} leaves the slow manifold of "
            f"{self.problem.branch} before its layer is over, at {self._state(run, i)}: a fold or an end of the sheet "
            "is too near, or the start is outside the basin. Move the start, or take a smaller epsilon."
        )

    def _state(self, run: Trajectory, i: int) -> str:
        if not len(run.t):
            return "once"
        values = run.y[:, i] * self.units + self.centre
        return self.problem.system.place(zip(self.problem.system.states, values))


def _height(
    branch: Branch,
    epsilon: float,
    near: np.ndarray,
    surface: SampledManifold | None,
    system: SlowFastSystem,
    units: np.ndarray,
) -> Surface:
    """h(x) (m, n_fast) and its largest estimated error, over points (m, n_slow), as the `branch` has them: about the
    centres of the `system` and in `units` (n,).
    """
    (x_centre, y_centre), (x_units, y_units) = (
        np.split(part, [len(system.x)]) for part in (system.centre, units)
    )
    if surface is not None:
        error = float((surface.error_estimates / y_units).max())
        low, high = np.array([surface.region[s.name] for s in branch.system.x]).T

        def solved(x: np.ndarray) -> tuple[np.ndarray, float]:
            # Iterates on the way back may come off the piece; where they end is looked at.
            there = np.clip(x * x_units + x_centre, low, high)
            return (np.atleast_2d(surface.evaluate(there)) - y_centre) / y_units, error

        return solved
    guess = None if branch.is_explicit or branch.seed is not None else near

    def pointwise(x: np.ndarray) -> tuple[np.ndarray, float]:
        y0 = np.atleast_2d(branch.points(x, near=guess))
        y, orders, errors, _, _ = climb(tape, branch, x, y0, epsilon, order=None, tolerance=1e-15)
        if (orders < 0).any():
            where = zip(system.x, x[np.argmin(orders)] * x_units + x_centre)
            raise BranchError(
                f"the slow manifold was not found at {branch.system.epsilon} = {epsilon:g} over "
                f"{system.place(where)}.",
                "Take a smaller epsilon.",
            )
        return y, float(np.max(errors))

    def summed(x: np.ndarray) -> tuple[np.ndarray, float]:
        y, _, left_out = best_sum(series, x, epsilon, near=guess)
        return y, float(np.max(left_out))

    try:
        tape = write_tape(branch.system)
    except UnsupportedFunctionError:
        # Where the zero-derivative principle has no jets for the field, the series is summed through this
        # order.
        series = expand(branch, order=8)
        return summed
    return pointwise


class _ShadowingFlow:
    """z' = f(x, h(x), epsilon) for z = (x, reconstruction variables), these `driven` at their rates."""

    def __init__(
        self,
        system: SlowFastSystem,
        driven: Mapping[sp.Symbol, sp.Expr],
        epsilon: float,
        height: Surface,
    ) -> None:
        self._height = height
        self._slow = len(system.x)
        self._p = parameter_vector(system, epsilon)
        self._rates = compile_over(
            system, (*system.f, *driven.values()), arguments=(*system.x, *driven, *system.y)
        )

    def rates(self, z: np.ndarray) -> tuple[np.ndarray, float]:
        h, error = self._height(z[:, : self._slow])
        return self._rates(np.hstack([z, h]), self._p), error

    def back(self, end: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
        """z(0) from z(time) = `end`, and what the error of h may have done to it."""
        nodes, _, S = chebyshev()
        # The slow flow is followed in panels of this length times its Lipschitz constant: Picard's iteration then
        # gains a digit or more each time.
        count = max(1, int(np.ceil(time * self._lipschitz(end) / 0.4)))
        length = time / count
        # From the right end of each panel: int_(c_i)^1 = S_last - S_i.
        left = 0.5 * length * (S[-1] - S)
        z, drift = end, np.zeros(len(end))
        for _ in range(count):
            values = np.tile(z, (len(nodes), 1))
            for _ in range(60):
                rates, error = self.rates(values)
                moved = z - left @ rates
                change = float(np.abs(moved - values).max())
                values = moved
                if change <= 2 * np.finfo(float).eps * (1.0 + float(np.abs(values).max())):
                    break
            drift += length * error * self.by_height(values[0])
            z = values[0]
            if drift.max() > LOST * (1.0 + float(np.abs(z).max())):
                # Already lost: the rest of the way back would only be slow.
                break
        return z, drift

    def _lipschitz(self, z: np.ndarray) -> float:
        """A finite-difference estimate of the Jacobian's size."""
        n = len(z)
        step = 1e-4 * (1.0 + np.abs(z))
        rates, _ = self.rates(np.vstack([z + step * row for row in np.eye(n)] + [z]))
        return float(np.linalg.norm((rates[:-1] - rates[-1]) / step[:, None])) + 1e-3

    def by_height(self, z: np.ndarray) -> np.ndarray:
        """Sizes (n,) of the derivatives of the rates by y at z (n,), by differences."""
        h, _ = self._height(z[None, : self._slow])
        base = np.hstack([z[None, :], h])
        n = h.shape[1]
        shifts = np.zeros((n, base.shape[1]))
        shifts[:, -n:] = 1e-6 * np.eye(n)
        return np.abs((self._rates(base + shifts, self._p) - self._rates(base, self._p)) / 1e-6).max(axis=0)
