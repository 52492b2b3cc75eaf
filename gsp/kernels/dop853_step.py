"""A step of DOP853 for any flow: twelve stages, and three more where a dense output is wanted."""

from __future__ import annotations

import math

from gsp.kernels import integrator
from gsp.kernels.call import call
from gsp.kernels.compilation import inlined_kernel, kernel
from gsp.kernels.dop853_tableau import DENSE, ERROR_3, ERROR_5, EXTENDED_STAGES, STAGES, A, C
from gsp.kernels.step_control import all_finite

# Rows of scratch: the rates of the stages, two arguments and a value.
SCRATCH = EXTENDED_STAGES + 3


@inlined_kernel
def _stage(s, shape, flow, at, y, k, argument, value):
    """Rate s, the row k[s] of `k` (16, n), at `argument`; written in where it is called, the sum has no loop."""
    field, p = flow
    t, h = at
    _, n = shape
    for i in range(n):
        total = 0.0
        for q in range(s):
            # Half of the tableau is 0; known when this is compiled.
            if A[s, q] != 0.0:
                total += A[s, q] * k[q, i]
        argument[i] = y[i] + h * total
    call(field, t + C[s] * h, argument, p, value)
    for i in range(n):
        k[s, i] = value[i]


@inlined_kernel
def _error(h, shape, y, y_new, k, rtol, atol):
    """Norm of the error, the estimate of order 5 damped by that of order 3; section II.10."""
    _, n = shape
    fifth = 0.0
    third = 0.0
    for i in range(n):
        scale = atol + rtol * max(abs(y[i]), abs(y_new[i]))
        total_5 = 0.0
        total_3 = 0.0
        for q in range(STAGES):
            total_5 += ERROR_5[q] * k[q, i]
            total_3 += ERROR_3[q] * k[q, i]
        fifth += (total_5 / scale) ** 2
        third += (total_3 / scale) ** 2
    together = fifth + 0.01 * third
    if together == 0.0:
        return 0.0
    return abs(h) * fifth / math.sqrt(n * together)


@inlined_kernel
def _interpolate(shape, h, y, y_new, k, rows):
    """Coefficients of the dense output in the nesting of `interpolate_many`; section II.6."""
    _, n = shape
    for i in range(n):
        rise = y_new[i] - y[i]
        rows[0, i] = h * k[0, i] - rise
        rows[1, i] = 2.0 * rise - h * (k[STAGES, i] + k[0, i])
        for m in range(4):
            total = 0.0
            for q in range(EXTENDED_STAGES):
                total += DENSE[m, q] * k[q, i]
            rows[2 + m, i] = h * total


@inlined_kernel
def _stretch(h, shape, y_new, last_argument, k):
    """The square of h times a Lipschitz quotient between the two points at t + h."""
    _, n = shape
    rise = 0.0
    run = 0.0
    for i in range(n):
        rise += (k[STAGES, i] - k[STAGES - 1, i]) ** 2
        run += (y_new[i] - last_argument[i]) ** 2
    return h * h * rise / run if run > 0.0 else 0.0


@kernel
def explicit_step(flow, at, start, tolerances, wants, new, room, counters):
    """One step: (error over the tolerance, what is wrong if it is infinite, (h times a Lipschitz quotient)^2).

    `flow` is (field, p), `at` (t, h), `start` and `new` a state and its rate. Where the step is good and its rows
    (6, n) of the dense output are wanted, they must be finite too. `room` is for these and (SCRATCH, n).
    """
    _, h = at
    y, rate = start
    rtol, atol = tolerances
    y_new, rate_new = new
    rows, scratch = room
    shape = rows.shape
    _, n = shape
    k = scratch[:EXTENDED_STAGES]
    argument = scratch[EXTENDED_STAGES]
    last_argument = scratch[EXTENDED_STAGES + 1]
    value = scratch[EXTENDED_STAGES + 2]
    for i in range(n):
        k[0, i] = rate[i]
    _stage(1, shape, flow, at, y, k, argument, value)
    _stage(2, shape, flow, at, y, k, argument, value)
    _stage(3, shape, flow, at, y, k, argument, value)
    _stage(4, shape, flow, at, y, k, argument, value)
    _stage(5, shape, flow, at, y, k, argument, value)
    _stage(6, shape, flow, at, y, k, argument, value)
    _stage(7, shape, flow, at, y, k, argument, value)
    _stage(8, shape, flow, at, y, k, argument, value)
    _stage(9, shape, flow, at, y, k, argument, value)
    _stage(10, shape, flow, at, y, k, argument, value)
    _stage(11, shape, flow, at, y, k, last_argument, value)
    # Row 13 of the tableau is the solution itself.
    _stage(12, shape, flow, at, y, k, y_new, rate_new)
    counters[integrator.FIELD_CALLS] += STAGES
    if not (all_finite(y_new) and all_finite(rate_new)):
        return math.inf, integrator.NON_FINITE, 0.0
    error = _error(h, shape, y, y_new, k, rtol, atol)
    if error <= 1.0 and wants:
        _stage(13, shape, flow, at, y, k, argument, value)
        _stage(14, shape, flow, at, y, k, argument, value)
        _stage(15, shape, flow, at, y, k, argument, value)
        counters[integrator.FIELD_CALLS] += EXTENDED_STAGES - STAGES - 1
        _interpolate(shape, h, y, y_new, k, rows)
        for i in range(n):
            if not (math.isfinite(rows[2, i]) and math.isfinite(rows[5, i])):
                return math.inf, integrator.NON_FINITE, 0.0
    return error, integrator.STEP_TOO_SMALL, _stretch(h, shape, y_new, last_argument, k)
