"""A step of the error of a reduction: it holds the solution of its equations, and begins with what is so."""

from fractions import Fraction

import flint
import numpy as np
import pytest
import sympy as sp
from flint import arb
from scipy.integrate import solve_ivp
from sympy import Rational as R

from gsp.proofs import balls
from gsp.slow_tubes.deviation import Deviation, DeviationFlow, Span, _widened, deviation
from gsp.slow_tubes.invariance import Invariance
from gsp.slow_tubes.reduction_error import bound_reduction
from tests.slow_tubes.test_slow_tube import s, series, x, y

SMALL = 0.0625


def exactly(ball: arb) -> Fraction:
    """The middle of a ball."""
    mantissa, exponent = ball.mid().man_exp()
    return Fraction(int(mantissa)) * Fraction(2) ** int(exponent)


def ends(ball: arb) -> tuple[Fraction, Fraction]:
    return exactly(ball.lower()), exactly(ball.upper())


def test_the_middle_of_a_step_holds_the_solution_there(monkeypatch: pytest.MonkeyPatch) -> None:
    # x' = 1, so that the reduced solution at a time is that time, and a rounding of the middle is seen.
    step, seen = DeviationFlow.step, []

    def watched(self, state: Deviation, span: Span):
        seen.append(span)
        return step(self, state, span)

    monkeypatch.setattr(DeviationFlow, "step", watched)
    manifold = series({x: sp.Integer(1)}, {y: -y + x}, 1)
    bound = bound_reduction(manifold, start={"x": 0.0}, span=(0.0, 0.7), epsilon=SMALL, steps=30)
    times = [Fraction(t) for t in bound.times]
    assert len(seen) == len(times) - 1 > 30
    rounded = 0
    for first, last, span in zip(times, times[1:], seen):
        middle = (first + last) / 2
        low, high = ends(span.middle[0])
        assert low <= middle <= high
        assert high - low < Fraction(1, 10**15)
        assert exactly(span.length) == last - first
        (over,), (rate,) = span.s, span.rates
        assert ends(over)[0] <= first <= last <= ends(over)[1]
        assert ends(rate)[0] <= 1 <= ends(rate)[1]
        rounded += Fraction(float(middle)) != middle
    assert rounded > 5


def test_a_deviation_holds_the_balls_that_it_is_made_of() -> None:
    with flint.ctx.workprec(balls.PRECISION):
        offset, away = [balls.hull(0.0, 1.0), balls.hull(-3.0, -2.0)], [balls.hull(4.0, 8.0)]
        found = deviation(offset, away)
        for held, ball in zip([*found.slow_box(), *found.fast_box()], [*offset, *away]):
            assert held.contains(ball)
        # 1/2 and 1/2 at right angles, and the half-width 2.
        assert float(found.radius.upper()) == pytest.approx(np.sqrt(0.5), rel=1e-6)
        assert float(found.spread.upper()) == pytest.approx(2.0, rel=1e-6)


def test_a_widened_ball_holds_the_ball_inside() -> None:
    with flint.ctx.workprec(balls.PRECISION):
        for ball in (arb(0), arb(5), balls.hull(-1.0, 3.0), balls.hull(1e6, 2e6)):
            assert _widened(ball).contains_interior(ball)
        assert float(_widened(balls.hull(-1.0, 1.0)).abs_upper()) == pytest.approx(1.2, rel=1e-6)


SYSTEMS = {
    "one": ({x: -x + y / 4}, {y: -(1 + x**2) * y + x}, ["x"], ["y"]),
    "turning": ({s: -s + x * y / 4}, {x: -x - 8 * y + s, y: x - y}, ["s"], ["x", "y"]),
}


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("length", [0.001, 0.02])
def test_a_step_holds_every_solution_that_begins_in_it(name: str, length: float) -> None:
    slow, fast, _, _ = SYSTEMS[name]
    manifold = series(slow, fast, 1)
    system = manifold.branch.system
    m, unit = len(system.y), SMALL**2
    rates = [e.subs(system.epsilon, R(SMALL)) for e in (*system.f, *(g / SMALL for g in system.g))]
    full = sp.lambdify([*system.x, *system.y], rates)
    reduced = sp.lambdify([*system.x], [sum(row[0] * SMALL**k for k, row in enumerate(manifold.reduced_field))])
    graph = sp.lambdify(
        [*system.x], [sum(row[i] * SMALL**k for k, row in enumerate(manifold.coefficients)) for i in range(m)]
    )
    tight = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-15}
    begin = 0.75
    with flint.ctx.workprec(balls.PRECISION):
        invariance = Invariance(manifold, values={})
        flow = DeviationFlow(invariance, arb(SMALL))
        solution = solve_ivp(lambda t, z: reduced(*z), (0.0, length), [begin], dense_output=True, **tight).sol
        low, high = float(solution(length)[0]) - 1e-12, begin + 1e-12
        slopes = [reduced(low)[0], reduced(high)[0]]
        half = float(solution(0.5 * length)[0])
        span = Span(
            arb(length),
            [balls.hull(half - 1e-12, half + 1e-12)],
            [balls.hull(low, high)],
            [balls.hull(min(slopes) - 1e-3, max(slopes) + 1e-3)],
        )
        offset, away = [balls.hull(-0.5, 1.5)], [balls.hull(0.5, 1.0)] * m
        moved = flow.step(deviation(offset, away), span)
        assert moved is not None
        after, worst = moved
        boxes = after.slow_box(), after.fast_box()
        draw, sharp = np.random.default_rng(3), 0.0
        for _ in range(12):
            u, z = draw.choice([-0.5, 0.5, 1.5]), draw.uniform(0.5, 1.0, m)
            at = begin + unit * u
            start = [at, *(np.array(graph(at)) + unit * z)]
            run = solve_ivp(
                lambda t, z: full(*z), (0.0, length), start, t_eval=np.linspace(0, length, 21), **tight
            )
            assert np.abs(run.y[0] - solution(run.t)[0]).max() / unit <= float(worst.upper()) + 1e-6
            last = run.y[:, -1]
            reached = (last[0] - solution(length)[0]) / unit, (last[1:] - graph(last[0])) / unit
            for box, value in zip(boxes, (np.array([reached[0]]), reached[1])):
                for ball, number in zip(box, value):
                    assert balls.below(ball) - 1e-6 <= number <= balls.above(ball) + 1e-6
            sharp = max(sharp, abs(reached[0]))
        # No more is said than there is: the slow box is hardly wider than it began.
        assert float(worst.upper()) <= 1.1 * (1.5 + length)
        assert sharp > 0.8 * balls.magnitude(boxes[0][0])
        assert balls.magnitude(boxes[1][0]) < 3.0
        if m == 1:
            # What shrinks does so by exp(-length/epsilon) at most, its rate being at least 1.
            assert float(after.spread.upper()) <= 0.25 * np.exp(-length / SMALL) + 0.1 * length / SMALL


def test_a_step_over_which_nothing_attracts_is_none() -> None:
    manifold = series({x: sp.Integer(1)}, {y: (x - R(1, 2)) * y + x}, 1)
    with flint.ctx.workprec(balls.PRECISION):
        flow = DeviationFlow(Invariance(manifold, values={}), arb(SMALL))
        for at, holds in ((0.0, True), (0.4375, True), (0.75, False)):
            span = Span(arb(2.0**-10), [arb(at)], [balls.hull(at - 1e-3, at + 1e-3)], [arb(1)])
            assert (flow.step(deviation([arb(0)], [arb(0)]), span) is not None) is holds
