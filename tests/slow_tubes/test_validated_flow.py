"""Solutions enclosed step by step hold the exact ones of every start in the ball."""

import pytest
import sympy as sp
from flint import arb

from gsp.algebra.precision import precision
from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction
from gsp.slow_tubes.validated_flow import _box, _horner, log_norm, solution_steps

x = sp.Symbol("x")


@pytest.mark.parametrize(
    ("rows", "bound"),
    [
        ([[-1, 0], [0, 3]], 3),
        ([[3, 0], [0, -1]], 3),
        ([[0, 1], [-1, 0]], 0),
        ([[0, 1], [1, 0]], 1),
        ([[-4, 3], [1, -4]], -2),
    ],
)
def test_a_logarithmic_norm_is_that_of_the_symmetric_part(rows: list[list[int]], bound: int) -> None:
    with precision(balls.PRECISION):
        assert bound <= balls.above(log_norm([[arb(v) for v in row] for row in rows])) <= bound + 1e-9


@pytest.mark.parametrize(("rate", "rest"), [(-2, 1e-17), (1, 1e-17), (1, 1e-4)])
def test_every_start_in_the_ball_is_held_at_all_times(
    rate: int, rest: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gsp.slow_tubes.validated_flow.REST", rest)
    with precision(balls.PRECISION):
        steps = list(solution_steps([rate * x], [x], [arb(1, 0.125)], 1.0))
        assert (steps[0].start, steps[-1].end) == (0.0, 1.0)
        for step in steps:
            for t in (step.start, 0.5 * (step.start + step.end), step.end):
                (found,) = step.over(t, t)
                for start in (0.875, 1.0, 1.125):
                    # Ends of the ball are ends of what is held, which two roundings may part.
                    assert (found + arb(0, 1e-17)).contains((rate * arb(t)).exp() * start)
        assert float(steps[-1].over(1.0, 1.0)[0].rad()) < 0.5


def test_the_rest_of_a_step_is_taken_over_the_whole_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    # x' = x^2, so that x = 1/(2 - t), in steps so long that what the polynomial leaves out is seen.
    monkeypatch.setattr("gsp.slow_tubes.validated_flow.REST", 1e-4)
    with precision(balls.PRECISION):
        steps = list(solution_steps([x**2], [x], [arb(0.5)], 1.0))
        assert len(steps) < 10
        for step in steps:
            for share in (0.5, 0.9, 1.0):
                t = step.start + share * (step.end - step.start)
                (found,) = step.over(t, t)
                with precision(4 * balls.PRECISION):
                    assert found.contains(1 / (2 - arb(t)))


@pytest.mark.parametrize("rate", [x**2, -(x**2)])
def test_a_box_is_widened_until_it_holds_the_solution_whatever_it_began_with(rate: sp.Expr) -> None:
    # It begins with the start alone, as if x stood still; x = 1/(2 - t) or 1/(2 + t).
    with precision(balls.PRECISION):
        start, length = arb(0.5), 2.0**-10
        box = _box(BallFunction([x], [rate]), [[start]], [start], arb(0), length)
        assert box is not None
        for end in (0.0, length):
            assert box[0].contains(1 / (2 - (end if rate == x**2 else -end)))


@pytest.mark.parametrize("rate", [sp.Integer(1), sp.Integer(-1), x, -x])
def test_a_box_holds_every_start_and_all_of_the_time(rate: sp.Expr) -> None:
    with precision(balls.PRECISION):
        box = _box(BallFunction([x], [rate]), [[arb(1)]], [arb(1)], arb(0.125), 0.25)
        assert box is not None
        for start in (0.875, 1.0, 1.125):
            for t in (0.0, 1e-12, 0.125, 0.25):
                sign = 1 if rate in (1, x) else -1
                assert box[0].contains(
                    start + sign * arb(t) if rate.is_number else start * (sign * arb(t)).exp()
                )


@pytest.mark.parametrize("rest", [1e-17, 1e-4])
def test_a_turn_in_the_plane_is_held(rest: float, monkeypatch: pytest.MonkeyPatch) -> None:
    # x' = -2 y, y' = 2 x: every start of the ball stays as far from the origin, and the norm is 0.
    monkeypatch.setattr("gsp.slow_tubes.validated_flow.REST", rest)
    y = sp.Symbol("y")
    with precision(balls.PRECISION):
        steps = list(solution_steps([-2 * y, 2 * x], [x, y], [arb(1), arb(0, 0.125)], 1.0))
        for step in steps:
            found = [ball + arb(0, 1e-17) for ball in step.over(step.end, step.end)]
            angle = 2 * arb(step.end)
            for v in (-0.125, 0.0, 0.125):
                assert found[0].contains(angle.cos() - v * angle.sin())
                assert found[1].contains(angle.sin() + v * angle.cos())
        assert float(steps[-1].radius) < 0.126 + 20 * rest**0.5


def test_a_polynomial_by_its_coefficients() -> None:
    assert _horner([arb(v) for v in (1, 2, 3, 4)], arb(5)) == 586
    assert _horner([arb(7)], arb(5)) == 7
