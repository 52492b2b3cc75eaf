"""One element of Gauss collocation with its stages eliminated: what orbits between any conditions are made of.

On an element of length h the stages Z_j = z + h sum_k A_jk F(Z_k) lead to z_+ = z + h sum_k b_k F(Z_k) (Ascher,
Mattheij and Russell 1995, section 5.4). Free parameters are none, the time q_0 with h = q_0 times the element's width,
or q_0 and one that the field depends on.
"""

from __future__ import annotations

from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.linear_algebra import factorise, solve


@kernel
def eliminate(
    field, jacobian, sensitivity, p, time, width, A, b, start, stages, end, free, share,
    rate, slopes, drift, matrix, pivots, columns, relation,
):  # fmt: skip
    """Condense one element: relation (n, n + free + 1) = [B | C | r], and what the stages change by.

    `columns` (n + free + 1, s n) gives dZ = columns[:n] dz_i + columns[n:n + free] dq + columns[n + free].
    """
    s, n = stages.shape
    h = time * width
    last = n + free
    for j in range(s):
        call(field, 0.0, stages[j], p, rate[j])
        call(jacobian, 0.0, stages[j], p, slopes[j])
        if free > 1:
            call(sensitivity, 0.0, stages[j], p, drift[j])
    for j in range(s):
        for i in range(n):
            row = j * n + i
            for k in range(s):
                for c in range(n):
                    matrix[row, k * n + c] = -h * A[j, k] * slopes[k, i, c]
            matrix[row, row] += 1.0
            total, moved, grown = start[i] - stages[j, i], 0.0, 0.0
            for k in range(s):
                total += h * A[j, k] * rate[k, i]
                moved += width * A[j, k] * rate[k, i]
                if free > 1:
                    grown += h * A[j, k] * drift[k, i]
            columns[last, row] = share * total
            if free > 0:
                columns[n, row] = moved
            if free > 1:
                columns[n + 1, row] = grown
            for c in range(n):
                columns[c, row] = 1.0 if c == i else 0.0
    if not factorise(matrix, pivots):
        return False
    for c in range(last + 1):
        solve(matrix, pivots, columns[c])
    for i in range(n):
        for c in range(last + 1):
            total = 0.0
            for k in range(s):
                for q in range(n):
                    total += h * b[k] * slopes[k, i, q] * columns[c, k * n + q]
            relation[i, c] = total
        relation[i, i] += 1.0
        rest = start[i] - end[i]
        for k in range(s):
            rest += h * b[k] * rate[k, i]
            if free > 0:
                relation[i, n] += width * b[k] * rate[k, i]
            if free > 1:
                relation[i, n + 1] += h * b[k] * drift[k, i]
        relation[i, last] += share * rest
    return True
