"""Values at the times asked for, read off the steps of a run."""

from __future__ import annotations

import numpy as np

from gsp.kernels.compilation import kernel

# Reading goes along the times of a step where it has more than this many, and along the states where those are so many;
# else number by number. Shorter loops take longer to begin than to run.
FEW_TIMES = 4
MANY_STATES = 8


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
def _along_states(times, states, dense, k, grid, low, high, out):
    """The states of step `k` at the times low to high - 1 of `grid`, in the arithmetic of `interpolate_many`."""
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
    """`_along_states`, bit by bit, along whatever makes the longer loops."""
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
def read_grid(times, states, dense, grid, begun, out):
    """Fill rows of `out` (m, n) from number `begun` on with the states at those of `grid` (m,) that the steps reach.

    The steps are `times` (k + 1,), `states` (k + 1, n), `dense` (k, rows, n), which may be empty when every one of the
    grid is the end of a step. Returns how many of the grid are read by now.
    """
    n = states.shape[1]
    count = grid.shape[0]
    sign = 1.0 if times[-1] >= times[0] else -1.0
    shares = np.empty(count - begun)
    rests = np.empty(count - begun)
    totals = np.empty(count - begun)
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
            _values(times, states, dense, k, grid, j, inside, out, shares, rests, totals)
        j = inside
        while j < count and grid[j] == times[k + 1]:
            for i in range(n):
                out[j, i] = states[k + 1, i]
            j += 1
    return j
