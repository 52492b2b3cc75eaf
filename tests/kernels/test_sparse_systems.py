"""Sparse linear systems by a fixed elimination: the solutions are LAPACK's, and rows are exchanged where they must."""

import numpy as np
import pytest

from gsp.kernels.linear_systems import decompose_shifted, solve_shifted
from gsp.kernels.radau_systems import decompose, solve_stages
from gsp.kernels.radau_tableau import EIGENVALUES
from gsp.kernels.sparse_quads import factorise_quads, fill_quads, solve_quads
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
def test_solutions_are_those_of_lapack(name):
    jacobian = example(name)
    n = len(jacobian)
    entries, pattern = sparse(jacobian)
    assert np.array_equal(dense_jacobian(entries, pattern, n).reshape(n, n), jacobian)
    pivots = np.empty(n, np.int64)
    regular, factors = decompose_shifted(entries, 0.8, pattern, n, pivots)
    assert regular
    assert factors.shape == (1, pattern[FACTORS])
    matrix = 0.8 * np.eye(n) - jacobian
    x = np.cos(np.arange(n))
    right = x.copy()
    solve_shifted(pattern, factors, pivots, x)
    assert x == pytest.approx(np.linalg.solve(matrix, right), rel=1e-12 * np.linalg.cond(matrix), abs=1e-13)


@pytest.mark.parametrize("name", PATTERNS)
def test_four_complex_systems_have_the_solutions_of_lapack(name):
    jacobian = example(name)
    n = len(jacobian)
    entries, pattern = sparse(jacobian)
    shifts = np.array([1.0, 0.7 + 2.0j, 3.0 - 0.5j, -0.2 + 1.5j])
    quads, right = np.empty(8 * pattern[FACTORS]), np.random.default_rng(n).normal(size=(n, 2, 4))
    sizes = np.empty((3, n))
    fill_quads(entries, np.concatenate([shifts.real, shifts.imag]), pattern, n, quads, sizes)
    assert factorise_quads(pattern, quads, np.empty(8 * n), sizes, np.empty(8))
    solved = right.ravel().copy()
    solve_quads(pattern, quads, solved, n)
    found = solved.reshape(n, 2, 4)
    for m, shift in enumerate(shifts):
        matrix = shift * np.eye(n) - jacobian
        expected = np.linalg.solve(matrix, right[:, 0, m] + 1j * right[:, 1, m])
        margin = 1e-13 * np.linalg.cond(matrix) * np.abs(expected).max()
        assert found[:, 0, m] + 1j * found[:, 1, m] == pytest.approx(expected, rel=0, abs=margin)


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.parametrize("stages", [5, 7])
@pytest.mark.parametrize("is_sparse", [True, False])
def test_the_systems_of_a_family_are_solved_with_their_eigenvalues(name, stages, is_sparse):
    jacobian = example(name)
    n, pairs, family, step = len(jacobian), stages // 2, (stages - 5) // 2, 0.8
    entries, pattern = sparse(jacobian) if is_sparse else (jacobian.ravel(), EMPTY)
    pivots, complex_pivots = np.empty(n, np.int64), np.empty((pairs, n), np.int64)
    regular, real, complexes, quads = decompose(entries, step, family, pattern, pivots, complex_pivots)
    assert regular
    assert (real.shape, quads.shape) == (
        ((1, pattern[FACTORS]), (8 * pattern[FACTORS],)) if is_sparse else ((n, n), (0,))
    )
    assert complexes.shape == ((0, 0, 0) if is_sparse else (pairs, n, n))
    f = np.random.default_rng(n).normal(size=(stages, n))
    transformed = [f[0].astype(complex), *(f[2 * m + 1] + 1j * f[2 * m + 2] for m in range(pairs))]
    system = (real, complexes, quads, pivots, complex_pivots)
    solve_stages(pattern, step, system, f, np.empty(n), np.empty(n, complex), np.empty(8 * n))
    found = [f[0].astype(complex), *(f[2 * m + 1] + 1j * f[2 * m + 2] for m in range(pairs))]
    for m, eigenvalue in enumerate(EIGENVALUES[family, : pairs + 1]):
        matrix = eigenvalue / step * np.eye(n) - jacobian
        expected = np.linalg.solve(matrix, eigenvalue / step * transformed[m])
        margin = 1e-13 * np.linalg.cond(matrix) * np.abs(expected).max()
        assert found[m] == pytest.approx(expected, rel=0, abs=margin)


def test_a_line_of_cells_has_factors_in_proportion_to_its_length():
    sizes = []
    for n in (100, 200):
        line = np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1)
        _, pattern = sparse(line)
        assert pattern[ENTRIES] == 3 * n - 2
        sizes.append(int(pattern[FACTORS]))
    assert sizes == [298, 598]


@pytest.mark.parametrize("small", [1e-9, 0.0, np.nan])
def test_four_systems_of_which_one_has_no_usable_pivot_are_not_solved_at_once(small):
    """-J = ((0, 1), (1, 1)), shifted by `small` in the third of four."""
    entries, pattern = sparse(np.array([[0.0, -1.0, 0.0], [-1.0, -1.0, 0.0], [0.0, 0.0, -3.0]]))
    shifts = np.array([1.0, 2.0, 3.0, 4.0, 0, 0, 0, 0])
    quads, sizes = np.empty(8 * pattern[FACTORS]), np.empty((3, 3))
    for lane, usable in ((2, False), (None, True)):
        own = shifts.copy()
        if lane is not None:
            own[lane] = small
        fill_quads(entries, own, pattern, 3, quads, sizes)
        assert factorise_quads(pattern, quads, np.empty(24), sizes, np.empty(8)) == usable


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


@pytest.mark.parametrize("family", [0, 1])
def test_rows_may_grow_in_columns_that_outweigh_them(family):
    """z -> x at 1e4 and x -> y at 1e-4: the row of y grows by 4e5, and no column does."""
    jacobian = np.array([[-1e-4, 0.0, 1e4], [1e-4, -1e-3, 0.0], [0.0, 1e-3, -1e4]])
    entries, pattern = sparse(jacobian)
    pivots, complex_pivots, step = np.empty(3, np.int64), np.empty((family + 2, 3), np.int64), 1e3
    regular, factors = decompose_shifted(entries, 1.0 / step, pattern, 3, pivots)
    assert regular
    assert factors.shape == (1, pattern[FACTORS])
    x = np.array([1.0, 2.0, -1.0])
    solve_shifted(pattern, factors, pivots, x)
    assert x == pytest.approx(np.linalg.solve(np.eye(3) / step - jacobian, [1.0, 2.0, -1.0]), rel=1e-13)
    assert decompose(entries, step, family, pattern, pivots, complex_pivots)[3].shape == (8 * pattern[FACTORS],)


def test_a_singular_matrix_is_said_to_be_one():
    jacobian = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 2.0]])
    entries, pattern = sparse(jacobian)
    assert not decompose_shifted(entries, 0.0, pattern, 3, np.empty(3, np.int64))[0]
    assert not decompose_shifted(np.full(entries.shape, np.nan), 1.0, pattern, 3, np.empty(3, np.int64))[0]
