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
from gsp.errors import BranchError, HyperbolicityError, Status, UnsupportedFunctionError
from gsp.fibres.decaying_signals import chebyshev
from gsp.fibres.inner_expansion import Problem
from gsp.fibres.layer_orbit import land
from gsp.integration.trajectory import Method, RunOptions, Trajectory, trajectory_of
from gsp.lowering.compiled_flow import parameter_vector
from gsp.lowering.compiled_function import compile_over
from gsp.lowering.tape import write_tape
from gsp.slow.series import best_sum, expand
from gsp.slow.slow_points import zero_derivative
from gsp.systems.flow import Point
from gsp.systems.system import VectorField

# Fast times 1/gap of the first run, how often it is doubled, and at how many times it is looked at. The base point is
# found from two times, the second one later by a factor and by so many layer times at least; their difference is an
# error estimate.
LAYER_TIMES, EXTENSIONS, LOOKS = 50.0, 4, 100
SECOND_FACTOR, SECOND_LATER = 1.3, 6.0
# Distance from the slow manifold, relative to 1 + |y|, at which the layer counts as over; or this many errors of h.
NEAR, NEAR_ERRORS = 1e-12, 10.0
# Estimated error, relative to 1 + |b|, above which there is no base point to speak of.
LOST = 1e-2
RTOL, ATOL = 2e-14, 1e-17
# The slow flow is followed in panels of this length times its Lipschitz constant: Picard's iteration then gains a
# digit or more each time.
PANEL, PICARD_STEPS = 0.4, 60

Surface = Callable[[np.ndarray], tuple[np.ndarray, float]]


@dataclass(frozen=True)
class Shadow:
    """A base point by shadowing: `values` by name, its `error` estimate, and the slow `time` shadowed."""

    start: dict[str, float]
    values: dict[str, float]
    error: float
    time: float
    status: Status


def shadow(
    branch: Branch,
    start: Point,
    *,
    epsilon: float,
    reconstruction: Mapping[sp.Symbol, sp.Expr],
    surface=None,
) -> Shadow:
    """The base point of the fibre through `start`; `surface` is a solved manifold, or None for pointwise values.

    Raises `BranchError` when the solution does not come near the slow manifold or leaves it at once,
    `HyperbolicityError` when epsilon is too large for the base point to mean anything, and as `land` does.
    """
    problem = Problem.declare(branch, start, reconstruction)
    system = branch.system
    x0 = np.array([problem.start[s.name] for s in system.x])
    y0 = np.array([problem.start[s.name] for s in system.y])
    landing = land(branch, x0, y0)
    if landing.direction < 0:
        problem = problem.reversed()
    height = _height(branch, epsilon, landing.point, surface)
    flow = VectorField(
        {
            **dict(zip(problem.system.states, problem.system.rates)),
            **dict(zip(problem.driven, problem.driven_rates)),
        },
        epsilon=system.epsilon,
        parameters=system.parameters,
    )
    slow = _ShadowingFlow(problem, epsilon, height)
    time = LAYER_TIMES * epsilon / landing.gap
    for _ in range(EXTENSIONS):
        run = trajectory_of(
            flow,
            start=problem.start,
            span=(0.0, time),
            epsilon=epsilon,
            rtol=RTOL,
            atol=ATOL,
            at=np.linspace(0.0, time, LOOKS + 1)[1:],
            options=RunOptions(method=Method.DOP853),
        )
        pair = _landed(problem, run, height, epsilon, epsilon / landing.gap)
        if pair is not None:
            break
        time *= 2.0
    else:
        end = ", ".join(f"{s.name} = {run[s.name][-1]:.6g}" for s in system.states)
        raise BranchError(
            f"the full system from {problem.place()} at epsilon = {epsilon:g} is still away from the slow "
            f"manifold of {branch} at time {run.t[-1]:.4g}, {end}.",
            "The start is outside its basin; move it, or take a smaller epsilon.",
        )
    names = [s.name for s in problem.slow]
    ends = np.array([run[name] for name in names])
    *times, distance = pair
    (first, defect), (second, _) = (slow.back(ends[:, i], float(run.t[i])) for i in times)
    scale = 1.0 + float(np.abs(first).max())
    # What is left of the layer would still move the slow variables by f_y distance epsilon/gap.
    defect += slow.by_height(ends[:, times[0]]) * distance * epsilon / landing.gap
    estimate = max(float(np.abs(first - second).max()), defect, 4 * np.finfo(float).eps * scale)
    if not estimate <= LOST * scale:
        raise HyperbolicityError(
            f"the base point of {problem.place()} is determined only to {estimate:.2g} at epsilon = "
            f"{epsilon:g}: the slow manifold of {branch} is not separated from its neighbours any more.",
            "Take a smaller epsilon.",
        )
    values = dict(zip(names, map(float, first)))
    return Shadow(problem.start, values, estimate, float(run.t[times[0]]), Status.SUCCESS)


