"""A quick look along the steps of a run: do watched functions keep clear of zero?"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels.call import call
from gsp.kernels.compilation import kernel

# Places of `functions`: how many of the states count; the address of the function that turns them into a point, and
# the point's size; the address of the tests there, and how many they are; whether pairs are watched, and the series.
STATES, LIFT, SIZE, TESTS, OUTPUTS, PAIRS, SERIES = range(7)


@kernel
def clear_of_zero(functions, p, columns, signs, margin, pieces, time, state, times, states, dense):
    """True when every watched function surely keeps its sign over the steps.

    Of the values of `functions` (7,) the `columns` (w,) are watched; each must have its
    sign of `signs` (w,) at `pieces` points of every step, and be further from zero than `margin` times the largest
    second difference of its values. The steps start at `time` with `state` (n,); `times` (k,), `states` (k, n) and
    `dense` (k, rows, n) as in `ledger`.
    """
    n = state.shape[0]
    rows = dense.shape[1]
    watched = columns.shape[0]
    used = functions[STATES]
    z = np.zeros(n)
    point = np.empty(functions[SIZE])
    out = np.empty(functions[OUTPUTS])
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
            for i in range(used):
                total = 0.0
                for q in range(rows - 1, -1, -1):
                    total = dense[k, q, i] + (s if q % 2 == 0 else r) * total
                start = state[i] if k == 0 else states[k - 1, i]
                z[i] = r * start + s * states[k, i] + s * r * total
            t = t0 + s * (times[k] - t0)
            call(functions[LIFT], t, z, p, point)
            call(functions[TESTS], t, point, p, out)
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


@kernel
def _begins(functions, columns, signs, loss, p, time, state):
    """Fill `signs` (w,) as they are at the start; False where a run does not begin, or a test is not a number."""
    point = np.empty(functions[SIZE])
    out = np.empty(functions[OUTPUTS])
    call(functions[LIFT], time, state, p, point)
    call(functions[TESTS], time, point, p, out)
    for value in out:
        if not math.isfinite(value):
            return False
    # As in `endings.on_loss`: det g_y, the pair and the series, what rounding makes of the first, the pair's size.
    if abs(out[0]) <= loss * abs(out[3]) or (functions[PAIRS] != 0 and abs(out[1]) <= loss * abs(out[4])):
        return False
    if functions[SERIES] != 0 and not out[2] > 0.0:
        return False
    for c in range(columns.shape[0]):
        signs[c] = -1.0 if out[columns[c]] < 0.0 and columns[c] != 2 else 1.0
    return True


@kernel
def look_along(functions, columns, signs, loss, margin, pieces, p, place, times, states, dense):
    """`clear_of_zero` over the next steps of a run that stands at `place` (time, state), which moves on to their end.

    With `signs` (w,) of zeros the start is looked at first: False where it lies on a loss or the series is none there.
    """
    if times.shape[0] == 0:
        return signs[0] != 0.0
    if signs[0] == 0.0 and not _begins(functions, columns, signs, loss, p, place[0], place[1:]):
        return False
    clear = clear_of_zero(
        functions, p, columns, signs, margin, pieces, place[0], place[1:], times, states, dense
    )
    place[0] = times[-1]
    # Written out: numba's own assignment compiles, for 2 s, the message that shapes do not fit.
    for i in range(states.shape[1]):
        place[1 + i] = states[states.shape[0] - 1, i]
    return clear
