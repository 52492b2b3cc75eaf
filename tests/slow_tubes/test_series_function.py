"""Power series with balls as coefficients hold Taylor's coefficients of every function that has an enclosure."""

from __future__ import annotations

import flint
import pytest
import sympy as sp
from flint import arb, arb_mat

from gsp.errors import UnsupportedFunctionError
from gsp.proofs import balls
from gsp.slow_tubes.ball_vectors import centre_of, centres, minus, row, times
from gsp.slow_tubes.series_function import SeriesFunction

x, y = sp.symbols("x y")


def test_arguments_are_cut_and_filled_with_zeros_and_what_has_no_value_is_not_finite() -> None:
    with flint.ctx.workprec(balls.PRECISION):
        both = SeriesFunction([x, y], [x * y, x + y, 1 / x, 1 / (x - 1)])
        product, total, reciprocal, pole = both([[arb(1), arb(2)], [arb(3)]], 3)
        assert [float(c) for c in product] == [3, 6, 0]
        assert [float(c) for c in total] == [4, 2, 0]
        assert [float(c) for c in reciprocal] == [1, -2, 4]
        assert not all(c.is_finite() for c in pole)
    with pytest.raises(UnsupportedFunctionError):
        SeriesFunction([x], [sp.gamma(x)])


def test_vectors_and_matrices_of_balls() -> None:
    matrix = arb_mat(2, 3, [1, 2, 3, 4, 5, arb(6, 0.5)])
    assert [float(e) for e in row(matrix, 1)[:2]] == [4, 5]
    assert [float(e.mid()) for e in times(matrix, [arb(1), arb(0), arb(-1)])] == [-2, -2]
    assert [float(e) for e in minus([arb(3), arb(1)], [arb(1), arb(4)])] == [2, -3]
    middle = centre_of(matrix).entries()
    assert [float(e) for e in middle] == [1, 2, 3, 4, 5, 6]
    assert all(e.rad() == 0 for e in [*middle, *centres([arb(1, 0.5)])])
