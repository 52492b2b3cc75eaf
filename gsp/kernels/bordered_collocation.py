"""The linear system of orbits by Gauss collocation: their elements condensed, and bordered by conditions.

An orbit z(sigma), 0 <= sigma <= 1, of z' = q_0 F(z; q_1) has elements between the points sigma_0 = 0, ..., sigma_N = 1
and on each the stages Z_j = z_i + h sum_k A_jk F(Z_k), h = q_0 (sigma_(i+1) - sigma_i), with
z_(i+1) = z_i + h sum_k b_k F(Z_k) (Ascher, Mattheij and Russell 1995, section 5.4). The free parameters q are none, the
length of time q_0, or that and one which the field depends on. `condense` eliminates the stages element by element;
what is left is dz_(i+1) = B_i dz_i + C_i dq + r_i. `border` solves these relations together with as many conditions as
there are states and free parameters,

    left dz_0 + right dz_N + across dq = wanted,

where the last rows also have `inner`[i] dz_i for 0 < i < N, so that arclength may count the whole orbit. Two
neighbouring relations share one dz_i, which is eliminated with row exchanges among both, so that growing and decaying
directions are each carried the way they are stable.
"""

from __future__ import annotations

from numpy import empty, int64, zeros

from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.linear_algebra import factorise, solve


@kernel
def condense(functions, p, time, orbit, rule, free, columns, relations):
    """Condense every element: relations[i] (n, n + free + 1) = [B_i | C_i | r_i]; False when one is singular.

    `columns` (N, n + free + 1, s n) gives dZ = columns[i, :n] dz_i + columns[i, n:n + free] dq + columns[i, n + free].
    `functions` are the field, its Jacobian and its sensitivity; an `orbit` is its widths, points and stages; a `rule` A
    and b.
    """
    field, jacobian, sensitivity = functions
    widths, z, stages = orbit
    A, b = rule
    N, s, n = stages.shape
    rate, drift = empty((s, n)), empty((s, n))
    slopes = empty((s, n, n))
    matrix = empty((s * n, s * n))
    pivots = empty(s * n, dtype=int64)
    last = n + free
    for e in range(N):
        width = widths[e]
        h = time * width
        for j in range(s):
            call(field, 0.0, stages[e, j], p, rate[j])
            call(jacobian, 0.0, stages[e, j], p, slopes[j])
            if free > 1:
                call(sensitivity, 0.0, stages[e, j], p, drift[j])
        for j in range(s):
            for i in range(n):
                row = j * n + i
                for k in range(s):
                    for c in range(n):
                        matrix[row, k * n + c] = -h * A[j, k] * slopes[k, i, c]
                matrix[row, row] += 1.0
                total, moved, grown = z[e, i] - stages[e, j, i], 0.0, 0.0
                for k in range(s):
                    total += h * A[j, k] * rate[k, i]
                    moved += width * A[j, k] * rate[k, i]
                    if free > 1:
                        grown += h * A[j, k] * drift[k, i]
                columns[e, last, row] = total
                if free > 0:
                    columns[e, n, row] = moved
                if free > 1:
                    columns[e, n + 1, row] = grown
                for c in range(n):
                    columns[e, c, row] = 1.0 if c == i else 0.0
        if not factorise(matrix, pivots):
            return False
        for c in range(last + 1):
            solve(matrix, pivots, columns[e, c])
        for i in range(n):
            for c in range(last + 1):
                total = 0.0
                for k in range(s):
                    for q in range(n):
                        total += h * b[k] * slopes[k, i, q] * columns[e, c, k * n + q]
                relations[e, i, c] = total
            relations[e, i, i] += 1.0
            rest = z[e, i] - z[e + 1, i]
            for k in range(s):
                rest += h * b[k] * rate[k, i]
                if free > 0:
                    relations[e, i, n] += width * b[k] * rate[k, i]
                if free > 1:
                    relations[e, i, n + 1] += h * b[k] * drift[k, i]
            relations[e, i, last] += rest
    return True


