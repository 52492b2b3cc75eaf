"""Coefficients of normal forms: known ones in coordinates of their own, and how they change with the coordinates."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.minimally_augmented import bialternate
from gsp.critical.multilinear_form import MultilinearForm
from gsp.critical.normal_forms import (
    bogdanov_takens,
    bordered,
    cubic_coefficient,
    first_lyapunov,
    null_vectors,
    quadratic_coefficient,
)

p, q, r = sp.symbols("p q r")
T = sp.Matrix([[2, 1, 0], [-1, 1, 1], [0, 1, 3]])


def derivatives(rates: list, in_other_coordinates: bool = False) -> list:
    """A, B and the form C at 0 of the field, as it stands or for T times its states."""
    states = sp.symbols("p q r")[: len(rates)]
    field = sp.Matrix(rates)
    if in_other_coordinates:
        S = T[: len(rates), : len(rates)]
        field = S * field.subs(dict(zip(states, S.inv() * sp.Matrix(states))), simultaneous=True)
    result = []
    everything = list(field)
    shape: tuple[int, ...] = (len(rates),)
    for _ in range(3):
        everything = [sp.diff(e, s) for e in everything for s in states]
        shape = (*shape, len(states))
        values = [float(e.subs(dict.fromkeys(states, 0))) for e in everything]
        result.append(np.array(values).reshape(shape))
    places = np.nonzero(result[2])
    return [*result[:2], MultilinearForm(np.array(places), result[2][places], len(rates))]


@pytest.mark.exhaustive
@pytest.mark.parametrize("moved", [False, True])
def test_a_fold_has_its_quadratic_and_a_cusp_its_cubic_coefficient(moved: bool) -> None:
    # On the centre manifold q = -2 p^2 + ..., so that c = 5 + 3 (-2).
    A, B, C = derivatives([3 * p * q + 5 * p**3, -q - 2 * p**2, -2 * r + p * q], moved)
    right, left = null_vectors(A)
    left = left / (left @ right)
    size = float(np.linalg.norm(np.array(T, dtype=float)[:, 0])) if moved else 1.0
    assert np.linalg.norm(right) == pytest.approx(1.0)
    assert right[np.argmax(np.abs(right))] > 0
    assert [np.abs(A @ right).max(), np.abs(left @ A).max()] == pytest.approx([0, 0], abs=1e-14)
    assert quadratic_coefficient(B, right, left) == pytest.approx(0.0, abs=1e-14)
    assert cubic_coefficient(A, B, C, right, left) == pytest.approx((5 - 6) / size**2)
    A, B, _ = derivatives([-7 * p**2 / 2 + q**2, -q + p**2, -2 * r], moved)
    assert quadratic_coefficient(B, right, left) == pytest.approx(-3.5 / size)
    matrix = bordered(A, left, right)
    assert matrix.shape == (4, 4)
    assert np.linalg.solve(matrix, [0, 0, 0, 1.0]) == pytest.approx([*right, 0.0])


@pytest.mark.parametrize("moved", [False, True])
def test_the_first_lyapunov_coefficient_of_a_normal_form_is_its_own(moved: bool) -> None:
    # z' = i omega z + a z |z|^2 has l1 = 2 a/omega for |q| = 1.
    omega, a = 3, sp.Rational(-2)
    rates = [-omega * q + a * p * (p**2 + q**2), omega * p + a * q * (p**2 + q**2)]
    A, B, C = derivatives(rates)
    l1, right, left = first_lyapunov(A, B, C, omega)
    assert l1 == pytest.approx(2 * float(a) / omega)
    assert A @ right == pytest.approx(1j * omega * right)
    assert A.T @ left == pytest.approx(-1j * omega * left)
    assert [np.linalg.norm(right), np.vdot(left, right)] == pytest.approx([1.0, 1.0])
    # Quadratic terms alone: the classical formula of the plane, and its sign beside a third state.
    plane = [-q + p**2 * 2 + p * q, p - p**2 + 3 * p * q + q**2 / 2]
    A, B, C = derivatives(plane)
    f, g = B
    formula = (
        f[0, 1] * (f[0, 0] + f[1, 1]) - g[0, 1] * (g[0, 0] + g[1, 1]) - f[0, 0] * g[0, 0] + f[1, 1] * g[1, 1]
    ) / 16
    assert first_lyapunov(A, B, C, 1.0)[0] == pytest.approx(2 * formula)
    # Each sum of terms is 0, and none of the terms.
    for even in ([-q + p**2 - q**2, p + 2 * p * q], [-q + p**3 - p * q**2, p + q * p**2 - q**3]):
        A, B, C = derivatives(even)
        assert first_lyapunov(A, B, C, 1.0)[0] == 0.0
    third = [*plane, -2 * r + p**2]
    A, B, C = derivatives(third, moved)
    assert np.sign(first_lyapunov(A, B, C, 1.0)[0]) == np.sign(formula)


def test_a_double_zero_has_both_coefficients_and_their_ratio_is_invariant() -> None:
    rates = [q, 3 * p**2 + 5 * p * q, -r + p**2]
    a, b = bogdanov_takens(*derivatives(rates)[:2])
    assert (abs(a), abs(b)) == pytest.approx((3.0, 5.0))
    assert a / b == pytest.approx(3 / 5)
    moved = bogdanov_takens(*derivatives(rates, in_other_coordinates=True)[:2])
    assert moved[0] / moved[1] == pytest.approx(3 / 5)


@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_the_bialternate_product_has_the_sums_of_two_eigenvalues(n: int) -> None:
    matrix = np.random.default_rng(n).normal(size=(n, n))
    values = np.linalg.eigvals(matrix)
    sums = [values[i] + values[j] for i in range(n) for j in range(i)]
    product = bialternate(matrix)
    assert np.poly(product) == pytest.approx(np.poly(np.array(sums)).real)
    assert bialternate(np.stack([matrix, 2 * matrix]))[1] == pytest.approx(2 * product)
