"""Eigenvalues of matrices far from normal, and verdicts that rest on them: Jordan blocks and rates far apart."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.critical.spectrum import LARGEST, eigenvalues, is_singular, symmetrised
from gsp.hyperbolicity.hyperbolicity import Kind, classify
from gsp.systems.system import SlowFastSystem
from tests.cases import thinned

s, eps = sp.symbols("s epsilon")


def system_of(matrix: sp.Matrix) -> SlowFastSystem:
    y = sp.symbols(f"y:{matrix.rows}")
    rates = matrix * sp.Matrix(y) + sp.ones(matrix.rows, 1) * s
    return SlowFastSystem(slow={s: -s}, fast=dict(zip(y, rates)), epsilon=eps)


def verdict(matrix: sp.Matrix, epsilon: float | None = None):
    (branch,) = solve_critical(system_of(matrix)).branches
    return classify(branch, region={"s": (0, 1)}, epsilon=epsilon)


def jordan(size: int, above: int, value: int = -1) -> sp.Matrix:
    return sp.Matrix(size, size, lambda i, j: value if i == j else above if j == i + 1 else 0)


def unimodular(size: int, seed: int) -> sp.Matrix:
    """Products of shears: whole numbers, as is the inverse."""
    rng = np.random.default_rng(seed)
    result = sp.eye(size)
    for _ in range(2 * size):
        i, j = rng.choice(size, 2, replace=False)
        shear = sp.eye(size)
        shear[int(i), int(j)] = int(rng.choice([-1, 1]))
        result = result * shear
    return result


@pytest.mark.exhaustive
@pytest.mark.parametrize(("size", "above"), [(4, 1000), (3, 10**5), (4, 100), (2, 10**6), (6, 100), (8, 100)])
def test_a_jordan_block_has_the_gap_of_its_eigenvalue(size, above) -> None:
    found = verdict(jordan(size, above))
    assert found.kind is Kind.ATTRACTING, found
    assert found.gap == pytest.approx(1.0)
    assert found.losses == ()
    assert verdict(jordan(size, above, value=1)).kind is Kind.REPELLING


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(6))
def test_a_jordan_block_in_other_coordinates_has_the_same_gap(seed) -> None:
    T = unimodular(4, seed)
    found = verdict(T * jordan(4, 100) * T.inv())
    assert found.kind is Kind.ATTRACTING, found
    assert found.gap == pytest.approx(1.0)
    assert found.losses == ()


@pytest.mark.exhaustive
@pytest.mark.parametrize("decades", [6, 9, 10, 11, 14, 20, 50])
def test_rates_far_apart_are_rates(decades) -> None:
    found = verdict(sp.Matrix([[-1, 0], [1, -(10**decades)]]), epsilon=0.01)
    assert found.kind is Kind.ATTRACTING, found
    assert found.gap == pytest.approx(1.0)
    assert found.losses == ()
    (note,) = found.notes
    assert "still faster than the slow variables" in note


@pytest.mark.parametrize("seed", thinned(range(4), 2))
def test_rates_far_apart_in_other_units_are_rates(seed) -> None:
    rng = np.random.default_rng(seed)
    units = sp.diag(*(sp.Integer(10) ** int(k) for k in rng.integers(-4, 5, 3)))
    found = verdict(units * sp.Matrix([[-1, 0, 1], [1, -(10**11), 0], [0, 2, -300]]) * units.inv())
    assert found.kind is Kind.ATTRACTING, found
    assert found.gap == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_a_zero_eigenvalue_beside_a_fast_one_is_one_in_any_coordinates(seed) -> None:
    T = unimodular(3, seed)
    A = np.array((T * sp.diag(-1, -(10**6), 0) * T.inv()).tolist(), dtype=float)
    assert is_singular(A[None])[0]
    assert np.abs(eigenvalues(A[None])[0]).min() == 0.0


def test_a_normal_matrix_keeps_its_double_precision_eigenvalues() -> None:
    rng = np.random.default_rng(0)
    A = rng.standard_normal((50, 4, 4)) - 3.0 * np.eye(4)
    assert np.array_equal(eigenvalues(A), np.linalg.eigvals(A))


def test_an_eigenvalue_of_a_defective_matrix_is_exact() -> None:
    A = np.array(jordan(6, 100).tolist(), dtype=float)
    P = np.array(unimodular(6, 3).tolist(), dtype=float)
    B = P @ A @ np.round(np.linalg.inv(P))
    assert np.abs(np.linalg.eigvals(B) + 1.0).max() > 1e-3
    # In any unit of time.
    for unit in (1.0, 2.0**-30, 2.0**30):
        assert eigenvalues(unit * B[None])[0] / unit == pytest.approx(-np.ones(6), abs=1e-12)


def test_what_is_singular_does_not_depend_on_units() -> None:
    singular = np.array([[1.0, 2.0], [3.0, 6.0]])
    regular = np.array([[1.0, 2.0], [3.0, 6.001]])
    for units in ((1.0, 1.0), (1e9, 1e-7), (1e-12, 1e12)):
        D = np.diag(units)
        assert is_singular((D @ singular)[None])[0]
        assert not is_singular((D @ regular @ np.linalg.inv(D))[None])[0]


def test_large_matrices_that_units_make_symmetric_have_real_eigenvalues() -> None:
    n = LARGEST + 4
    chain = np.diag(-2.0 * np.ones(n)) + np.diag(np.ones(n - 1), 1) + np.diag(np.ones(n - 1), -1)
    # In two parts, which have units of their own.
    chain[6, 7] = chain[7, 6] = 0.0
    units = 2.0 ** np.arange(0, 10 * n, 10)
    scaled = chain * units[:, None] / units
    assert symmetrised(scaled) == pytest.approx(chain, abs=1e-12)
    found = eigenvalues(np.stack([scaled, 3.0 * scaled]))
    assert found.shape == (2, n)
    exact = np.concatenate([-2 + 2 * np.cos(np.pi * np.arange(1, m + 1) / (m + 1)) for m in (7, n - 7)])
    assert np.sort(found[0]) == pytest.approx(np.sort(exact), abs=1e-12)
    assert np.sort(found[1]) == pytest.approx(np.sort(3.0 * exact), abs=1e-12)
    assert eigenvalues(np.empty((0, n, n))).shape == (0, n)


def test_what_no_units_make_symmetric_keeps_its_complex_eigenvalues() -> None:
    n = LARGEST + 1
    around = np.roll(np.eye(n), 1, axis=1)
    for matrix in (around, around - around.T, 2.0 * around + around.T):
        assert symmetrised(matrix) is None
        found = eigenvalues(matrix[None])[0]
        turns = np.exp(2j * np.pi * np.arange(n) / n)
        exact = matrix[0, 1] * turns + matrix[1, 0] / turns
        assert max(np.abs(found - e).min() for e in exact) < 1e-12


@pytest.mark.parametrize("scale", [1e-200, 1e-160, 1e160, 1e200])
def test_eigenvalues_of_matrices_whose_squares_leave_the_doubles(scale: float) -> None:
    jordan = np.array([[3.0, 1.0, 0.0], [0.0, 3.0, 1.0], [0.0, 0.0, 3.0]])
    zero = np.zeros((3, 3))
    found = eigenvalues(np.stack([scale * jordan, scale * np.diag([1.0, 2.0, 4.0]), zero]))
    np.testing.assert_allclose(found[0] / scale, 3.0, rtol=1e-6)
    np.testing.assert_allclose(np.sort(found[1].real / scale), [1.0, 2.0, 4.0], rtol=1e-12)
    np.testing.assert_array_equal(found[2], 0.0)
