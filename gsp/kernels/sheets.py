"""A sheet g(x, y) = 0 followed over one straight line in x: Euler steps in y and Newton's corrections."""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.linear_algebra import factorise, norm, solve
from gsp.kernels.step_control import all_finite
from gsp.kernels.uncounted import uncounted

# A correction this share of the step before it may lead to another sheet, and so may one of this share squared after a
# step of second order: of 6,438 points over sheets with many folds 16 were another sheet's, 733 at 0.25 without the
# second test, and 1 at 0.1, for half as many corrections again. Below this share of 1 + |y| it is rounding.
TRUSTED, ROUNDING = 0.2, 1e-9


@kernel
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


@kernel
def _euler(slow_jacobian, p, z, slow, way, factors, pivots, step):
    """The change of y along the `way` in x, by the slope at `z`, where g_y is factorised."""
    m = way.shape[0]
    call(slow_jacobian, 0.0, z, p, slow)
    for i in range(step.shape[0]):
        step[i] = 0.0
        for j in range(m):
            step[i] -= slow[i * m + j] * way[j]
    solve(factors, pivots, step)


@kernel
def follow_sheet(functions, p, x, y, target, pieces, tolerance, rounds):
    """Follow the sheet from (x, y) to `target` (n_slow,) in `pieces` equal steps; True if each can be trusted.

    The compiled `functions` give g (n,), g_y (n, n) and g_x (n, n_slow) at z = (x, y). `y` (n,) becomes the point over
    the target. Newton's method ends at corrections of `tolerance` (1 + |y|) that are small beside |y| too, or one round
    later, or is given up after so many `rounds`.
    """
    residual, jacobian, slow_jacobian = functions
    m = x.shape[0]
    n = y.shape[0]
    # One array: each that is allocated costs as much as a round on a small problem.
    scratch = np.empty(2 * m + 5 * n + 2 * n * n + n * m)
    z = scratch[: m + n]
    way = scratch[m + n : 2 * m + n]
    step = scratch[2 * m + n : 2 * m + 2 * n]
    predicted = scratch[2 * m + 2 * n : 2 * m + 3 * n]
    change = scratch[2 * m + 3 * n : 2 * m + 4 * n]
    rest = 2 * m + 5 * n
    pivots = scratch[rest - n : rest].view(np.int64)
    flat = scratch[rest : rest + n * n]
    factors = scratch[rest + n * n : rest + 2 * n * n].reshape((n, n))
    slow = scratch[rest + 2 * n * n :]
    # Entry by entry: numba's own assignment compiles, for 2 s, the message that shapes do not fit.
    for i in range(m):
        z[i] = x[i]
        way[i] = (target[i] - x[i]) / pieces
    for i in range(n):
        z[m + i] = y[i]
    orientation = _linearise(jacobian, p, z, flat, factors, pivots)
    if orientation == 0.0:
        return False
    _euler(slow_jacobian, p, z, slow, way, factors, pivots, step)
    length = norm(way)
    for piece in range(pieces):
        moved = norm(step) + length
        for j in range(m):
            z[j] = target[j] if piece == pieces - 1 else x[j] + (piece + 1) * way[j]
        for i in range(n):
            change[i] = step[i]
            z[m + i] += step[i]
            predicted[i] = z[m + i]
        converged = small = False
        for _ in range(rounds):
            call(residual, 0.0, z, p, step)
            if not all_finite(step) or _linearise(jacobian, p, z, flat, factors, pivots) == 0.0:
                return False
            solve(factors, pivots, step)
            correction = norm(step)
            far = norm(z[m:])
            scale = 1.0 + far
            if not correction < math.inf:
                return False
            # Damped to steps of length 1 + |y|: a nearly singular Jacobian must not throw the point away.
            share = min(1.0, scale / max(correction, 1e-300))
            for i in range(n):
                z[m + i] -= share * step[i]
            # In units in which y is tiny a small correction may be a large share of it: once more, and it is none.
            small, before = correction <= tolerance * scale, small
            if small and (before or correction <= math.sqrt(tolerance) * far):
                converged = True
                break
        for i in range(n):
            predicted[i] = z[m + i] - predicted[i]
        rounding = ROUNDING * (1.0 + norm(z[m:]))
        if not converged or not norm(predicted) <= TRUSTED * moved + rounding:
            return False
        if _linearise(jacobian, p, z, flat, factors, pivots) != orientation:
            return False
        # With the mean of the slopes at both ends the step is of second order.
        _euler(slow_jacobian, p, z, slow, way, factors, pivots, step)
        for i in range(n):
            predicted[i] -= (step[i] - change[i]) / 2.0
        if not norm(predicted) <= TRUSTED**2 * (norm(step) + length) + rounding:
            return False
    for i in range(n):
        y[i] = z[m + i]
    return True


@kernel
def reach_sheet(sheet, target, y):
    """Fill `y` (n,) with the point over `target` (n_slow,) of the sheet that a seed lies on; True if it was reached.

    `sheet` are the three addresses of `follow_sheet`, its rounds, how many numbers of pieces are tried one after the
    other, and these; then, as bits, its tolerance, the seed (x, y) about centres and in units, these units and centres,
    and p.
    """
    sheet, target, y = uncounted(sheet), uncounted(target), uncounted(y)
    tried = 5 + sheet[4]
    numbers = sheet[tried:].view(np.float64)
    m = 1 + target.shape[0]
    n = m + y.shape[0]
    units, centres = numbers[n : 2 * n - 1], numbers[2 * n - 1 : 3 * n - 2]
    scaled = np.empty(m - 1)
    for i in range(m - 1):
        scaled[i] = (target[i] - centres[i]) / units[i]
    for pieces in sheet[5:tried]:
        for i in range(y.shape[0]):
            y[i] = numbers[m + i]
        functions = (sheet[0], sheet[1], sheet[2])
        if follow_sheet(functions, numbers[3 * n - 2 :], numbers[1:m], y, scaled, pieces, numbers[0], sheet[3]):
            for i in range(y.shape[0]):
                y[i] = y[i] * units[m - 1 + i] + centres[m - 1 + i]
            return True
    return False


@kernel
def reach_sheets(sheet, targets, out, found):
    """`reach_sheet` over each of `targets` (k, n_slow), into row i of `out` (k, n); `found` (k,) says which."""
    sheet, targets, out = uncounted(sheet), uncounted(targets), uncounted(out)
    for i in range(targets.shape[0]):
        found[i] = reach_sheet(sheet, targets[i], out[i])
