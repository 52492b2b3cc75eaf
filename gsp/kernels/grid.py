"""Values at the times asked for, read off the steps of a run."""

from __future__ import annotations

from gsp.kernels.compilation import inlined_kernel, kernel
from gsp.kernels.sparse_systems import AT


@kernel
def runs_along(grid, first, last):
    """Whether the times of `grid` (m,) lie between `first` and `last`, each nearer to the end than the one before."""
    sign = 1.0 if last > first else -1.0
    wrong = 0
    for j in range(grid.shape[0] - 1):
        # Written so that what is not a number is wrong.
        wrong += 0 if sign * grid[j] < sign * grid[j + 1] else 1
    return wrong == 0 and sign * first <= sign * grid[0] and sign * grid[-1] <= sign * last


# Both inlined, since to hand so many arrays on would take longer than a step's few times do.
@inlined_kernel
def _read_numbers(times, states, dense, k, grid, low, high, out):
    """`_read_states`, bit by bit, number by number."""
    step = times[k + 1] - times[k]
    for j in range(low, high):
        s = (grid[j] - times[k]) / step
        r = 1.0 - s
        for i in range(states.shape[1]):
            total = 0.0
            for m in range(dense.shape[1] - 1, -1, -1):
                total = dense[AT(k), AT(m), AT(i)] + (s if m % 2 == 0 else r) * total
            out[AT(j), AT(i)] = r * states[AT(k), AT(i)] + s * states[AT(k + 1), AT(i)] + s * r * total


@inlined_kernel
def _read_states(times, states, dense, k, grid, low, high, out):
    """The states of step `k` at the times low to high - 1 of `grid`, in the arithmetic of `interpolate_many`."""
    n, rows = states.shape[1], dense.shape[1]
    step = times[k + 1] - times[k]
    for j in range(low, high):
        s = (grid[j] - times[k]) / step
        r = 1.0 - s
        for i in range(n):
            out[j, i] = dense[k, rows - 1, i]
        for m in range(rows - 2, -1, -1):
            factor = s if m % 2 == 0 else r
            for i in range(n):
                out[j, i] = dense[k, m, i] + factor * out[j, i]
        for i in range(n):
            out[j, i] = r * states[k, i] + s * states[k + 1, i] + s * r * out[j, i]


@kernel
def read_grid(times, states, dense, grid, begun, out):
    """Fill rows of `out` (m, n) from number `begun` on with the states at those of `grid` (m,) that the steps reach.

    The steps are `times` (k + 1,), `states` (k + 1, n), `dense` (k, rows, n), which may be empty when every one of the
    grid is the end of a step. Returns how many of the grid are read by now.
    """
    n = states.shape[1]
    count = grid.shape[0]
    sign = 1.0 if times[-1] >= times[0] else -1.0
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
            # Along fewer states than these loops take longer to begin than to run, and values are read one by
            # one.
            if n < 6:
                _read_numbers(times, states, dense, k, grid, j, inside, out)
            else:
                _read_states(times, states, dense, k, grid, j, inside, out)
        j = inside
        while j < count and grid[j] == times[k + 1]:
            for i in range(n):
                out[j, i] = states[k + 1, i]
            j += 1
    return j
