"""Rodas5P, the integrator for stiff flows: one Jacobian and one LU decomposition a step, no Newton iteration.

Linearly implicit, A-stable and stiffly accurate, order 5(4); see `rodas5p_tableau`. The flow is autonomous by
contract: the field is handed t, but there is no term in df/dt, and a field that used t would lose the order.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numba.misc.special import literally

from gsp.kernels import ledger
from gsp.kernels.call import call
from gsp.kernels.decomposition import decompose_with, factors_size, solve_with
from gsp.kernels.rodas5p_tableau import DENSE, DENSE_ROWS, GAMMA, NODES, STAGES, A, C
from gsp.kernels.shape import shape_of, sizes
from gsp.kernels.step_control import accept, all_finite, begin, reject, step_towards

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
# The largest values on (0, 1) of the factors of the dense output's last two coefficients, x^2 (1-x)^2, x^2 (1-x).
LAST_TERM = 1.0 / 16.0
LAST_BUT_ONE = 4.0 / 27.0
# The series falls off faster than the estimate supposes. With this share the dense output's error, on the nine problems
# of `benchmarks`, is near the tolerance where one slaved variable decides it, and no step is lost where none does.
GAP_SHARE = 0.3


@njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
def _stage(s, shape, code, field, p, t, h, y, sparse, factors, pivots, k, argument, value):
    """Increment s, the row k[s] of `k` (8, n). A literal `s` unrolls the sums."""
    literally(s)
    _, n = sizes(shape)
    for i in range(n):
        if s < 6:
            total = y[i]
            for q in range(s):
                total += A[s, q] * k[q, i]
        else:
            total = argument[i] + k[s - 1, i]
        argument[i] = total
    call(field, t + NODES[s] * h, argument, p, value)
    inverse = 1.0 / h
    for i in range(n):
        total = 0.0
        for q in range(s):
            total += C[s, q] * k[q, i]
        value[i] += total * inverse
    solve_with(code, sparse, factors, pivots, value, shape)
    for i in range(n):
        k[s, i] = value[i]


@njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
def _interpolate(shape, k, y, y_new, rtol, atol, rows):
    """Fill `rows` (3, n) of the dense output; return its error, the first term left out, over the tolerance.

    The embedded error says nothing about a fast variable that is slaved: it is damped by the factor 1/(h lambda),
    and the polynomial's error is not. The terms of the polynomial fall off like a geometric series.
    """
    _, n = sizes(shape)
    for m in range(DENSE_ROWS):
        for i in range(n):
            rows[m, i] = DENSE[m, 0] * k[0, i]
        for s in range(1, STAGES):
            weight = DENSE[m, s]
            for i in range(n):
                rows[m, i] += weight * k[s, i]
    largest = 0.0
    for i in range(n):
        last = LAST_TERM * abs(rows[2, i])
        before = LAST_BUT_ONE * abs(rows[1, i])
        if last < before:
            last *= last / before
        largest = max(largest, last / (atol + rtol * max(abs(y[i]), abs(y_new[i]))))
    return largest


@njit(cache=True, error_model="numpy", nogil=True)
def rodas5p(
    field,
    jacobian,
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
    shape=None,
    code=None,
):
    """Advance until the last stop, a full record or a failure; see `ledger` for arguments and codes."""
    shape = shape_of(dense, shape)
    _, n = sizes(shape)
    k = np.empty((STAGES, n))
    rows = np.empty((DENSE_ROWS, n))
    value = np.empty(n)
    argument = np.empty(n)
    y_new = np.empty(n)
    rate_new = np.empty(n)
    jacobian_flat = np.empty(n * n)
    factors = np.empty((n, n))
    pivots = np.empty(n, np.int64)
    sparse = np.empty(factors_size(code))
    scratch = np.empty(1)
    if not begin(field, p, y, rate, stops[-1], rtol, atol, 5, argument, rate_new, memory, counters):
        return ledger.NON_FINITE
    recorded = 0
    have_jacobian = False
    while True:
        if recorded == times.shape[0]:
            return ledger.RECORD_FULL
        if counters[ledger.STEPS] + counters[ledger.REJECTED] >= max_steps:
            return ledger.TOO_MANY_STEPS
        t = memory[ledger.TIME]
        if not have_jacobian:
            call(jacobian, t, y, p, jacobian_flat)
            counters[ledger.JACOBIAN_CALLS] += 1
            if not all_finite(jacobian_flat):
                return ledger.SINGULAR_JACOBIAN
            have_jacobian = True
        stop = stops[counters[ledger.NEXT_STOP]]
        step = step_towards(stop, t, memory[ledger.STEP])
        clipped = abs(step) < abs(memory[ledger.STEP])
        lands = step == stop - t
        t_new = stop if lands else t + step
        # What t really advances by, so that the record of times alone tells the steps.
        step = t_new - t
        if step == 0.0:
            return ledger.STEP_TOO_SMALL

        diagonal = 1.0 / (step * GAMMA)
        regular = decompose_with(code, jacobian_flat, diagonal, sparse, scratch, factors, pivots, shape)
        counters[ledger.DECOMPOSITIONS] += 1
        error = math.inf
        failure = ledger.STEP_TOO_SMALL
        if not regular:
            failure = ledger.SINGULAR_JACOBIAN
        else:
            for i in range(n):
                value[i] = rate[i]
            solve_with(code, sparse, factors, pivots, value, shape)
            for i in range(n):
                k[0, i] = value[i]
            _stage(1, shape, code, field, p, t, step, y, sparse, factors, pivots, k, argument, value)
            _stage(2, shape, code, field, p, t, step, y, sparse, factors, pivots, k, argument, value)
            _stage(3, shape, code, field, p, t, step, y, sparse, factors, pivots, k, argument, value)
            _stage(4, shape, code, field, p, t, step, y, sparse, factors, pivots, k, argument, value)
            _stage(5, shape, code, field, p, t, step, y, sparse, factors, pivots, k, argument, value)
            _stage(6, shape, code, field, p, t, step, y, sparse, factors, pivots, k, argument, value)
            _stage(7, shape, code, field, p, t, step, y, sparse, factors, pivots, k, argument, value)
            counters[ledger.FIELD_CALLS] += STAGES - 1
            total = 0.0
            for i in range(n):
                y_new[i] = argument[i] + value[i]
                ratio = value[i] / (atol + rtol * max(abs(y[i]), abs(y_new[i])))
                total += ratio * ratio
            if all_finite(y_new):
                error = max(
                    math.sqrt(total / n), GAP_SHARE * _interpolate(shape, k, y, y_new, rtol, atol, rows)
                )
                if error <= 1.0:
                    call(field, t_new, y_new, p, rate_new)
                    counters[ledger.FIELD_CALLS] += 1
                    if not all_finite(rate_new):
                        error = math.inf
                        failure = ledger.NON_FINITE
            else:
                failure = ledger.NON_FINITE

        if error <= 1.0:
            times[recorded] = t_new
            for i in range(n):
                states[recorded, i] = y_new[i]
            if recorded < dense.shape[0]:
                for m in range(DENSE_ROWS):
                    for i in range(n):
                        dense[recorded, m, i] = rows[m, i]
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
            for i in range(n):
                y[i] = y_new[i]
                rate[i] = rate_new[i]
            have_jacobian = False
            if counters[ledger.NEXT_STOP] == stops.shape[0]:
                return ledger.FINISHED
        else:
            factor = FAILURE_FACTOR
            if math.isfinite(error):
                factor = max(MINIMUM_FACTOR, SAFETY * error**-EXPONENT)
            if not reject(step, factor, memory, counters):
                return failure
