"""A quick look along the steps of a run: do watched functions keep clear of zero?"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels.addresses import call_sheet
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel

# Places of `functions`: how many values are watched, and the address of the function that gives them over a state; what
# is looked at once, at the start: the address of the function that turns the state into a point, and the point's size,
# the address of the tests there, and how many they are, whether pairs are watched, and the series; the address of
# `sheets.reach_sheet` and the number of slow variables, where a start may be given by them. Behind these the outputs of
# the tests that are watched, then which of the point's entries are the state's, then what `reach_sheet` takes.
WATCHED, ALONG, LIFT, SIZE, TESTS, OUTPUTS, PAIRS, SERIES, SHEET, SLOW, COLUMNS = range(11)

# Pieces of a step. The interpolants have degree 4 to 9, so more zeros than pieces are rare; they are smooth, and a
# dip between two points shows at the points beside it.
SUBDIVISIONS = 8
# A dip below the neighbouring points is about an eighth of their second difference; a factor of 8 for safety.
DIP = 1.0
# Pieces of a step for the quick look, and for the second look at what the wider bends between them do not exclude.
LOOKS, CLOSER_LOOKS = 4, 16
# A start is on a loss when det g_y is below this share of what a relative change of the point makes, or H of its
# size: points on an implicit branch come out of Newton's method, which finds a fold to half the digits.
ON_LOSS = 1e-7


# What a look finds: no zero, a zero or what is not a number, a bend that may hide two zeros.
_CLEAR, _CROSSED, _BENT = range(3)


@kernel
def clear_of_zero(functions, p, signs, start, steps):
    """True when every watched function surely keeps its sign over the steps.

    Each of the values (w,) that `functions` gives over a state must have its sign of `signs` (w,) at `LOOKS` points of
    every step, and be further from zero than `DIP` times the second differences beside it, as the search has it; if
    only the latter fails, at `CLOSER_LOOKS` points. The `steps` start at a time with a state (n,); their
    times (k,), states (k, n) and dense output (k, rows, n) as in `integrator`.
    """
    found = _look(LOOKS, functions, p, signs, start, steps)
    if found == _BENT:
        found = _look(CLOSER_LOOKS, functions, p, signs, start, steps)
    return found == _CLEAR


@kernel
def _look(pieces, functions, p, signs, start, steps):
    """What `pieces` points of every step say of the watched functions."""
    time, state = start
    times, states, dense = steps
    n = state.shape[0]
    rows = dense.shape[1]
    watched = signs.shape[0]
    if watched == 0:
        return _CLEAR
    along = functions[ALONG]
    scratch = np.zeros(n + 5 * watched)
    z = scratch[:n]
    out = scratch[n : n + watched]
    # By value: the last three, the latest first, and the last second difference.
    known = scratch[n + watched :].reshape((4, watched))
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
                begun = state[i] if k == 0 else states[k - 1, i]
                z[i] = r * begun + s * states[k, i] + s * r * total
            call(along, t0 + s * (times[k] - t0), z, p, out)
            for c in range(watched):
                value = out[c] * signs[c]
                # Written so that what is not a number is not clear.
                if not 0.0 < value < math.inf:
                    return _CROSSED
                # A bend counts for the pieces beside it and those beside these: for five points.
                if value <= DIP * known[3, c]:
                    return _BENT
                if seen > 1:
                    bend = abs(value - 2.0 * known[0, c] + known[1, c])
                    nearest = min(value, known[0, c], known[1, c])
                    if (nearest if seen == 2 else min(nearest, known[2, c])) <= DIP * bend:
                        return _BENT
                    known[3, c] = bend
                known[2, c] = known[1, c]
                known[1, c] = known[0, c]
                known[0, c] = value
            seen += 1
    return _CLEAR


@kernel
def reach_start(functions, state):
    """Put the coordinates of the point over the slow variables in `state` in their place; False where none is found."""
    slow = functions[SLOW]
    places = COLUMNS + functions[WATCHED]
    point = np.empty(functions[SIZE] - 1)
    for i in range(slow):
        point[i] = state[i]
    if not call_sheet(functions[SHEET], functions[places + slow :], point[:slow], point[slow:]):
        return False
    for i in range(slow):
        state[i] = point[functions[places + i]]
    return True


@kernel
def begins_clear(functions, p, signs, time, state):
    """Fill `signs` (w,) as they are at the start; False where a run does not begin, or a test is not a number."""
    size = functions[SIZE]
    scratch = np.empty(size + functions[OUTPUTS])
    point = scratch[:size]
    out = scratch[size:]
    call(functions[LIFT], time, state, p, point)
    call(functions[TESTS], time, point, p, out)
    for value in out:
        if not math.isfinite(value):
            return False
    # As in `endings.on_loss`: det g_y, the pair and the series, what rounding makes of the first, the pair's size.
    if abs(out[0]) <= ON_LOSS * abs(out[3]):
        return False
    if functions[PAIRS] != 0 and abs(out[1]) <= ON_LOSS * abs(out[4]):
        return False
    if functions[SERIES] != 0 and not out[2] > 0.0:
        return False
    for c in range(signs.shape[0]):
        column = functions[COLUMNS + c]
        signs[c] = -1.0 if out[column] < 0.0 and column != 2 else 1.0
    return True
