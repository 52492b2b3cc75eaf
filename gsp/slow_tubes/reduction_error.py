"""The error of a reduction, proved: |full - reduced| over a span of time, the initial layer included.

s' = R(s) is the reduced flow and s(t) its solution (`validated_flow`). The full solution is written x = s +
epsilon^(n+1) U, y = h_n(x) + epsilon^(n+1) P z. Exactly, with A = D_x f, C = D_z f/epsilon^(n+1) and B = D_z Gamma at
places between the two,

    U' = A U + C z + phi(s),    epsilon z' = B z + rho(x),

where epsilon^(n+1) phi is what f has on the graph over R. Over a step of length t, by variation of constants, z goes
from z_0 to E z_0 + (1 - E) q with E = exp(B t/epsilon), q = rho/(-B) for one fast variable, with its sign; for
several |z| does, with the logarithmic norm for B. U follows a linear flow with constant coefficients, and what A and
C z + phi vary by goes into a radius. Both hold as long as U and z stay in the boxes over which A, B, C and rho were
taken, and they do if what follows lies inside these boxes.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import flint
import numpy as np
import sympy as sp
from flint import arb, arb_mat

from gsp.algebra.differentiation import jacobian
from gsp.algebra.laurent import laurent
from gsp.errors import DeclarationError
from gsp.proofs import balls
from gsp.proofs.certificate import ProofVerdict
from gsp.proofs.equations import without_decimals
from gsp.proofs.spectrum import least_eigenvalue
from gsp.results.card import Card
from gsp.slow.series import SeriesManifold
from gsp.slow_tubes.adapted_basis import AdaptedBasis, adapted_bases
from gsp.slow_tubes.invariance import Invariance, NotInvariantError
from gsp.slow_tubes.isolation import norm
from gsp.slow_tubes.validated_flow import Step, log_norm, solution_steps
from gsp.systems.arguments import check_noun, check_whole
from gsp.systems.flow import check_epsilon, named
from gsp.systems.region import check_interval

# Steps of the error over the span; the bound exceeds the error by about a hundredth for 500 over ten slow times.
STEPS = 500
# A million steps take hours.
MOST_STEPS = 1_000_000
# In the layer a step is this share of the time since the start and of epsilon.
GRADED = 0.1
# A box that does not hold what follows is widened so often, by this factor.
WIDENINGS, WIDER = 25, 1.2


@dataclass(frozen=True, eq=False, repr=False)
class ReductionBound(Card):
    """A proved bound on how far the full solution is from the reduced one.

    At `times` (k,) since the start, `slow` (k,) bounds |x - s| and `fast` (k,) |y - h_n(x)|, Euclidean. `bound` is that
    of |x - s| over all times up to the last, not only at these. PROVED: they reach the end of the span; UNDECIDED:
    they end at `times[-1]` for the `reason`; REFUTED: the series solves no invariance equation.
    """

    verdict: ProofVerdict
    reason: str
    epsilon: float
    times: np.ndarray
    slow: np.ndarray
    fast: np.ndarray
    bound: float

    def __repr__(self) -> str:
        return f"ReductionBound({self.verdict.name}, {self.bound:.6g})"

    def __str__(self) -> str:
        if not len(self.times):
            return f"{self.verdict.value}\n  {self.reason}"
        return (
            f"{self.verdict.value} for t in [0, {self.times[-1]:g}]\n  {self.reason}\n"
            f"  |full - reduced| <= {self.bound:.6g} in the slow variables, <= {self.slow[-1]:.6g} at the end"
        )


def bound_reduction(
    series: SeriesManifold,
    *,
    start: Mapping[str, float],
    span: tuple[float, float],
    epsilon: float,
    reduced_start: Mapping[str, float] | None = None,
    steps: int = STEPS,
) -> ReductionBound:
    """Prove a bound on |full - reduced| over `span` for the reduced flow of an attracting `series`.

    `start` names the slow variables of the full solution, and its fast ones, which lie on the series when none is
    named. The reduced solution starts at `reduced_start`, or at the same slow variables. `steps` of the error are taken
    and a few more in the layer. The method is the module's. Raises `DeclarationError` for a wrong start or span, an
    implicit branch or one that is not attracting, and `UnsupportedFunctionError` for rates that are not rational in
    the fast variables and epsilon.

    >>> y, x, eps = sp.symbols("y x epsilon")
    >>> system = SlowFastSystem(slow={y: -x}, fast={x: y - x}, epsilon=eps)
    >>> series = expand(solve_critical(system).branches[0], order=1)
    >>> bound_reduction(series, start={"y": 1}, span=(0, 1), epsilon=0.125).verdict.name
    'PROVED'
    """
    check_noun(series, SeriesManifold, verb="bound_reduction")
    branch, system = series.branch, series.branch.system
    if not branch.is_explicit:
        raise DeclarationError(
            f"the error is bounded about an explicit series. Got the implicit branch {branch}. "
            "Solve for the fast variables."
        )
    steps = check_whole(steps, what="steps", least=1, most=MOST_STEPS)
    small = check_epsilon(epsilon)
    first, last = check_interval(span, what="span", remedy="Give (t0, t1) with t0 < t1.")
    slow, fast = [s.name for s in system.x], [s.name for s in system.y]
    full = named(start, what="start")
    reduced = named(reduced_start, what="reduced_start") if reduced_start is not None else full
    for what, given in (("start", full), ("reduced_start", reduced)):
        missing = [name for name in slow if name not in given]
        if missing:
            raise DeclarationError(f"{what} gives no value for {', '.join(missing)}. Got {dict(given)}.")
    if any(name in full for name in fast) and not all(name in full for name in fast):
        raise DeclarationError(
            f"start names some fast variables and not others. Got {dict(full)}. Name all of {', '.join(fast)}, or none."
        )
    with flint.ctx.workprec(balls.PRECISION):
        x = [balls.exact(float(full[name])) for name in slow]
        s = [balls.exact(float(reduced[name])) for name in slow]
        y = [balls.exact(float(full[name])) for name in fast] if fast[0] in full else None
        try:
            return _Run(series, small, x).along(x, y, s, last - first, steps)
        except NotInvariantError as error:
            left = f"a term in {system.epsilon}^{error.order} is left over"
            reason = f"the series does not solve the invariance equation: {left}"
            empty = np.empty(0)
            return ReductionBound(ProofVerdict.REFUTED, reason, small, empty, empty, empty, math.nan)


@dataclass(eq=False)
class _State:
    """U within `radius` of `centre`; z a ball with its sign for one fast variable, else a symmetric one about |z|."""

    centre: list[arb]
    radius: arb
    z: arb


@dataclass(eq=False)
class _Coefficients:
    """A, C z + phi and what z tends to, over a step."""

    A: list[list[arb]]
    C: list[list[arb]]
    phi: list[arb]
    B: arb
    target: arb


class _Run:
    def __init__(self, series: SeriesManifold, epsilon: float, near: list[arb]) -> None:
        system = series.branch.system
        values = {p: without_decimals(v) for p, v in system.parameters.items()}
        self.basis = _attracting(series, values, near)
        self.invariance = Invariance(series, values=values, basis=self.basis.matrix)
        self.n, self.m = self.invariance.slow, self.invariance.m
        self.epsilon = arb(epsilon)
        self.unit = balls.power(self.epsilon, series.order + 1)
        at = {system.epsilon: sp.Rational(epsilon)}
        self.field = [e.xreplace(at) for e in self.invariance.reduced_field]

    def along(self, x: list[arb], y: list[arb] | None, s: list[arb], end: float, steps: int) -> ReductionBound:
        """The bound from the full start (x, y) and the reduced one, over a time `end`."""
        offset = [(a - b) / self.unit for a, b in zip(x, s)]
        centre = [arb(o.mid()) for o in offset]
        state = _State(centre, norm([o - c for o, c in zip(offset, centre)]), self._start(x, y))
        rows = [(0.0, *self._sizes(state, x))]
        worst = arb(rows[0][1])
        longest, t = end / steps, 0.0
        for step in solution_steps(self.field, self.invariance.x, s, end):
            while t < step.end:
                length = min(longest, GRADED * (t + float(self.epsilon.mid())))
                after = min(step.end, t + length)
                moved = self._advanced(state, step, t, after)
                if moved is None:
                    return self._result(rows, worst, end, "the logarithmic norm gives no bound from here on")
                state, reached = moved
                t = after
                worst = worst.max(reached)
                rows.append((t, *self._sizes(state, step.over(t, t))))
        return self._result(rows, worst, end, "the reduced solution could not be enclosed from here on")

    def _result(self, rows: list[tuple], worst: arb, end: float, reason: str) -> ReductionBound:
        times, slow, fast = np.array(rows).T
        bound = balls.magnitude(worst)
        proved = times[-1] == end and bool(np.isfinite([bound, *slow, *fast]).all())
        return ReductionBound(
            ProofVerdict.PROVED if proved else ProofVerdict.UNDECIDED,
            "the logarithmic norm carries the bound to the end" if proved else reason,
            float(self.epsilon.mid()),
            times,
            slow,
            fast,
            bound,
        )

    def _start(self, x: list[arb], y: list[arb] | None) -> arb:
        if y is None:
            return arb(0)
        graph = self.invariance.graph([*x, self.epsilon])
        away = arb_mat(self.m, 1, [(a - b) / self.unit for a, b in zip(y, graph)])
        turning = arb_mat(self.m, self.m, self.invariance.turning([*x, self.epsilon]))
        z = turning.solve(away)
        if self.m == 1:
            return z[0, 0]
        size = norm([z[i, 0] for i in range(self.m)]).upper()
        return size.union(-size)

    def _sizes(self, state: _State, s: list[arb]) -> tuple[float, float]:
        """Bounds of |x - s| and |y - h_n(x)|."""
        slow = (norm(state.centre) + state.radius) * self.unit
        ball = balls.hull(-1.0, 1.0) * state.radius
        x = [a + (c + ball) * self.unit for a, c in zip(s, state.centre)]
        turning = norm(self.invariance.turning([*x, self.epsilon]))
        return balls.magnitude(slow), balls.magnitude(turning * state.z * self.unit)

    def _advanced(self, state: _State, step: Step, t: float, after: float) -> tuple[_State, arb] | None:
        """The state at the time `after`, and a bound of |x - s| on the way."""
        s = step.over(t, after)
        length = arb(after) - arb(t)
        span = arb(0).union(length)
        unit_ball = balls.hull(-1.0, 1.0)
        u = [c + unit_ball * state.radius for c in state.centre]
        box_u, box_z = u, state.z.union(arb(0))
        for _ in range(WIDENINGS):
            wide_u = [_widened(b) for b in box_u]
            wide_z = _widened(box_z)
            found = self._coefficients(s, wide_u, wide_z)
            if found is None:
                return None
            z = state.z.union(found.target)
            force = self._force(found, z)
            image = [a + span * (_dot(row, wide_u) + b) for a, row, b in zip(u, found.A, force)]
            if all(w.contains_interior(i) for w, i in zip(wide_u, image)) and wide_z.contains_interior(z):
                return self._moved(state, found, z, image, length)
            if not all(i.is_finite() for i in [*image, z]):
                return None
            box_u = [b.union(i) for b, i in zip(box_u, image)]
            box_z = box_z.union(z)
        return None

    def _coefficients(self, s: list[arb], u: list[arb], z: arb) -> _Coefficients | None:
        """Over every place between s and s + epsilon^(n+1) u; None where the fast directions do not attract."""
        n, m, inv = self.n, self.m, self.invariance
        x = [a + (b * self.unit) for a, b in zip(s, u)]
        between = [a.union(b) for a, b in zip(s, x)]
        tube = [z.union(arb(0))] * m
        rho = inv.residual([*x, self.epsilon])
        B = inv.normal([*x, *tube, self.epsilon])
        slopes = inv.rate_slopes([*between, *tube, self.epsilon])
        forcing = inv.forcing([*between, *tube, self.epsilon])
        if m == 1:
            decay = B[0]
            if not decay < 0:
                return None
            target = balls.quotient(rho[0], -decay)
        else:
            form = [[-(B[i * m + j] + B[j * m + i]) / 2 for j in range(m)] for i in range(m)]
            least = least_eigenvalue(form)
            if not least > 0.0:
                return None
            decay = arb(-least)
            size = (norm(rho) / arb(least)).upper()
            target = size.union(-size)
        A = [[slopes[i * n + k] for k in range(n)] for i in range(n)]
        C = [[forcing[i * m + j] for j in range(m)] for i in range(n)]
        found = _Coefficients(A, C, inv.mismatch([*s, self.epsilon]), decay, target)
        everything = [*itertools.chain(*A), *itertools.chain(*C), *found.phi, decay, target]
        return found if all(e.is_finite() for e in everything) else None

    def _force(self, found: _Coefficients, z: arb) -> list[arb]:
        """C z + phi."""
        if self.m == 1:
            return [row[0] * z + p for row, p in zip(found.C, found.phi)]
        ball = balls.hull(-1.0, 1.0)
        return [p + ball * (norm(row) * z.abs_upper()) for row, p in zip(found.C, found.phi)]

    def _moved(
        self, state: _State, found: _Coefficients, z: arb, u: list[arb], length: arb
    ) -> tuple[_State, arb]:
        # E = exp(B t/epsilon) and its integral J rise with B, so that their ends are those of B's.
        left = balls.exp(found.B * length / self.epsilon)
        passed = balls.rising(lambda b: (1 - (b * length / self.epsilon).exp()) * self.epsilon / -b, found.B)
        after = left * state.z + (1 - left) * found.target
        after = after.intersection(z) if after.overlaps(z) else after
        # int z: the weights E and 1 - E are positive, so that mean values of the target serve.
        integral = state.z * passed + found.target * (length - passed)
        whole = z * length
        integral = integral.intersection(whole) if integral.overlaps(whole) else integral
        force = self._force(found, z)
        if self.m == 1 and (z > 0 or z < 0):
            total = [row[0] * integral + p * length for row, p in zip(found.C, found.phi)]
        elif self.m > 1:
            total = self._force(found, integral / length)
            total = [b * length for b in total]
        else:
            total = [b * length for b in force]
        n = self.n
        middle = [[arb(e.mid()) for e in row] for row in found.A]
        mean = [arb((b / length).mid()) for b in total]
        # D' = A D + b with both constant, by the exponential of a matrix with one more row.
        rows = [*[[e * length for e in row] + [b * length] for row, b in zip(middle, mean)], [arb(0)] * (n + 1)]
        ahead = arb_mat(n + 1, n + 1, [e for row in rows for e in row]).exp() * arb_mat(
            n + 1, 1, [*state.centre, arb(1)]
        )
        reached = [ahead[i, 0] for i in range(n)]
        centre = [arb(b.mid()) for b in reached]
        size_a = norm([e for row in found.A for e in row])
        change = norm([a - b for row, other in zip(found.A, middle) for a, b in zip(row, other)])
        grown = (log_norm(found.A) * length).exp().max(arb(1))
        # |int Psi (b - mean)| <= |int (b - mean)| + sup |Psi - 1| int |b - mean|.
        offset = norm([b - m * length for b, m in zip(total, mean)])
        stir = norm([b - m for b, m in zip(force, mean)]) * length
        turned = size_a * length * (size_a * length).exp()
        error = (
            state.radius * (log_norm(found.A) * length).exp()
            + grown * length * change * self._reach(state, middle, mean, length)
            + offset
            + turned * stir
            + norm([a - b for a, b in zip(reached, centre)])
        )
        return _State(centre, error.upper(), after), norm(u) * self.unit

    def _reach(self, state: _State, A: list[list[arb]], b: list[arb], length: arb) -> arb:
        """A bound of |D| over the step."""
        size = norm([e for row in A for e in row])
        start = norm(state.centre)
        return start + length * (size * start + norm(b)) * (size * length).exp()


def _attracting(series: SeriesManifold, values: dict[sp.Symbol, sp.Expr], near: list[arb]) -> AdaptedBasis:
    """A constant basis; `DeclarationError` where the branch does not attract at the start."""
    system, graph = series.branch.system, series.branch.graph
    assert graph is not None
    at = {y: sp.sympify(e, strict=True).xreplace(values) for y, e in graph.items()}
    g = [laurent(e, system.epsilon, order=0).get(0, sp.Integer(0)).xreplace(values) for e in system.g]
    point = {x: sp.Rational(float(v.mid())) for x, v in zip(system.x, near)}
    matrix = jacobian(g, system.y).xreplace(at).xreplace(point)
    for basis in adapted_bases(matrix, system.x, [point]):
        if 1 not in basis.signs:
            return basis
    raise DeclarationError(
        f"the error of a reduction is bounded on an attracting branch. Got {series.branch} at "
        f"{', '.join(f'{x} = {float(v):g}' for x, v in point.items())}, which does not attract. "
        "certify(series) proves a tube about one of saddle type."
    )


def _dot(row: list[arb], vector: list[arb]) -> arb:
    total = arb(0)
    for a, b in zip(row, vector):
        total = total + a * b
    return total


def _widened(ball: arb) -> arb:
    spread = arb(ball.rad()) * (WIDER - 1.0) + (1 + ball.abs_upper()) * arb(1e-12)
    return ball + balls.hull(-1.0, 1.0) * spread
