"""Newton's method for a cycle, on a mesh and over meshes until the estimated error is below a tolerance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gsp.errors import Status
from gsp.orbits.periodic.collocation import Condition, Cycle, Linearisation, OrbitProblem, phase_condition
from gsp.orbits.periodic.mesh import adapted, growth_density, interval_errors

# A step this small, in units of the cycle, is the last: the next one would be its square.
CONVERGED = 1e-9
# Steps that no longer get smaller are rounding when they are below this.
STAGNANT = 1e-6
STEPS = 25
# Phases are known to so many units in the last place, and the states at a phase to that times their slopes: in a jump
# that takes 1e-12 of the period, to 1e-3 of the amplitude.
PHASE_ROUNDING = 16 * 2.0**-52
# Halvings of a step that makes the defect larger.
HALVINGS = 5
# A cycle that has shrunk by this factor is an equilibrium.
COLLAPSED = 1e-6
# Meshes tried: each is right for the cycle on the one before.
MESHES = 12
# A mesh is kept when its estimated error is below the tolerance and above this share of it.
WASTEFUL = 1e-3

Conditions = Callable[[Cycle], Sequence[Condition]]


@dataclass(frozen=True, eq=False)
class Solution:
    """A cycle, its linearisation at the last step but its own (None when there was none), and how it came."""

    cycle: Cycle
    linear: Linearisation | None
    status: Status
    iterations: int
    update: float


def scales_of(cycle: Cycle) -> np.ndarray:
    """Amplitude of each state (n,); for a state that hardly moves, a small share of the largest."""
    amplitudes = cycle.amplitudes
    largest = float(amplitudes.max(initial=0.0)) or 1.0
    return np.maximum(amplitudes, 1e-6 * largest)


def solve_cycle(
    problem: OrbitProblem,
    guess: Cycle,
    *,
    scales: np.ndarray,
    conditions: Conditions | None = None,
    steps: int = STEPS,
    damped: bool = True,
) -> Solution:
    """Newton's method on the mesh of `guess`.

    Without `conditions` the only free scalar is the period, and the phase is held against the guess.
    """
    held = conditions or (lambda cycle: [phase_condition(cycle, guess, scales)])
    cycle, previous, total = guess, np.inf, 0
    linear: Linearisation | None = None
    defect = problem.residual(cycle, scales)
    for _ in range(steps):
        total += 1
        try:
            linear = problem.linearise(cycle)
            step = linear.solve(held(cycle), scales, np.empty((0, 0)))[0]
        except np.linalg.LinAlgError:
            return Solution(cycle, None, Status.SINGULAR_JACOBIAN, total, np.inf)
        update = max(_size(step, cycle, scales), abs(step.period) / cycle.period)
        if not np.isfinite(update):
            return Solution(cycle, None, Status.NON_FINITE, total, update)
        share, found, new = 1.0, cycle.moved(step), np.inf
        for _ in range(HALVINGS if damped else 1):
            new = problem.residual(found, scales) if found.period > 0.0 else np.inf
            if new <= max(2.0 * defect, 1e-8):
                break
            share *= 0.5
            found = cycle.moved(step, share)
        if not np.isfinite(new):
            return Solution(cycle, linear, Status.NON_FINITE, total, update)
        cycle, defect = found, new
        if (cycle.amplitudes <= COLLAPSED * scales).all():
            break
        if share == 1.0 and (update <= CONVERGED or (update <= STAGNANT and update > 0.3 * previous)):
            return Solution(cycle, linear, Status.SUCCESS, total, update)
        previous = update
    return Solution(cycle, linear, Status.NOT_CONVERGED, total, previous)


def _size(step: Cycle, cycle: Cycle, scales: np.ndarray) -> float:
    """Largest entry of a step in units of `scales`, where what the rounding of phases does counts as `CONVERGED`."""
    slopes = cycle.slopes
    blur = PHASE_ROUNDING * np.abs(np.concatenate([slopes[:, :1], slopes], axis=1))
    return float((np.abs(step.values) / (scales + blur / CONVERGED)).max())


@dataclass(frozen=True, eq=False)
class Refined:
    """A cycle on a mesh made for it: `error` in units of the amplitudes, `period_error` relative."""

    solution: Solution
    error: float
    period_error: float
    status: Status
    iterations: int
    meshes: int


def refine(
    problem: OrbitProblem,
    guess: Cycle,
    *,
    tolerance: float,
    most: int,
    progress: Callable[[float], object] | None,
) -> Refined:
    """Solve, adapt the mesh, and again, until the estimated error is at most `tolerance`."""
    cycle, iterations, period, aim = guess, 0, float("nan"), tolerance
    best: Refined | None = None
    for count in range(1, MESHES + 1):
        solution = solve_cycle(problem, cycle, scales=scales_of(cycle))
        iterations += solution.iterations
        if not solution.status.ok:
            if best is None:
                return Refined(solution, np.inf, np.inf, solution.status, iterations, count)
            # A mesh too coarse for this cycle: the one before stands, with its own error.
            return Refined(best.solution, best.error, best.period_error, solution.status, iterations, count)
        cycle = solution.cycle
        scales = scales_of(cycle)
        error = float(interval_errors(cycle, scales).max())
        # Between two meshes; of the coarser one rather, so that it errs on the safe side.
        change = abs(cycle.period / period - 1.0) if count > 1 else np.inf
        period = cycle.period
        best = Refined(solution, error, change, Status.SUCCESS, iterations, count)
        if progress is not None:
            progress(min(1.0, np.log(max(error, 1e-300)) / np.log(tolerance)))
        if count > 1 and error <= tolerance and change <= tolerance:
            return best
        if count > 2 and error > tolerance:
            # The estimate that the mesh was made from was too hopeful.
            aim *= 0.5
        mesh = adapted(cycle, scales, aim, most=most, least=growth_density(problem, cycle))
        if count > 2 and len(mesh) - 1 >= most and len(cycle.mesh) - 1 >= most:
            break
        cycle = cycle.on(mesh)
    assert best is not None
    return Refined(best.solution, best.error, best.period_error, Status.MESH_LIMIT, iterations, best.meshes)
