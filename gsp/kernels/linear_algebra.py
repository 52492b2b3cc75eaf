"""Dense linear systems of a few unknowns: norms, and LU factors with partial pivoting, in place.

LAPACK's call costs more than the arithmetic below about ten unknowns.
"""

from __future__ import annotations

import math

from gsp.kernels.compilation import kernel


@kernel
def norm(vector):
    """The Euclidean norm of `vector` (n,)."""
    # A loop: the array of the squares would be allocated, and `np.sum` takes longer to compile.
    total = 0.0
    for value in vector:
        total += value * value
    return math.sqrt(total)


@kernel
def factorise(matrix, pivots):
    """Overwrite `matrix` (n, n) by its LU factors, U's diagonal inverted; False when a pivot is 0 or NaN."""
    n = matrix.shape[0]
    for k in range(n):
        row = k
        largest = abs(matrix[k, k])
        for i in range(k + 1, n):
            size = abs(matrix[i, k])
            if size > largest:
                largest = size
                row = i
        pivots[k] = row
        if not largest > 0.0:
            return False
        if row != k:
            for j in range(n):
                matrix[k, j], matrix[row, j] = matrix[row, j], matrix[k, j]
        inverse = 1.0 / matrix[k, k]
        matrix[k, k] = inverse
        for i in range(k + 1, n):
            factor = matrix[i, k] * inverse
            matrix[i, k] = factor
            if factor != 0.0:
                for j in range(k + 1, n):
                    matrix[i, j] -= factor * matrix[k, j]
    return True


@kernel
def solve(factors, pivots, b):
    """Overwrite `b` (n,) by the solution, with what `factorise` left in `factors` and `pivots`."""
    n = b.shape[0]
    for k in range(n):
        row = pivots[k]
        b[k], b[row] = b[row], b[k]
    for i in range(1, n):
        total = b[i]
        for j in range(i):
            total -= factors[i, j] * b[j]
        b[i] = total
    for i in range(n - 1, -1, -1):
        total = b[i]
        for j in range(i + 1, n):
            total -= factors[i, j] * b[j]
        b[i] = total * factors[i, i]
