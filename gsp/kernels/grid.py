"""Values at the times asked for, read off the steps of a run; and whether the dense output is good enough for them.

The error e of a dense output u obeys e' = J e + f(u) - u', to first order. Where J is fast e follows the defect
f(u) - u'; elsewhere it is a share of the step times the defect. One linear system holds both,

    (RATE/h - J) e = f(u) - u',

with the Jacobian J of the step's start. A time at which e is above the tolerance is handed back, to be landed on. What
is done about explicit methods stands in `corrections`.
"""

from __future__ import annotations

import numpy as np

from gsp.kernels import ledger
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.linear_systems import decompose_shifted, solve_shifted
from gsp.kernels.sparse_systems import entries_of, pattern_of

# The derivative of the terms left out over these, on a step of length 1. On 28 stiff problems and eight others the
# error that is left at rtol 1e-2 to 1e-6 is that of the steps' ends.
RATE = 5.0

# What a reader does about the error: nothing; what is said above; what `corrections` does.
TRUSTS = 0
CHECKS = 1
CORRECTS = 2

# No step is in doubt.
READ = -1

# Reading goes along the times of a step where it has more than this many, and along the states where those are so many;
# else number by number. Shorter loops take longer to begin than to run.
FEW_TIMES = 4
MANY_STATES = 8

# Where a step is looked at that has more times in it: off the middle, where an odd error vanishes.
PLACES = np.array([0.2, 0.55, 0.85])


@kernel
def runs_along(grid, first, last):
    """Whether the times of `grid` (m,) lie between `first` and `last`, each nearer to the end than the one before."""
    sign = 1.0 if last > first else -1.0
    wrong = 0
    for j in range(grid.shape[0] - 1):
        # Written so that what is not a number is wrong.
        wrong += 0 if sign * grid[j] < sign * grid[j + 1] else 1
    return wrong == 0 and sign * first <= sign * grid[0] and sign * grid[-1] <= sign * last


# Arrays go whole with the number of a row: a view of each row would cost more than what is computed of it.


@kernel
def _value(states, dense, k, s, out):
    """Fill `out` (n,) with the state of step `k` at its share `s`, in the arithmetic of `interpolate_many`."""
    r = 1.0 - s
    for i in range(states.shape[1]):
        total = 0.0
        for q in range(dense.shape[1] - 1, -1, -1):
            total = dense[k, q, i] + (s if q % 2 == 0 else r) * total
        out[i] = r * states[k, i] + s * states[k + 1, i] + s * r * total


@kernel
def _along_states(times, states, dense, k, grid, low, high, out):
    """`_value`, bit by bit, for the times low to high - 1 of `grid`."""
    n = states.shape[1]
    step = times[k + 1] - times[k]
    for j in range(low, high):
        s = (grid[j] - times[k]) / step
        r = 1.0 - s
        for i in range(n):
            out[j, i] = 0.0
        for m in range(dense.shape[1] - 1, -1, -1):
            factor = s if m % 2 == 0 else r
            for i in range(n):
                out[j, i] = dense[k, m, i] + factor * out[j, i]
        for i in range(n):
            out[j, i] = r * states[k, i] + s * states[k + 1, i] + s * r * out[j, i]


@kernel
def _values(times, states, dense, k, grid, low, high, out, shares, rests, totals):
    """`_value` for the times low to high - 1 of `grid`, bit by bit, along whatever makes the longer loops."""
    step = times[k + 1] - times[k]
    count = high - low
    n = states.shape[1]
    if n >= MANY_STATES:
        _along_states(times, states, dense, k, grid, low, high, out)
        return
    if count <= FEW_TIMES:
        for j in range(low, high):
            s = (grid[j] - times[k]) / step
            r = 1.0 - s
            for i in range(n):
                total = 0.0
                for m in range(dense.shape[1] - 1, -1, -1):
                    total = dense[k, m, i] + (s if m % 2 == 0 else r) * total
                out[j, i] = r * states[k, i] + s * states[k + 1, i] + s * r * total
        return
    for q in range(count):
        shares[q] = (grid[low + q] - times[k]) / step
    for q in range(count):
        rests[q] = 1.0 - shares[q]
    for i in range(n):
        for q in range(count):
            totals[q] = 0.0
        for m in range(dense.shape[1] - 1, -1, -1):
            term = dense[k, m, i]
            if m % 2 == 0:
                for q in range(count):
                    totals[q] = term + shares[q] * totals[q]
            else:
                for q in range(count):
                    totals[q] = term + rests[q] * totals[q]
        begun = states[k, i]
        ended = states[k + 1, i]
        for q in range(count):
            totals[q] = rests[q] * begun + shares[q] * ended + shares[q] * rests[q] * totals[q]
        for q in range(count):
            out[low + q, i] = totals[q]


