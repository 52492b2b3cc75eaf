"""DOP853, the integrator for flows without a fast time scale: explicit, order 8(5,3), dense output of order 7.

Twelve calls of the field a step, and three more where a dense output is recorded; the steps are the same, but beside
the border of the field's domain, where these three must be finite too. See `dop853_tableau` for the source. The
Jacobian is an argument only because every integrator has the same signature.
"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels import ledger
from gsp.kernels.call import call
from gsp.kernels.compilation import inlined_kernel, kernel
from gsp.kernels.dop853_tableau import DENSE, ERROR_3, ERROR_5, EXTENDED_STAGES, STAGES, A, C
from gsp.kernels.step_control import accept, all_finite, begin, next_step, reject

# Control of the step as in DOP853: safety 0.9, change between 1/3 and 6.
SAFETY = 0.9
MINIMUM_FACTOR = 1.0 / 3.0
MAXIMUM_FACTOR = 6.0
# PI control, Hairer, Norsett, Wanner I, section II.4; 0.04 is the largest beta that the code's manual advises.
BETA = 0.04
EXPONENT = 1.0 / 8.0 - 0.2 * BETA
ERROR_FLOOR = 1e-4
LARGEST_GROWTH = ERROR_FLOOR**-BETA
FAILURE_FACTOR = 0.1
# |h lambda| at the border of stability; how many signs make or clear a suspicion (DOP853; II, section IV.2).
STABILITY_BORDER = 6.1
STIFF_SIGNS = 15
NON_STIFF_SIGNS = 6


@inlined_kernel
def _stage(s, shape, field, p, t, h, y, k, argument, value):
    """Rate s, the row k[s] of `k` (16, n), at `argument`; written in where it is called, the sum has no loop."""
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
def _record_dense(row, shape, h, y, y_new, k, dense):
    """Coefficients of the dense output in the nesting of `interpolate_many`; section II.6."""
    _, n = shape
    for i in range(n):
        rise = y_new[i] - y[i]
        dense[row, 0, i] = h * k[0, i] - rise
        dense[row, 1, i] = 2.0 * rise - h * (k[STAGES, i] + k[0, i])
        for m in range(4):
            total = 0.0
            for q in range(EXTENDED_STAGES):
                total += DENSE[m, q] * k[q, i]
            dense[row, 2 + m, i] = h * total


@inlined_kernel
def _looks_stiff(h, shape, y_new, last_argument, k):
    """Hairer's test: h times a Lipschitz quotient between the two points at t + h is beyond the border."""
    _, n = shape
    rise = 0.0
    run = 0.0
    for i in range(n):
        rise += (k[STAGES, i] - k[STAGES - 1, i]) ** 2
        run += (y_new[i] - last_argument[i]) ** 2
    return run > 0.0 and abs(h) * math.sqrt(rise / run) > STABILITY_BORDER


@kernel
def dop853(
    program,
    p,
    stops,
    rtol,
    atol,
    max_steps,
    y,
    rate,
    memory,
    counters,
    times,
    states,
    dense,
):
    """Advance until the last stop, a full record or a failure; see `ledger` for arguments and codes."""
    field = program[ledger.FIELD]
    shape = dense.shape[1:]
    _, n = shape
    # One array in place of five, whose making would be a tenth of a short run.
    scratch = np.empty((EXTENDED_STAGES + 4, n))
    k = scratch[:EXTENDED_STAGES]
    argument = scratch[EXTENDED_STAGES]
    last_argument = scratch[EXTENDED_STAGES + 1]
    y_new = scratch[EXTENDED_STAGES + 2]
    value = scratch[EXTENDED_STAGES + 3]
    if not begin(field, p, y, rate, stops[-1], rtol, atol, 8, argument, y_new, memory, counters):
        return ledger.NON_FINITE
    recorded = 0
    while True:
        code, t, step, t_new, clipped, lands = next_step(
            stops, max_steps, recorded, times.shape[0], memory, counters
        )
        if code != ledger.GOING_ON:
            return code

        for i in range(n):
            k[0, i] = rate[i]
        _stage(1, shape, field, p, t, step, y, k, argument, value)
        _stage(2, shape, field, p, t, step, y, k, argument, value)
        _stage(3, shape, field, p, t, step, y, k, argument, value)
        _stage(4, shape, field, p, t, step, y, k, argument, value)
        _stage(5, shape, field, p, t, step, y, k, argument, value)
        _stage(6, shape, field, p, t, step, y, k, argument, value)
        _stage(7, shape, field, p, t, step, y, k, argument, value)
        _stage(8, shape, field, p, t, step, y, k, argument, value)
        _stage(9, shape, field, p, t, step, y, k, argument, value)
        _stage(10, shape, field, p, t, step, y, k, argument, value)
        _stage(11, shape, field, p, t, step, y, k, last_argument, value)
        # Row 13 of the tableau is the solution itself.
        _stage(12, shape, field, p, t, step, y, k, y_new, value)
        counters[ledger.FIELD_CALLS] += STAGES
        error = math.inf
        failure = ledger.NON_FINITE
        if all_finite(y_new) and all_finite(value):
            failure = ledger.STEP_TOO_SMALL
            error = _error(step, shape, y, y_new, k, rtol, atol)
            if error <= 1.0 and recorded < dense.shape[0]:
                _stage(13, shape, field, p, t, step, y, k, argument, value)
                _stage(14, shape, field, p, t, step, y, k, argument, value)
                _stage(15, shape, field, p, t, step, y, k, argument, value)
                counters[ledger.FIELD_CALLS] += EXTENDED_STAGES - STAGES - 1
                _record_dense(recorded, shape, step, y, y_new, k, dense)
                for i in range(n):
                    if not (math.isfinite(dense[recorded, 2, i]) and math.isfinite(dense[recorded, 5, i])):
                        error = math.inf
                        failure = ledger.NON_FINITE

        if error <= 1.0:
            times[recorded] = t_new
            for i in range(n):
                states[recorded, i] = y_new[i]
            recorded += 1
            if _looks_stiff(step, shape, y_new, last_argument, k):
                counters[ledger.NON_STIFF_SIGNS] = 0
                counters[ledger.STIFF_SIGNS] += 1
                if counters[ledger.STIFF_SIGNS] == STIFF_SIGNS:
                    counters[ledger.STIFF] = 1
            else:
                counters[ledger.NON_STIFF_SIGNS] += 1
                if counters[ledger.NON_STIFF_SIGNS] == NON_STIFF_SIGNS:
                    counters[ledger.STIFF_SIGNS] = 0
            factor = MAXIMUM_FACTOR
            # The code starts its memory at the floor.
            growth = max(error, ERROR_FLOOR) ** -BETA
            if error > 0.0:
                previous = memory[ledger.PREVIOUS_GROWTH]
                factor = SAFETY / (previous if previous > 0.0 else LARGEST_GROWTH) * error**-EXPONENT
                factor = min(MAXIMUM_FACTOR, max(MINIMUM_FACTOR, factor))
            accept(t_new, step, clipped, lands, growth, factor, memory, counters)
            for i in range(n):
                y[i] = y_new[i]
                rate[i] = k[STAGES, i]
            if counters[ledger.NEXT_STOP] == stops.shape[0]:
                return ledger.FINISHED
        else:
            factor = FAILURE_FACTOR
            if math.isfinite(error):
                factor = max(MINIMUM_FACTOR, SAFETY * error**-EXPONENT)
            if not reject(step, factor, memory, counters):
                return failure
