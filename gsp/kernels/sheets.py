"""A sheet g(x, y) = 0 followed over one straight line in x: Euler steps in y and Newton's corrections."""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels.call import call
from gsp.kernels.compilation import inner_kernel, kernel
from gsp.kernels.linear_algebra import factorise, solve
from gsp.kernels.step_control import all_finite

# A correction this share of the step before it may lead to another sheet; below the number it is rounding.
TRUSTED, ROUNDING = 0.25, 1e-9


@inner_kernel
def _linearise(jacobian, p, z, flat, factors, pivots):
    """Factorise g_y at `z`; the sign of its determinant, 0 where it cannot be told."""
    n = factors.shape[0]
    call(jacobian, 0.0, z, p, flat)
    if not all_finite(flat):
        return 0.0
    for i in range(n):
        for j in range(n):
            factors[i, j] = flat[i * n + j]
    if not factorise(factors, pivots):
        return 0.0
    sign = 1.0
    for i in range(n):
        if (pivots[i] != i) != (factors[i, i] < 0.0):
            sign = -sign
    return sign


@inner_kernel
def _length(vector):
    return math.sqrt(np.sum(vector * vector))


@kernel
def follow_sheet(residual, jacobian, slow_jacobian, p, x, y, target, pieces, tolerance, rounds):
    """Follow the sheet from (x, y) to `target` (n_slow,) in `pieces` equal steps; True if each can be trusted.

    The compiled functions give g (n,), g_y (n, n) and g_x (n, n_slow) at z = (x, y). `y` (n,) becomes the point over
    the target. Newton's method ends at corrections of `tolerance` (1 + |y|), or is given up after so many `rounds`.
    """
    m = x.shape[0]
    n = y.shape[0]
    z = np.empty(m + n)
    flat = np.empty(n * n)
    slow = np.empty(n * m)
    factors = np.empty((n, n))
    pivots = np.empty(n, np.int64)
    step = np.empty(n)
    # Entry by entry: numba's own assignment compiles, for 2 s, the message that shapes do not fit.
    for i in range(m):
        z[i] = x[i]
    for i in range(n):
        z[m + i] = y[i]
    orientation = _linearise(jacobian, p, z, flat, factors, pivots)
    for piece in range(pieces):
        call(slow_jacobian, 0.0, z, p, slow)
        if _linearise(jacobian, p, z, flat, factors, pivots) == 0.0:
            return False
        for i in range(n):
            step[i] = 0.0
            for j in range(m):
                step[i] -= slow[i * m + j] * (target[j] - x[j]) / pieces
        solve(factors, pivots, step)
        moved = _length(step) + _length(target - x) / pieces
        for j in range(m):
            z[j] = target[j] if piece == pieces - 1 else x[j] + (piece + 1) * (target[j] - x[j]) / pieces
        for i in range(n):
            z[m + i] += step[i]
        predicted = z[m:].copy()
        converged = False
        for _ in range(rounds):
            call(residual, 0.0, z, p, step)
            if not all_finite(step) or _linearise(jacobian, p, z, flat, factors, pivots) == 0.0:
                return False
            solve(factors, pivots, step)
            length = _length(step)
            scale = 1.0 + _length(z[m:])
            if not length < math.inf:
                return False
            # Damped to steps of length 1 + |y|: a nearly singular Jacobian must not throw the point away.
            share = min(1.0, scale / max(length, 1e-300))
            for i in range(n):
                z[m + i] -= share * step[i]
            if length <= tolerance * scale:
                converged = True
                break
        if not converged or not _length(z[m:] - predicted) <= TRUSTED * moved + ROUNDING:
            return False
    if orientation == 0.0 or _linearise(jacobian, p, z, flat, factors, pivots) != orientation:
        return False
    for i in range(n):
        y[i] = z[m + i]
    return True


@kernel
def follow_sheets(residual, jacobian, slow_jacobian, p, x, y, targets, pieces, tolerance, rounds, out, found):
    """`follow_sheet` from (x, y) to each of `targets` (k, n_slow), in the first number of `pieces` (q,) that serves.

    Row i of `out` (k, n) becomes the point over target i, where `found` (k,) says that it was reached.
    """
    for i in range(targets.shape[0]):
        found[i] = False
        for count in pieces:
            for j in range(y.shape[0]):
                out[i, j] = y[j]
            if follow_sheet(
                residual, jacobian, slow_jacobian, p, x, out[i], targets[i], count, tolerance, rounds
            ):
                found[i] = True
                break
