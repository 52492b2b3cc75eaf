"""The linear systems (shift - J) x = b of the integrators, with dense factors or with those of a sparse pattern.

Factors are (n, n), or (1, factors) for a pattern; where its fixed pivots cannot be used they are dense, with partial
pivoting.
"""

from __future__ import annotations

import numpy as np

from gsp.kernels.compilation import kernel
from gsp.kernels.linear_algebra import factorise, solve
from gsp.kernels.sparse_systems import FACTORS, dense_jacobian, factorise_sparse, fill, solve_sparse


@kernel
def decompose_shifted(jacobian, shift, pattern, n, pivots):
    """(True, the factors of shift - J); (False, whatever) where it is singular. `pivots` (n,) goes with them."""
    if pattern.shape[0] != 0:
        values, sizes = np.empty((1, pattern[FACTORS])), np.empty((3, n))
        fill(jacobian, shift, pattern, n, values[0], sizes)
        if factorise_sparse(pattern, values[0], np.empty(n), sizes):
            return True, values
    full = dense_jacobian(jacobian, pattern, n)
    factors = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            factors[i, j] = -full[i * n + j]
        factors[i, i] += shift
    return factorise(factors, pivots), factors


@kernel
def solve_shifted(pattern, factors, pivots, b):
    """Overwrite `b` (n,) by the solution, with what `decompose_shifted` left."""
    if factors.shape[0] == b.shape[0]:
        solve(factors, pivots, b)
    else:
        solve_sparse(pattern, factors[0], b)
