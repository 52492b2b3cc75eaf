"""Rodas5P, the integrator for stiff flows: one Jacobian and one LU decomposition a step, no Newton iteration.

Linearly implicit, A-stable and stiffly accurate, order 5(4); see `rodas5p_tableau`. The flow is autonomous by
contract: the field is handed t, but there is no term in df/dt, and a field that used t would lose the order.
"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels import ledger
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.linear_algebra import factorise, solve
from gsp.kernels.rodas5p_tableau import DENSE, DENSE_ROWS, GAMMA, LAST_BUT_ONE, LAST_TERM, NODES, STAGES, A, C
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
# The series falls off faster than the estimate supposes. With this share the dense output's error, on the nine problems
# of `benchmarks`, is near the tolerance where one slaved variable decides it, and no step is lost where none does.
GAP_SHARE = 0.3


@kernel
def _increments(field, p, t, h, y, rate, factors, pivots, k, argument, value):
    """The eight increments, rows of `k` (8, n); `argument` is left at that of the last, `value` at the last itself."""
    n = y.shape[0]
    inverse = 1.0 / h
    for s in range(STAGES):
        if s == 0:
            for i in range(n):
                value[i] = rate[i]
        else:
            for i in range(n):
                if s < A.shape[0]:
                    total = y[i]
                    for q in range(s):
                        total += A[s, q] * k[q, i]
                else:
                    total = argument[i] + k[s - 1, i]
                argument[i] = total
            call(field, t + NODES[s] * h, argument, p, value)
            for i in range(n):
                total = 0.0
                for q in range(s):
                    total += C[s, q] * k[q, i]
                value[i] += total * inverse
        solve(factors, pivots, value)
        for i in range(n):
            k[s, i] = value[i]


@kernel
def _interpolate(k, y, y_new, rtol, atol, rows):
    """Fill `rows` (3, n) of the dense output; return its error, the first term left out, over the tolerance.

    The embedded error says nothing about a fast variable that is slaved: it is damped by the factor 1/(h lambda),
    and the polynomial's error is not. The terms of the polynomial fall off like a geometric series.
    """
    n = y.shape[0]
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


@kernel
def _step_by_loops(field, p, t, h, y, rate, rtol, atol, jacobian_flat, y_new, rate_new, rows, counters):
    """One step for any flow, with partial pivoting: (error over the tolerance, what is wrong if it is infinite)."""
    n = y.shape[0]
    k = np.empty((STAGES, n))
    argument = np.empty(n)
    value = np.empty(n)
    factors = np.empty((n, n))
    pivots = np.empty(n, np.int64)
    diagonal = 1.0 / (h * GAMMA)
    for i in range(n):
        for j in range(n):
            factors[i, j] = -jacobian_flat[i * n + j]
        factors[i, i] += diagonal
    if not factorise(factors, pivots):
        return math.inf, ledger.SINGULAR_JACOBIAN
    _increments(field, p, t, h, y, rate, factors, pivots, k, argument, value)
    counters[ledger.FIELD_CALLS] += STAGES - 1
    total = 0.0
    for i in range(n):
        y_new[i] = argument[i] + value[i]
        ratio = value[i] / (atol + rtol * max(abs(y[i]), abs(y_new[i])))
        total += ratio * ratio
    if not all_finite(y_new):
        return math.inf, ledger.NON_FINITE
    error = max(math.sqrt(total / n), GAP_SHARE * _interpolate(k, y, y_new, rtol, atol, rows))
    if error <= 1.0:
        call(field, t + h, y_new, p, rate_new)
        counters[ledger.FIELD_CALLS] += 1
        if not all_finite(rate_new):
            return math.inf, ledger.NON_FINITE
    return error, ledger.STEP_TOO_SMALL


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
    jacobian_flat = np.empty(n * n)
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
            if not have_jacobian:
                call(program[ledger.JACOBIAN], t, y, p, jacobian_flat)
                have_jacobian = True
                if not all_finite(jacobian_flat):
                    return ledger.SINGULAR_JACOBIAN
            error, failure = _step_by_loops(
                program[ledger.FIELD], p, t, step, y, rate, rtol, atol, jacobian_flat,
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
