"""Values at the times asked for, read off the steps of a run; and whether the dense output is good enough for them.

The error e of a dense output u obeys e' = J e + f(u) - u', to first order. Where J is fast e follows the defect
f(u) - u'; elsewhere it is a share of the step times the defect. One linear system holds both,

    (RATE/h - J) e = f(u) - u',

with the Jacobian J of the step's start. A time at which e is above the tolerance is handed back, to be landed on.
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

# What a reader does about the error: nothing; what is said above; the same without J, for explicit methods.
TRUSTS = 0
CHECKS = 1
CHECKS_EXPLICIT = 2

# No step is in doubt.
READ = -1

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
def _value(states, dense, k, s, out, j):
    """Fill row `j` of `out` with the state of step `k` at its share `s`, in the arithmetic of `interpolate_many`."""
    r = 1.0 - s
    for i in range(states.shape[1]):
        total = 0.0
        for q in range(dense.shape[1] - 1, -1, -1):
            total = dense[k, q, i] + (s if q % 2 == 0 else r) * total
        out[j, i] = r * states[k, i] + s * states[k + 1, i] + s * r * total


@kernel
def _slope(states, dense, k, s, slope):
    """The derivative of step `k` by its share `s`."""
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
def _is_good(field, pattern, p, t, step, value, slope, solves, factors, pivots, defect, rtol, atol):
    """Whether the error of the dense output at a time looks smaller than the tolerance."""
    call(field, t, value, p, defect)
    inverse = 1.0 / step
    for i in range(value.shape[0]):
        defect[i] -= slope[i] * inverse
    if solves:
        solve_shifted(pattern, factors, pivots, defect)
    else:
        for i in range(value.shape[0]):
            defect[i] *= step / RATE
    bad = 0
    for i in range(value.shape[0]):
        # Written so that what is not a number is bad.
        bad += 0 if abs(defect[i]) <= atol + rtol * abs(value[i]) else 1
    return bad == 0


@kernel
def read_grid(check, program, p, rtol, atol, times, states, dense, grid, begun, out, doubts, counters):
    """Fill rows of `out` (m, n) from number `begun` on with the states at those of `grid` (m,) that the steps reach.

    The steps are `times` (k + 1,), `states` (k + 1, n), `dense` (k, rows, n), which may be empty when every one of the
    grid is the end of a step. `doubts` (m,) receives the step of a time at which the error looks larger than the
    tolerance, else `READ`; in a step with many times that is told from a few places. Returns how many of the grid are
    read by now, and how many of them are in doubt.
    """
    n = states.shape[1]
    count = grid.shape[0]
    sign = 1.0 if times[-1] >= times[0] else -1.0
    value = np.empty(n)
    slope = np.empty(n)
    defect = np.empty(n)
    pattern = pattern_of(program)
    matrix = np.empty((0, n))
    pivots = np.empty(n, np.int64)
    place = np.empty((1, n))
    in_doubt = 0
    j = begun
    while j < count and grid[j] == times[0]:
        doubts[j] = READ
        for i in range(n):
            out[j, i] = states[0, i]
        j += 1
    for k in range(times.shape[0] - 1):
        if j == count:
            break
        end = sign * times[k + 1]
        step = times[k + 1] - times[k]
        inside = j
        while inside < count and sign * grid[inside] < end:
            inside += 1
        solves = False
        if inside > j and check == CHECKS:
            counters[ledger.JACOBIAN_CALLS] += 1
            counters[ledger.DECOMPOSITIONS] += 1
            for i in range(n):
                value[i] = states[k, i]
            solves, matrix = _decompose(program, pattern, times[k], value, p, step, pivots)
        few = inside - j <= PLACES.shape[0]
        good = True
        for m in range(0 if few or check == TRUSTS else PLACES.shape[0]):
            _value(states, dense, k, PLACES[m], place, 0)
            _slope(states, dense, k, PLACES[m], slope)
            for i in range(n):
                value[i] = place[0, i]
            t = times[k] + PLACES[m] * step
            good = good and _is_good(
                program[ledger.FIELD],
                pattern,
                p,
                t,
                step,
                value,
                slope,
                solves,
                matrix,
                pivots,
                defect,
                rtol,
                atol,
            )
            counters[ledger.FIELD_CALLS] += 1
        for q in range(j, inside):
            s = (grid[q] - times[k]) / step
            _value(states, dense, k, s, out, q)
            if check != TRUSTS and few:
                _slope(states, dense, k, s, slope)
                for i in range(n):
                    value[i] = out[q, i]
                good = _is_good(
                    program[ledger.FIELD],
                    pattern,
                    p,
                    grid[q],
                    step,
                    value,
                    slope,
                    solves,
                    matrix,
                    pivots,
                    defect,
                    rtol,
                    atol,
                )
                counters[ledger.FIELD_CALLS] += 1
            doubts[q] = READ if good else k
            in_doubt += 0 if good else 1
        j = inside
        while j < count and grid[j] == times[k + 1]:
            doubts[j] = READ
            for i in range(n):
                out[j, i] = states[k + 1, i]
            j += 1
    return j, in_doubt
