"""Gauss's methods: the conditions that define them, polynomials that are reproduced, and the stated constant."""

from __future__ import annotations

from math import comb, factorial

import numpy as np
import pytest

from gsp.collocation.gauss import gauss

STAGES = (1, 2, 3, 4, 7)


@pytest.mark.parametrize("m", STAGES)
def test_the_method_is_the_one_of_order_2m(m: int) -> None:
    """B(2m) and C(m) of Hairer, Norsett, Wanner I, II.7: they determine it."""
    scheme = gauss(m)
    assert scheme.degree == m
    for k in range(1, 2 * m + 1):
        assert scheme.b @ scheme.c ** (k - 1) == pytest.approx(1 / k, rel=1e-13)
    for k in range(1, m + 1):
        np.testing.assert_allclose(scheme.A @ scheme.c ** (k - 1), scheme.c**k / k, rtol=1e-12, atol=1e-15)
    assert scheme.x.tolist() == [0.0, *scheme.c.tolist()]
    assert (np.diff(scheme.x) > 0).all()


@pytest.mark.parametrize("m", STAGES)
def test_polynomials_of_degree_m_are_reproduced_with_all_their_derivatives(m: int) -> None:
    scheme = gauss(m)
    p = np.polynomial.Polynomial(np.arange(2.0, m + 3.0) * (-1.0) ** np.arange(m + 1))
    values = p(scheme.x)
    np.testing.assert_allclose(scheme.slopes @ values, p.deriv()(scheme.c), rtol=1e-10)
    assert scheme.leading @ values == pytest.approx(factorial(m) * p.coef[m], rel=1e-9)
    places = np.array([0.0, 0.123, 0.5, 1.0, *scheme.c])
    np.testing.assert_allclose(scheme.basis(places) @ values, p(places), rtol=1e-11)
    np.testing.assert_array_equal(scheme.basis(scheme.x), np.eye(m + 1))


@pytest.mark.parametrize("m", STAGES)
def test_the_constant_is_the_largest_error_of_the_next_power(m: int) -> None:
    # For u = s^(m+1)/(m+1)! the error's derivative is P_m(2 s - 1)/C(2m, m)/m!, with Legendre's polynomial.
    legendre = np.polynomial.legendre.Legendre.basis(m, domain=[0.0, 1.0]).integ(lbnd=0.0)
    expected = np.abs(legendre(np.linspace(0.0, 1.0, 2001))).max() / comb(2 * m, m) / factorial(m)
    assert gauss(m).constant == pytest.approx(expected, rel=1e-9)


def test_states_are_taken_from_the_element_that_holds_the_place() -> None:
    """Two elements of different lengths with different polynomials, and places beyond either end."""
    scheme, mesh = gauss(3), np.array([0.0, 0.3, 1.0])
    left, right = np.polynomial.Polynomial([1.0, -2.0, 0.5, 4.0]), np.polynomial.Polynomial([3.0, 1.0, -1.0])
    where = scheme.places(mesh)
    np.testing.assert_allclose(where[0], 0.3 * scheme.x)
    np.testing.assert_allclose(where[1], 0.3 + 0.7 * scheme.x)
    values = np.stack(
        [np.stack([left(where[0]), right(where[1])]), -np.stack([left(where[0]), right(where[1])])], 2
    )
    places = np.array([0.0, 0.1, 0.2999, 0.3, 0.7, 1.0, 1.1, -0.05])
    expected = np.where(places < 0.3, left(places), right(places))
    np.testing.assert_allclose(scheme.at(mesh, values, places), np.stack([expected, -expected], 1), rtol=1e-11)


def test_a_scheme_is_made_once() -> None:
    assert gauss(4) is gauss(4)
