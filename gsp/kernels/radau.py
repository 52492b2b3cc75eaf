"""Radau IIA with 3, 5 or 7 stages, for stiff flows at tight tolerances: orders 5, 9, 13, L-stable.

Hairer, Wanner II, section IV.8, and the paper named in `radau_tableau`: simplified Newton iteration with the
Jacobian of the step's start, transformed to one real and (stages - 1)/2 complex systems of n unknowns;
collocation polynomials as first guess and as dense output.

The driver's contract in `ledger` holds with two additions. The number of stages is that of the rows of `dense`,
and `memory` has `memory_size(stages, n)` entries: the tail keeps what the next step starts from.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from gsp.kernels import ledger
from gsp.kernels.call import call
from gsp.kernels.linear_algebra import solve
from gsp.kernels.radau_systems import decompose, solve_complex
from gsp.kernels.radau_tableau import (
    A_COLUMNS,
    DEFECT,
    DENSE,
    DENSE_COLUMNS,
    EIGENVALUES,
    NODES,
    T_COLUMNS,
    T_INVERSE_COLUMNS,
    WIDTH,
)
from gsp.kernels.step_control import accept, all_finite, begin, reject, step_towards

# Control of the step as in RADAU: safety 0.9, change between 1/5 and 8, estimate of local order stages + 1.
SAFETY = 0.9
MINIMUM_FACTOR = 0.2
MAXIMUM_FACTOR = 8.0
# Gustafsson's memory never falls below this (RADAU).
ERROR_FLOOR = 1e-2
# After a value that is not finite or a pivot of 0 there is no estimate; as in Rodas5P.
FAILURE_FACTOR = 0.1

# Control of the iteration as in RADAU: at most 7, 12, 17 rounds; slower than 0.99 is divergence, then half a step.
SLOWEST_RATE = 0.99
DIVERGENCE_FACTOR = 0.5
LOOSEST_ITERATION = 0.03
# Share of the tolerance asked for. At 0.02 the steps' errors, all of one sign, outweigh those of the collocation.
ITERATION_SHARE = 0.002
ROUNDING = 10 * 2.0**-52

# The estimate is O(h^(s+1)) for s stages, the error of the dense output O(h^(s+2)), that of a step O(h^(2s)). A
# step is controlled with rtol^TRANSFORM in place of rtol, which brings the dense output to the tolerance and the
# end below it: on five stiff problems at rtol 1e-4 to 1e-12 to 1.4 and 0.03 times rtol in geometric mean. RADAU's
# 0.1 rtol^((s+1)/(2s)) cares for the end alone. A factor of 0.3 before the power gained nothing at equal cost.
TRANSFORM = np.array([4.0 / 5.0, 6.0 / 7.0, 8.0 / 9.0])

# The largest values on (0, 1) of the factors of the polynomial's last two coefficients, x^a (1-x)^b with a + b =
# stages - 1 and stages, a = b or b + 1: they come at x = a/(a+b).
LARGEST_FACTORS = np.array(
    [[(a / (a + b)) ** a * (b / (a + b)) ** b for a, b in ((m, m), (m + 1, m))] for m in (1, 2, 3)]
)
# The series falls off faster than the estimate supposes. On the nine problems of `benchmarks`, for rtol 1e-5 to 1e-11,
# the dense output was up to 47 times as bad as the tolerance without it, 50 times as good with a share of 1, and never
# 3 times as bad with these.
GAP_SHARE = np.array([0.02, 0.02, 0.008])

# Tail of memory: the iteration's last theta/(1 - theta), the length of the last step, its dense output, its rise.
CONTRACTION = ledger.MEMORY_SIZE
LENGTH = CONTRACTION + 1
PIECE = LENGTH + 1

CONVERGED = 0
DIVERGED = 1
UNDEFINED = 2


def memory_size(stages: int, n: int) -> int:
    """Entries of `memory` for `n` states."""
    return PIECE + (stages + 1) * n


@njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
def _multiply(columns, shape, x, out):
    """`out` (WIDTH, n) = M `x` for the family's M (WIDTH, stages); the eight sums stay in vector registers."""
    stages, n = shape
    family = (stages - 3) // 2
    for i in range(n):
        a = b = c = d = e = f = g = h = 0.0
        for q in range(stages):
            value = x[q, i]
            a += columns[family, q, 0] * value
            b += columns[family, q, 1] * value
            c += columns[family, q, 2] * value
            d += columns[family, q, 3] * value
            e += columns[family, q, 4] * value
            f += columns[family, q, 5] * value
            g += columns[family, q, 6] * value
            h += columns[family, q, 7] * value
        out[0, i] = a
        out[1, i] = b
        out[2, i] = c
        out[3, i] = d
        out[4, i] = e
        out[5, i] = f
        out[6, i] = g
        out[7, i] = h


@njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
def _guess(memory, step, shape, z):
    """First guess of the rises `z` (WIDTH, n): the last step's dense output, continued; 0 where there is none."""
    stages, n = shape
    length = memory[LENGTH]
    if length == 0.0:
        z[:] = 0.0
        return
    for a in range(stages):
        s = 1.0 + NODES[(stages - 3) // 2, a] * step / length
        r = 1.0 - s
        for i in range(n):
            total = 0.0
            for k in range(stages - 1, -1, -1):
                total = memory[PIECE + k * n + i] + (s if k % 2 == 0 else r) * total
            z[a, i] = -r * memory[PIECE + stages * n + i] + s * r * total


@njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
def _iterate(field, p, t, step, y, weight, tolerance, shape, system, work, memory):
    """Simplified Newton iteration for Z = h A F(Z); (outcome, rounds, factor for the next attempt).

    The residual is taken in this form, not multiplied by A^-1: the rises are then exact to rounding.
    """
    stages, n = shape
    real, complexes, pivots, complex_pivots = system
    z, f, w, b, twist, argument, value = work
    pairs = stages // 2
    family = (stages - 3) // 2
    for m in range(1 + pairs):
        twist[m] = EIGENVALUES[family, m] * (1.0 / step)
    most = 7 + 5 * (stages - 3) // 2
    contraction = max(memory[CONTRACTION], 2.0**-52) ** 0.8
    norm = 0.0
    rate = 0.0
    for k in range(1, most + 1):
        for a in range(stages):
            for i in range(n):
                argument[i] = y[i] + z[a, i]
            call(field, t + NODES[family, a] * step, argument, p, value)
            for i in range(n):
                f[a, i] = value[i]
        _multiply(A_COLUMNS, shape, f, w)
        for a in range(stages):
            for i in range(n):
                w[a, i] = step * w[a, i] - z[a, i]
        _multiply(T_INVERSE_COLUMNS, shape, w, f)
        for i in range(n):
            value[i] = f[0, i] * twist[0].real
        solve(real, pivots, value)
        for i in range(n):
            f[0, i] = value[i]
        for m in range(pairs):
            for i in range(n):
                b[i] = twist[m + 1] * complex(f[2 * m + 1, i], f[2 * m + 2, i])
            solve_complex(complexes, m, complex_pivots, b, shape)
            for i in range(n):
                f[2 * m + 1, i] = b[i].real
                f[2 * m + 2, i] = b[i].imag
        last_norm = norm
        norm = 0.0
        for a in range(stages):
            for i in range(n):
                norm += (f[a, i] * weight[i]) ** 2
        norm = math.sqrt(norm / (n * stages))
        if not math.isfinite(norm):
            return UNDEFINED, k, FAILURE_FACTOR
        if k > 1 and norm > 0.0:
            last_rate = rate
            rate = norm / last_norm
            theta = rate if k == 2 else math.sqrt(rate * last_rate)
            if theta >= SLOWEST_RATE:
                return DIVERGED, k, DIVERGENCE_FACTOR
            contraction = theta / (1.0 - theta)
            left = most - 1 - k
            expected = contraction * norm * theta**left / tolerance
            if expected >= 1.0 and k < most:
                # Too slow to be done in time: a step for which it would be.
                return DIVERGED, k, 0.8 * min(20.0, expected) ** (-1.0 / (4 + left))
        _multiply(T_COLUMNS, shape, f, w)
        for a in range(stages):
            for i in range(n):
                z[a, i] += w[a, i]
        if contraction * norm <= tolerance:
            memory[CONTRACTION] = contraction
            return CONVERGED, k, 1.0
    return DIVERGED, most, DIVERGENCE_FACTOR


@njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
def _norm(values, y, y_new, rtol, atol, shape):
    _, n = shape
    total = 0.0
    for i in range(n):
        total += (values[i] / (atol + rtol * max(abs(y[i]), abs(y_new[i])))) ** 2
    return math.sqrt(total / n)


@njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
def _gap(z, y, y_new, rtol, atol, shape):
    """Error of the collocation polynomial within the step, the first term left out, over the tolerance.

    The estimate (8.19) is damped in the fast variables, by the factor 1/(h lambda), and the polynomial's error in one
    that is slaved is not. The terms of the polynomial fall off like a geometric series.
    """
    stages, n = shape
    family = (stages - 3) // 2
    largest = 0.0
    for i in range(n):
        last = 0.0
        before = 0.0
        for a in range(stages):
            last += DENSE[family, stages - 2, a] * z[a, i]
            before += DENSE[family, stages - 3, a] * z[a, i]
        last = LARGEST_FACTORS[family, 1] * abs(last)
        before = LARGEST_FACTORS[family, 0] * abs(before)
        if last < before:
            last *= last / before
        largest = max(largest, last / (atol + rtol * max(abs(y[i]), abs(y_new[i]))))
    return largest


@njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
def _piece(z, defect, shape, w, memory):
    """Coefficients of the dense output: collocation polynomial and its leading error, filtered as the estimate is.

    y - u = gamma e K(theta) in the notation of the tableau, for the estimate e = h (f0 - u'(0))/gamma.
    """
    stages, n = shape
    family = (stages - 3) // 2
    _multiply(DENSE_COLUMNS, shape, z, w)
    for k in range(stages):
        weight = EIGENVALUES[family, 0].real * DEFECT[family, k]
        for i in range(n):
            memory[PIECE + k * n + i] = w[k, i] + weight * defect[i]


@njit(cache=True, error_model="numpy", nogil=True)
def radau(
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
    jacobian = program[ledger.JACOBIAN]
    shape = dense.shape[1:]
    stages, n = shape
    family = (stages - 3) // 2
    z = np.empty((WIDTH, n))
    f = np.empty((WIDTH, n))
    w = np.empty((WIDTH, n))
    argument = np.empty(n)
    value = np.empty(n)
    weight = np.empty(n)
    defect = np.empty(n)
    slope = np.empty(n)
    y_new = np.empty(n)
    rate_new = np.empty(n)
    jacobian_flat = np.empty(n * n)
    real = np.empty((n, n))
    complexes = np.empty((stages // 2, n, n), np.complex128)
    b = np.empty(n, np.complex128)
    twist = np.empty(1 + stages // 2, np.complex128)
    pivots = np.empty(n, np.int64)
    complex_pivots = np.empty((stages // 2, n), np.int64)
    system = (real, complexes, pivots, complex_pivots)
    work = (z, f, w, b, twist, argument, value)

    controlled = rtol ** TRANSFORM[family]
    # The iteration ends where its error is lost beside the tolerance asked for, or in rounding.
    tolerance = max(ROUNDING / controlled, min(LOOSEST_ITERATION, ITERATION_SHARE * rtol / controlled))
    atol *= controlled / rtol
    gap_share = GAP_SHARE[family] * controlled / rtol
    rtol = controlled
    exponent = -1.0 / (stages + 1)
    largest_growth = ERROR_FLOOR**exponent
    if not begin(field, p, y, rate, stops[-1], rtol, atol, stages, argument, rate_new, memory, counters):
        return ledger.NON_FINITE
    if counters[ledger.STEPS] + counters[ledger.REJECTED] == 0:
        memory[CONTRACTION] = 1.0
    recorded = 0
    have_jacobian = False
    while True:
        if recorded == times.shape[0]:
            return ledger.RECORD_FULL
        if counters[ledger.STEPS] + counters[ledger.REJECTED] >= max_steps:
            return ledger.TOO_MANY_STEPS
        t = memory[ledger.TIME]
        if not have_jacobian:
            # One for each step: compiled, it costs less than the rounds that an old one would add.
            call(jacobian, t, y, p, jacobian_flat)
            counters[ledger.JACOBIAN_CALLS] += 1
            if not all_finite(jacobian_flat):
                return ledger.SINGULAR_JACOBIAN
            have_jacobian = True
            for i in range(n):
                weight[i] = 1.0 / (atol + rtol * abs(y[i]))
        stop = stops[counters[ledger.NEXT_STOP]]
        step = step_towards(stop, t, memory[ledger.STEP])
        clipped = abs(step) < abs(memory[ledger.STEP])
        lands = step == stop - t
        t_new = stop if lands else t + step
        # What t really advances by, so that the record of times alone tells the steps.
        step = t_new - t
        if step == 0.0:
            return ledger.STEP_TOO_SMALL

        counters[ledger.DECOMPOSITIONS] += 1
        error = math.inf
        factor = FAILURE_FACTOR
        safety = SAFETY
        failure = ledger.STEP_TOO_SMALL
        if not decompose(jacobian_flat, step, shape, system):
            failure = ledger.SINGULAR_JACOBIAN
        else:
            _guess(memory, step, shape, z)
            outcome, rounds, factor = _iterate(
                field, p, t, step, y, weight, tolerance, shape, system, work, memory
            )
            counters[ledger.FIELD_CALLS] += rounds * stages
            most = 7 + 5 * (stages - 3) // 2
            safety = SAFETY * (2 * most + 1) / (2 * most + rounds)
            if outcome == UNDEFINED:
                failure = ledger.NON_FINITE
            elif outcome == CONVERGED:
                # (8.19): e = (gamma/h - J)^-1 (f0 - u'(0)) with the collocation polynomial u.
                for i in range(n):
                    y_new[i] = y[i] + z[stages - 1, i]
                    total = z[stages - 1, i]
                    for a in range(stages):
                        total += DENSE[family, 0, a] * z[a, i]
                    slope[i] = total / step
                    defect[i] = rate[i] - slope[i]
                solve(real, pivots, defect)
                error = _norm(defect, y, y_new, rtol, atol, shape)
                if error >= 1.0 and (counters[ledger.STEPS] == 0 or counters[ledger.JUST_REJECTED] == 1):
                    # (8.20), for a start off the slow manifold.
                    for i in range(n):
                        argument[i] = y[i] + defect[i]
                    call(field, t, argument, p, defect)
                    counters[ledger.FIELD_CALLS] += 1
                    for i in range(n):
                        defect[i] -= slope[i]
                    solve(real, pivots, defect)
                    error = _norm(defect, y, y_new, rtol, atol, shape)
                # The gap counts in units of the tolerance asked for.
                error = max(error, gap_share * _gap(z, y, y_new, rtol, atol, shape))
                if not math.isfinite(error):
                    error = math.inf
                    factor = FAILURE_FACTOR
                    failure = ledger.NON_FINITE
                elif error <= 1.0:
                    call(field, t_new, y_new, p, rate_new)
                    counters[ledger.FIELD_CALLS] += 1
                    if not all_finite(rate_new):
                        error = math.inf
                        factor = FAILURE_FACTOR
                        failure = ledger.NON_FINITE

        if error <= 1.0:
            _piece(z, defect, shape, w, memory)
            times[recorded] = t_new
            memory[LENGTH] = step
            for i in range(n):
                memory[PIECE + stages * n + i] = z[stages - 1, i]
                states[recorded, i] = y_new[i]
                y[i] = y_new[i]
                rate[i] = rate_new[i]
            if recorded < dense.shape[0]:
                for k in range(stages):
                    for i in range(n):
                        dense[recorded, k, i] = memory[PIECE + k * n + i]
            recorded += 1
            factor = MAXIMUM_FACTOR
            growth = largest_growth
            if error > 0.0:
                growth = error**exponent
                factor = safety * growth
                previous = memory[ledger.PREVIOUS_STEP]
                if previous != 0.0 and not clipped:
                    # Gustafsson's predictive controller, (8.25).
                    trend = growth / memory[ledger.PREVIOUS_GROWTH]
                    factor = min(factor, SAFETY * growth * (step / previous) * trend)
                factor = min(MAXIMUM_FACTOR, max(MINIMUM_FACTOR, factor))
            accept(t_new, step, clipped, lands, min(growth, largest_growth), factor, memory, counters)
            have_jacobian = False
            if counters[ledger.NEXT_STOP] == stops.shape[0]:
                return ledger.FINISHED
        else:
            if math.isfinite(error):
                factor = max(MINIMUM_FACTOR, safety * error**exponent)
            if not reject(step, factor, memory, counters):
                return failure