@kernel
def read_step(states, dense, k, s, value, slope):
    """The state of step `k` at its share `s`, and its derivative by that."""
    _value(states, dense, k, s, value)
    r = 1.0 - s
    for i in range(states.shape[1]):
        total = 0.0
        rise = 0.0
        for q in range(dense.shape[1] - 1, -1, -1):
            if q % 2 == 0:
                rise = s * rise + total
                total = dense[k, q, i] + s * total
            else:
                rise = r * rise - total
                total = dense[k, q, i] + r * total
        slope[i] = states[k + 1, i] - states[k, i] + (r - s) * total + s * r * rise


@kernel
def _decompose(program, pattern, t, y, p, step, pivots):
    """(True, the factors of RATE/h - J); (False, whatever) where it is singular."""
    n = y.shape[0]
    jacobian = np.empty(entries_of(pattern, n))
    call(program[ledger.JACOBIAN], t, y, p, jacobian)
    return decompose_shifted(jacobian, RATE / step, pattern, n, pivots)


@kernel
def _find_defect(field, p, t, step, value, slope, defect):
    """Fill `defect` (n,) with f(u) - u' of the dense output u at a time."""
    call(field, t, value, p, defect)
    inverse = 1.0 / step
    for i in range(value.shape[0]):
        defect[i] -= slope[i] * inverse


@kernel
def _is_good(solved, step, value, defect, rtol, atol):
    """Whether an error looks smaller than the tolerance: `defect` itself where it was solved for, else its share."""
    share = 1.0 if solved else step / RATE
    bad = 0
    for i in range(value.shape[0]):
        # Written so that what is not a number is bad.
        bad += 0 if abs(defect[i] * share) <= atol + rtol * abs(value[i]) else 1
    return bad == 0


@kernel
def read_grid(check, rtol, atol, times, states, dense, grid, begun, out):
    """Fill rows of `out` (m, n) from number `begun` on with the states at those of `grid` (m,) that the steps reach.

    The steps are `times` (k + 1,), `states` (k + 1, n), `dense` (k, rows, n), which may be empty when every one of the
    grid is the end of a step. Returns how many of the grid are read by now, and whether `doubt_grid` is to look at the
    error of any, as `check` says.
    """
    n = states.shape[1]
    count = grid.shape[0]
    sign = 1.0 if times[-1] >= times[0] else -1.0
    shares = np.empty(count - begun)
    rests = np.empty(count - begun)
    totals = np.empty(count - begun)
    looks = False
    j = begun
    while j < count and grid[j] == times[0]:
        for i in range(n):
            out[j, i] = states[0, i]
        j += 1
    for k in range(times.shape[0] - 1):
        if j == count:
            break
        end = sign * times[k + 1]
        inside = j
        while inside < count and sign * grid[inside] < end:
            inside += 1
        if inside > j:
            looks = check != TRUSTS
            _values(times, states, dense, k, grid, j, inside, out, shares, rests, totals)
        j = inside
        while j < count and grid[j] == times[k + 1]:
            for i in range(n):
                out[j, i] = states[k + 1, i]
            j += 1
    return j, looks


@kernel
def doubt_grid(check, program, p, rtol, atol, times, states, dense, grid, begun, reached, doubts, counters):
    """Fill `doubts` (m,), `begun` to `reached` - 1, with the step of a time where the error looks too large, or READ.

    In a step with many times that is told from a few places. The rest is as `read_grid` takes it. Returns how
    many of the grid are in doubt.
    """
    n = states.shape[1]
    sign = 1.0 if times[-1] >= times[0] else -1.0
    value = np.empty(n)
    slope = np.empty(n)
    defect = np.empty(n)
    pattern = pattern_of(program)
    pivots = np.empty(n, np.int64)
    in_doubt = 0
    for q in range(begun, reached):
        doubts[q] = READ
    j = begun
    for k in range(times.shape[0] - 1):
        # What is the end of a step is as good as the step.
        while j < reached and grid[j] == times[k]:
            j += 1
        if j == reached:
            break
        end = sign * times[k + 1]
        step = times[k + 1] - times[k]
        inside = j
        while inside < reached and sign * grid[inside] < end:
            inside += 1
        if inside == j:
            j = inside
            continue
        counters[ledger.JACOBIAN_CALLS] += 1
        counters[ledger.DECOMPOSITIONS] += 1
        for i in range(n):
            value[i] = states[k, i]
        solves, matrix = _decompose(program, pattern, times[k], value, p, step, pivots)
        few = inside - j <= PLACES.shape[0]
        for m in range(inside - j if few else PLACES.shape[0]):
            s = (grid[j + m] - times[k]) / step if few else PLACES[m]
            read_step(states, dense, k, s, value, slope)
            _find_defect(program[ledger.FIELD], p, times[k] + s * step, step, value, slope, defect)
            if solves:
                solve_shifted(pattern, matrix, pivots, defect)
            good = _is_good(solves, step, value, defect, rtol, atol)
            counters[ledger.FIELD_CALLS] += 1
            if not good:
                # One place tells of all the times of its step.
                low, high = (j + m, j + m + 1) if few else (j, inside)
                for q in range(low, high):
                    doubts[q] = k
                in_doubt += high - low
                if not few:
                    break
        j = inside
    return in_doubt
