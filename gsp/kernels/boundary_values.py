"""One Newton step of a two-point boundary-value problem with free parameters, by Gauss collocation.

An orbit z(sigma), 0 <= sigma <= 1, of z' = q_0 F(z; epsilon) has elements between the points sigma_0 = 0, ...,
sigma_m = 1 and on each the stages Z_j = z_i + h sum_k A_jk F(Z_k), h = q_0 (sigma_(i+1) - sigma_i), with
z_(i+1) = z_i + h sum_k b_k F(Z_k) (Ascher, Mattheij and Russell 1995, section 5.4). The parameters q are the length
of time q_0 and, when there are two, epsilon. The conditions, as many as there are states and parameters, are

    left dz_0 + right dz_m + across dq = wanted,

where the last row also has `inner`[i] dz_i for 0 < i < m, so that arclength may count the whole orbit.
The stages are eliminated element by element. What is left, dz_(i+1) = B_i dz_i + C_i dq + r_i, is condensed to
a relation between dz_0, dz_m and dq: two neighbouring relations share one dz_i, which is eliminated with row
exchanges among both, so that growing and decaying directions are each carried the way they are stable.
"""

from __future__ import annotations

from numpy import empty, int64, zeros

from gsp.kernels.compilation import kernel
from gsp.kernels.gauss_element import eliminate
from gsp.kernels.linear_algebra import factorise, solve


@kernel
def newton_step(
    field, jacobian, sensitivity, p, q, mesh, A, b, z, stages, left, right, across, wanted, inner, share, dz, dstages,
    dq,
):  # fmt: skip
    """Solve the linear system; False when it is singular.

    `z` (m + 1, n) and `stages` (m, s, n) are the orbit, q its parameters, of which q[1] is p[0] when there are
    two. The defects of the orbit count `share` times: 1 in Newton's method, 0 for a tangent. The step is left in
    `dz`, `dstages`, `dq`.
    """
    m, s, n = stages.shape
    free = q.shape[0]
    width = n + free + 1
    rate, drift = empty((s, n)), empty((s, n))
    slopes = empty((s, n, n))
    local = empty((s * n, s * n))
    pivots = empty(s * n, dtype=int64)
    columns = empty((m, width, s * n))
    relation = empty((n, width))
    # Rows over (dz_0, dz_i, dz_(i+1), dq, 1): the pivot rows of each elimination are kept.
    wide = 3 * n + free + 1
    kept = zeros((m, n, wide))
    pair = zeros((2 * n, wide))
    # What the inner weights of the last condition become over (dz_0, dz_i, dz_(i+1), dq, 1).
    spread = zeros(wide)
    for e in range(m):
        if not eliminate(
            field, jacobian, sensitivity, p, q[0], mesh[e + 1] - mesh[e], A, b, z[e], stages[e], z[e + 1], free, share,
            rate, slopes, drift, local, pivots, columns[e], relation,
        ):  # fmt: skip
            return False
        if e == 0:
            for i in range(n):
                for j in range(n):
                    pair[i, j] = -relation[i, j]
                    pair[i, n + j] = 1.0 if i == j else 0.0
                    pair[i, 2 * n + j] = 0.0
                for j in range(free):
                    pair[i, 3 * n + j] = -relation[i, n + j]
                pair[i, wide - 1] = relation[i, n + free]
            continue
        for i in range(n):
            for j in range(n):
                pair[n + i, j] = 0.0
                pair[n + i, n + j] = -relation[i, j]
                pair[n + i, 2 * n + j] = 1.0 if i == j else 0.0
            for j in range(free):
                pair[n + i, 3 * n + j] = -relation[i, n + j]
            pair[n + i, wide - 1] = relation[i, n + free]
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
        for k in range(n):
            spread[n + k] += inner[e, k]
        for k in range(n):
            factor = spread[n + k] / pair[k, n + k]
            if factor != 0.0:
                for j in range(wide):
                    spread[j] -= factor * pair[k, j]
        for k in range(n):
            spread[n + k] = spread[2 * n + k]
            spread[2 * n + k] = 0.0
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
    final = empty((size, size))
    unknown = empty(size)
    for i in range(n):
        for j in range(2 * n):
            final[i, j] = pair[i, j]
        for j in range(free):
            final[i, 2 * n + j] = pair[i, 3 * n + j]
        unknown[i] = pair[i, wide - 1]
    for i in range(n + free):
        for j in range(n):
            final[n + i, j] = left[i, j]
            final[n + i, n + j] = right[i, j]
        for j in range(free):
            final[n + i, 2 * n + j] = across[i, j]
        unknown[n + i] = wanted[i]
    for j in range(2 * n):
        final[size - 1, j] += spread[j]
    for j in range(free):
        final[size - 1, 2 * n + j] += spread[3 * n + j]
    unknown[size - 1] += spread[wide - 1]
    for i in range(size):
        largest = 0.0
        for j in range(size):
            largest = max(largest, abs(final[i, j]))
        if not largest > 0.0:
            return False
        for j in range(size):
            final[i, j] /= largest
        unknown[i] /= largest
    order = empty(size, dtype=int64)
    if not factorise(final, order):
        return False
    solve(final, order, unknown)
    for i in range(n):
        dz[0, i] = unknown[i]
        dz[m, i] = unknown[n + i]
    for i in range(free):
        dq[i] = unknown[2 * n + i]
    for e in range(m - 1, 0, -1):
        for i in range(n - 1, -1, -1):
            total = kept[e, i, wide - 1]
            for j in range(n):
                total -= kept[e, i, j] * dz[0, j] + kept[e, i, 2 * n + j] * dz[e + 1, j]
            for j in range(free):
                total -= kept[e, i, 3 * n + j] * dq[j]
            for j in range(i + 1, n):
                total -= kept[e, i, n + j] * dz[e, j]
            dz[e, i] = total / kept[e, i, n + i]
    for e in range(m):
        for j in range(s):
            for i in range(n):
                row = j * n + i
                total = columns[e, n + free, row]
                for c in range(n):
                    total += columns[e, c, row] * dz[e, c]
                for c in range(free):
                    total += columns[e, n + c, row] * dq[c]
                dstages[e, j, i] = total
    return True
