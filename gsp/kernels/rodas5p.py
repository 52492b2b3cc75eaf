"""Rodas5P, the integrator for stiff flows: one Jacobian and one LU decomposition a step, no Newton iteration.

Linearly implicit, A-stable and stiffly accurate, order 5(4); see `rodas5p_tableau`. The flow is autonomous by
contract: the field is handed t, but there is no term in df/dt, and a field that used t would lose the order.
"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels import ledger
from gsp.kernels.addresses import call_rosenbrock_loops
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.rodas5p_loops import GAP_SHARE
from gsp.kernels.rodas5p_tableau import DENSE_ROWS, STAGES
from gsp.kernels.sparse_systems import entries_of, pattern_of
from gsp.kernels.step_control import accept, all_finite, begin, next_step, reject

# Control of the step as in RODAS (Hairer, Wanner II, section IV.7): safety 0.9, change between 1/5 and 6.
SAFETY = 0.9
# The estimate is of local order 5.
EXPONENT = 0.2
MINIMUM_FACTOR = 0.2
MAXIMUM_FACTOR = 6.0
# Gustafsson's memory counts no error below 1e-2, so that one lucky step does not stop all growth (RODAS).
LARGEST_GROWTH = 1e-2**-EXPONENT
# No estimate exists when a value is not finite or a pivot is 0; a tenth is RODAS's choice for a bad first step.
FAILURE_FACTOR = 0.1


@kernel
def rodas5p(program, p, stops, rtol, atol, max_steps, y, rate, memory, counters, times, states, dense):
    """Advance until the last stop, a full record or a failure; see `ledger` for arguments and codes."""
    n = y.shape[0]
    y_new = np.empty(n)
    rate_new = np.empty(n)
    if not begin(
        program[ledger.FIELD], p, y, rate, stops[-1], rtol, atol, 5, y_new, rate_new, memory, counters
    ):
        return ledger.NON_FINITE
    # Addresses of the flow's own code and the size of its blocks; see `machine_code.rosenbrock`.
    coded = program[ledger.CODE] != 0
    linearise = program[ledger.CODE]
    step_code = program[ledger.CODE + 1] if coded else 0
    size = program[ledger.CODE + 2] if coded else 0
    block = np.empty(size + 3)
    end = np.empty(size + 1 + DENSE_ROWS * n)
    if coded:
        call(linearise, memory[ledger.TIME], y, p, block)
        block[size] = rtol
        block[size + 1] = atol
        block[size + 2] = GAP_SHARE
    rows = np.empty((DENSE_ROWS, n))
    pattern = pattern_of(program)
    jacobian_flat = np.empty(entries_of(pattern, n))
    recorded = 0
    have_jacobian = False
    while True:
        code, t, step, t_new, clipped, lands = next_step(
            stops, max_steps, recorded, times.shape[0], memory, counters
        )
        if code != ledger.GOING_ON:
            break

        counters[ledger.DECOMPOSITIONS] += 1
        error = math.inf
        failure = ledger.STEP_TOO_SMALL
        if coded:
            call(step_code, step, block, p, end)
            counters[ledger.FIELD_CALLS] += STAGES
            error = end[size]
        by_code = error < math.inf
        if not by_code:
            # The loops pivot, and say what is wrong where that does not help.
            for i in range(n if coded else 0):
                y[i] = block[i]
                rate[i] = block[n + i]
            if program[ledger.LOOPS] == 0:
                counters[ledger.DECOMPOSITIONS] -= 1
                counters[ledger.FIELD_CALLS] -= STAGES
                return ledger.LOOPS_WANTED
            if not have_jacobian:
                call(program[ledger.JACOBIAN], t, y, p, jacobian_flat)
                have_jacobian = True
                if not all_finite(jacobian_flat):
                    return ledger.SINGULAR_JACOBIAN
            error, failure = call_rosenbrock_loops(
                program[ledger.LOOPS], program[ledger.FIELD], pattern, p, t, step, y, rate, rtol, atol, jacobian_flat,
                y_new, rate_new, rows, counters,
            )  # fmt: skip

        if error <= 1.0:
            if by_code:
                for i in range(size):
                    block[i] = end[i]
                for m in range(DENSE_ROWS if recorded < dense.shape[0] else 0):
                    for i in range(n):
                        dense[recorded, m, i] = end[size + 1 + m * n + i]
            else:
                for i in range(n):
                    y[i] = y_new[i]
                    rate[i] = rate_new[i]
                if coded:
                    call(linearise, t_new, y, p, block)
                for m in range(DENSE_ROWS if recorded < dense.shape[0] else 0):
                    for i in range(n):
                        dense[recorded, m, i] = rows[m, i]
            times[recorded] = t_new
            for i in range(n):
                states[recorded, i] = block[i] if coded else y[i]
            recorded += 1
            factor = MAXIMUM_FACTOR
            growth = LARGEST_GROWTH
            if error > 0.0:
                growth = error**-EXPONENT
                factor = SAFETY * growth
                previous = memory[ledger.PREVIOUS_STEP]
                if previous != 0.0 and not clipped:
                    # Gustafsson's predictive controller, Hairer, Wanner II, section IV.8.
                    trend = growth / memory[ledger.PREVIOUS_GROWTH]
                    factor = min(factor, factor * (step / previous) * trend)
                factor = min(MAXIMUM_FACTOR, max(MINIMUM_FACTOR, factor))
            accept(t_new, step, clipped, lands, min(growth, LARGEST_GROWTH), factor, memory, counters)
            counters[ledger.JACOBIAN_CALLS] += 1
            have_jacobian = False
            if counters[ledger.NEXT_STOP] == stops.shape[0]:
                code = ledger.FINISHED
                break
        else:
            factor = FAILURE_FACTOR
            if math.isfinite(error):
                factor = max(MINIMUM_FACTOR, SAFETY * error**-EXPONENT)
            if not reject(step, factor, memory, counters):
                code = failure
                break
    for i in range(n if coded else 0):
        y[i] = block[i]
        rate[i] = block[n + i]
    return code
