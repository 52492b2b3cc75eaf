"""Bounds of eigenvalues over ball matrices: true whatever basis the doubles propose."""

import numpy as np
import pytest
from flint import arb

from gsp.proofs import spectrum
from gsp.proofs.spectrum import largest_modulus, least_eigenvalue, spectrum_of

# Eigenvalues 1/4, 1/4 and 5/2, which no row tells.
FORM = [[arb(1 if i == j else 0.75) for j in range(3)] for i in range(3)]


def test_radii_off_the_diagonal_are_taken_off() -> None:
    form = [[arb(3), arb(0, 1)], [arb(0, 1), arb(3)]]
    assert 1.99 < least_eigenvalue(form) <= 2.0
    assert 4.0 <= largest_modulus(form) < 4.01


@pytest.mark.parametrize("scale", [0.25, 0.5, 0.8, 1.0, 1.1, 1.5, 3.0])
def test_a_basis_that_is_not_orthonormal_is_none_the_worse_a_proof(
    scale: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    eigh = np.linalg.eigh
    monkeypatch.setattr(spectrum.np.linalg, "eigh", lambda a: (eigh(a)[0], scale * eigh(a)[1]))
    assert 0.2499 < least_eigenvalue(FORM) <= 0.25
    assert 2.5 <= largest_modulus(FORM) < 5.0


@pytest.mark.parametrize(("sign", "counts"), [(-1, (1, 0)), (1, (0, 1))])
def test_the_gap_of_a_number_is_that_of_its_nearer_end(sign: int, counts: tuple[int, int]) -> None:
    found = spectrum_of([arb(2 * sign, 1)], np.array([[2.0 * sign]]))
    assert found is not None
    assert found.counts == counts
    assert 0.999 < found.gap <= 1.0
    assert spectrum_of([arb(sign, 1.5)], np.array([[1.0 * sign]])) is None
    least = spectrum_of([arb(1e-300 * sign)], np.array([[1e-300 * sign]]))
    assert least is not None
    assert 0.0 < least.gap <= 1e-300


def with_eigenvalues(draw: np.random.Generator, values: list[complex]) -> np.ndarray:
    """A matrix with these eigenvalues, a pair a + b i by its first, in a basis near the identity."""
    size = sum(2 if value.imag else 1 for value in values)
    blocks, k = np.zeros((size, size)), 0
    for value in values:
        width = 2 if value.imag else 1
        turn = np.array([[value.real, value.imag], [-value.imag, value.real]])
        blocks[k : k + width, k : k + width] = turn[:width, :width]
        k += width
    basis = np.eye(size) + draw.integers(-2, 3, (size, size)) / 8
    return basis @ blocks @ np.linalg.inv(basis)


CASES = [
    [-1, -3],
    [-1, 2],
    [4, 1.5],
    [-1 + 3j],
    [2 + 1j, -1],
    [-0.5 + 2j, 1, 3],
    [-2, -1, -4, -0.75],
    [-1 + 1j, 2 + 1j],
]


@pytest.mark.parametrize("values", CASES, ids=str)
@pytest.mark.parametrize("radius", [0.0, 0.01])
def test_counts_and_gap_hold_for_every_matrix_inside(values: list[complex], radius: float) -> None:
    draw = np.random.default_rng(len(values))
    values = [complex(v) for v in values]
    for _ in range(4):
        middle = with_eigenvalues(draw, values)
        m = len(middle)
        found = spectrum_of([arb(float(v), radius) for v in middle.ravel()], middle)
        assert found is not None
        unstable = sum((2 if v.imag else 1) for v in values if v.real > 0)
        assert found.counts == (m - unstable, unstable)
        assert sorted(found.signs) == [-1] * (m - unstable) + [1] * unstable
        least = min(abs(v.real) for v in values)
        assert found.gap <= least
        assert found.gap > (0.999999 if not radius else 0.7) * least
        # What it says of the basis is so at every corner that is tried.
        for _ in range(5):
            inner = middle + radius * draw.choice([-1.0, 1.0], (m, m))
            turned = np.linalg.solve(found.basis, inner @ found.basis)
            form = 0.5 * (found.signs[:, None] * turned + turned.T * found.signs[None, :])
            assert np.linalg.eigvalsh(form).min() >= found.gap - 1e-9
            assert abs(np.linalg.eigvals(inner).real).min() >= found.gap - 1e-9


def test_nearly_parallel_eigenvectors_are_left_to_lyapunovs_basis() -> None:
    for sign in (-1.0, 1.0):
        # One eigenvector for the eigenvalue 1, along (1, 1).
        middle = sign * np.array([[-3.0, 4.0], [-4.0, 5.0]])
        found = spectrum_of([arb(float(v)) for v in middle.ravel()], middle)
        assert found is not None
        assert found.counts == ((2, 0) if sign < 0 else (0, 2))
        turned = np.linalg.solve(found.basis, middle @ found.basis)
        assert 0.0 < found.gap <= np.linalg.eigvalsh(0.5 * sign * (turned + turned.T)).min() + 1e-12
    # A saddle has no such basis, and nothing is said of what may turn about the axis or is not finite.
    jordan = np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert spectrum_of([arb(float(v)) for v in jordan.ravel()], jordan) is None
    assert spectrum_of([arb("nan")] * 4, np.eye(2)) is None
    assert spectrum_of([arb(float(v)) for v in np.eye(2).ravel()], np.full((2, 2), np.nan)) is None
    assert spectrum_of([arb(1, 1.5), arb(0), arb(0), arb(1)], np.eye(2)) is None


@pytest.mark.parametrize("place", [(0, 0), (0, 1), (1, 1)])
def test_nothing_bounds_what_is_not_a_number(place: tuple[int, int]) -> None:
    form = [[arb("nan") if place in ((i, j), (j, i)) else arb(int(i == j)) for j in range(2)] for i in range(2)]
    assert least_eigenvalue(form) == -np.inf
    assert largest_modulus(form) == np.inf


def test_bounds_of_forms_are_those_of_eigenvalues() -> None:
    draw = np.random.default_rng(6)
    for size in (1, 2, 3, 4):
        for _ in range(10):
            half = draw.integers(-8, 9, (size, size)) / 4.0
            form = half + half.T
            exact, spread = np.linalg.eigvalsh(form), 2.0**-6
            given = [[arb(float(v), spread) for v in row] for row in form]
            least, most = least_eigenvalue(given), largest_modulus(given)
            assert least <= exact.min() - spread or least == -np.inf
            assert most >= abs(exact).max() + spread
            assert most <= abs(exact).max() * (1 + 1e-6) + 3 * spread * size or size > 2
            positive = form + (0.25 - exact.min()) * np.eye(size)
            found = least_eigenvalue([[arb(float(v)) for v in row] for row in positive])
            assert 0.0 < found <= 0.25 + 1e-12
