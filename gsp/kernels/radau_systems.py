"""The linear systems of Radau's iteration: (lambda/h - J) x = b for one real and several complex eigenvalues."""

from __future__ import annotations

import numpy as np

from gsp.kernels.compilation import kernel
from gsp.kernels.linear_algebra import solve
from gsp.kernels.linear_systems import decompose_shifted
from gsp.kernels.quads import LANES, QUAD
from gsp.kernels.radau_tableau import EIGENVALUES
from gsp.kernels.sparse_quads import factorise_quads, fill_quads, solve_quads
from gsp.kernels.sparse_systems import FACTORS, dense_jacobian


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
def _decompose_sparse(jacobian, step, family, pairs, pattern, n):
    """(whether the fixed pivots serve, the factors (1, factors) of the real system, the quads of all systems).

    The real system is the first of four, and one again where the family has fewer complex ones than three.
    """
    shifts = np.zeros(QUAD)
    for m in range(LANES):
        shift = EIGENVALUES[family, m if m <= pairs else 0] / step
        shifts[m], shifts[LANES + m] = shift.real, shift.imag
    count = pattern[FACTORS]
    quads, sizes = np.empty(QUAD * count), np.empty((3, n))
    fill_quads(jacobian, shifts, pattern, n, quads, sizes)
    usable = factorise_quads(pattern, quads, np.empty(QUAD * n), sizes, np.empty(QUAD))
    real = np.empty((1, count))
    for p in range(count):
        real[0, p] = quads[QUAD * p]
    return usable, real, quads


@kernel
def decompose(jacobian, step, family, pattern, pivots, complex_pivots):
    """Whether all systems lambda/h - J of the family are regular, and their factors: of the real one, of the complex
    ones (pairs, n, n), and the quads of all of them, empty where the factors are dense.

    `jacobian` is (n*n,), or has the entries of `pattern`; `pivots` (n,) and `complex_pivots` (pairs, n) go with them.
    """
    pairs, n = complex_pivots.shape
    if pattern.shape[0] != 0:
        usable, real, quads = _decompose_sparse(jacobian, step, family, pairs, pattern, n)
        if usable:
            return True, real, np.empty((0, 0, 0), np.complex128), quads
    full = dense_jacobian(jacobian, pattern, n)
    regular, real = decompose_shifted(full, EIGENVALUES[family, 0].real / step, pattern[:0], n, pivots)
    matrices = np.empty((pairs, n, n), np.complex128)
    for m in range(pairs):
        for i in range(n):
            for j in range(n):
                matrices[m, i, j] = -full[i * n + j]
            matrices[m, i, i] += EIGENVALUES[family, m + 1] / step
        regular = regular and factorise_complex(matrices, m, complex_pivots)
    return regular, real, matrices, np.empty(0)


@kernel
def _solve_dense(step, system, f, value, b):
    stages, n = f.shape
    family = (stages - 5) // 2
    real, complexes, _, pivots, complex_pivots = system
    for i in range(n):
        value[i] = f[0, i] * EIGENVALUES[family, 0].real / step
    solve(real, pivots, value)
    for i in range(n):
        f[0, i] = value[i]
    for m in range(stages // 2):
        twist = EIGENVALUES[family, m + 1] * (1.0 / step)
        for i in range(n):
            b[i] = twist * complex(f[2 * m + 1, i], f[2 * m + 2, i])
        solve_complex(complexes, m, complex_pivots, b)
        for i in range(n):
            f[2 * m + 1, i] = b[i].real
            f[2 * m + 2, i] = b[i].imag


@kernel
def _solve_sparse(pattern, step, quads, f, b):
    stages, n = f.shape
    family, pairs = (stages - 5) // 2, stages // 2
    for m in range(LANES):
        own = m if m <= pairs else 0
        twist = EIGENVALUES[family, own] / step
        for i in range(n):
            right = twist * (complex(f[2 * own - 1, i], f[2 * own, i]) if own else complex(f[0, i], 0.0))
            b[QUAD * i + m], b[QUAD * i + LANES + m] = right.real, right.imag
    solve_quads(pattern, quads, b, n)
    for i in range(n):
        f[0, i] = b[QUAD * i]
        for m in range(1, pairs + 1):
            f[2 * m - 1, i], f[2 * m, i] = b[QUAD * i + m], b[QUAD * i + LANES + m]


@kernel
def solve_stages(pattern, step, system, f, value, b, right):
    """Overwrite the transformed residuals `f` (stages, n) by the solutions of their systems, times lambda/h.

    `system` is what `decompose` found, with its pivots; `value` (n,), `b` (n,) and `right` (8 n,) are scratch, the last
    for quads alone.
    """
    if system[2].shape[0] != 0:
        _solve_sparse(pattern, step, system[2], f, right)
    else:
        _solve_dense(step, system, f, value, b)
