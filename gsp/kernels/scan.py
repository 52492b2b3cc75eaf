"""A quick look along the steps of a run: do watched functions keep clear of zero?"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels.call import call
from gsp.kernels.compilation import kernel


@kernel
def clear_of_zero(
    lift, size, address, outputs, p, columns, signs, margin, pieces, time, state, times, states, dense
):
    """True when every watched function surely keeps its sign over the steps.

    The compiled function at `lift` turns a state into a point of `size` coordinates, the one at `address` that into
    `outputs` values, of which `columns` (w,) are watched; each must have its
    sign of `signs` (w,) at `pieces` points of every step, and be further from zero than `margin` times the largest
    second difference of its values. The steps start at `time` with `state` (n,); `times` (k,), `states` (k, n) and
    `dense` (k, rows, n) as in `ledger`.
    """
    n = state.shape[0]
    rows = dense.shape[1]
    watched = columns.shape[0]
    z = np.empty(n)
    point = np.empty(size)
    out = np.empty(outputs)
    one = np.empty(watched)
    two = np.empty(watched)
    nearest = np.full(watched, math.inf)
    bend = np.zeros(watched)
    seen = 0
    for k in range(times.shape[0]):
        t0 = time if k == 0 else times[k - 1]
        for m in range(pieces + 1):
            if m == pieces and k < times.shape[0] - 1:
                break
            s = m / pieces
            r = 1.0 - s
            for i in range(n):
                total = 0.0
                for q in range(rows - 1, -1, -1):
                    total = dense[k, q, i] + (s if q % 2 == 0 else r) * total
                start = state[i] if k == 0 else states[k - 1, i]
                z[i] = r * start + s * states[k, i] + s * r * total
            t = t0 + s * (times[k] - t0)
            call(lift, t, z, p, point)
            call(address, t, point, p, out)
            for c in range(watched):
                value = out[columns[c]] * signs[c]
                # Written so that what is not a number is not clear.
                if not value > 0.0 or not math.isfinite(value):
                    return False
                nearest[c] = min(nearest[c], value)
                if seen > 1:
                    bend[c] = max(bend[c], abs(value - 2.0 * one[c] + two[c]))
                if nearest[c] <= margin * bend[c]:
                    return False
                two[c] = one[c]
                one[c] = value
            seen += 1
    return True
