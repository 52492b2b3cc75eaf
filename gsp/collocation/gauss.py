"""Gauss's collocation methods: nodes, weights and the Runge-Kutta matrix on the unit interval."""

from __future__ import annotations

import numpy as np


def gauss_tableau(stages: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(c, b, A), shapes (s,), (s,) and (s, s): A_jk is the integral from 0 to c_j of the k-th Lagrange polynomial.

    Of order 2s. Hairer, Norsett, Wanner I, section II.7.
    """
    points, weights = np.polynomial.legendre.leggauss(stages)
    c = (1.0 + points) / 2.0
    powers = np.arange(1, stages + 1)
    vandermonde = c[:, None] ** (powers - 1)
    return c, weights / 2.0, np.ascontiguousarray((c[:, None] ** powers / powers) @ np.linalg.inv(vandermonde))
