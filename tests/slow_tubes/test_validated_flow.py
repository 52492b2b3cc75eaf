"""Solutions enclosed step by step hold the exact ones of every start in the ball."""

import math

import pytest
import sympy as sp
from flint import arb

from gsp.algebra.precision import precision
from gsp.proofs import balls
from gsp.slow_tubes.validated_flow import log_norm, solution_steps

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


@pytest.mark.parametrize("rate", [-2, 1])
def test_every_start_in_the_ball_is_held_at_all_times(rate: int) -> None:
    with precision(balls.PRECISION):
        steps = list(solution_steps([rate * x], [x], [arb(1, 0.125)], 1.0))
        assert (steps[0].start, steps[-1].end) == (0.0, 1.0)
        for step in steps:
            for t in (step.start, 0.5 * (step.start + step.end), step.end):
                (found,) = step.over(t, t)
                for start in (0.875, 1.0, 1.125):
                    assert found.overlaps(arb(start * math.exp(rate * t), 1e-15))
        assert float(steps[-1].over(1.0, 1.0)[0].rad()) < 0.5