def _landed(
    problem: Problem, run: Trajectory, height: Surface, epsilon: float, layer_time: float
) -> tuple[int, int, float] | None:
    """Indices of two times at which the run is on the slow manifold, having stayed there, and its distance at the first
    (or the error of h); None when it ends before.

    A run that leaves again, at a fold say, may come back later to the same sheet; that is not this fibre.
    """
    system = problem.system
    x = np.array([run[s.name] for s in system.x]).T
    y = np.array([run[s.name] for s in system.y]).T
    over, left = None, 0.0
    for i in range(len(run.t)):
        try:
            h, error = height(x[i : i + 1])
        except BranchError as reason:
            raise BranchError(_leaving(problem, run, i, epsilon) + f" {reason}") from None
        distance = float(np.linalg.norm(y[i] - h[0]))
        limit = max(NEAR * (1.0 + float(np.linalg.norm(h))), NEAR_ERRORS * error)
        if over is None and distance <= limit:
            over, left = i, max(distance, error)
        # A thousand such distances away it has left again.
        elif over is not None and distance > 1e3 * limit:
            raise BranchError(_leaving(problem, run, i, epsilon))
        if over is not None:
            later = max(SECOND_FACTOR * run.t[over], run.t[over] + SECOND_LATER * layer_time)
            if run.t[i] >= later:
                return over, i, left
    if not run.status.ok:
        raise BranchError(_leaving(problem, run, len(run.t) - 1, epsilon) + f" It {run.message}.")
    return None


def _leaving(problem: Problem, run: Trajectory, i: int, epsilon: float) -> str:
    end = ", ".join(f"{s.name} = {run[s.name][i]:.6g}" for s in problem.system.states) if len(run.t) else "once"
    return (
        f"the full system from {problem.place()} at epsilon = {epsilon:g} leaves the slow manifold of {problem.branch} "
        f"before its layer is over, at {end}: a fold or an end of the sheet is too near, or the start is outside "
        "the basin. Move the start, or take a smaller epsilon."
    )


def _height(branch: Branch, epsilon: float, near: np.ndarray, surface) -> Surface:
    """h(x) (m, n_fast) and its largest estimated error, over points (m, n_slow)."""
    if surface is not None:
        return lambda x: (np.atleast_2d(surface.evaluate(x)), float(surface.error_estimate))
    guess = None if branch.is_explicit or branch.seed is not None else near

    def pointwise(x: np.ndarray) -> tuple[np.ndarray, float]:
        found = zero_derivative(branch, x, epsilon=epsilon, tolerance=1e-15, near=guess)
        if not found.status.ok:
            raise BranchError(
                f"the slow manifold of {branch} was not found at epsilon = {epsilon:g}: {found.message}.",
                "Take a smaller epsilon.",
            )
        return found.y, float(np.max(found.error))

    def summed(x: np.ndarray) -> tuple[np.ndarray, float]:
        y, _, left_out = best_sum(series, x, epsilon, near=guess)
        return y, float(np.max(left_out))

    try:
        write_tape(branch.system)
    except UnsupportedFunctionError:
        # Where the zero-derivative principle has no jets for the field, the series is summed through this
        # order.
        series = expand(branch, order=8)
        return summed
    return pointwise


class _ShadowingFlow:
    """z' = f(x, h(x), epsilon) for z = (x, reconstruction variables)."""

    def __init__(self, problem: Problem, epsilon: float, height: Surface) -> None:
        system = problem.system
        self._height = height
        self._slow = len(system.x)
        self._p = parameter_vector(system, epsilon)
        self._rates = compile_over(
            system, (*system.f, *problem.driven_rates), arguments=(*system.x, *problem.driven, *system.y)
        )

    def rates(self, z: np.ndarray) -> tuple[np.ndarray, float]:
        h, error = self._height(z[:, : self._slow])
        return self._rates(np.hstack([z, h]), self._p), error

    def back(self, end: np.ndarray, time: float) -> tuple[np.ndarray, float]:
        """z(0) from z(time) = `end`, and what the error of h may have done to it."""
        nodes, _, S = chebyshev()
        count = max(1, int(np.ceil(time * self._lipschitz(end) / PANEL)))
        length = time / count
        # From the right end of each panel: int_(c_i)^1 = S_last - S_i.
        left = 0.5 * length * (S[-1] - S)
        z, drift = end, 0.0
        for _ in range(count):
            values = np.tile(z, (len(nodes), 1))
            for _ in range(PICARD_STEPS):
                rates, error = self.rates(values)
                moved = z - left @ rates
                change = float(np.abs(moved - values).max())
                values = moved
                if change <= 2 * np.finfo(float).eps * (1.0 + float(np.abs(values).max())):
                    break
            drift += length * error * self.by_height(values[0])
            z = values[0]
            if drift > LOST * (1.0 + float(np.abs(z).max())):
                # Already lost: the rest of the way back would only be slow.
                break
        return z, drift

    def _lipschitz(self, z: np.ndarray) -> float:
        """A finite-difference estimate of the Jacobian's size."""
        n = len(z)
        step = 1e-4 * (1.0 + np.abs(z))
        rates, _ = self.rates(np.vstack([z + step * row for row in np.eye(n)] + [z]))
        return float(np.linalg.norm((rates[:-1] - rates[-1]) / step[:, None])) + 1e-3

    def by_height(self, z: np.ndarray) -> float:
        """Size of the derivative of the rates by y at z (n,), by differences."""
        h, _ = self._height(z[None, : self._slow])
        base = np.hstack([z[None, :], h])
        n = h.shape[1]
        shifts = np.zeros((n, base.shape[1]))
        shifts[:, -n:] = 1e-6 * np.eye(n)
        return float(np.abs((self._rates(base + shifts, self._p) - self._rates(base, self._p)) / 1e-6).max())
