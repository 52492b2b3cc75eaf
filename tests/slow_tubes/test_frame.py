"""Norms in an eigenbasis: the box of a norm is the least one, and a frame is taken where the norm in it falls."""

import numpy as np
import pytest
from flint import arb, arb_mat

from gsp.slow_tubes.adapted_basis import _constant
from gsp.slow_tubes.frame import FibreBasis, framed


def matrix(rows) -> arb_mat:
    return arb_mat([[arb(v) for v in row] for row in rows])


def frame(rows) -> FibreBasis:
    return FibreBasis(matrix(rows), matrix(rows).inv())


IDENTITY = {m: frame(np.eye(m).tolist()) for m in (1, 2)}


def test_a_box_is_the_least_that_holds_all_of_a_size() -> None:
    # T = [[3, 4], [0, 2]]: of |T^-1 w| <= 1/2 the ends are w_1 = 5/2 and w_2 = 1.
    first, second = frame([[3.0, 4.0], [0.0, 2.0]]).box(arb(0.5))
    for side, end in ((first, 2.5), (second, 1.0)):
        assert float(side.abs_upper()) == pytest.approx(end, rel=1e-8)
        assert side.contains(arb(end)) or float(side.abs_upper()) < end


@pytest.mark.parametrize(
    ("rows", "rate"),
    [
        ([[-1.0, 100.0], [0.0, -2.0]], 1.0),
        ([[-1.0, 50.0], [-2.0, -1.0]], 1.0),
        ([[-3.0, 0.0], [0.0, -2.0]], 2.0),
    ],
)
def test_a_norm_falls_as_the_eigenvalues_say(rows, rate: float) -> None:
    _, decay = framed(IDENTITY[2], matrix(rows))
    assert decay == pytest.approx(rate, rel=1e-6)
    assert IDENTITY[2].decay(matrix(rows)) <= decay


def test_a_frame_in_which_the_norm_falls_stays() -> None:
    for rows in ([[-3.0, 0.1], [0.0, -2.0]], [[-3.0]]):
        old = IDENTITY[len(rows)]
        new, decay = framed(old, matrix(rows))
        assert new is old
        assert decay == pytest.approx(-max(row[i] for i, row in enumerate(rows)), rel=0.1)


def test_the_signs_of_directions_are_those_of_their_eigenvalues() -> None:
    basis = _constant(np.array([[-1.0, 0.0, 0.0], [0.0, 2.0, 5.0], [0.0, -5.0, 2.0]]))
    assert basis.signs == (-1, 1)
    assert basis.blocks == ((0,), (1, 2))
