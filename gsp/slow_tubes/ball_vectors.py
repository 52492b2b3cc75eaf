"""Vectors of balls as lists, and ball matrices applied to them."""

from __future__ import annotations

from collections.abc import Sequence

from flint import arb, arb_mat


def centres(vector: Sequence[arb]) -> list[arb]:
    """The middles of the balls, exactly."""
    return [arb(ball.mid()) for ball in vector]


def centre_of(matrix: arb_mat) -> arb_mat:
    """The matrix of the middles."""
    return arb_mat(matrix.nrows(), matrix.ncols(), centres(matrix.entries()))


def row(matrix: arb_mat, i: int) -> list[arb]:
    """One row."""
    return [matrix[i, j] for j in range(matrix.ncols())]


def times(matrix: arb_mat, vector: Sequence[arb]) -> list[arb]:
    """The matrix applied to a vector."""
    return (matrix * arb_mat(len(vector), 1, list(vector))).entries()


def minus(one: Sequence[arb], two: Sequence[arb]) -> list[arb]:
    """one - two."""
    return [a - b for a, b in zip(one, two)]
