"""What the checker proves of interval matrices, against numbers and against random matrices of each."""

import random
from fractions import Fraction

import numpy as np
import pytest

from gsp.proofs import intervals as ia
from gsp.proofs.interval_matrices import decay, is_positive, is_regular, norm, solved


def interval(low: float, high: float | None = None) -> ia.Interval:
    return int(Fraction(low) * ia.ONE), int(Fraction(low if high is None else high) * ia.ONE)


def matrix(rows, spread: float = 0.0) -> list[list[ia.Interval]]:
    return [[interval(v - spread, v + spread) for v in row] for row in rows]


@pytest.mark.parametrize(
    ("entries", "exact"), [([-3.0, 4.0], 5.0), ([4.0, -3.0], 5.0), ([-7.0], 7.0), ([2.0, 3.0, 6.0], 7.0)]
)
def test_a_norm_is_a_bound_and_hardly_more(entries: list[float], exact: float) -> None:
    assert exact <= norm([interval(v) for v in entries]) / ia.ONE <= exact * (1 + 1e-9)
    assert norm([interval(-1.0, 2.0)]) == 2 * ia.ONE


def test_a_solution_holds_that_of_every_matrix_inside() -> None:
    draw = np.random.default_rng(2)
    for size in (1, 2, 4):
        middle = draw.integers(-8, 9, (size, size)) + 20.0 * np.eye(size)[draw.permutation(size)]
        right = draw.integers(-8, 9, (size, 2)).astype(float)
        found = solved(matrix(middle, 2.0**-10), matrix(right, 2.0**-10))
        assert found is not None
        for _ in range(20):
            inner = middle + draw.uniform(-1, 1, (size, size)) * 2.0**-10
            exact = np.linalg.solve(inner, right + draw.uniform(-1, 1, (size, 2)) * 2.0**-10)
            for row, values in zip(found, exact):
                for (low, high), value in zip(row, values):
                    assert low / ia.ONE - 1e-12 <= value <= high / ia.ONE + 1e-12
    assert not is_regular(matrix([[1.0, 2.0], [2.0, 4.0]]))
    assert is_regular(matrix([[0.0, 2.0], [3.0, 0.0]]))


def test_what_is_positive_has_positive_pivots() -> None:
    assert is_positive(matrix([[2.0, 1.0], [1.0, 2.0]], 0.25))
    assert not is_positive(matrix([[2.0, 1.0], [1.0, 2.0]], 0.5))
    assert not is_positive(matrix([[0.0]]))


def minor(rows: list[list[int]]) -> int:
    """The determinant, along the first column."""
    if not rows:
        return 1
    rest = [row[1:] for row in rows]
    return sum((-1) ** i * row[0] * minor(rest[:i] + rest[i + 1 :]) for i, row in enumerate(rows))


def test_what_is_positive_has_positive_leading_minors() -> None:
    draw, positive = random.Random(7), 0
    for size in (1, 2, 3, 4) * 40:
        half = [[draw.randint(-2, 2) + 3 * (i == j) for j in range(size)] for i in range(size)]
        rows = [[half[i][j] + half[j][i] for j in range(size)] for i in range(size)]
        exact = all(minor([row[:k] for row in rows[:k]]) > 0 for k in range(1, size + 1))
        assert is_positive(matrix(rows)) is exact, rows
        positive += exact
    assert 20 < positive < 140


def test_a_decay_is_a_bound_of_the_least_eigenvalue_of_the_symmetric_part() -> None:
    draw = random.Random(5)
    for _ in range(50):
        rows = [[draw.randint(-9, 9) / 4 + (8 if i == j else 0) for j in range(3)] for i in range(3)]
        for sign in (1, -1):
            found = decay(matrix([[sign * v for v in row] for row in rows]), [0, 2], sign) / ia.ONE
            block = np.array(rows)[np.ix_([0, 2], [0, 2])]
            assert found <= np.linalg.eigvalsh((block + block.T) / 2).min() + 1e-12
            across = abs(block[0, 1] + block[1, 0]) / 2
            assert found == pytest.approx(min(block[0, 0], block[1, 1]) - across, abs=1e-12)


def test_what_is_less_than_a_unit_is_rounded_against_the_claim() -> None:
    assert norm([(0, 1), (0, 1)]) == 2
    assert norm([(-3, 0), (0, 4)]) >= 5
    assert decay([[(4, 6)]], [0], 1) == 4
    assert decay([[(-6, -4)]], [0], -1) == 4
    # Twice 5 less 1 is 9.
    assert decay([[(5, 5), (1, 1)], [(0, 0), (5, 5)]], [0, 1], 1) == 4
    assert decay([[(-5, -5), (1, 1)], [(0, 0), (-5, -5)]], [0, 1], -1) == 4


@pytest.mark.parametrize("entry", [(-1, 1), (0, 1), (-1, 0), (0, 0)])
def test_a_matrix_that_may_be_zero_is_not_regular(entry: ia.Interval) -> None:
    assert not is_regular([[entry]])
    assert not is_regular([[entry, ia.ZERO], [ia.ZERO, ia.UNIT]])
    assert not is_positive([[entry]])
