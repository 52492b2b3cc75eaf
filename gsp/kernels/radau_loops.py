"""An attempt at a step of Radau IIA for any flow and any number of stages, with partial pivoting."""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels import integrator
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.linear_systems import solve_shifted
from gsp.kernels.quads import QUAD
from gsp.kernels.radau_block import CONTRACTION, END, LENGTH, LINES, POINT, lines_of, width_of
from gsp.kernels.radau_iteration import (
    CONVERGED,
    FAILURE_FACTOR,
    GOING_ON,
    estimates_twice,
    failure_of,
    judge,
    most_rounds,
    opening,
)
from gsp.kernels.radau_systems import decompose, solve_stages
from gsp.kernels.radau_tableau import (
    DEFECT,
    DENSE,
    EIGENVALUES,
    LARGEST_FACTORS,
    LINEARISED,
    NODES,
    T_INVERSE,
    A,
    T,
)
from gsp.kernels.sparse_systems import entries_of
from gsp.kernels.step_control import all_finite


@kernel
def _guess(memory, step, z):
    """First guess of the rises `z` (stages, n): the last step's dense output, continued; 0 where there is none."""
    stages, n = z.shape
    width = width_of(stages)
    length = memory[LENGTH]
    # Row by row, along all states.
    rows = np.empty((stages + 1, n))
    for i in range(n):
        for k in range(stages + 1):
            rows[k, i] = memory[LINES + i * width + k]
    for a in range(stages):
        r = 0.0 if length == 0.0 else -NODES[(stages - 5) // 2, a] * step / length
        s = 1.0 - r
        for i in range(n):
            z[a, i] = rows[stages - 1, i]
        for k in range(stages - 2, -1, -1):
            factor = s if k % 2 == 0 else r
            for i in range(n):
                z[a, i] = rows[k, i] + factor * z[a, i]
        for i in range(n):
            z[a, i] = -r * rows[stages, i] + s * r * z[a, i]


@kernel
def _multiply(matrices, x, out):
    """`out` (stages, n) = M `x` for the family's M."""
    stages, n = x.shape
    family = (stages - 5) // 2
    for a in range(stages):
        first = matrices[family, a, 0]
        for i in range(n):
            out[a, i] = first * x[0, i]
        # Two at a time, since the sums are fetched and kept each time; `stages` is odd.
        for q in range(1, stages, 2):
            factor, other = matrices[family, a, q], matrices[family, a, q + 1]
            for i in range(n):
                out[a, i] = out[a, i] + factor * x[q, i] + other * x[q + 1, i]


@kernel
def _round(flow, at, y, weight, pattern, system, z, room):
    """One round for the rises `z` (stages, n), of the norm that is returned.

    The residual is h A F - Z, not multiplied by A^-1: the rises are then exact to rounding.
    """
    field, p = flow
    t, step = at
    f, w, value, b, right = room
    stages, n = z.shape
    family = (stages - 5) // 2
    for a in range(stages):
        for i in range(n):
            w[a, i] = y[i] + z[a, i]
        call(field, t + NODES[family, a] * step, w[a], p, f[a])
    _multiply(A, f, w)
    for a in range(stages):
        for i in range(n):
            w[a, i] = step * w[a, i] - z[a, i]
    _multiply(T_INVERSE, w, f)
    solve_stages(pattern, step, system, f, value, b, right)
    # By states first: one long sum would wait for each of its terms.
    for i in range(n):
        value[i] = 0.0
    for a in range(stages):
        for i in range(n):
            value[i] += (f[a, i] * weight[i]) ** 2
    total = 0.0
    for i in range(n):
        total += value[i]
    _multiply(T, f, w)
    for a in range(stages):
        for i in range(n):
            z[a, i] += w[a, i]
    return math.sqrt(total / (n * stages))


@kernel
def _errors(estimate, coefficients, y, y_new, rtol, atol):
    """The estimate's norm, and the error of the collocation polynomial within the step, both over the tolerance.

    The estimate (8.19) is damped in the fast variables, by the factor 1/(h lambda), and the polynomial's error in one
    that is slaved is not: the largest first term left out. The terms fall off like a geometric series, a pair of poles
    makes them A rho^k cos(k theta + phi).
    """
    stages, n = coefficients.shape
    family = (stages - 5) // 2
    total = 0.0
    largest = 0.0
    for i in range(n):
        weight = 1.0 / (atol + rtol * max(abs(y[i]), abs(y_new[i])))
        total += (estimate[i] * weight) ** 2
        first = LARGEST_FACTORS[family, 0] * coefficients[stages - 5, i]
        second = LARGEST_FACTORS[family, 1] * coefficients[stages - 4, i]
        third = LARGEST_FACTORS[family, 2] * coefficients[stages - 3, i]
        fourth = LARGEST_FACTORS[family, 3] * coefficients[stages - 2, i]
        # In pairs, since every second one vanishes where the solution is even or odd about a step's middle.
        last = max(abs(fourth), abs(third))
        before = max(abs(second), abs(first))
        # Not last^2, which overflows from 1e154 on.
        term = last * (last / before) if last < before else last
        size = max(last, before)
        if size > 0.0:
            # c_k^2 - c_(k-1) c_(k+1) = (A rho^k sin theta)^2 has no zeros, where the coefficients pass through theirs.
            unit = 1.0 / size
            first, second, third, fourth = first * unit, second * unit, third * unit, fourth * unit
            envelope = abs(third * third - second * fourth)
            ahead = envelope * math.sqrt(envelope)
            bound = abs(second * second - first * third)
            term = max(term, size * (ahead / bound) if ahead * size < bound * last else last)
        largest = max(largest, term * weight)
    return math.sqrt(total / n), largest


@kernel
def attempt_by_loops(flow, step, stages, state, control, block):
    """Fill the end and the lines of `block`: (error over tolerance, rounds, factor if it is infinite, failure then).

    `flow` is (field, jacobian, pattern, p), `control` (rtol, atol, the iteration's tolerance, share of the gap).
    """
    field, jacobian, pattern, p = flow
    y, rate, memory, counters = state
    rtol, atol, tolerance, gap_share = control
    n = y.shape[0]
    family = (stages - 5) // 2
    z = np.empty((stages, n))
    f = np.empty((stages, n))
    w = np.empty((stages, n))
    weight = np.empty(n)
    value = np.empty(n)
    defect = np.empty(n)
    slope = np.empty(n)
    y_new = np.empty(n)
    b = np.empty(n, np.complex128)
    pivots = np.empty(n, np.int64)
    complex_pivots = np.empty((stages // 2, n), np.int64)
    t = memory[integrator.TIME]
    end = POINT + END * n
    lines = lines_of(n)
    width = width_of(stages)

    _guess(memory, step, z)
    for i in range(n):
        value[i] = y[i] + z[LINEARISED[family], i]
    entries = np.empty(entries_of(pattern, n))
    call(jacobian, t, value, p, entries)
    if not all_finite(entries):
        # The guess may lie beyond the field's domain.
        call(jacobian, t, y, p, entries)
        if not all_finite(entries):
            return math.inf, 0, 0.0, integrator.SINGULAR_JACOBIAN
    regular, real, complexes, quads = decompose(entries, step, family, pattern, pivots, complex_pivots)
    if not regular:
        return math.inf, 0, FAILURE_FACTOR, integrator.SINGULAR_JACOBIAN
    system = (real, complexes, quads, pivots, complex_pivots)
    right = np.empty(QUAD * n if quads.shape[0] != 0 else 0)
    room = (f, w, value, b, right)
    for i in range(n):
        weight[i] = 1.0 / (atol + rtol * abs(y[i]))
    most = most_rounds(stages)
    now = opening(memory[CONTRACTION])
    verdict = GOING_ON
    factor = FAILURE_FACTOR
    rounds = 0
    while verdict == GOING_ON:
        rounds += 1
        norm = _round((field, p), (t, step), y, weight, pattern, system, z, room)
        verdict, factor, now = judge(rounds, most, norm, now, tolerance)
    counters[integrator.FIELD_CALLS] += rounds * stages
    if verdict != CONVERGED:
        return math.inf, rounds, factor, failure_of(verdict)
    memory[CONTRACTION] = now[2]

    # (8.19): e = (gamma/h - J)^-1 (f0 - u'(0)) with the collocation polynomial u.
    _multiply(DENSE, z, w)
    for i in range(n):
        y_new[i] = y[i] + z[stages - 1, i]
        slope[i] = (z[stages - 1, i] + w[0, i]) / step
        defect[i] = rate[i] - slope[i]
    solve_shifted(pattern, real, pivots, defect)
    error, gap = _errors(defect, w, y, y_new, rtol, atol)
    if error >= 1.0 and estimates_twice(counters):
        # (8.20), for a start off the slow manifold.
        for i in range(n):
            value[i] = y[i] + defect[i]
        call(field, t, value, p, defect)
        counters[integrator.FIELD_CALLS] += 1
        for i in range(n):
            defect[i] -= slope[i]
        solve_shifted(pattern, real, pivots, defect)
        error, gap = _errors(defect, w, y, y_new, rtol, atol)
    # The gap counts in units of the tolerance asked for.
    error = max(error, gap_share * gap)
    if not math.isfinite(error):
        return math.inf, rounds, FAILURE_FACTOR, integrator.NON_FINITE
    # The collocation polynomial and its leading error, filtered as the estimate is: y - u = gamma e K(theta) in the
    # notation of the tableau, for the estimate e = h (f0 - u'(0))/gamma.
    for i in range(n):
        for k in range(stages):
            leading = EIGENVALUES[family, 0].real * DEFECT[family, k]
            block[lines + i * width + k] = w[k, i] + leading * defect[i]
    call(field, t + step, y_new, p, value)
    counters[integrator.FIELD_CALLS] += 1
    if not all_finite(value):
        return math.inf, rounds, FAILURE_FACTOR, integrator.NON_FINITE
    for i in range(n):
        block[end + i] = y_new[i]
        block[end + n + i] = value[i]
        block[lines + i * width + stages] = z[stages - 1, i]
    return error, rounds, 1.0, integrator.STEP_TOO_SMALL
