"""Values of an explicit run between its steps: corrected, and where that does not do, landed on: the method goes again
from the start of the step to the time."""

from __future__ import annotations

import numpy as np

from gsp.kernels import ledger
from gsp.kernels.addresses import call_method
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.corrections import READ, correct_grid
from gsp.kernels.step_control import all_finite

# What was one step is a step or two again.
MOST_STEPS = 100
# Rows of scratch.
LANDING_RECORD = 4


@kernel
def land(program, p, rtol, atol, times, states, grid, doubtful, out, counters, memory, record):
    """Replace the rows of `out` (m, n) that are in doubt, with `doubtful` (m,) as `correct_grid` leaves it.

    `memory`, of the method's size, and `record`, the (times, states, dense) of a few steps, are scratch. Where the run
    fails, what was read stays.
    """
    n = states.shape[1]
    y = np.empty(n)
    rate = np.empty(n)
    spent = np.empty(ledger.COUNTERS_SIZE, np.int64)
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
        memory[ledger.TIME] = times[k]
        memory[ledger.STEP] = grid[j] - times[k]
        call(program[ledger.FIELD], times[k], y, p, rate)
        spent[ledger.FIELD_CALLS] = 1
        code = ledger.RECORD_FULL if all_finite(rate) else ledger.NON_FINITE
        while code == ledger.RECORD_FULL:
            code = call_method(
                program[ledger.METHOD], program, p, grid[j : j + 1], rtol, atol, MOST_STEPS,
                y, rate, memory, spent, record[0], record[1], record[2],
            )  # fmt: skip
        if code == ledger.FINISHED:
            for i in range(n):
                out[j, i] = y[i]
        counters[ledger.FIELD_CALLS] += spent[ledger.FIELD_CALLS]


@kernel
def correct(program, p, rtol, atol, times, states, dense, grid, begun, reached, out, counters, memory):
    """Correct rows `begun` to `reached` - 1 of `out` (m, n), as `read_grid` has filled them, or land on their times.

    `memory`, of the method's size, is scratch.
    """
    n = states.shape[1]
    doubtful = np.empty(grid.shape[0], np.int64)
    if correct_grid(
        program, p, rtol, atol, times, states, dense, grid, begun, reached, out, doubtful, counters
    ):
        record = (np.empty(LANDING_RECORD), np.empty((LANDING_RECORD, n)), dense[:0])
        land(
            program, p, rtol, atol, times, states, grid[begun:reached], doubtful[begun:reached], out[begun:reached],
            counters, memory, record,
        )  # fmt: skip
