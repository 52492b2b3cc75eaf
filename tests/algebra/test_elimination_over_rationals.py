"""Columns by elimination: the greedy choice of independent ones, part by part, against one rank at a time."""

from __future__ import annotations

import random

import flint
import mpmath
import pytest
import sympy as sp

from gsp.algebra.elimination_over_rationals import (
    connected_parts,
    independent_columns,
    independent_rows,
    numbers_at,
)
from gsp.algebra.sharing import plus, reciprocal, times


def matrix_of(rows: int, columns: int, share: float, seed: int) -> flint.fmpq_mat:
    drawn = random.Random(seed)
    numbers = [
        flint.fmpq(drawn.randint(-3, 3), drawn.randint(1, 4)) if drawn.random() < share else flint.fmpq(0)
        for _ in range(rows * columns)
    ]
    return flint.fmpq_mat(rows, columns, numbers)


@pytest.mark.parametrize("share", [0.15, 0.4, 1.0])
@pytest.mark.parametrize("seed", range(6))
def test_a_column_is_chosen_where_it_raises_the_rank_of_those_before_it(share: float, seed: int) -> None:
    matrix = matrix_of(6, 9, share, seed)
    entries = matrix.table()
    order = random.Random(seed).sample(range(9), 8)
    greedy: list[int] = []
    for j in order:
        if flint.fmpq_mat([[row[i] for i in (*greedy, j)] for row in entries]).rank() > len(greedy):
            greedy.append(j)
    assert independent_columns(matrix, order) == greedy


def test_parts_have_every_row_and_column_once_and_no_entry_between_them() -> None:
    places = [(0, 3), (2, 3), (2, 0), (1, 1)]
    parts = connected_parts(places, 4, 5)
    assert sorted(i for rows, _ in parts for i in rows) == list(range(4))
    assert sorted(j for _, columns in parts for j in columns) == list(range(5))
    part = {("row", i): k for k, (rows, _) in enumerate(parts) for i in rows}
    part |= {("column", j): k for k, (_, columns) in enumerate(parts) for j in columns}
    assert all(part["row", i] == part["column", j] for i, j in places)
    assert len(parts) == 5


def test_an_entry_has_its_number_to_most_digits_and_a_rational_one_exactly() -> None:
    """e = exp(-x) e + 1/(e + 1), six times over."""
    x = sp.Symbol("x")
    entry = x
    with mpmath.workdps(60):
        at = value = mpmath.mpf(5) / 17
        for _ in range(6):
            entry = plus([times(sp.exp(-x), entry), reciprocal(plus([entry, sp.S.One]))])
            value = mpmath.exp(-at) * value + 1 / (value + 1)
        found = numbers_at(sp.Matrix([[entry, x]]), {x: sp.Rational(5, 17)})
        assert found is not None
        assert found[0][1] == sp.Rational(5, 17)
        assert abs(mpmath.mpf(str(found[0][0])) / value - 1) < mpmath.mpf(10) ** -40


@pytest.mark.parametrize("seed", range(8))
def test_rows_are_told_apart_where_roots_are_complex_at_the_point(seed: int) -> None:
    """Half of such rows left a length that is complex by rounding, which cannot be compared: a TypeError."""
    x, drawn = sp.Symbol("x"), random.Random(seed)
    roots = [sp.sqrt(drawn.randint(0, 3) - 7 * x), (1 - 5 * x) ** sp.Rational(drawn.randint(1, 5), 3)]

    def entry() -> sp.Expr:
        return drawn.choice([*roots, sp.exp(x)]) * drawn.choice([1, sp.Rational(1, 3), -2]) + drawn.choice(
            roots
        )

    first, second = ([entry() for _ in range(4)] for _ in range(2))
    third = [a * roots[0] + b for a, b in zip(first, second)]
    fourth = [a * (roots[1] + 2) + b for a, b in zip(third, second)]
    values = numbers_at(sp.Matrix([first, second, third, fourth]), {x: sp.Rational(5, 11)})
    assert values is not None
    assert independent_rows(values) == [0, 1]
