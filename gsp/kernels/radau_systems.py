"""The linear systems of Radau's iteration: (lambda/h - J) x = b for one real and several complex eigenvalues."""

from __future__ import annotations

from gsp.kernels.compilation import kernel
from gsp.kernels.linear_algebra import factorise
from gsp.kernels.radau_tableau import EIGENVALUES


@kernel
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
def decompose(jacobian_flat, step, family, system):
    """Factors of lambda/h - J for each eigenvalue of the family; False when one is singular."""
    real, complexes, pivots, complex_pivots = system
    pairs, n, _ = complexes.shape
    for i in range(n):
        for j in range(n):
            entry = -jacobian_flat[i * n + j]
            real[i, j] = entry
            for m in range(pairs):
                complexes[m, i, j] = entry
        real[i, i] += EIGENVALUES[family, 0].real / step
        for m in range(pairs):
            complexes[m, i, i] += EIGENVALUES[family, m + 1] / step
    if not factorise(real, pivots):
        return False
    for m in range(pairs):  # noqa: SIM110 - a generator does not compile
        if not factorise_complex(complexes, m, complex_pivots):
            return False
    return True
