"""A compiled function at many points."""

from __future__ import annotations

import numpy as np

from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.uncounted import uncounted


@kernel
def evaluate_many(address, points, p, out):
    """Fill row i of `out` (m, outputs) with the function at row i of `points` (m, n)."""
    for i in range(points.shape[0]):
        call(address, 0.0, points[i], p, out[i])


@kernel
def observe(address, states, epsilon, constants, out):
    """`evaluate_many` at rows of `states` (m, n) that nobody may write to, with p = (epsilon, *constants[1:])."""
    n = states.shape[1]
    p = np.empty(constants.shape[0])
    for i in range(p.shape[0]):
        p[i] = constants[i]
    p[0] = epsilon
    z = np.empty(n)
    out = uncounted(out)
    for j in range(states.shape[0]):
        for i in range(n):
            z[i] = states[j, i]
        call(address, 0.0, z, p, out[j])


@kernel
def evaluate(address, t, z, p, out):
    """Fill `out` with the function at the state `z` (n,) at time `t`."""
    call(address, t, z, p, out)
