"""Matrices of rational numbers: their null spaces and eigenvectors by elimination, in python-flint."""

from __future__ import annotations

import flint
import sympy as sp


def rational_matrix(matrix: sp.Matrix) -> flint.fmpq_mat | None:
    """`matrix` in python-flint, or None where an entry is no rational number."""
    if not all(entry.is_Rational for entry in matrix):
        return None
    return flint.fmpq_mat(*matrix.shape, [flint.fmpq(int(entry.p), int(entry.q)) for entry in matrix])  # pyright: ignore[reportCallIssue]


def null_space(matrix: flint.fmpq_mat) -> list[list[flint.fmpq]]:
    """A basis of the vectors v with `matrix` v = 0, one for each column that elimination leaves without a pivot."""
    echelon, rank = matrix.rref()
    columns = matrix.ncols()
    pivots = [next(j for j in range(columns) if echelon[i, j] != 0) for i in range(rank)]
    basis = []
    for free in sorted(set(range(columns)) - set(pivots)):
        vector = [flint.fmpq(int(j == free)) for j in range(columns)]
        for i, pivot in enumerate(pivots):
            vector[pivot] = -echelon[i, free]
        basis.append(vector)
    return basis


def rational_eigenvectors(matrix: flint.fmpq_mat) -> list[tuple[flint.fmpq, list[flint.fmpq]]] | None:
    """(eigenvalue, eigenvector) for a basis of eigenvectors; None without one of rational eigenvalues.

    The roots are those of the linear factors of the characteristic polynomial over the rationals.
    """
    n = matrix.nrows()
    factors = matrix.charpoly().factor()[1]
    if any(factor.degree() > 1 for factor, _ in factors):
        return None
    unit = flint.fmpq_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])  # pyright: ignore[reportCallIssue]
    pairs = []
    for factor, times in factors:
        value = -flint.fmpq(factor[0]) / factor[1]
        vectors = null_space(matrix - unit * value)
        if len(vectors) < times:
            return None
        pairs += [(value, vector) for vector in vectors]
    return pairs
