"""Eigenvalues of fast Jacobians that may be far from normal: in double precision where that decides, else exactly.

Rounding moves the eigenvalues of a Jordan block of size m by its m-th root. Where their condition numbers (Wilkinson,
The Algebraic Eigenvalue Problem, 1965, chapter 2) leave digits in doubt, the matrix is taken as the exact numbers that
its entries are, and its eigenvalues are the roots of its exact characteristic polynomial. A larger matrix is made
symmetric by a change of units where that can be, as for chains and lines of diffusion: rounding then moves an
eigenvalue by no more than rounding.
"""

from __future__ import annotations

import numpy as np

from gsp.algebra.polynomials import characteristic_roots

# Relative error of an eigenvalue above which it is computed exactly.
CERTAIN = 1e-6
# Past this size an exact characteristic polynomial takes seconds.
LARGEST = 12
# A change of the entries by this relative amount is rounding that has added up on the way to them.
ENTRIES = 1e-13


def eigenvalues(matrices: np.ndarray) -> np.ndarray:
    """Eigenvalues (m, n), complex, of finite matrices (m, n, n), each to `CERTAIN` or as near as doubles allow."""
    if matrices.shape[-1] > LARGEST:
        return np.array([_of_large(matrix) for matrix in matrices]).reshape(matrices.shape[:2])
    values = np.linalg.eigvals(matrices).astype(complex)
    n = matrices.shape[-1]
    if n < 2 or not len(matrices):
        return values
    # Rounding errors of an eigenvalue problem of size n (LAPACK Users' Guide, 4.8).
    unit = 4.0 * n * np.finfo(float).eps
    # In units of the largest entry, for squares of what a run near its blow-up holds overflow.
    largest = np.abs(matrices).max(axis=(1, 2))
    largest[largest == 0.0] = 1.0
    scaled = matrices / largest[:, np.newaxis, np.newaxis]
    sizes = np.linalg.norm(scaled, axis=(1, 2))
    least = np.abs(values).min(axis=1) / largest
    # Elsner's bound: no eigenvalue is farther off than this, whatever the matrix (Stewart and Sun 1990, IV.1.3).
    farthest = 2.0 * sizes * unit ** (1.0 / n)
    for i in np.flatnonzero((farthest > CERTAIN * least) & (n <= LARGEST)):
        if _error(scaled[i], unit * sizes[i]) > CERTAIN:
            values[i] = characteristic_roots(matrices[i])
    return values


def _of_large(matrix: np.ndarray) -> np.ndarray:
    symmetric = symmetrised(matrix)
    return (np.linalg.eigvals(matrix) if symmetric is None else np.linalg.eigvalsh(symmetric)).astype(complex)


def symmetrised(matrix: np.ndarray) -> np.ndarray | None:
    """D^-1 A D for a finite matrix A (n, n) when a diagonal D > 0 makes it symmetric, else None.

    D is found along a tree of A's entries: D_j / D_i = sqrt(A_ji / A_ij), in logarithms, which do not overflow.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    i, j = np.nonzero(matrix)
    forth, back = matrix[i, j], matrix[j, i]
    with np.errstate(over="ignore", under="ignore"):
        if not (np.sign(forth) == np.sign(back)).all():
            return None
    half = 0.5 * (np.log(np.abs(back)) - np.log(np.abs(forth)))
    n = len(matrix)
    step = csr_matrix((half, (i, j)), shape=(n, n))
    pattern = csr_matrix((np.ones(len(i)), (i, j)), shape=(n, n))
    units = np.zeros(n)
    _, labels = connected_components(pattern, directed=False)
    for first in np.unique(labels, return_index=True)[1]:
        order, parents = breadth_first_order(pattern, first, directed=False)
        for node in order[1:]:
            units[node] = units[parents[node]] + step[parents[node], node]
    # How well the logarithms of units agree around a loop.
    if not (np.abs(units[j] - units[i] - half) <= 1e-10 * (1.0 + np.abs(half))).all():
        return None
    found = np.zeros((n, n))
    found[i, j] = np.sign(forth) * np.sqrt(np.abs(forth)) * np.sqrt(np.abs(back))
    return found


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
