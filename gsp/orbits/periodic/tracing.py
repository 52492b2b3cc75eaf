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

from gsp.critical.continuation.arclength import Controls
from gsp.errors import Status
from gsp.orbits.periodic.collocation import Cycle, LinearCondition, OrbitProblem, phase_condition
from gsp.orbits.periodic.floquet import multipliers
from gsp.orbits.periodic.mesh import adapted, growth_density, interval_errors
from gsp.orbits.periodic.newton import WASTEFUL, local_scales, scales_of, solve_cycle
from gsp.systems.region import Interval
from gsp.tracing.arclength import Arrival, Pace, Stride, Trace, Tracer
from gsp.tracing.newton import Solution


@dataclass(frozen=True)
class CycleControls(Controls):
    """Controls of a family of cycles, whose errors `tolerance` bounds, with the most intervals and longest period."""

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


class CycleTracer(Tracer[Row]):
    """Steps along one family; `bounds` are the parameter's."""

    def __init__(self, problem: OrbitProblem, bounds: Interval, controls: CycleControls) -> None:
        self.problem = problem
        self.bounds = bounds
        self.controls = controls
        self.width = bounds[1] - bounds[0]
        self.most = controls.max_points
        # Of two tangents in a row, the least cosine: a family that turns faster is stepped along again, more
        # finely.
        self.pace = Pace(
            controls.step, controls.max_step, 1e-7, 5, largest_turn=float(np.arccos(0.7)), growth=1.5,
        )  # fmt: skip
        self.largest = np.zeros(problem.size)

    # -- geometry ------------------------------------------------------------------------------------

    def inner(self, at: Cycle, a: Cycle, b: Cycle) -> float:
        """Inner product of two differences of cycles on the mesh of `at`, in its units."""
        weight = at.scheme.b[:, None] * at.widths[:, None, None] / scales_of(self.problem, at) ** 2
        states = float(np.sum(weight * a.values[:, 1:] * b.values[:, 1:]))
        return states + a.period * b.period / at.period**2 + a.parameter * b.parameter / self.width**2

    def across(self, at: Cycle, tangent: Cycle) -> Callable[[Cycle], LinearCondition]:
        """The condition <cycle - at, tangent> = 0."""
        weights = tangent.values[:, 1:] / scales_of(self.problem, at) ** 2

        def condition(cycle: Cycle) -> LinearCondition:
            moved = cycle.moved(at, -1.0)
            value = -self.inner(at, moved, tangent)
            return LinearCondition(
                weights, tangent.period / at.period**2, tangent.parameter / self.width**2, value
            )

        return condition

    def at_parameter(self, at: Cycle, value: float) -> Callable[[Cycle], LinearCondition]:
        """The condition parameter = value."""
        nothing = np.zeros_like(at.values[:, 1:])
        return lambda cycle: LinearCondition(
            nothing, 0.0, 1.0 / self.width, (value - cycle.parameter) / self.width
        )  # fmt: skip

    def solved(
        self,
        guess: Cycle,
        reference: Cycle,
        condition: Callable[[Cycle], LinearCondition],
    ) -> Solution[Cycle]:
        """Newton's method with that condition, the phase held against `reference`."""
        scales = scales_of(self.problem, reference)
        return solve_cycle(
            self.problem,
            guess,
            scales=scales,
            conditions=lambda cycle: [phase_condition(cycle, reference, scales), condition(cycle)],
            steps=8,
            damped=False,
        )

    def row(
        self, solution: Solution[Cycle], condition: Callable[[Cycle], LinearCondition], iterations: int
    ) -> Row:
        """What belongs to a cycle: its tangent on the side of the condition, multipliers, error."""
        cycle = solution.point
        scales = scales_of(self.problem, cycle)
        linear, divergence = self.problem.linearise(cycle), self.problem.divergence(cycle)
        held = [phase_condition(cycle, cycle, scales), condition(cycle)]
        tangent = self.problem.steps(linear, cycle, held, scales, np.array([[0.0, 1.0]]))[1]
        drift, carried = self._drift(cycle, tangent, scales)
        moving = replace(tangent, values=tangent.values + carried)
        length = float(np.sqrt(self.inner(cycle, moving, moving)))
        if not 0.0 < length < np.inf:
            raise np.linalg.LinAlgError("no tangent")
        error = float(interval_errors(cycle, local_scales(self.problem, cycle)).max())
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
        self, solution: Solution[Cycle], condition: Callable[[Cycle], LinearCondition], along: Cycle
    ) -> Row | None:
        """The cycle on a mesh made for it, with its tangent; None when Newton's method fails there."""
        tolerance, iterations = self.controls.tolerance, solution.iterations
        for _ in range(4):
            cycle = solution.point
            scales = local_scales(self.problem, cycle)
            error = float(interval_errors(cycle, scales).max())
            least = growth_density(self.problem, cycle)
            # It is kept while its intervals have 1.5 times the growth that they may have.
            resolved = (least * cycle.widths <= 1.5).all()
            if tolerance * WASTEFUL <= error <= tolerance and resolved:
                break
            # A new mesh is made for this share of the tolerance, so that it serves for some steps.
            mesh = adapted(cycle, scales, 0.3 * tolerance, most=self.controls.max_intervals, least=least)
            if len(mesh) >= len(cycle.mesh) and error <= tolerance and resolved:
                break
            cycle, along = cycle.on(mesh), along.on(mesh)
            condition = self.across(cycle, along)
            solution = self.solved(cycle, cycle, condition)
            if not solution.status.ok:
                return None
            if len(mesh) - 1 >= self.controls.max_intervals:
                break
        try:
            return self.row(solution, condition, iterations)
        except np.linalg.LinAlgError:
            return None

    def predicted(self, here: Row, length: float) -> tuple[Cycle, Cycle] | None:
        """The predictor at that arclength, and the direction in which it lies, both on the mesh moved along."""
        cycle, widths = here.cycle, here.cycle.widths
        strain = float(np.abs(length * np.diff(here.drift) / widths).max())
        # A predictor changes the width of an interval by half of it at most.
        share = min(1.0, 0.5 / strain) if strain > 0.0 else 1.0
        values = here.tangent.values + share * (here.moving.values - here.tangent.values)
        mesh = cycle.mesh + length * share * here.drift
        mesh[0], mesh[-1] = 0.0, 1.0
        direction = Cycle(mesh, values, here.tangent.period, here.tangent.parameter)
        guess = Cycle(mesh, cycle.values, cycle.period, cycle.parameter).moved(direction, length)
        return (guess, direction) if guess.period > 0.0 else None

    def corrected(self, guess: tuple[Cycle, Cycle], length: float) -> Solution[Cycle] | None:
        """The cycle in the plane of the guess, unless it is further from it than the guess from the last."""
        start, direction = guess
        solution = self.solved(start, start, self.across(start, direction))
        moved = solution.point.moved(start, -1.0)
        if not solution.status.ok or self.inner(start, moved, moved) > length**2 * self.inner(
            start, direction, direction
        ):
            return None
        return solution

    def oriented(self, here: Row, guess: tuple[Cycle, Cycle], found: Solution[Cycle]) -> Stride[Row] | None:
        """The cycle on a mesh of its own with its tangent."""
        start, direction = guess
        row = self.settled(found, self.across(start, direction), direction)
        if row is None:
            return None
        old = direction if row.cycle.mesh is start.mesh else direction.on(row.cycle.mesh)
        norm = float(np.sqrt(self.inner(row.cycle, old, old)))
        cosine = self.inner(row.cycle, old, row.moving) / norm
        return Stride(row, row.iterations, float(np.arccos(np.clip(cosine, -1.0, 1.0))))

    def onto(self, row: Row, guess: Cycle, value: float) -> Row | None:
        """The cycle near `guess`, on the mesh of `row`, at that value of the parameter."""
        condition = self.at_parameter(guess, value)
        solution = self.solved(guess, row.cycle, condition)
        if not solution.status.ok:
            return None
        try:
            return self.row(solution, self.across(solution.point, row.moving), solution.iterations)
        except np.linalg.LinAlgError:
            return None

    # -- the family ------------------------------------------------------------------------------------

    def run(
        self, first: Row, progress: Callable[[float], object] | None
    ) -> tuple[list[Row], list[float], Status, int]:
        """Rows from `first` on, the arclength from each to the next, the ending, and how many were refused."""
        trace = Trace([first])
        self.largest = first.cycle.amplitudes
        try:
            self.follow(trace, progress=progress)
        except KeyboardInterrupt:
            trace.ending = Status.INTERRUPTED
        assert isinstance(trace.ending, Status)
        return trace.nodes, [0.0, *trace.lengths], trace.ending, trace.rejected

    def arrived(self, trace: Trace[Row], here: Row, stride: Stride[Row], length: float) -> Arrival[Row] | None:
        """The row, or the one on the bound before it; the ending where the family shrinks or slows down."""
        new, (low, high) = stride.node, self.bounds
        if not low < new.cycle.parameter < high:
            return self._bounded(here, new, length)
        self.largest = np.maximum(self.largest, new.cycle.amplitudes)
        shrinks = (new.cycle.amplitudes < here.cycle.amplitudes).all()
        ending = None
        # A family ends at an equilibrium when its cycle has shrunk to this share of the largest one.
        if shrinks and (new.cycle.amplitudes <= 1e-3 * self.largest).all():
            ending = Status.EQUILIBRIUM_REACHED
        elif new.cycle.period > self.controls.max_period:
            ending = Status.PERIOD_GROWS
        return Arrival([(new, length)], ending)

    def _bounded(self, last: Row, new: Row, length: float) -> Arrival[Row] | None:
        """The end on the bound that `new` is beyond, if the cycle there is found."""
        bound = self.bounds[0] if new.cycle.parameter <= self.bounds[0] else self.bounds[1]
        before, after = last.cycle.parameter, new.cycle.parameter
        share = (bound - before) / (after - before)
        ahead = new.cycle if new.cycle.mesh is last.cycle.mesh else new.cycle.on(last.cycle.mesh)
        guess = last.cycle.moved(ahead.moved(last.cycle, -1.0), share)
        found = self.onto(last, guess, bound)
        return None if found is None else Arrival([(found, share * length)], Status.BOUND_REACHED)
