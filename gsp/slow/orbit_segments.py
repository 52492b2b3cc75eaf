"""Points of the slow manifold from orbit segments of the full flow, for every type of normal hyperbolicity.

Over a slow point x a segment of the full flow is sought with its slow coordinates at time 0 fixed at x. Its stable
fast directions are fixed at the upstream end and its unstable ones at the downstream end (J. Guckenheimer and
C. Kuehn, "Computing slow manifolds of saddle type", SIAM Journal on Applied Dynamical Systems 8 (2009) 854-879);
what is fixed there wrongly has decayed by exp(-gap T/epsilon) at time 0, and how much of it is left is read off
the linear system that was solved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsp.algebra.switching_functions import switches
from gsp.collocation.bordered import FlowEquations, OrbitChange, linearise
from gsp.collocation.gauss import gauss
from gsp.critical.branch import Branch
from gsp.errors import Status, UnsupportedFunctionError
from gsp.kernels.slow_points import CONVERGED
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.lowering.compiled_function import compile_over
from gsp.lowering.tape import Tape, write_tape
from gsp.slow.segment_problem import Held, Point, SegmentProblem, step_length
from gsp.slow.slow_points import climb
from gsp.slow.slow_track import LEFT, Track, follow_slow_flow
from gsp.tracing.newton import Rules, newton

# Gauss points an element: order 12, which rounding meets on elements of `slow_track.DECAY`.
STAGES = 6
SCHEME = gauss(STAGES)
# A Newton step of 1e-15, relative to 1 + |z|, is rounding, and one of 1e-8 is followed by rounding.
RULES = Rules(30, 1e-15, 1e-8, stagnant=0.5, growth=2.0, setbacks=3, longest=1.0)
# Bounds on the decay that a segment is made for, in powers of e.
SHORTEST, LONGEST = 12.0, 60.0
# Fractions of epsilon along which a segment that fails is approached.
LADDER = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 0.7, 0.85, 1.0)
# Share of the tolerance that may come from where a segment begins, which is lengthened for that.
SHARE = 0.1
# What is left of a segment's length when it fails or comes out badly.
RETREAT = 0.8


@dataclass(frozen=True, eq=False)
class Segments:
    """What k segments gave: the fast variables `y` (k, n_fast) over the slow points, NaN where Newton failed.

    `selection` (k,) is what is left of the ends' errors, `discretisation` (k,) the estimated error of collocation;
    `status` says how each ended, `is_cut_short` which were shortened, as a rule because their orbit leaves the branch,
    to end at the places `ends` (k, n) after a decay by `decayed` (k,) powers of e, and `reached` (k,) the largest
    epsilon at which a segment was solved.
    """

    y: np.ndarray
    selection: np.ndarray
    discretisation: np.ndarray
    status: list[Status]
    is_cut_short: np.ndarray
    ends: np.ndarray
    decayed: np.ndarray
    reached: np.ndarray
    iterations: int

    @property
    def error(self) -> np.ndarray:
        """Both errors together (k,)."""
        return self.selection + self.discretisation


class SegmentSolver:
    """Solves segments of one branch at one epsilon; `unstable` is the number of unstable fast directions."""

    def __init__(self, branch: Branch, *, epsilon: float, unstable: int, tolerance: float) -> None:
        self.branch = branch
        self.system = branch.system
        self.epsilon = epsilon
        self.unstable = unstable
        self.tolerance = tolerance
        self.flow = compile_flow(self.system)
        self.tape: Tape | None
        try:
            self.tape = write_tape(self.system)
        except UnsupportedFunctionError:
            # Max, Piecewise and the like have no jets; segments do not need them, only good guesses do.
            self.tape = None
        found = switches(self.system.rates, self.system.states)
        self.surfaces = compile_over(self.system, tuple(each.surface for each in found)) if found else None
        self.equations = FlowEquations(self.flow.field, self.flow.jacobian, 0, 0)
        # From the polynomial through an element's start and stages to both its halves.
        self.halving = SCHEME.basis(np.concatenate([SCHEME.c / 2, [0.5], (1 + SCHEME.c) / 2]))

    def solve(self, x: np.ndarray, y: np.ndarray) -> Segments:
        """Segments through the slow points x (k, n_slow), from points y (k, n_fast) of M0 over them."""
        # Orbits that leave the domain of the field give infinities, which are looked for where they matter.
        with np.errstate(all="ignore"):
            return self._solved(x, y)

    def _solved(self, x: np.ndarray, y: np.ndarray) -> Segments:
        first = self._tracks(x, y, np.full(len(x), SHORTEST))
        drift = np.max([track.drift for track in first], axis=0)
        goal = np.clip(np.log(np.maximum(drift, 1e-300) / (SHARE * SHARE * self.tolerance)), SHORTEST, LONGEST)
        result = self._attempt(x, y, goal)
        for _ in range(2):
            # A longer segment only where this one was solved: what failed is too long already.
            short = np.isfinite(result.selection) & (result.selection > SHARE * self.tolerance)
            short &= ~result.is_cut_short & (goal < LONGEST)
            if not short.any():
                break
            needed = 3.0 + np.log(result.selection[short] / (SHARE * self.tolerance))
            goal[short] = np.minimum(goal[short] + needed, LONGEST)
            _replace(result, short, self._attempt(x[short], y[short], goal[short]))
        goal = np.minimum(goal, result.decayed)
        hopeful = np.ones(len(x), dtype=bool)
        for _ in range(7):
            # An orbit on its way to a fold, say: a shorter segment may be solved where the whole one is not, or badly.
            failed = np.array([not status.ok for status in result.status])
            poor = failed | (hopeful & result.is_cut_short & (result.error > self.tolerance))
            if not poor.any():
                break
            goal[poor] *= RETREAT
            before = result.error[poor]
            _replace(result, poor, self._attempt(x[poor], y[poor], goal[poor], is_cut_short=True))
            # Once shortening loses more than it mends it is over.
            hopeful[poor] = result.error[poor] < before
        return result

    # -- one attempt -------------------------------------------------------------------------------

    def _tracks(self, x: np.ndarray, y: np.ndarray, goal: np.ndarray) -> list[Track]:
        """The slow flow from x to where each end of a segment lies: upstream, then downstream."""
        fast = len(self.system.y)
        return [
            follow_slow_flow(
                self.branch, x, y, epsilon=self.epsilon, goal=goal, side=side, unstable=self.unstable
            )
            if count
            else Track.empty(x, y)
            for side, count in ((LEFT, fast - self.unstable), (1 - LEFT, self.unstable))
        ]

    def _attempt(
        self, x: np.ndarray, y: np.ndarray, goal: np.ndarray, *, is_cut_short: bool = False
    ) -> Segments:
        upstream, downstream = self._tracks(x, y, goal)
        nx, n = len(self.system.x), len(self.system.states)
        k = len(x)
        counts = upstream.counts + downstream.counts
        width = int(counts.max(initial=1))
        lengths = np.zeros((k, width))
        z = np.zeros((k, width + 1, n))
        rates = np.zeros((k, width + 1, n))
        for q in range(k):
            a, b = int(upstream.counts[q]), int(downstream.counts[q])
            lengths[q, :a] = upstream.lengths[q, :a][::-1]
            lengths[q, a : a + b] = downstream.lengths[q, :b]
            for target, name in ((z, "states"), (rates, "rates")):
                target[q, : a + 1] = getattr(upstream, name)[q, : a + 1][::-1]
                target[q, a : a + b + 1] = getattr(downstream, name)[q, : b + 1]
        rows = np.arange(k)
        ends = (z[rows, 0].copy(), z[rows, counts].copy())
        problem = SegmentProblem(
            x=np.ascontiguousarray(x),
            lengths=lengths,
            counts=counts,
            middles=upstream.counts.copy(),
            z=z,
            stages=self._stages(lengths, z, rates),
            bases=(self._basis(ends[0], stable=True), self._basis(ends[1], stable=False)),
        )
        status, reached, iterations = self._newton(problem)
        failed = np.array([not s.ok for s in status])
        solution = np.where(failed[:, None], np.nan, z[rows, problem.middles, nx:])
        discretisation = self._refine(problem, solution, np.flatnonzero(~failed))
        response, moved = problem.response, problem.moved
        fast = len(self.system.y)
        selection = np.zeros(k)
        for side, track, columns in (
            (0, upstream, slice(0, fast - self.unstable)),
            (1, downstream, slice(fast - self.unstable, fast)),
        ):
            # Taken off M_epsilon by as much as M_epsilon is off M0, at most.
            error = track.drift + moved[:, side]
            selection += np.linalg.norm(response[:, :, columns], axis=(1, 2)) * error
        downwards = downstream.is_cut_short if not is_cut_short else upstream.decayed > downstream.decayed
        where = np.where(downwards[:, None], ends[1], ends[0])
        return Segments(
            y=solution,
            selection=np.where(failed, np.inf, selection),
            discretisation=discretisation,
            status=status,
            is_cut_short=upstream.is_cut_short | downstream.is_cut_short | is_cut_short,
            ends=where,
            decayed=np.minimum(upstream.decayed, downstream.decayed),
            reached=reached,
            iterations=int(iterations.sum()),
        )

    def _refine(self, problem: SegmentProblem, solution: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Halve the elements until the solution stands still; returns the estimated error left (k,)."""
        error, before = np.full(len(solution), np.inf), np.zeros(len(solution))
        part, nx = problem, len(self.system.x)
        taken = np.arange(len(problem.x))
        # Elements are halved until the change this makes, over 2^STAGES (the order of a stiff limit), is below
        # SHARE of the tolerance, but not more often than this. Across a kink there is no such order, and what an
        # element is off by depends on where in it the kink is: one change may be small by chance, hardly two.
        for _ in range(3):
            if not rows.size:
                break
            part = part.halved(np.searchsorted(taken, rows), self.halving)
            taken = rows
            every = np.arange(len(rows))
            status, _ = self._solve(part, every, self.epsilon)
            better = np.array([one.ok for one in status])
            y = part.z[every, part.middles, nx:]
            change = np.linalg.norm(y - solution[rows], axis=1)
            solution[rows[better]] = y[better]
            problem.response[rows[better]], problem.moved[rows[better]] = (
                part.response[better],
                part.moved[better],
            )
            across = np.maximum(change, before[rows])
            left = np.where(self._is_kinked(part), across, change / 2.0**STAGES)
            before[rows] = change
            error[rows] = np.where(better, left, np.minimum(error[rows], change))
            rows = rows[better & (error[rows] > SHARE * self.tolerance * (1.0 + np.linalg.norm(y, axis=1)))]
        return error

    def _is_kinked(self, problem: SegmentProblem) -> np.ndarray:
        """Which segments (k,) cross a surface on which the field is not smooth."""
        if self.surfaces is None:
            return np.zeros(len(problem.x), dtype=bool)
        z = problem.z
        used = (np.arange(z.shape[1]) <= problem.counts[:, None])[:, :, None]
        p = parameter_vector(self.system, self.epsilon)
        values = self.surfaces(z.reshape(-1, z.shape[2]), p).reshape(*z.shape[:2], -1)
        both = ((values > 0.0) & used).any(axis=1) & ((values < 0.0) & used).any(axis=1)
        return both.any(axis=1)

    def _stages(self, lengths: np.ndarray, z: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Cubic Hermite guesses (k, m, s, n) inside the elements."""
        c = SCHEME.c[:, None]
        start, end = z[:, :-1, None, :], z[:, 1:, None, :]
        h = lengths[:, :, None, None]
        return np.ascontiguousarray(
            start * (1 + 2 * c) * (1 - c) ** 2
            + end * c**2 * (3 - 2 * c)
            + h * (rates[:, :-1, None, :] * c * (1 - c) ** 2 + rates[:, 1:, None, :] * c**2 * (c - 1))
        )

    def _basis(self, z: np.ndarray, *, stable: bool) -> np.ndarray:
        """Rows (k, n_fast, n_fast), of which the first span the left eigenvectors to be fixed."""
        fast = len(self.system.y)
        count = fast - self.unstable if stable else self.unstable
        if count in (0, fast):
            return np.broadcast_to(np.eye(fast), (len(z), fast, fast)).copy()
        values, vectors = np.linalg.eig(self.fast_jacobian(z).transpose(0, 2, 1))
        needed = np.real(values) < 0 if stable else np.real(values) > 0
        spanning = np.where(needed[:, None, :], vectors, 0.0)
        return (
            np.linalg.svd(np.concatenate([np.real(spanning), np.imag(spanning)], axis=2))[0]
            .transpose(0, 2, 1)
            .copy()
        )

    def fast_jacobian(self, z: np.ndarray) -> np.ndarray:
        """g_y (k, n_fast, n_fast) at points z (k, n)."""
        nx = len(self.system.x)
        J = self.flow.jacobians(z, parameter_vector(self.system, self.epsilon))
        return self.epsilon * J[:, nx:, nx:]

    # -- Newton's method ---------------------------------------------------------------------------

    def _newton(self, problem: SegmentProblem) -> tuple[list[Status], np.ndarray, np.ndarray]:
        every = np.arange(len(problem.x))
        guess = problem.z.copy(), problem.stages.copy()
        self._refine_guess(problem, every, self.epsilon)
        status, iterations = self._solve(problem, every, self.epsilon)
        good = np.array([one.ok for one in status], dtype=bool)
        reached = np.where(good, self.epsilon, 0.0)
        failed = np.flatnonzero(~good)
        if failed.size:
            problem.z[failed], problem.stages[failed] = guess[0][failed], guess[1][failed]
            self._refine_guess(problem, failed, LADDER[0] * self.epsilon)
        for fraction in LADDER:
            if not failed.size:
                break
            value = fraction * self.epsilon
            new, more = self._solve(problem, failed, value)
            iterations[failed] += more
            for row, one in zip(failed, new):
                status[row] = one
            failed = failed[[one.ok for one in new]]
            reached[failed] = value
        return status, reached, iterations

    def _refine_guess(self, problem: SegmentProblem, rows: np.ndarray, epsilon: float) -> None:
        """Fast variables of the guess by the zero-derivative principle, wherever it converges.

        At the ends of the elements that are used; the stages are corrected by what is linear between them.
        """
        nx = len(self.system.x)
        z = problem.z[rows]
        used = np.arange(z.shape[1]) <= problem.counts[rows, None]
        change = np.zeros((*z.shape[:2], z.shape[2] - nx))
        change[used] = self._improved(z[used], epsilon) - z[used][:, nx:]
        c = SCHEME.c[:, None]
        problem.z[rows, :, nx:] += change
        problem.stages[rows, :, :, nx:] += (1 - c) * change[:, :-1, None] + c * change[:, 1:, None]

    def _improved(self, z: np.ndarray, epsilon: float) -> np.ndarray:
        nx = len(self.system.x)
        if self.tape is None:
            return z[:, nx:]
        y, _, error, codes, _ = climb(
            self.tape, self.branch, z[:, :nx], z[:, nx:], epsilon, order=None, tolerance=SHARE * self.tolerance
        )
        # Newton's method may find another sheet: kept only when the way there is not longer than what is corrected.
        good = (codes == CONVERGED) & (error <= np.linalg.norm(y - z[:, nx:], axis=1) + 1e-9)
        return np.where(good[:, None], y, z[:, nx:])

    def _solve(
        self, problem: SegmentProblem, rows: np.ndarray, epsilon: float
    ) -> tuple[list[Status], np.ndarray]:
        """Newton's method on some segments, and again when the ends have moved from where they were fixed."""
        fast, k = len(self.system.y), len(rows)
        p = parameter_vector(self.system, epsilon)
        status, total = [Status.SUCCESS] * k, np.zeros(k, dtype=np.int64)
        z, stages = problem.z[rows], problem.stages[rows]
        response = np.zeros((k, fast, fast))
        counts = problem.counts[rows]
        bases = [basis[rows] for basis in problem.bases]
        index = np.arange(k)

        def fixed() -> list[np.ndarray]:
            values = []
            for basis, place in zip(bases, (np.zeros(k, dtype=np.int64), counts)):
                y = self._improved(z[index, place], epsilon)
                values.append(np.einsum("kij,kj->ki", basis, y))
            return values

        values, felt = fixed(), np.zeros(k)
        for _ in range(2):
            for q in range(k):
                held = Held(
                    problem.x[rows[q]], int(problem.middles[rows[q]]), bases[0][q, : fast - self.unstable],
                    values[0][q], bases[1][q, : self.unstable], values[1][q],
                )  # fmt: skip
                m = int(counts[q])
                status[q], steps = self._segment(
                    p, problem.lengths[rows[q], :m], held, z[q, : m + 1], stages[q, :m], response[q]
                )
                total[q] += steps
            old, values = values, fixed()
            moved = np.stack([np.linalg.norm(a - b, axis=1) for a, b in zip(values, old)], axis=1)
            felt = np.linalg.norm(response, axis=(1, 2)) * moved.sum(axis=1)
            if not (felt[[one.ok for one in status]] > SHARE * self.tolerance).any():
                break
        problem.moved[rows] = moved
        problem.z[rows], problem.stages[rows], problem.response[rows] = z, stages, response
        return status, total

    def _segment(
        self,
        p: np.ndarray,
        lengths: np.ndarray,
        held: Held,
        z: np.ndarray,
        stages: np.ndarray,
        response: np.ndarray,
    ) -> tuple[Status, int]:
        """Newton's method on one segment, in place; the status and the number of steps.

        `response` (n_fast, n_fast) becomes the derivative of the fast variables at the middle by the ends' values.
        """
        nx, ends = len(self.system.x), len(self.system.y)
        # The values at the ends are the first conditions, in turn.
        tangents = np.eye(nx + ends)[:, :ends]

        def step_of(point: Point) -> list[OrbitChange]:
            linear = linearise(self.equations, SCHEME, p, 1.0, lengths, *point)
            return linear.solve(held.conditions(point[0]), tangents=tangents)

        def moved(point: Point, steps: list[OrbitChange], share: float) -> Point:
            for i in range(ends):
                response[:, i] = steps[1 + i].states[held.middle, nx:]
            return point[0] + share * steps[0].states, point[1] + share * steps[0].stages

        found = newton((z, stages), step_of, length=step_length, moved=moved, rules=RULES)
        z[:], stages[:] = found.point
        return found.status, found.iterations


def _replace(result: Segments, rows: np.ndarray, new: Segments) -> None:
    """Put `new` for some rows of `result`, where it is better."""
    places = np.flatnonzero(rows)
    better = (new.error < result.error[places]) | ~np.isfinite(result.error[places])
    for name in ("y", "selection", "discretisation", "is_cut_short", "ends", "decayed", "reached"):
        getattr(result, name)[places[better]] = getattr(new, name)[better]
    for place, status in zip(places[better], np.array(new.status, dtype=object)[better]):
        result.status[place] = status
