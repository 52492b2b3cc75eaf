"""A step of the error of a reduction: it holds the solution of its equations, and begins with what is so."""

import itertools
from fractions import Fraction

import flint
import numpy as np
import pytest
import sympy as sp
from flint import arb, arb_mat
from scipy.integrate import quad, solve_ivp
from sympy import Rational as R

from gsp.proofs import balls
from gsp.slow_tubes.deviation import (
    Deviation,
    DeviationFlow,
    Span,
    _Coefficients,
    _FastPath,
    _Varying,
    _widened,
    deviation,
)
from gsp.slow_tubes.frame import FibreBasis
from gsp.slow_tubes.invariance import Invariance
from gsp.slow_tubes.reduction_error import bound_reduction
from tests.slow_tubes.test_slow_tube import epsilon as EPS
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
    "one": ({x: -x + y / 4}, {y: -(1 + x**2) * y + x}),
    "with epsilon": ({x: -x + y / 4 + EPS * (3 + 5 * x)}, {y: -(1 + x**2 + EPS) * y + x + 5 * EPS}),
    "turning": ({s: -s + x * y / 4}, {x: -x - 8 * y + s, y: x - y}),
}


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("length", [0.001, 0.02])
def test_a_step_holds_every_solution_that_begins_in_it(name: str, length: float) -> None:
    manifold = series(*SYSTEMS[name], 1)
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
        if name == "one":
            # What shrinks does so by exp(-length/epsilon) at most, its rate being at least 1.
            assert float(after.spread.upper()) <= 0.25 * np.exp(-length / SMALL) + 0.1 * length / SMALL


def test_what_a_deviation_is_on_the_way_holds_a_rise_that_is_over_in_a_sixth_of_the_step() -> None:
    """U' = (1/6 - 1024 t) U over (0, h), h = 1/1024: in the mean U falls, and at t = h/6 it is exp(h/72) U_0."""
    manifold = series({s: sp.Integer(1), x: (R(1, 6) - 1024 * s) * x}, {y: -y}, 1)
    with flint.ctx.workprec(balls.PRECISION):
        flow, h = DeviationFlow(Invariance(manifold, values={}), arb(SMALL)), arb(1) / 1024
        span = Span(h, [h / 2, arb(0)], [arb(0).union(h), arb(0)], [arb(1), arb(0)])
        moved = flow.step(deviation([arb(0), arb(1)], [arb(0)]), span)
        assert moved is not None
        after, worst = moved
        assert float(worst.upper()) >= np.exp(1 / 1024 / 72)
        assert after.slow_box()[1].contains((-h / 3).exp())


def test_a_step_over_which_nothing_attracts_is_none() -> None:
    manifold = series({x: sp.Integer(1)}, {y: (x - R(1, 2)) * y + x}, 1)
    with flint.ctx.workprec(balls.PRECISION):
        flow = DeviationFlow(Invariance(manifold, values={}), arb(SMALL))
        for at, holds in ((0.0, True), (0.4375, True), (0.75, False)):
            span = Span(arb(2.0**-10), [arb(at)], [balls.hull(at - 1e-3, at + 1e-3)], [arb(1)])
            assert (flow.step(deviation([arb(0)], [arb(0)]), span) is not None) is holds


# f over the graph is 1 for the first, so that all of U comes from z; the others bend A, B and C within a step.
BENT = {
    "forced": ({x: 1 + 2 * (y - sp.sin(5 * x))}, {y: -(y - sp.sin(5 * x))}, 0),
    "bent": ({x: sp.sin(3 * x) + y**2 / 2}, {y: -(2 + sp.cos(4 * x)) * y + sp.sin(3 * x)}, 0),
    "turned": ({s: sp.cos(2 * s) + x * y}, {x: -x - 8 * y + sp.sin(3 * s), y: x - (1 + s**2) * y}, 0),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", BENT)
@pytest.mark.parametrize(("u", "z"), [(0.0, 0.0), (1.0, 0.0), (-1.0, 3.0)])
def test_a_step_from_a_point_holds_the_one_solution(name: str, u: float, z: float) -> None:
    """What was left out of it would be seen: nothing is wide at the start."""
    slow, fast, order = BENT[name]
    length = 0.01
    manifold = series(slow, fast, order)
    system = manifold.branch.system
    m, unit, begin = len(system.y), SMALL ** (order + 1), 0.5
    full = sp.lambdify([*system.x, *system.y], [*system.f, *(g / SMALL for g in system.g)])
    reduced = sp.lambdify([*system.x], list(manifold.reduced_field[0]))
    graph = sp.lambdify([*system.x], list(manifold.coefficients[0]))
    tight = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-16, "dense_output": True}
    with flint.ctx.workprec(balls.PRECISION):
        flow = DeviationFlow(Invariance(manifold, values={}), arb(SMALL))
        solution = solve_ivp(lambda t, q: reduced(*q), (0.0, length), [begin], **tight).sol
        over = balls.hull(*sorted((begin, float(solution(length)[0])))) + arb(0, 1e-9)
        middle = arb(float(solution(0.5 * length)[0]), 1e-13)
        slopes = [float(reduced(v)[0]) for v in np.linspace(begin, float(solution(length)[0]), 50)]
        span = Span(arb(length), [middle], [over], [balls.hull(min(slopes), max(slopes)) + arb(0, 1e-2)])
        state = deviation([arb(u)], [arb(z)] * m)
        at = begin + unit * u
        run = solve_ivp(
            lambda t, q: full(*q), (0.0, length), [at, *(np.array(graph(at)) + unit * z)],
            t_eval=np.linspace(0.0, length, 41), **{**tight, "dense_output": False},
        )  # fmt: skip
        moved = flow.step(state, span)
        assert moved is not None
        after, bound = moved
        along = (run.y[0] - solution(run.t)[0]) / unit
        left = (run.y[1:, -1] - graph(run.y[0, -1])) / unit
        assert np.abs(along).max() <= balls.above(bound) + 1e-10
        for ball, value in zip([*after.slow_box(), *after.fast_box()], [along[-1], *left]):
            assert balls.below(ball) - 1e-10 <= value <= balls.above(ball) + 1e-10
        # Of what is 1 and 3 at the start, and moves by as much, hardly more is left open than there is.
        assert max(float(after.radius), float(after.spread)) < 0.06


