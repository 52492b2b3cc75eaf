"""Values between the ends of DOP853's steps: its dense output of order 7, corrected where its error is too large.

The error e of the dense output u obeys e' = f(u) - u' in the lowest order, and vanishes with its slope at both ends:

    e = s^2 (1-s)^2 (c_1 + s (c_2 + (1-s) (c_3 + s (c_4 + (1-s) c_5)))),

five numbers a state. Where two of the three stages of the output stand its slope is the field's, so that three calls of
the field tell them all. Over the 115 trees of order 8 that leaves a thirtieth of e, in the root of the mean square,
less than what the lowest order leaves: h J e.
"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels import integrator
from gsp.kernels.call import call
from gsp.kernels.compilation import inlined_kernel, kernel
from gsp.kernels.dop853_tableau import DENSE_ROWS, C

# No step is in doubt.
READ = -1
# Where the slope is the field's: f(u) - u' is a thirtieth and a three-hundredth of what it is elsewhere.
_MET = (C[13], C[14])
# Where f(u) - u' is taken. Of all triples of twentieths this leaves next to the least, and |e| is at most a third of
# what is found.
PLACES = (0.45, 0.65, 0.9)
# Where e is compared with the tolerance: over the trees it is largest about 0.5 and 0.83.
LOOKS = (0.35, 0.5, 0.65, 0.76, 0.84, 0.92)
# Powers of s and 1 - s beside the two ends and the rows of a dense output, and beside the numbers of e.
_OUTPUT = ((0, 1), (1, 0), (1, 1), (2, 1), (2, 2), (3, 2), (3, 3), (4, 3))
_ERROR = ((2, 2), (3, 2), (3, 3), (4, 3), (4, 4))


def _values(powers, shares) -> np.ndarray:
    """Values (powers, shares) of these products."""
    return np.array([[s**a * (1 - s) ** b for s in shares] for a, b in powers])


def _slopes(powers, shares) -> np.ndarray:
    """Their derivatives."""
    return np.array([[s**a * (1 - s) ** b * (a / s - b / (1 - s)) for s in shares] for a, b in powers])


# Beside the slope of e at each of PLACES: its numbers.
NUMBERS = np.linalg.inv(_slopes(_ERROR, (*_MET, *PLACES)))[len(_MET) :].copy()
# Values at PLACES, slopes there, values at LOOKS: beside ends and rows, and beside the slope of e at each of PLACES.
OUTPUT = np.hstack([_values(_OUTPUT, PLACES), _slopes(_OUTPUT, PLACES), _values(_OUTPUT, LOOKS)])
ERROR = NUMBERS @ np.hstack([_values(_ERROR, PLACES), _slopes(_ERROR, PLACES), _values(_ERROR, LOOKS)])
_COUNT, _COLUMNS = len(PLACES), OUTPUT.shape[1]
# Columns of the work: those of OUTPUT, then for e its slopes at PLACES as found, those corrected by, its numbers.
_DEFECTS, _KNOWN, _NUMBERS = _COLUMNS, _COLUMNS + _COUNT, _COLUMNS + 2 * _COUNT
_WORK = _NUMBERS + NUMBERS.shape[1]


@kernel
def _find_defects(field, p, steps, k, corrections, work, point, rate):
    """Find the slope at PLACES that the error of step `k` has beside what is corrected.

    `work` is (n, _WORK); `point` and `rate` (n,) are scratch.
    """
    times, states, dense = steps
    t = times[k]
    step = times[k + 1] - t
    n = states.shape[1]
    for i in range(n):
        for m in range(_COLUMNS):
            work[i, m] = OUTPUT[0, m] * states[k, i] + OUTPUT[1, m] * states[k + 1, i]
        for q in range(DENSE_ROWS):
            row = dense[k, q, i]
            for m in range(_COLUMNS):
                work[i, m] += OUTPUT[2 + q, m] * row
        if corrections:
            for q in range(_COUNT):
                known = work[i, _KNOWN + q]
                for m in range(_COLUMNS):
                    work[i, m] += ERROR[q, m] * known
    for m in range(_COUNT):
        for i in range(n):
            point[i] = work[i, m]
        call(field, t + PLACES[m] * step, point, p, rate)
        for i in range(n):
            work[i, _DEFECTS + m] = step * rate[i] - work[i, _COUNT + m]


@kernel
def _worst(work, rtol, atol):
    """The largest error in tolerances; infinite where one is not a number."""
    worst = 0.0
    for i in range(work.shape[0]):
        for m in range(2 * _COUNT, _COLUMNS):
            error = 0.0
            for q in range(_COUNT):
                error += ERROR[q, m] * work[i, _DEFECTS + q]
            share = abs(error) / (atol + rtol * abs(work[i, m])) if error != 0.0 else 0.0
            # Written so that what is not a number is infinite.
            worst = max(worst, share if share < math.inf else math.inf)
    return worst


@kernel
def _find_numbers(corrections, work):
    """Find the error's numbers, and count its slopes in with those corrected by."""
    for i in range(work.shape[0]):
        for q in range(NUMBERS.shape[1]):
            total = 0.0
            for m in range(_COUNT):
                total += NUMBERS[m, q] * work[i, _DEFECTS + m]
            work[i, _NUMBERS + q] = total
        for m in range(_COUNT):
            work[i, _KNOWN + m] = work[i, _DEFECTS + m] + (work[i, _KNOWN + m] if corrections else 0.0)