@kernel
def border(relations, columns, conditions, shares, steps):
    """Solve the bordered system for every column of the target (n + free, R); False when it is singular.

    The `conditions` are left, right, across, inner (k, N + 1, n), of the last k, and target. The defects r
    of the orbit count shares[c] times in column c: 1 in Newton's method, 0 for a tangent. The `steps` receive dz
    (R, N + 1, n), dstages (R, N, s, n) and dq (R, free).
    """
    left, right, across, inner, target = conditions
    dz, dstages, dq = steps
    N, n = relations.shape[0], relations.shape[1]
    s, free, cases, inners = dstages.shape[2], dq.shape[1], target.shape[1], inner.shape[0]
    # Rows over (dz_0, dz_i, dz_(i+1), dq, 1): the pivot rows of each elimination are kept.
    wide = 3 * n + free + 1
    kept = zeros((N, n, wide))
    pair = zeros((2 * n, wide))
    # What the inner weights of the last conditions become over (dz_0, dz_i, dz_(i+1), dq, 1).
    spread = zeros((inners, wide))
    if N == 0:
        # A segment without elements ends where it begins.
        for i in range(n):
            pair[i, i], pair[i, n + i] = -1.0, 1.0
    for e in range(N):
        first = 0 if e == 0 else n
        for i in range(n):
            for j in range(n):
                pair[first + i, j] = -relations[e, i, j] if e == 0 else 0.0
                pair[first + i, n + j] = 0.0 if e == 0 else -relations[e, i, j]
                pair[first + i, 2 * n + j] = 0.0
            pair[first + i, first + n + i] = 1.0
            for j in range(free):
                pair[first + i, 3 * n + j] = -relations[e, i, n + j]
            pair[first + i, wide - 1] = relations[e, i, n + free]
        if e == 0:
            continue
        for k in range(n):
            row = k
            for i in range(k + 1, 2 * n):
                if abs(pair[i, n + k]) > abs(pair[row, n + k]):
                    row = i
            if not abs(pair[row, n + k]) > 0.0:
                return False
            if row != k:
                for j in range(wide):
                    pair[k, j], pair[row, j] = pair[row, j], pair[k, j]
            for i in range(k + 1, 2 * n):
                factor = pair[i, n + k] / pair[k, n + k]
                if factor != 0.0:
                    for j in range(wide):
                        pair[i, j] -= factor * pair[k, j]
        for c in range(inners):
            for k in range(n):
                spread[c, n + k] += inner[c, e, k]
            for k in range(n):
                factor = spread[c, n + k] / pair[k, n + k]
                if factor != 0.0:
                    for j in range(wide):
                        spread[c, j] -= factor * pair[k, j]
            for k in range(n):
                spread[c, n + k] = spread[c, 2 * n + k]
                spread[c, 2 * n + k] = 0.0
        for i in range(n):
            for j in range(wide):
                kept[e, i, j] = pair[i, j]
            for j in range(n):
                pair[i, j] = pair[n + i, j]
                pair[i, n + j] = pair[n + i, 2 * n + j]
                pair[i, 2 * n + j] = 0.0
            for j in range(3 * n, wide):
                pair[i, j] = pair[n + i, j]
    size = 2 * n + free
    final = zeros((size, size))
    unknown = empty((cases, size))
    for i in range(n):
        for j in range(2 * n):
            final[i, j] = pair[i, j]
        for j in range(free):
            final[i, 2 * n + j] = pair[i, 3 * n + j]
        for c in range(cases):
            unknown[c, i] = shares[c] * pair[i, wide - 1]
    for i in range(n + free):
        for j in range(n):
            final[n + i, j] = left[i, j]
            final[n + i, n + j] = right[i, j]
        for j in range(free):
            final[n + i, 2 * n + j] = across[i, j]
        for c in range(cases):
            unknown[c, n + i] = target[i, c]
    for k in range(inners):
        row = size - inners + k
        for j in range(2 * n):
            final[row, j] += spread[k, j]
        for j in range(free):
            final[row, 2 * n + j] += spread[k, 3 * n + j]
        for c in range(cases):
            unknown[c, row] += shares[c] * spread[k, wide - 1]
    for i in range(size):
        largest = 0.0
        for j in range(size):
            largest = max(largest, abs(final[i, j]))
        if not largest > 0.0:
            return False
        for j in range(size):
            final[i, j] /= largest
        for c in range(cases):
            unknown[c, i] /= largest
    order = empty(size, dtype=int64)
    if not factorise(final, order):
        return False
    for c in range(cases):
        solve(final, order, unknown[c])
        for i in range(n):
            dz[c, 0, i] = unknown[c, i]
            dz[c, N, i] = unknown[c, n + i]
        for i in range(free):
            dq[c, i] = unknown[c, 2 * n + i]
        for e in range(N - 1, 0, -1):
            for i in range(n - 1, -1, -1):
                total = shares[c] * kept[e, i, wide - 1]
                for j in range(n):
                    total -= kept[e, i, j] * dz[c, 0, j] + kept[e, i, 2 * n + j] * dz[c, e + 1, j]
                for j in range(free):
                    total -= kept[e, i, 3 * n + j] * dq[c, j]
                for j in range(i + 1, n):
                    total -= kept[e, i, n + j] * dz[c, e, j]
                dz[c, e, i] = total / kept[e, i, n + i]
        for e in range(N):
            for j in range(s):
                for i in range(n):
                    row = j * n + i
                    total = shares[c] * columns[e, n + free, row]
                    for k in range(n):
                        total += columns[e, k, row] * dz[c, e, k]
                    for k in range(free):
                        total += columns[e, n + k, row] * dq[c, k]
                    dstages[c, e, j, i] = total
    return True
