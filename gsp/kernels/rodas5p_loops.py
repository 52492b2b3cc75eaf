"""A step of Rodas5P for any flow, with partial pivoting."""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels import ledger
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.linear_systems import decompose_shifted, solve_shifted
from gsp.kernels.rodas5p_tableau import DENSE, DENSE_ROWS, GAMMA, LAST_BUT_ONE, LAST_TERM, NODES, STAGES, A, C
from gsp.kernels.step_control import all_finite

# The series falls off faster than the estimate supposes. With this share the dense output's error, on the nine problems
# of `benchmarks`, is near the tolerance where one slaved variable decides it, and no step is lost where none does.
GAP_SHARE = 0.3


@kernel
def _increments(field, pattern, p, t, h, y, rate, factors, pivots, k, argument, value, total):
    """The eight increments, rows of `k` (8, n); `argument` is left at that of the last, `value` at the last itself."""
    n = y.shape[0]
    inverse = 1.0 / h
    for s in range(STAGES):
        if s == 0:
            for i in range(n):
                value[i] = rate[i]
        else:
            # Along the states innermost, for vectors.
            for i in range(n):
                argument[i] = y[i] if s < A.shape[0] else argument[i] + k[s - 1, i]
                total[i] = 0.0
            for q in range(s):
                for i in range(n if s < A.shape[0] else 0):
                    argument[i] += A[s, q] * k[q, i]
                for i in range(n):
                    total[i] += C[s, q] * k[q, i]
            call(field, t + NODES[s] * h, argument, p, value)
            for i in range(n):
                value[i] += total[i] * inverse
        solve_shifted(pattern, factors, pivots, value)
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
def step_by_loops(field, pattern, p, t, h, y, rate, rtol, atol, jacobian_flat, y_new, rate_new, rows, counters):
    """One step for any flow, with partial pivoting: (error over the tolerance, what is wrong if it is infinite)."""
    n = y.shape[0]
    k = np.empty((STAGES, n))
    argument = np.empty(n)
    value = np.empty(n)
    pivots = np.empty(n, np.int64)
    regular, factors = decompose_shifted(jacobian_flat, 1.0 / (h * GAMMA), pattern, n, pivots)
    if not regular:
        return math.inf, ledger.SINGULAR_JACOBIAN
    _increments(field, pattern, p, t, h, y, rate, factors, pivots, k, argument, value, np.empty(n))
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
