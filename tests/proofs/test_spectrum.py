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
