"""Pseudo-arclength continuation of cycles: predictor, corrector, meshes along the way, and the ending.

The unknowns are the cycle, its period and the parameter. A step is held across the tangent of the family [Kel77],
so that folds are passed, and so is a canard explosion, where the parameter moves by exp(-c/epsilon) while the cycle
grows: the arclength is then all in the cycle, and the parameter an answer. Lengths are in units of the cycle's
amplitudes, of its period, and of the width of the parameter's bounds.

[Kel77] H. B. Keller, "Numerical solution of bifurcation and nonlinear eigenvalue problems", in P. Rabinowitz (ed.),
Applications of Bifurcation Theory (1977).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gsp.collocation.newton import Solution
from gsp.errors import Status
from gsp.orbits.periodic.collocation import Condition, Cycle, OrbitProblem, phase_condition
from gsp.orbits.periodic.floquet import multipliers
from gsp.orbits.periodic.mesh import adapted, growth_density, interval_errors
from gsp.orbits.periodic.newton import WASTEFUL, scales_of, solve_cycle
from gsp.systems.region import Interval

# Newton steps a corrector may take, and the numbers that lengthen and shorten the next arclength step.
CORRECTIONS = 8
FEW, MANY = 4, 6
LONGER, SHORTER = 1.5, 0.7
SMALLEST_STEP = 1e-7
# Of two tangents in a row, the least cosine: a family that turns faster is stepped along again, more finely.
STRAIGHT = 0.7
# A family ends at an equilibrium when its cycle has shrunk to this share of the largest one.
VANISHED = 1e-3
# A predictor changes the width of an interval by this share of it at most.
STRAIN = 0.5
# A new mesh is made for this share of the tolerance, so that it serves for some steps.
AIM = 0.3
# Meshes tried for one cycle; a mesh is kept while it has this share of the growth an interval may have.
MESHES = 4
SLACK = 1.5


@dataclass(frozen=True)
class Controls:
    """Steps in arclength, how many, the error of each cycle, intervals at most, and the longest period."""

    step: float
    max_step: float
    max_points: int
    tolerance: float
    max_intervals: int
    max_period: float


@dataclass(frozen=True, eq=False)
class Row:
    """A cycle of a family with what was computed at it.

    `tangent` points along the family, `moving` is the same for values carried along with the mesh, whose points have
    the velocities `drift` (N + 1,): without them a predictor that is linear in the states would fail as soon as
    a layer moves by its own width. `moving` is of unit length.
    """

    cycle: Cycle
    tangent: Cycle
    moving: Cycle
    drift: np.ndarray
    divergence: float
    multipliers: np.ndarray
    error: float
    status: Status
    iterations: int


class Tracer:
    """Steps along one family; `bounds` are the parameter's."""

    def __init__(self, problem: OrbitProblem, bounds: Interval, controls: Controls) -> None:
        self.problem = problem
        self.bounds = bounds
        self.controls = controls
        self.width = bounds[1] - bounds[0]
        self.rejected = 0

    # -- geometry ------------------------------------------------------------------------------------

    def inner(self, at: Cycle, a: Cycle, b: Cycle) -> float:
        """Inner product of two differences of cycles on the mesh of `at`, in its units."""
        weight = at.scheme.b[:, None] * at.widths[:, None, None] / scales_of(at) ** 2
        states = float(np.sum(weight * a.values[:, 1:] * b.values[:, 1:]))
        return states + a.period * b.period / at.period**2 + a.parameter * b.parameter / self.width**2

    def across(self, at: Cycle, tangent: Cycle) -> Callable[[Cycle], Condition]:
        """The condition <cycle - at, tangent> = 0."""
        weights = tangent.values[:, 1:] / scales_of(at) ** 2

        def condition(cycle: Cycle) -> Condition:
            moved = cycle.moved(at, -1.0)
            value = -self.inner(at, moved, tangent)
            return Condition(weights, tangent.period / at.period**2, tangent.parameter / self.width**2, value)

        return condition

    def at_parameter(self, at: Cycle, value: float) -> Callable[[Cycle], Condition]:
        """The condition parameter = value."""
        nothing = np.zeros_like(at.values[:, 1:])
        return lambda cycle: Condition(
            nothing, 0.0, 1.0 / self.width, (value - cycle.parameter) / self.width
        )  # fmt: skip

    def corrected(
        self,
        guess: Cycle,
        reference: Cycle,
        condition: Callable[[Cycle], Condition],
    ) -> Solution[Cycle]:
        """Newton's method with that condition, the phase held against `reference`."""
        scales = scales_of(reference)
        return solve_cycle(
            self.problem,
            guess,
            scales=scales,
            conditions=lambda cycle: [phase_condition(cycle, reference, scales), condition(cycle)],
            steps=CORRECTIONS,
            damped=False,
        )

    def row(self, solution: Solution[Cycle], condition: Callable[[Cycle], Condition], iterations: int) -> Row:
        """What belongs to a cycle: its tangent on the side of the condition, multipliers, error."""
        cycle = solution.point
        scales = scales_of(cycle)
        linear, divergence = self.problem.linearise(cycle), self.problem.divergence(cycle)
        held = [phase_condition(cycle, cycle, scales), condition(cycle)]
        tangent = self.problem.steps(linear, cycle, held, scales, np.array([[0.0, 1.0]]))[1]
        drift, carried = self._drift(cycle, tangent, scales)
        moving = replace(tangent, values=tangent.values + carried)
        length = float(np.sqrt(self.inner(cycle, moving, moving)))
        if not 0.0 < length < np.inf:
            raise np.linalg.LinAlgError("no tangent")
        error = float(interval_errors(cycle, scales).max())
        met = error <= 10.0 * self.controls.tolerance
        return Row(
            cycle, tangent.times(1.0 / length), moving.times(1.0 / length), drift / length, divergence,
            multipliers(linear.transfers, divergence, scales), error,
            Status.SUCCESS if met else Status.MESH_LIMIT, iterations,
        )  # fmt: skip

    def _drift(self, cycle: Cycle, tangent: Cycle, scales: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocities of the mesh points (N + 1,) and what they add to those of the values (N, m + 1, n).

        The motion along the cycle is taken out of the tangent where the cycle is fast, in its layers.
        """
        scheme, widths = cycle.scheme, cycle.widths
        along = np.empty_like(cycle.values)
        along[:, 1:] = cycle.slopes
        along[:, 0] = cycle.period * self.problem.compiled.rates(
            cycle.values[:, 0], self.problem.constants(cycle)
        )
        u, v = along[:, 1:] / scales, tangent.values[:, 1:] / scales
        speed = np.einsum("i,jin,jin->j", scheme.b, u, u)
        share = np.einsum("i,jin,jin->j", scheme.b, u, v)
        # Sums over the two intervals at a mesh point; slow pieces, below the mean speed, stay where they are.
        weight = widths * speed
        total = weight + np.roll(weight, 1) + float(weight.sum()) * (widths + np.roll(widths, 1))
        pulled = widths * share
        velocity = -(pulled + np.roll(pulled, 1)) / total
        velocity = np.append(velocity, velocity[0])
        inside = velocity[:-1, None] + np.diff(velocity)[:, None] * scheme.x
        # The phase is free: the first point stays, and the whole cycle is shifted instead.
        return velocity - velocity[0], along * inside[..., None]

    # -- one step ------------------------------------------------------------------------------------

    def settled(
        self, solution: Solution[Cycle], condition: Callable[[Cycle], Condition], along: Cycle
    ) -> Row | None:
        """The cycle on a mesh made for it, with its tangent; None when Newton's method fails there."""
        tolerance, iterations = self.controls.tolerance, solution.iterations
        for _ in range(MESHES):
            cycle = solution.point
            scales = scales_of(cycle)
            error = float(interval_errors(cycle, scales).max())
            least = growth_density(self.problem, cycle)
            resolved = (least * cycle.widths <= SLACK).all()
            if tolerance * WASTEFUL <= error <= tolerance and resolved:
                break
            mesh = adapted(cycle, scales, AIM * tolerance, most=self.controls.max_intervals, least=least)
            if len(mesh) >= len(cycle.mesh) and error <= tolerance and resolved:
                break
            cycle, along = cycle.on(mesh), along.on(mesh)
            condition = self.across(cycle, along)
            solution = self.corrected(cycle, cycle, condition)
            if not solution.status.ok:
                return None
            if len(mesh) - 1 >= self.controls.max_intervals:
                break
        try:
            return self.row(solution, condition, iterations)
        except np.linalg.LinAlgError:
            return None

    def predicted(self, row: Row, length: float) -> tuple[Cycle, Cycle]:
        """The predictor at that arclength, and the direction in which it lies, both on the mesh moved along."""
        cycle, widths = row.cycle, row.cycle.widths
        strain = float(np.abs(length * np.diff(row.drift) / widths).max())
        share = min(1.0, STRAIN / strain) if strain > 0.0 else 1.0
        values = row.tangent.values + share * (row.moving.values - row.tangent.values)
        mesh = cycle.mesh + length * share * row.drift
        mesh[0], mesh[-1] = 0.0, 1.0
        direction = Cycle(mesh, values, row.tangent.period, row.tangent.parameter)
        guess = Cycle(mesh, cycle.values, cycle.period, cycle.parameter).moved(direction, length)
        return guess, direction

    def step(self, row: Row, length: float) -> Row | None:
        """The cycle at that arclength from `row`; None when the corrector fails or the family turns too fast."""
        guess, direction = self.predicted(row, length)
        if guess.period <= 0.0:
            return None
        condition = self.across(guess, direction)
        solution = self.corrected(guess, guess, condition)
        if not solution.status.ok:
            return None
        moved = solution.point.moved(guess, -1.0)
        if self.inner(guess, moved, moved) > length**2 * self.inner(guess, direction, direction):
            return None
        found = self.settled(solution, condition, direction)
        if found is None:
            return None
        old = direction if found.cycle.mesh is guess.mesh else direction.on(found.cycle.mesh)
        norm = float(np.sqrt(self.inner(found.cycle, old, old)))
        if self.inner(found.cycle, old, found.moving) < STRAIGHT * norm:
            return None
        return found

    def onto(self, row: Row, guess: Cycle, value: float) -> Row | None:
        """The cycle near `guess`, on the mesh of `row`, at that value of the parameter."""
        condition = self.at_parameter(guess, value)
        solution = self.corrected(guess, row.cycle, condition)
        if not solution.status.ok:
            return None
        try:
            return self.row(solution, self.across(solution.point, row.moving), solution.iterations)
        except np.linalg.LinAlgError:
            return None

    # -- the family ------------------------------------------------------------------------------------

    def run(
        self, first: Row, progress: Callable[[float], object] | None
    ) -> tuple[list[Row], list[float], Status]:
        """Rows from `first` on, the arclength between each and the one before, and the ending."""
        rows, lengths = [first], [0.0]
        controls, (low, high) = self.controls, self.bounds
        length = min(controls.step, controls.max_step)
        largest = first.cycle.amplitudes
        try:
            while len(rows) < controls.max_points:
                last = rows[-1]
                new = self.step(last, length)
                if new is None:
                    self.rejected += 1
                    length *= 0.5
                    if length < SMALLEST_STEP:
                        return rows, lengths, Status.STEP_TOO_SMALL
                    continue
                if not low < new.cycle.parameter < high:
                    ending = self._bounded(rows, lengths, new, length)
                    if ending is not None:
                        return rows, lengths, ending
                    self.rejected += 1
                    length *= 0.5
                    continue
                rows.append(new)
                lengths.append(length)
                if progress is not None:
                    progress(len(rows) / controls.max_points)
                largest = np.maximum(largest, new.cycle.amplitudes)
                shrinks = (new.cycle.amplitudes < last.cycle.amplitudes).all()
                if shrinks and (new.cycle.amplitudes <= VANISHED * largest).all():
                    return rows, lengths, Status.EQUILIBRIUM_REACHED
                if new.cycle.period > controls.max_period:
                    return rows, lengths, Status.PERIOD_GROWS
                if new.iterations <= FEW:
                    length = min(length * LONGER, controls.max_step)
                elif new.iterations > MANY:
                    length *= SHORTER
        except KeyboardInterrupt:
            return rows, lengths, Status.INTERRUPTED
        return rows, lengths, Status.TOO_MANY_POINTS

    def _bounded(self, rows: list[Row], lengths: list[float], new: Row, length: float) -> Status | None:
        """End on the bound that `new` is beyond, if the cycle there is found."""
        last = rows[-1]
        bound = self.bounds[0] if new.cycle.parameter <= self.bounds[0] else self.bounds[1]
        before, after = last.cycle.parameter, new.cycle.parameter
        share = (bound - before) / (after - before)
        ahead = new.cycle if new.cycle.mesh is last.cycle.mesh else new.cycle.on(last.cycle.mesh)
        guess = last.cycle.moved(ahead.moved(last.cycle, -1.0), share)
        found = self.onto(last, guess, bound)
        if found is None:
            return None
        rows.append(found)
        lengths.append(share * length)
        return Status.BOUND_REACHED
