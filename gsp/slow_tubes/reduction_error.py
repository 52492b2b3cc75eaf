"""The error of a reduction, proved: |full - reduced| over a span of time, the initial layer included.

The reduced solution s is enclosed by `validated_flow`; `deviation` carries the full one's distance from it from step
to step, and here the steps are laid out and what they reach is reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import sympy as sp
from flint import arb, arb_mat

from gsp.algebra.precision import precision
from gsp.errors import DeclarationError
from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction
from gsp.proofs.equations import without_decimals
from gsp.proofs.verdict import ProofVerdict
from gsp.results.bounds import at_least, at_most
from gsp.results.card import Card
from gsp.slow.series import SeriesManifold
from gsp.slow_tubes.adapted_basis import AdaptedBasis, adapted_bases, fast_jacobian
from gsp.slow_tubes.deviation import Deviation, DeviationFlow, Span, deviation
from gsp.slow_tubes.invariance import Invariance, NotInvariantError
from gsp.slow_tubes.isolation import norm
from gsp.slow_tubes.validated_flow import solution_steps
from gsp.systems.arguments import check_noun, check_whole
from gsp.systems.flow import check_epsilon, values_by_name
from gsp.systems.region import check_interval

# In the layer a step turns or shrinks z by this, while z is as large as at the start.
GRADED = 0.05


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
        return f"ReductionBound({self.verdict.name}, {at_most(self.bound)})"

    def __str__(self) -> str:
        if not len(self.times):
            return f"{self.verdict.value}\n  {self.reason}"
        return (
            f"{self.verdict.value} for t in [0, {at_least(self.times[-1])}]\n  {self.reason}\n"
            f"  |full - reduced| <= {at_most(self.bound)} in the slow variables, <= {at_most(self.slow[-1])} at the end"
        )


def bound_reduction(
    series: SeriesManifold,
    *,
    start: Mapping[str, float],
    span: tuple[float, float],
    epsilon: float,
    reduced_start: Mapping[str, float] | None = None,
    steps: int = 200,
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
            "the error is bounded about an explicit series.",
            "Solve for the fast variables.",
            got=f"the implicit branch {branch}",
            value=branch,
        )
    # A million steps take hours.
    steps = check_whole(steps, what="steps", least=1, most=1_000_000)
    small = check_epsilon(epsilon)
    first, last = check_interval(span, what="span", remedy="Give (t0, t1) with t0 < t1.")
    slow, fast = [s.name for s in system.x], [s.name for s in system.y]
    full = values_by_name(start, what="start")
    reduced = values_by_name(reduced_start, what="reduced_start") if reduced_start is not None else full
    for what, given in (("start", full), ("reduced_start", reduced)):
        missing = [name for name in slow if name not in given]
        if missing:
            raise DeclarationError(f"{what} gives no value for {', '.join(missing)}.", got=dict(given))
    if any(name in full for name in fast) and not all(name in full for name in fast):
        raise DeclarationError(
            "start names some fast variables and not others.",
            f"Name all of {', '.join(fast)}, or none.",
            got=dict(full),
        )
    with precision(balls.PRECISION):
        x = [balls.exact(float(full[name])) for name in slow]
        s = [balls.exact(float(reduced[name])) for name in slow]
        y = [balls.exact(float(full[name])) for name in fast] if fast[0] in full else None
        try:
            return _Run(series, small, x).along(x, y, s, last - first, steps)
        except NotInvariantError as error:
            verdict, reason = error.verdict_at(system.epsilon, [x, s])
            empty = np.empty(0)
            return ReductionBound(verdict, reason, small, empty, empty, empty, math.nan)


class _Run:
    def __init__(self, series: SeriesManifold, epsilon: float, near: list[arb]) -> None:
        system = series.branch.system
        values = {p: without_decimals(v) for p, v in system.parameters.items()}
        self.basis = _attracting(series, values, near)
        self.invariance = Invariance(series, values=values, basis=self.basis.matrix)
        # The decimal that is printed.
        small = Fraction(repr(epsilon))
        self.epsilon = balls.exact(small)
        self.flow = DeviationFlow(self.invariance, self.epsilon)
        at = {system.epsilon: sp.Rational(small)}
        self.field = [e.xreplace(at) for e in self.invariance.reduced_field]
        self.rates = BallFunction(self.invariance.x, self.field)

    def along(self, x: list[arb], y: list[arb] | None, s: list[arb], end: float, steps: int) -> ReductionBound:
        """The bound from the full start (x, y) and the reduced one, over a time `end`."""
        offset = [(a - b) / self.flow.unit for a, b in zip(x, s)]
        state = deviation(offset, self._away(x, y))
        rows = [(0.0, *self._sizes(state, x))]
        worst = arb(rows[0][1])
        longest, t, pace = end / steps, 0.0, self._pace(state, s)
        for step in solution_steps(self.field, self.invariance.x, s, end):
            while t < step.end:
                length = min(longest, pace(t))
                after = min(step.end, t + length)
                # A ball: in doubles the middle would be rounded, and the solution there another one.
                middle, s_over = (arb(t) + arb(after)) / 2, step.over(t, after)
                moved = self.flow.step(
                    state,
                    Span(arb(after) - arb(t), step.over(middle, middle), s_over, self.rates(s_over)),
                )
                if moved is None:
                    return self._result(rows, worst, end, "the logarithmic norm gives no bound from here on")
                state, reached = moved
                t = after
                worst = worst.max(reached * self.flow.unit)
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

    def _away(self, x: list[arb], y: list[arb] | None) -> list[arb]:
        """z at the start."""
        m = self.invariance.m
        if y is None:
            return [arb(0)] * m
        graph = self.invariance.graph([*x, self.epsilon])
        away = arb_mat(m, 1, [(a - b) / self.flow.unit for a, b in zip(y, graph)])
        turning = arb_mat(m, m, self.invariance.turning([*x, self.epsilon]))
        return turning.solve(away).entries()

    def _pace(self, state: Deviation, s: list[arb]) -> Callable[[float], float]:
        """How long a step may be at a time t.

        What a step adds to the bound is its square times what is left of the layer: it may grow as the root of that
        falls.
        """
        m = self.invariance.m
        B = self.invariance.normal([*s, *state.fast, self.epsilon])
        matrix = np.array([float(b.mid()) for b in B]).reshape(m, m)
        small = float(self.epsilon.mid())
        if not np.isfinite(matrix).all():
            return lambda t: GRADED * small
        values = np.linalg.eigvals(matrix)
        unit, decay = small / float(np.abs(values).max()), -float(np.real(values).max()) / small

        def longest(t: float) -> float:
            # A step is at least a share of the time since the start.
            return max(GRADED * unit * math.exp(min(0.5 * decay * t, 700.0)), 0.0125 * (t + unit))

        return longest

    def _sizes(self, state: Deviation, s: list[arb]) -> tuple[float, float]:
        """Bounds of |x - s| and |y - h_n(x)|."""
        m, unit = self.invariance.m, self.flow.unit
        slow = (norm(state.centre) + state.radius) * unit
        x = [a + u * unit for a, u in zip(s, state.slow_box())]
        turning = arb_mat(m, m, self.invariance.turning([*x, self.epsilon]))
        y = turning * arb_mat(m, 1, state.fast_box())
        return balls.magnitude(slow), balls.magnitude(norm(y.entries()) * unit)


def _attracting(series: SeriesManifold, values: dict[sp.Symbol, sp.Expr], near: list[arb]) -> AdaptedBasis:
    """A constant basis; `DeclarationError` where the branch does not attract at the start."""
    x = series.branch.system.x
    point = {s: sp.Rational(float(v.mid())) for s, v in zip(x, near)}
    for basis in adapted_bases(fast_jacobian(series.branch, values).xreplace(point), x, [point]):
        if 1 not in basis.signs:
            return basis
    raise DeclarationError(
        "the error of a reduction is bounded on an attracting branch.",
        got=(
            f"{series.branch} at {', '.join(f'{s} = {float(v):g}' for s, v in point.items())}, which does not "
            "attract. certify(series) proves a tube about one of saddle type"
        ),
    )
