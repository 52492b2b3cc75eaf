"""Values of an explicit run between its steps: corrected, and where that does not do, landed on: the method goes again
from the start of the step to the time."""

from __future__ import annotations

import numpy as np

from gsp.kernels import integrator
from gsp.kernels.addresses import call_method
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.corrections import READ, correct_grid
from gsp.kernels.step_control import all_finite

# Rows of scratch.
LANDING_RECORD = 4


@kernel
def land(program, p, tolerances, steps, grid, out, doubtful, memory):
    """Replace the rows of `out` (m, n) that are in doubt, with `doubtful` (m,) as `correct_grid` leaves it.

    `memory`, of the method's size, is scratch. Where the run fails, what was read stays. Returns how many calls of
    the field that took.
    """
    rtol, atol = tolerances
    times, states, dense = steps
    n = states.shape[1]
    ends, between = np.empty(LANDING_RECORD), np.empty((LANDING_RECORD, n))
    calls = 0
    y = np.empty(n)
    rate = np.empty(n)
    spent = np.empty(integrator.COUNTERS_SIZE, np.int64)
    for j in range(grid.shape[0]):
        k = doubtful[j]
        if k == READ:
            continue
        for i in range(n):
            y[i] = states[k, i]
        for i in range(memory.shape[0]):
            memory[i] = 0.0
        for i in range(spent.shape[0]):
            spent[i] = 0
        # The step that leads there is tried first.
        memory[integrator.TIME] = times[k]
        memory[integrator.STEP] = grid[j] - times[k]
        call(program[integrator.FIELD], times[k], y, p, rate)
        spent[integrator.FIELD_CALLS] = 1
        code = integrator.RECORD_FULL if all_finite(rate) else integrator.NON_FINITE
        while code == integrator.RECORD_FULL:
            # What was one step is a step or two again.
            code = call_method(
                program[integrator.METHOD], (program, p), grid[j : j + 1], (rtol, atol, 100),
                (y, rate, memory, spent), (ends, between, dense[:0]),
            )  # fmt: skip
        if code == integrator.FINISHED:
            for i in range(n):
                out[j, i] = y[i]
        calls += spent[integrator.FIELD_CALLS]
    return calls


@kernel
def correct(program, p, tolerances, steps, grid, out, counters, memory):
    """Correct `out` (m, n), as `read_grid` has filled it at `grid` (m,), or land on its times.

    `memory`, of the method's size, is scratch.
    """
    doubtful = np.empty(grid.shape[0], np.int64)
    if correct_grid(program, p, tolerances, steps, grid, out, doubtful, counters):
        calls = land(program, p, tolerances, steps, grid, out, doubtful, memory)
        counters[integrator.FIELD_CALLS] += calls
