"""Runs of one stability along a curve: by the eigenvalues of its rows, special rows belonging to both sides."""

from __future__ import annotations

import numpy as np
import pytest

from gsp.critical.continuation.critical_curve import stability


def runs(eigenvalues: list, special: tuple[int, ...] = ()):
    counts, segments = stability(np.array(eigenvalues, dtype=complex), special)
    return counts.tolist(), [(s.first, s.last, s.unstable, s.kind) for s in segments]


def test_runs_are_told_by_how_many_eigenvalues_are_unstable() -> None:
    assert runs([[-1, -2], [-1, -3]]) == ([0, 0], [(0, 1, 0, "attracting")])
    assert runs([[1, 2]]) == ([2], [(0, 0, 2, "repelling")])
    assert runs([[1, -2], [1, -2]]) == ([1, 1], [(0, 1, 1, "saddle")])
    assert runs([[1j, -1j], [1 + 1j, 1 - 1j]]) == ([0, 2], [(0, 0, 0, "attracting"), (1, 1, 2, "repelling")])


def test_a_special_row_belongs_to_both_runs_and_is_stable_in_what_lies_on_the_axis() -> None:
    fold = [[-2, -5], [-1, -5], [1e-9, -5], [1, -5], [2, -5]]
    expected = [(0, 2, 0, "attracting"), (2, 4, 1, "saddle")]
    assert runs(fold, (2,)) == ([0, 0, 0, 1, 1], expected)
    # Without one between them neither run reaches the other.
    assert runs([fold[i] for i in (0, 1, 3, 4)]) == (
        [0, 0, 1, 1], [(0, 1, 0, "attracting"), (2, 3, 1, "saddle")],
    )  # fmt: skip
    # A special row at which nothing changes parts nothing, at an end either.
    assert runs([[-1], [0], [-1]], (1,))[1] == [(0, 2, 0, "attracting")]
    assert runs([[0], [1], [1]], (0,)) == ([0, 1, 1], [(0, 2, 1, "repelling")])
    assert runs([[1], [1], [0]], (2,)) == ([1, 1, 0], [(0, 2, 1, "repelling")])
    # What is off the axis at a special row counts, however small it is beside the others' rates.
    assert runs([[-1, 3], [0, 3], [1, 3]], (1,)) == ([1, 1, 2], [(0, 1, 1, "saddle"), (1, 2, 2, "repelling")])


def test_a_row_without_eigenvalues_is_as_stable_as_the_one_before() -> None:
    nan = np.nan
    assert runs([[1], [1], [nan]]) == ([1, 1, 1], [(0, 2, 1, "repelling")])
    assert runs([[nan], [1], [nan], [-1]]) == ([1, 1, 1, 0], [(0, 2, 1, "repelling"), (3, 3, 0, "attracting")])


@pytest.mark.parametrize("count", [1, 2, 3])
def test_every_row_lies_in_a_run(count: int) -> None:
    rng = np.random.default_rng(count)
    values = rng.choice([-1.0, 1.0], (40, count))
    counts, segments = stability(values.astype(complex), ())
    assert counts.tolist() == (values > 0).sum(axis=1).tolist()
    rows = [row for s in segments for row in range(s.first, s.last + 1)]
    assert rows == list(range(40))
    assert all(counts[row] == s.unstable for s in segments for row in range(s.first, s.last + 1))
