"""Eigenvalues of fast Jacobians that may be far from normal: in double precision where that decides, else exactly.

Rounding moves the eigenvalues of a Jordan block of size m by its m-th root. Where their condition numbers (Wilkinson,
The Algebraic Eigenvalue Problem, 1965, chapter 2) leave digits in doubt, the matrix is taken as the exact numbers that
its entries are, and its eigenvalues are the roots of its exact characteristic polynomial.
"""

from __future__ import annotations

import numpy as np

from gsp.algebra.polynomials import characteristic_roots

# Relative error of an eigenvalue above which it is computed exactly.
CERTAIN = 1e-6
# Past this size an exact characteristic polynomial takes seconds.
LARGEST = 12
# Rounding errors of an eigenvalue problem of size n, in units of n times the machine's (LAPACK Users' Guide, 4.8).
ROUNDING = 4.0
# A change of the entries by this relative amount is rounding that has added up on the way to them.
ENTRIES = 1e-13


def eigenvalues(matrices: np.ndarray) -> np.ndarray:
    """Eigenvalues (m, n), complex, of finite matrices (m, n, n), each to `CERTAIN` or as near as doubles allow."""
    values = np.linalg.eigvals(matrices).astype(complex)
    n = matrices.shape[-1]
    if n < 2 or not len(matrices):
        return values
    unit = ROUNDING * n * np.finfo(float).eps
    sizes = np.linalg.norm(matrices, axis=(1, 2))
    least = np.abs(values).min(axis=1)
    # Elsner's bound: no eigenvalue is farther off than this, whatever the matrix (Stewart and Sun 1990, IV.1.3).
    farthest = 2.0 * sizes * unit ** (1.0 / n)
    for i in np.flatnonzero((farthest > CERTAIN * least) & (n <= LARGEST)):
        if _error(matrices[i], unit * sizes[i]) > CERTAIN:
            values[i] = characteristic_roots(matrices[i])
    return values


def _error(matrix: np.ndarray, perturbation: float) -> float:
    """Largest relative error that a perturbation of that norm makes in an eigenvalue: its condition number's share."""
    values, right = np.linalg.eig(matrix)
    try:
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        return float("inf")
    # Of a defective matrix the inverse has entries that overflow when squared.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        conditions = np.linalg.norm(left, axis=1) * np.linalg.norm(right, axis=0)
        errors = perturbation * conditions / np.abs(values)
    return float(np.max(np.nan_to_num(errors, nan=0.0, posinf=np.inf)))


def is_singular(matrices: np.ndarray) -> np.ndarray:
    """Which matrices (m, n, n) a relative change of their entries by `ENTRIES` makes singular.

    The relative change of det A is at most the entries' times sum |A_ij| |(A^-1)_ji|, to first order. Units of rows
    and columns do not matter to it.
    """
    result = np.ones(len(matrices), dtype=bool)
    for i, matrix in enumerate(matrices):
        try:
            inverse = np.linalg.inv(matrix)
        except np.linalg.LinAlgError:
            continue
        change = ENTRIES * float((np.abs(matrix) * np.abs(inverse.T)).sum())
        result[i] = not change < 1.0
    return result
