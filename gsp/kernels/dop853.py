"""DOP853, the integrator for flows without a fast time scale: explicit, order 8(5,3), dense output of order 7.

Twelve calls of the field a step, and three more where a dense output is recorded; the steps are the same, but beside
the border of the field's domain, where these three must be finite too. See `dop853_tableau` for the source. The
Jacobian is an argument only because every integrator has the same signature.
"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels import integrator
from gsp.kernels.compilation import kernel
from gsp.kernels.dop853_step import SCRATCH, explicit_step
from gsp.kernels.dop853_tableau import DENSE_ROWS
from gsp.kernels.step_control import accept, begin, next_step, reject

# Control of the step as in DOP853: safety 0.9, change between 1/3 and 6.
SAFETY = 0.9
MINIMUM_FACTOR = 1.0 / 3.0
MAXIMUM_FACTOR = 6.0
# PI control, Hairer, Norsett, Wanner I, section II.4; 0.04 is the largest beta that the code's manual advises.
BETA = 0.04
EXPONENT = 1.0 / 8.0 - 0.2 * BETA
ERROR_FLOOR = 1e-4
LARGEST_GROWTH = ERROR_FLOOR**-BETA
# |h lambda| at the border of stability; how many signs make or clear a suspicion (DOP853; II, section IV.2).
STABILITY_BORDER = 6.1
# (rtol, atol) by which no error is too large.
ANY = (0.0, math.inf)
STIFF_SIGNS = 15
NON_STIFF_SIGNS = 6


@kernel
def dop853(flow, stops, control, state, record):
    """Advance until the last stop, a full record or a failure; see `integrator` for arguments and codes."""
    program, p = flow
    rtol, atol, max_steps = control
    y, rate, memory, counters = state
    times, states, dense = record
    n = y.shape[0]
    y_new = np.empty(n)
    rate_new = np.empty(n)
    field, tolerances, start, new = (program[integrator.FIELD], p), (rtol, atol), (y, rate), (y_new, rate_new)
    if not begin(field, state, stops[-1], tolerances, 8, new):
        return integrator.NON_FINITE
    rows = np.empty((DENSE_ROWS, n))
    # Made once: to make it would be a tenth of a step.
    room = (rows, np.empty((SCRATCH, n)))
    recorded = 0
    while True:
        code, t, step, t_new, clipped, hits_stop, crosses = next_step(
            stops, max_steps, recorded, times.shape[0], memory, counters
        )
        if code != integrator.GOING_ON:
            return code

        wants = recorded < dense.shape[0]
        error, failure, stretch = explicit_step(
            field, (t, step), start, ANY if crosses else tolerances, wants, new, room, counters
        )
        if error <= 1.0:
            times[recorded] = t_new
            for i in range(n):
                states[recorded, i] = y_new[i]
            for m in range(DENSE_ROWS if wants else 0):
                for i in range(n):
                    dense[recorded, m, i] = rows[m, i]
            recorded += 1
            # Hairer's test of stiffness.
            if stretch > STABILITY_BORDER * STABILITY_BORDER:
                counters[integrator.NON_STIFF_SIGNS] = 0
                counters[integrator.STIFF_SIGNS] += 1
                if counters[integrator.STIFF_SIGNS] == STIFF_SIGNS:
                    counters[integrator.STIFF] = 1
            else:
                counters[integrator.NON_STIFF_SIGNS] += 1
                if counters[integrator.NON_STIFF_SIGNS] == NON_STIFF_SIGNS:
                    counters[integrator.STIFF_SIGNS] = 0
            factor = MAXIMUM_FACTOR
            # The code starts its memory at the floor.
            growth = max(error, ERROR_FLOOR) ** -BETA
            if error > 0.0:
                previous = memory[integrator.PREVIOUS_GROWTH]
                factor = SAFETY / (previous if previous > 0.0 else LARGEST_GROWTH) * error**-EXPONENT
                factor = min(MAXIMUM_FACTOR, max(MINIMUM_FACTOR, factor))
            accept(t_new, step, clipped, hits_stop, growth, factor, memory, counters)
            for i in range(n):
                y[i] = y_new[i]
                rate[i] = rate_new[i]
            if t_new == stops[-1]:
                return integrator.FINISHED
        else:
            # Without an estimate, where a value is not finite.
            factor = 0.1
            if math.isfinite(error):
                factor = max(MINIMUM_FACTOR, SAFETY * error**-EXPONENT)
            if not reject(step, factor, memory, counters):
                return failure