@inlined_kernel
def _error(work, i, s):
    """The error of state `i` at the share `s` of the step."""
    r = 1.0 - s
    rest = work[i, _NUMBERS + 2] + s * (work[i, _NUMBERS + 3] + r * work[i, _NUMBERS + 4])
    return s * s * r * r * (work[i, _NUMBERS] + s * (work[i, _NUMBERS + 1] + r * rest))


@kernel
def correct_grid(program, p, tolerances, steps, grid, out, doubtful, counters):
    """Correct `out` (m, n), which `grid.read_grid` has filled at `grid` (m,), step by step.

    `tolerances` are (rtol, atol), and the `steps` (times, states, dense) as that takes them. Fills `doubtful` (m,) with
    the step of a time that is to be landed on, or READ, and returns how many times these are.
    """
    rtol, atol = tolerances
    times, states, _ = steps
    n = states.shape[1]
    reached = grid.shape[0]
    sign = 1.0 if times[-1] >= times[0] else -1.0
    field = program[integrator.FIELD]
    point = np.empty(n)
    rate = np.empty(n)
    work = np.empty((n, _WORK))
    for j in range(reached):
        doubtful[j] = READ
    in_doubt = 0
    low = 0
    for k in range(times.shape[0] - 1):
        # What is the end of a step is as good as the step.
        while low < reached and grid[low] == times[k]:
            low += 1
        if low == reached:
            break
        end = sign * times[k + 1]
        high = low
        while high < reached and sign * grid[high] < end:
            high += 1
        if high == low:
            continue
        t = times[k]
        step = times[k + 1] - t
        corrections = 0
        first = 0.0
        while True:
            _find_defects(field, p, steps, k, corrections, work, point, rate)
            counters[integrator.FIELD_CALLS] += _COUNT
            worst = _worst(work, rtol, atol)
            if corrections == 0:
                first = worst
            if worst <= 1.0:
                break
            _find_numbers(corrections, work)
            # What is in doubt after so many is landed on: of 4143 steps of twelve problems 0.6 in a hundred,
            # and 2.7 after one. In 19 steps an error is above two tolerances and above twice that of the step's
            # end; with one correction in 5.
            if worst == math.inf or corrections == 2:
                break
            for j in range(low, high):
                for i in range(n):
                    out[j, i] += _error(work, i, (grid[j] - t) / step)
            corrections += 1
        # Where corrections do not halve it each, h J e is as large as e, at the edge of stability: then what is found
        # of e is no measure, and its zeros are none.
        spread = 0 if worst <= 0.5**corrections * first else 1
        for j in range(low, low if worst <= 1.0 else high):
            bad = spread
            for i in range(n):
                error = _error(work, i, (grid[j] - t) / step)
                bad += 0 if abs(error) <= atol + rtol * abs(out[j, i]) else 1
            if bad:
                doubtful[j] = k
                in_doubt += 1
        low = high
    return in_doubt