@pytest.mark.parametrize(("first", "last"), [(1.0, 0.25), (0.25, 1.0)])
def test_what_shrinks_or_grows_towards_its_last_is_largest_at_one_end(first: float, last: float) -> None:
    unit = arb_mat(1, 1, [1])
    path = _FastPath([arb(0)], [arb(0)], [arb(0)], [arb(5)], arb(first), arb(last))
    (held,) = path.box(FibreBasis(unit, unit))
    assert held.contains(balls.hull(4.0, 6.0))
    assert not held.contains(6.001)


@pytest.mark.parametrize("widened", ["U", "z"])
def test_no_box_is_taken_that_does_not_hold_what_follows_inside(widened: str, monkeypatch) -> None:
    # Neither that of U nor that of z holds itself inside where it is not widened.
    calls = []

    def widen(ball: arb) -> arb:
        calls.append(1)
        return _widened(ball) if (len(calls) % 2 == 1) is (widened == "U") else ball

    monkeypatch.setattr("gsp.slow_tubes.deviation._widened", widen)
    monkeypatch.setattr("gsp.slow_tubes.deviation.WIDENINGS", 1)
    with flint.ctx.workprec(balls.PRECISION):
        flow = DeviationFlow(Invariance(series({x: -x + y}, {y: -y + x}, 1), values={}), arb(SMALL))
        span = Span(arb(2.0**-10), [arb(1)], [balls.hull(0.99, 1.01)], [balls.hull(-0.1, 0.1)])
        assert flow.step(deviation([balls.hull(-1.0, 1.0)], [balls.hull(-1.0, 1.0)]), span) is None


@pytest.mark.parametrize("rate", [-8, 8])
@pytest.mark.parametrize("wide", [0, 1])
def test_a_step_of_a_linear_system_is_its_closed_form_to_rounding(rate: int, wide: int) -> None:
    """x' = a x + 3 y, epsilon y' = -y: U = exp(a t) U_0 + 3 z_0 (exp(a t) - exp(-t/epsilon))/(a + 1/epsilon)."""
    bits, length = balls.PRECISION, 0.09375
    with flint.ctx.workprec(bits):
        flow = DeviationFlow(Invariance(series({x: rate * x + 3 * y}, {y: -y}, 0), values={}), arb(SMALL))
        still = Span(arb(length), [arb(0)], [arb(0)], [arb(0)])
        given = balls.hull(1.0 - 0.5 * wide, 1.0 + 0.5 * wide)
        moved = flow.step(deviation([given - 1], [given]), still)
        assert moved is not None
        after, bound = moved
    with flint.ctx.workprec(4 * bits):
        for u0, z0 in itertools.product((-0.5 * wide, 0.5 * wide), (1 - 0.5 * wide, 1 + 0.5 * wide)):
            for share in range(1, 33):
                t = arb(length) * share / 32
                grown, shrunk = (rate * t).exp(), (-t / SMALL).exp()
                u, z = grown * u0 + 3 * z0 * (grown - shrunk) / (rate + 1 / arb(SMALL)), shrunk * z0
                assert abs(u) <= bound
            assert after.slow_box()[0].contains(u)
            assert after.fast_box()[0].contains(z)
        if not wide:
            assert float(after.radius + after.spread) < 1e-18


