"""A compiled function at many points."""

from __future__ import annotations

from gsp.kernels.call import call
from gsp.kernels.compilation import kernel


@kernel
def evaluate_many(address, points, p, out):
    """Fill row i of `out` (m, outputs) with the function at row i of `points` (m, n)."""
    for i in range(points.shape[0]):
        call(address, 0.0, points[i], p, out[i])


@kernel
def evaluate(address, t, z, p, out):
    """Fill `out` with the function at the state `z` (n,) at time `t`."""
    call(address, t, z, p, out)
