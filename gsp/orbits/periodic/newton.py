"""Newton's method for a cycle, on a mesh and over meshes until the estimated error is below a tolerance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsp.errors import Status
from gsp.orbits.periodic.collocation import Cycle, LinearCondition, OrbitProblem, driven, phase_condition
from gsp.orbits.periodic.mesh import adapted, growth_density, interval_errors
from gsp.tracing.newton import Rules, Solution, newton

# A step this small, in units of the cycle, is the last: the next one would be its square.
CONVERGED = 1e-9
STEPS = 25
# Steps that no longer get smaller are rounding when they are below 1e-6.
RULES = Rules(STEPS, CONVERGED, 1e-6)
# Phases are known to so many units in the last place, and the states at a phase to that times their slopes: in a jump
# that takes 1e-12 of the period, to 1e-3 of the amplitude.
PHASE_ROUNDING = 16 * np.finfo(float).eps
# A cycle that has shrunk by this factor is an equilibrium.
COLLAPSED = 1e-6
# A mesh is kept when its estimated error is below the tolerance and above this share of it.
WASTEFUL = 1e-3

Conditions = Callable[[Cycle], Sequence[LinearCondition]]


def scales_of(problem: OrbitProblem, cycle: Cycle) -> np.ndarray:
    """Amplitude of each state (n,); of one that hardly moves, no less than what counts as moving.

    That is a small share of what the others move it by: |F_u| times their amplitudes, for as long as it remembers or
    the period lasts. Nor is rounding of its own size a movement. Where the small states would stay 0 by themselves, no
    unit of theirs is known but the largest amplitude.
    """
    amplitudes = cycle.amplitudes
    least = 1e-6 * (float(amplitudes.max(initial=0.0)) or 1.0)
    small = amplitudes < least
    from_others = driven(problem.flow, np.flatnonzero(small).tolist())
    if not from_others:
        return np.maximum(amplitudes, least)
    pushes = np.einsum("j,k,jkil->il", cycle.widths, cycle.scheme.b, np.abs(problem.jacobians(cycle)))
    remembered = np.maximum(np.diag(pushes), 1.0 / cycle.period)
    np.fill_diagonal(pushes, 0.0)
    moved = 1e-6 * (pushes * amplitudes).max(axis=1) / remembered
    rounding = np.sqrt(np.finfo(float).eps) * np.abs(cycle.values).max(axis=(0, 1))
    own = np.maximum(moved, rounding)
    small[[k for k in from_others if own[k] > 0.0]] = False
    return np.maximum(amplitudes, np.where(small, least, own))


def local_scales(problem: OrbitProblem, cycle: Cycle) -> np.ndarray:
    """Sizes in which errors of each interval are judged (N, n): a state's amplitude, or what it is there.

    No orbit crosses the axis of a state whose rate vanishes with it, and how far from there it is sets how long it
    takes to come back: its errors count by its own size, unless it lies on the axis throughout.
    """
    scales = scales_of(problem, cycle)
    comes_near = problem.has_axis & (cycle.amplitudes >= scales)
    own = np.clip(np.abs(cycle.values).max(axis=1), np.finfo(float).tiny, scales)
    return np.where(comes_near, own, scales)


def solve_cycle(
    problem: OrbitProblem,
    guess: Cycle,
    *,
    scales: np.ndarray,
    conditions: Conditions | None = None,
    steps: int = STEPS,
    damped: bool = True,
) -> Solution[Cycle]:
    """Newton's method on the mesh of `guess`.

    Without `conditions` the only free scalar is the period, and the phase is held against the guess. It fails where
    the cycle has collapsed to an equilibrium.
    """
    held = conditions or (lambda cycle: [phase_condition(cycle, guess, scales)])
    defect = problem.residual(guess, scales)

    def collapsed(cycle: Cycle) -> bool:
        return bool((cycle.amplitudes <= COLLAPSED * scales).all())

    def step_of(cycle: Cycle) -> Cycle:
        if collapsed(cycle):
            raise np.linalg.LinAlgError("an equilibrium")
        return problem.steps(problem.linearise(cycle), cycle, held(cycle), scales)[0]

    def length(step: Cycle, cycle: Cycle) -> float:
        return max(_size(step, cycle, scales), abs(step.period) / cycle.period)

    def moved(cycle: Cycle, step: Cycle, share: float) -> Cycle | None:
        nonlocal defect
        found, new = cycle, np.inf
        # Halvings of a step that makes the defect larger.
        for _ in range(5 if damped else 1):
            found = cycle.moved(step, share)
            new = problem.residual(found, scales) if found.period > 0.0 else np.inf
            if new <= max(2.0 * defect, 1e-8):
                break
            share *= 0.5
        defect = new
        return found if np.isfinite(new) else None

    found = newton(guess, step_of, length=length, moved=moved, rules=replace(RULES, steps=steps))
    return replace(found, status=Status.NOT_CONVERGED) if collapsed(found.point) else found


def _size(step: Cycle, cycle: Cycle, scales: np.ndarray) -> float:
    """Largest entry of a step in units of `scales`, where what the rounding of phases does counts as `CONVERGED`."""
    slopes = cycle.slopes
    blur = PHASE_ROUNDING * np.abs(np.concatenate([slopes[:, :1], slopes], axis=1))
    return float((np.abs(step.values) / (scales + blur / CONVERGED)).max())


@dataclass(frozen=True, eq=False)
class Refined:
    """A cycle on a mesh made for it: `error` in units of `local_scales`, `period_error` relative."""

    solution: Solution[Cycle]
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
    # Meshes tried: each is right for the cycle on the one before.
    for count in range(1, 12 + 1):
        solution = solve_cycle(problem, cycle, scales=scales_of(problem, cycle))
        iterations += solution.iterations
        if not solution.status.ok:
            if best is None:
                return Refined(solution, np.inf, np.inf, solution.status, iterations, count)
            # A mesh too coarse for this cycle: the one before stands, with its own error.
            return Refined(best.solution, best.error, best.period_error, solution.status, iterations, count)
        cycle = solution.point
        scales = local_scales(problem, cycle)
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
