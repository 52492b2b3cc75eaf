"""Gauss's collocation methods on the unit interval, and the polynomials through an element's start and its stages."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import factorial

import numpy as np


@dataclass(frozen=True, eq=False)
class Scheme:
    """The Gauss method with m stages: nodes c (m,), weights b (m,), matrix A (m, m), and what polynomials need.

    Of order 2m at the ends of elements. `x` (m + 1,) are 0 and the nodes, `barycentric` their weights; `slopes`
    (m, m + 1) takes a polynomial's values at x to its derivatives at c; `leading` (m + 1,) to its m-th derivative;
    `constant` is the maximum over an interval of length 1 of the error for u^(m+1) = 1.
    """

    c: np.ndarray
    b: np.ndarray
    A: np.ndarray
    x: np.ndarray
    barycentric: np.ndarray
    slopes: np.ndarray
    leading: np.ndarray
    constant: float

    @property
    def degree(self) -> int:
        """Number of stages and degree of the polynomials, m."""
        return len(self.c)

    def basis(self, s: np.ndarray) -> np.ndarray:
        """Lagrange polynomials on x at places s (k,) of [0, 1]: (k, m + 1)."""
        difference = s[:, None] - self.x
        exact = difference == 0.0
        terms = self.barycentric / np.where(exact, 1.0, difference)
        values = terms / terms.sum(axis=1, keepdims=True)
        hit = exact.any(axis=1)
        values[hit] = exact[hit]
        return values

    def at(self, mesh: np.ndarray, values: np.ndarray, places: np.ndarray) -> np.ndarray:
        """States (k, n) at `places` (k,) of the polynomials with `values` (N, m + 1, n) on a mesh (N + 1,)."""
        j = np.clip(np.searchsorted(mesh, places, side="right") - 1, 0, len(mesh) - 2)
        local = (places - mesh[j]) / np.diff(mesh)[j]
        return np.einsum("ki,kin->kn", self.basis(local), values[j])

    def places(self, mesh: np.ndarray) -> np.ndarray:
        """Where the values of an element are taken (N, m + 1): at its start and at its Gauss points."""
        return mesh[:-1, None] + np.diff(mesh)[:, None] * self.x


@lru_cache(maxsize=16)
def gauss(m: int) -> Scheme:
    """The scheme with m stages (Hairer, Norsett, Wanner I, section II.7)."""
    points, weights = np.polynomial.legendre.leggauss(m)
    c, b = (1.0 + points) / 2.0, weights / 2.0
    x = np.append(0.0, c)
    gaps = x[:, None] - x + np.eye(m + 1)
    barycentric = 1.0 / gaps.prod(axis=1)
    differentiation = (barycentric / barycentric[:, None]) / gaps
    np.fill_diagonal(differentiation, 0.0)
    np.fill_diagonal(differentiation, -differentiation.sum(axis=1))
    slopes = differentiation[1:]
    # A is the inverse of the derivatives' dependence on the inner values.
    A = np.linalg.inv(slopes[:, 1:])
    # For u^(m+1) = 1 the derivative is off by the product of (s - c_i) over m!.
    error = np.polynomial.Polynomial.fromroots(c).integ() / factorial(m)
    constant = float(np.abs(error(np.linspace(0.0, 1.0, 2001))).max())
    return Scheme(c, b, A, x, barycentric, slopes, barycentric * factorial(m), constant)