def test_a_step_holds_what_a_changing_decay_and_a_changing_slope_do() -> None:
    # z = z_0 exp(-((1 + s_0) t + t^2/2)/epsilon) where x' = 1; x = x_0/(1 - x_0 t) where x' = x^2.
    bits, length, begin = balls.PRECISION, 2.0**-5, 0.5
    with flint.ctx.workprec(bits):
        flow = DeviationFlow(
            Invariance(series({x: sp.Integer(1)}, {y: -(1 + x) * y}, 0), values={}), arb(SMALL)
        )
        end = begin + length
        moved = flow.step(
            deviation([arb(0)], [arb(1)]),
            Span(arb(length), [arb((begin + end) / 2)], [balls.hull(begin, end)], [arb(1)]),
        )
        assert moved is not None
        exact = (-((1 + begin) * arb(length) + arb(length) ** 2 / 2) / SMALL).exp()
        assert moved[0].fast_box()[0].contains(exact)
        flow = DeviationFlow(Invariance(series({x: x**2}, {y: -y}, 0), values={}), arb(SMALL))

        def solution(t: float, start: arb) -> arb:
            return start / (1 - start * arb(t))

        s, small = arb(begin), arb(2) ** -40
        over = s.union(solution(length, s))
        moved = flow.step(
            deviation([small], [arb(0)]), Span(arb(length), [solution(length / 2, s)], [over], [over**2])
        )
        assert moved is not None
        exact = (solution(length, s + small * SMALL) - solution(length, s)) / SMALL
        assert moved[0].slow_box()[0].contains(exact)


def test_a_step_is_what_its_formulas_say() -> None:
    """All terms at once, each of its own size: the equations of the module in floats."""
    length, eps, a, b, c, decay = 0.5, 0.25, 0.5, -2.0, 3.0, 1.5
    q, p, away, first, last, near = 0.5, 0.75, 0.25, 0.125, 0.5, 0.0625

    def ball(middle: float, radius: float = 0.0) -> arb:
        return arb(middle, radius)

    def one(value: arb) -> arb_mat:
        return arb_mat(1, 1, [value])

    with flint.ctx.workprec(balls.PRECISION):
        frame = FibreBasis(one(arb(1)), one(arb(1)))
        flow = DeviationFlow(Invariance(series({x: -x + y}, {y: -y + x}, 1), values={}), arb(eps))
        found = _Coefficients(
            A=_Varying([ball(a, 0.125)], [ball(0.25)]),
            gamma=_Varying([ball(0.0)], [ball(0.0)]),
            push=_Varying([ball(1.0, 0.03125)], [ball(0.5, 0.0625)]),
            phi=_Varying([ball(-2.0)], [ball(0.25)]),
            B=one(ball(b)),
            C=one(ball(c, 0.0625)),
            middle=[ball(1.0)],
            frame=frame,
            decay=arb(decay),
        )
        path = _FastPath([ball(q)], [ball(p)], [ball(away, near)], [ball(0.375, 0.25)], ball(first), ball(last))
        state = Deviation([ball(1.0)], ball(0.0625), [ball(9.0)], ball(9.0), frame)
        after, bound = flow._moved(state, found, path, [ball(2.0, 60.0)], arb(length))
    # still = 1 - 2, rates = 1/2 + 1/4 + A_1 U_m with U_m = 2.
    push, change, rate = -1.0 + c * (q - 1.0), 1.25 + c * p, b / eps

    def pushed(t: float) -> float:
        return np.exp(a * (length - t)) * (c * away * np.exp(rate * t) + change * (t - length / 2) + push)

    reached = np.exp(a * length) + quad(pushed, 0.0, length)[0]
    assert float(after.centre[0]) == pytest.approx(reached, rel=1e-9)
    assert float(after.fast[0]) == pytest.approx(away * np.exp(rate * length) + q + p * length / 2, rel=1e-9)
    E = np.exp(-decay * length / eps)
    J = (1 - E) * eps / decay
    assert float(after.spread) == pytest.approx(
        E * first + (1 - E) * last + near * np.exp(rate * length), rel=1e-6
    )
    # |A - A_0| |U|, |A_1| |U - U_m| L/2, |C - C_0| |z - z_m|, and what still and rates leave.
    defects = 0.125 * 62 + 0.25 * 60 * length / 2 + 0.0625 * 0.875 + 0.03125 + 0.0625 * length / 2
    grown = np.exp(a * length)
    forced = (c + 0.0625) * (J * first + (length - J) * last) + defects * length
    # What is not known of z_0 at the start is not known of U_0 at the end.
    open_ = c * near * (grown - np.exp(rate * length)) / (a - rate)
    assert float(after.radius) == pytest.approx(0.0625 * grown + grown * forced + open_, rel=1e-6)
    most = grown * (0.0625 + forced)
    moving = a * (60 + most) + c * 0.25 + 1.25 * length / 2
    bends = abs(a * (a * 2 - c * 0.625 - 1.0) + c * p + 1.25) + a * moving + c * -b * (away + near) / eps
    assert float(bound) == pytest.approx(
        max(1.0, abs(reached) + open_) + bends * length**2 / 8 + most, rel=1e-6
    )
