"""The linear system of orbits by Gauss collocation, element after element: what is left between the two ends.

`gsp.collocation.bordered` eliminates the stages of all elements at once and leaves one relation for each,
dz_(i+1) = B_i dz_i + C_i dq + r_i (Ascher, Mattheij and Russell 1995, section 5.4). Two neighbouring relations share
one dz_i, which is eliminated with row exchanges among both, so that growing and decaying directions are each carried
the way they are stable. Rows go over (dz_0, dz_i, dz_(i+1), dq, 1).
"""

from __future__ import annotations

from numpy import zeros

from gsp.kernels.compilation import kernel


@kernel
def eliminate(rows, inner, pair, spread, kept):
    """Eliminate the dz_i between the ends from the relations `rows` (N, n, w); False when the system is singular.

    `pair` (2n, w) begins with the first relation and ends with one between dz_0 and dz_N, `spread` (k, w) with what
    the weights `inner` (k, N + 1, n) become at these. The pivot rows are left in `kept` (N, n, w).
    """
    N, n, wide = rows.shape
    inners = inner.shape[0]
    for e in range(1, N):
        for i in range(n):
            for j in range(wide):
                pair[n + i, j] = rows[e, i, j]
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
                for j in range(wide):
                    spread[c, j] -= factor * pair[k, j]
            for k in range(n):
                spread[c, n + k] = spread[c, 2 * n + k]
                spread[c, 2 * n + k] = 0.0
        for i in range(n):
            for j in range(wide):
                kept[e, i, j] = pair[i, j]
                pair[i, j] = pair[n + i, j]
            for j in range(n):
                pair[i, n + j] = pair[i, 2 * n + j]
                pair[i, 2 * n + j] = 0.0
    return True


@kernel
def substitute(kept, shares, dz, dq):
    """Fill `dz` (R, N + 1, n) between its ends from the pivot rows; the defects count shares[c] times in row c."""
    N, n, wide = kept.shape
    for c in range(dz.shape[0]):
        known = zeros(wide)
        known[wide - 1] = -shares[c]
        for j in range(n):
            known[j] = dz[c, 0, j]
            known[n + j] = dz[c, N, j]
        for j in range(3 * n, wide - 1):
            known[j] = dq[c, j - 3 * n]
        for e in range(N - 1, 0, -1):
            for j in range(n):
                known[2 * n + j] = known[n + j]
                known[n + j] = 0.0
            for i in range(n - 1, -1, -1):
                total = 0.0
                for j in range(wide):
                    total -= kept[e, i, j] * known[j]
                known[n + i] = total / kept[e, i, n + i]
                dz[c, e, i] = known[n + i]
