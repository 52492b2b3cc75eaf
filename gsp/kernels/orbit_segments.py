"""Orbit segments of the full flow by Gauss collocation: Newton's method on a boundary-value problem.

A segment has elements of lengths h_0, ..., h_(m-1) and states z_0, ..., z_m at their ends. On each element the
stages Z_j satisfy Z_j = z_i + h sum_k A_jk F(Z_k), and z_(i+1) = z_i + h sum_k b_k F(Z_k) (Ascher, Mattheij and
Russell 1995, section 5.4). Gauss points serve decaying and growing directions alike. The conditions are

    left (z_0)_fast = at_left,    (z_middle)_slow = x,    right (z_m)_fast = at_right,

as many as there are states. The stages are eliminated element by element; what is left is banded.
"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels.compilation import kernel
from gsp.kernels.gauss_element import eliminate

CONVERGED = 0
NOT_CONVERGED = 1
NON_FINITE = 2
SINGULAR = 3

ITERATIONS = 30
# A Newton step of this length, relative to 1 + |z|, is rounding; one below LAST is followed by rounding.
ROUNDING = 1e-15
LAST = 1e-8
# A step may be this much longer than the one before, so many times, before the iteration is given up.
GROWTH = 2.0
SETBACKS = 3


@kernel
def _solve_banded(matrix, right, size, lower, upper):
    """Gauss elimination with row exchanges inside a band; `right` (size, k) is overwritten by the solution."""
    columns = right.shape[1]
    for k in range(size):
        last = min(size, k + lower + 1)
        row = k
        largest = abs(matrix[k, k])
        for i in range(k + 1, last):
            if abs(matrix[i, k]) > largest:
                largest = abs(matrix[i, k])
                row = i
        if not largest > 0.0:
            return False
        end = min(size, k + upper + 1)
        if row != k:
            for j in range(k, end):
                matrix[k, j], matrix[row, j] = matrix[row, j], matrix[k, j]
            for j in range(columns):
                right[k, j], right[row, j] = right[row, j], right[k, j]
        for i in range(k + 1, last):
            factor = matrix[i, k] / matrix[k, k]
            if factor != 0.0:
                for j in range(k + 1, end):
                    matrix[i, j] -= factor * matrix[k, j]
                for j in range(columns):
                    right[i, j] -= factor * right[k, j]
    for k in range(size - 1, -1, -1):
        end = min(size, k + upper + 1)
        for j in range(columns):
            total = right[k, j]
            for i in range(k + 1, end):
                total -= matrix[k, i] * right[i, j]
            right[k, j] = total / matrix[k, k]
    return True


@kernel
def _segment(field, jacobian, p, A, b, h, middle, x, left, at_left, right, at_right, z, stages, response):
    """Newton's method on one segment; see `solve_segments`. Returns (code, iterations)."""
    m = h.shape[0]
    s, n = stages.shape[1], stages.shape[2]
    slow = x.shape[0]
    lefts, rights = left.shape[0], right.shape[0]
    size = (m + 1) * n
    lower, upper = 2 * n, 4 * n
    rate = np.empty((s, n))
    slopes = np.empty((s, n, n))
    local = np.empty((s * n, s * n))
    pivots = np.empty(s * n, dtype=np.int64)
    columns = np.empty((m, n + 1, s * n))
    relation = np.empty((n, n + 1))
    matrix = np.empty((size, size))
    unknown = np.empty((size, 1 + lefts + rights))
    previous = math.inf
    setbacks = 0
    for iteration in range(1, ITERATIONS + 1):
        for i in range(size):
            for j in range(max(0, i - lower - 1), min(size, i + upper + 1)):
                matrix[i, j] = 0.0
            for j in range(unknown.shape[1]):
                unknown[i, j] = 0.0
        row = 0
        for i in range(lefts):
            total = at_left[i]
            for j in range(n - slow):
                matrix[row, slow + j] = left[i, j]
                total -= left[i, j] * z[0, slow + j]
            unknown[row, 0] = total
            unknown[row, 1 + i] = 1.0
            row += 1
        for e in range(m + 1):
            if e == middle:
                for i in range(slow):
                    matrix[row, e * n + i] = 1.0
                    unknown[row, 0] = x[i] - z[e, i]
                    row += 1
            if e == m:
                break
            if not eliminate(
                field, jacobian, 0, p, 1.0, h[e], A, b, z[e], stages[e], z[e + 1], 0, 1.0,
                rate, slopes, rate, local, pivots, columns[e], relation,
            ):  # fmt: skip
                return SINGULAR, iteration
            for i in range(n):
                for j in range(n):
                    matrix[row, e * n + j] = -relation[i, j]
                matrix[row, (e + 1) * n + i] = 1.0
                unknown[row, 0] = relation[i, n]
                row += 1
        for i in range(rights):
            total = at_right[i]
            for j in range(n - slow):
                matrix[row, m * n + slow + j] = right[i, j]
                total -= right[i, j] * z[m, slow + j]
            unknown[row, 0] = total
            unknown[row, 1 + lefts + i] = 1.0
            row += 1
        if not _solve_banded(matrix, unknown, size, lower, upper):
            return SINGULAR, iteration
        length = 0.0
        for e in range(m + 1):
            norm = 1.0
            for i in range(n):
                norm += abs(z[e, i])
            for i in range(n):
                change = abs(unknown[e * n + i, 0]) / norm
                # Written so that NaN is kept.
                if not change <= length:
                    length = change
        if not math.isfinite(length):
            return NON_FINITE, iteration
        factor = min(1.0, 1.0 / length) if length > 0.0 else 1.0
        for e in range(m):
            for j in range(s):
                for i in range(n):
                    total = columns[e, n, j * n + i]
                    for c in range(n):
                        total += columns[e, c, j * n + i] * unknown[e * n + c, 0]
                    stages[e, j, i] += factor * total
        for e in range(m + 1):
            for i in range(n):
                z[e, i] += factor * unknown[e * n + i, 0]
        if length <= ROUNDING or previous <= LAST or (length <= LAST and length >= 0.5 * previous):
            for i in range(n - slow):
                for j in range(lefts + rights):
                    response[i, j] = unknown[middle * n + slow + i, 1 + j]
            return CONVERGED, iteration
        if length > GROWTH * previous:
            setbacks += 1
            if setbacks == SETBACKS:
                return NOT_CONVERGED, iteration
        previous = length
    return NOT_CONVERGED, ITERATIONS


@kernel
def solve_segments(
    field, jacobian, p, A, b, lengths, counts, middles, xs, left, at_left, lefts, right, at_right, rights, z,
    stages, response, codes, iterations,
):  # fmt: skip
    """Solve the segments one after another, in place.

    `lengths` (k, m) are the elements' lengths in time, of which segment q has counts[q], z_0 being where it
    begins; middles[q] is the element's end over which x = xs[q]. The conditions are the first lefts[q] rows of
    left[q] (n_fast, n_fast) with the values at_left[q], and the first rights[q] of right[q]. `z` (k, m + 1, n) and
    `stages` (k, m, s, n) hold the guess and are overwritten; response[q] (n_fast, n_fast) is the derivative of
    the fast variables at the middle by the values at the ends.
    """
    for q in range(xs.shape[0]):
        m = counts[q]
        codes[q], iterations[q] = _segment(
            field, jacobian, p, A, b, lengths[q, :m], middles[q], xs[q], left[q, : lefts[q]], at_left[q],
            right[q, : rights[q]], at_right[q], z[q], stages[q, :m], response[q],
        )  # fmt: skip
