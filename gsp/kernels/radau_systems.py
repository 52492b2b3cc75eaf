"""The linear systems of Radau's iteration: (lambda/h - J) x = b for one real and several complex eigenvalues."""

from __future__ import annotations

import numpy as np

from gsp.kernels.compilation import inner_kernel, kernel
from gsp.kernels.linear_systems import decompose_shifted
from gsp.kernels.radau_tableau import EIGENVALUES
from gsp.kernels.sparse_systems import FACTORS, dense_jacobian, factorise_sparse, fill, solve_sparse


@inner_kernel
def _size(z):
    return abs(z.real) + abs(z.imag)


@kernel
def factorise_complex(matrices, m, pivots):
    """`factorise` for the complex matrix m, with pivots by |Re| + |Im|: the modulus would cost a root each.

    Here and below an index goes in with the whole array: each slice would cost two atomic counts of references.
    """
    n = matrices.shape[1]
    for k in range(n):
        row = k
        largest = _size(matrices[m, k, k])
        for i in range(k + 1, n):
            size = _size(matrices[m, i, k])
            if size > largest:
                largest = size
                row = i
        pivots[m, k] = row
        if not largest > 0.0:
            return False
        if row != k:
            for j in range(n):
                matrices[m, k, j], matrices[m, row, j] = matrices[m, row, j], matrices[m, k, j]
        inverse = 1.0 / matrices[m, k, k]
        matrices[m, k, k] = inverse
        for i in range(k + 1, n):
            factor = matrices[m, i, k] * inverse
            matrices[m, i, k] = factor
            if factor != 0.0:
                for j in range(k + 1, n):
                    matrices[m, i, j] -= factor * matrices[m, k, j]
    return True


@kernel
def solve_complex(factors, m, pivots, b):
    """`solve` with what `factorise_complex` left."""
    n = b.shape[0]
    for k in range(n):
        row = pivots[m, k]
        b[k], b[row] = b[row], b[k]
    for i in range(1, n):
        total = b[i]
        for j in range(i):
            total -= factors[m, i, j] * b[j]
        b[i] = total
    for i in range(n - 1, -1, -1):
        total = b[i]
        for j in range(i + 1, n):
            total -= factors[m, i, j] * b[j]
        b[i] = total * factors[m, i, i]


@kernel
def solve_complex_shifted(pattern, factors, m, pivots, b):
    """Overwrite `b` (n,) by the solution of the complex system m, with what `decompose` left."""
    if factors.shape[1] == b.shape[0]:
        solve_complex(factors, m, pivots, b)
    else:
        solve_sparse(pattern, factors[m, 0], b)


@inner_kernel
def _decompose_complex(jacobian, step, family, pattern, pivots):
    """(whether all are regular, factors (pairs, ...)) of lambda/h - J for the complex eigenvalues of the family."""
    pairs, n = pivots.shape
    if pattern.shape[0] != 0:
        values = np.empty((pairs, 1, pattern[FACTORS]), np.complex128)
        row = np.empty(n, np.complex128)
        largest = np.empty(n)
        usable = True
        for m in range(pairs):
            fill(jacobian, EIGENVALUES[family, m + 1] / step, pattern, n, values[m, 0])
            usable = usable and factorise_sparse(pattern, values[m, 0], row, largest)
        if usable:
            return True, values
    full = dense_jacobian(jacobian, pattern, n)
    matrices = np.empty((pairs, n, n), np.complex128)
    for m in range(pairs):
        for i in range(n):
            for j in range(n):
                matrices[m, i, j] = -full[i * n + j]
            matrices[m, i, i] += EIGENVALUES[family, m + 1] / step
        if not factorise_complex(matrices, m, pivots):
            return False, matrices
    return True, matrices


@kernel
def decompose(jacobian, step, family, pattern, pivots, complex_pivots):
    """(whether all are regular, factors of lambda/h - J for the real eigenvalue of the family, for the complex ones).

    `jacobian` is (n*n,), or has the entries of `pattern`; `pivots` (n,) and `complex_pivots` (pairs, n) go with them.
    """
    n = pivots.shape[0]
    regular, real = decompose_shifted(jacobian, EIGENVALUES[family, 0].real / step, pattern, n, pivots)
    if not regular:
        return False, real, np.empty((0, 0, 0), np.complex128)
    regular, complexes = _decompose_complex(jacobian, step, family, pattern, complex_pivots)
    return regular, real, complexes
