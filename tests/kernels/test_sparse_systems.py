"""Sparse linear systems by a fixed elimination: the solutions are LAPACK's, and rows are exchanged where they must."""

import numpy as np
import pytest

from gsp.kernels.linear_systems import decompose_shifted, solve_shifted
from gsp.kernels.radau_systems import decompose, solve_complex_shifted
from gsp.kernels.radau_tableau import EIGENVALUES
from gsp.kernels.sparse_systems import ENTRIES, FACTORS, dense_jacobian
from gsp.lowering.steps.sparse_pattern import write_pattern
from gsp.lowering.steps.straight_line import eliminate
from tests.lowering.steps.test_straight_line import PATTERNS

EMPTY = np.empty(0, np.int64)


def sparse(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The entries of a matrix that are not 0, and their pattern."""
    places = [(int(i), int(j)) for i, j in zip(*np.nonzero(matrix))]
    return matrix[tuple(zip(*places))], write_pattern(places, eliminate(len(matrix), places))


def example(name: str) -> np.ndarray:
    pattern = PATTERNS[name]
    rng = np.random.default_rng(len(pattern))
    return np.where(pattern, rng.normal(size=pattern.shape), 0.0) - 2.0 * np.diag(np.diag(pattern))


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.parametrize("stages", [3, 5, 7])
def test_solutions_are_those_of_lapack(name, stages):
    jacobian = example(name)
    n, pairs, family, step = len(jacobian), stages // 2, (stages - 3) // 2, 0.8
    entries, pattern = sparse(jacobian)
    assert np.array_equal(dense_jacobian(entries, pattern, n).reshape(n, n), jacobian)
    pivots, complex_pivots = np.empty(n, np.int64), np.empty((pairs, n), np.int64)
    regular, real, complexes = decompose(entries, step, family, pattern, pivots, complex_pivots)
    assert regular
    assert real.shape == (1, pattern[FACTORS])
    assert complexes.shape == (pairs, 1, pattern[FACTORS])
    right = np.cos(np.arange(n))
    for m, eigenvalue in enumerate(EIGENVALUES[family, : pairs + 1]):
        matrix = eigenvalue / step * np.eye(n) - jacobian
        x = right.astype(complex) if m else right.copy()
        if m:
            solve_complex_shifted(pattern, complexes, m - 1, complex_pivots, x)
        else:
            solve_shifted(pattern, real, pivots, x)
        assert x == pytest.approx(np.linalg.solve(matrix, right), rel=1e-12 * np.linalg.cond(matrix), abs=1e-13)


def test_a_line_of_cells_has_factors_in_proportion_to_its_length():
    sizes = []
    for n in (100, 200):
        line = np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1)
        _, pattern = sparse(line)
        assert pattern[ENTRIES] == 3 * n - 2
        sizes.append(int(pattern[FACTORS]))
    assert sizes == [298, 598]


@pytest.mark.parametrize("shift", [1e-9, 0.0])
def test_where_the_fixed_pivots_cannot_be_used_rows_are_exchanged(shift):
    # Without an exchange the first pivot is 1e-9 or 0, and the factors grow by its inverse.
    jacobian = np.array([[0.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [0.0, 0.0, -3.0]])
    entries, pattern = sparse(jacobian)
    pivots = np.empty(3, np.int64)
    right = np.array([1.0, 2.0, -1.0])
    regular, factors = decompose_shifted(entries, shift, pattern, 3, pivots)
    assert regular
    assert factors.shape == (3, 3)
    x = right.copy()
    solve_shifted(pattern, factors, pivots, x)
    assert x == pytest.approx(np.linalg.solve(shift * np.eye(3) - jacobian, right), rel=1e-14)
    whole = decompose_shifted(jacobian.ravel(), shift, EMPTY, 3, pivots)[1]
    assert np.array_equal(whole, factors)


def test_a_singular_matrix_is_said_to_be_one():
    jacobian = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 2.0]])
    entries, pattern = sparse(jacobian)
    assert not decompose_shifted(entries, 0.0, pattern, 3, np.empty(3, np.int64))[0]
    assert not decompose_shifted(np.full(entries.shape, np.nan), 1.0, pattern, 3, np.empty(3, np.int64))[0]
