"""The times at which a dense output is in doubt, landed on: the method goes again from the start of their step."""

from __future__ import annotations

import numpy as np

from gsp.kernels import ledger
from gsp.kernels.addresses import call_method
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.grid import READ
from gsp.kernels.step_control import all_finite

# What was one step is a step or two again.
MOST_STEPS = 100
# Rows of scratch.
LANDING_RECORD = 4


@kernel
def land(program, p, rtol, atol, times, states, grid, doubts, out, counters, memory, record):
    """Replace the rows of `out` (m, n) that are in doubt, with `doubts` (m,) as `grid.read_grid` leaves it.

    `memory`, of the method's size, and `record`, the (times, states, dense) of a few steps, are scratch. Where the run
    fails, what was read stays. Returns the ledger's FINISHED, or LOOPS_WANTED when the rest is to be landed on once
    they are there; of what is done the doubt is taken.
    """
    n = states.shape[1]
    y = np.empty(n)
    rate = np.empty(n)
    spent = np.empty(ledger.COUNTERS_SIZE, np.int64)
    for j in range(grid.shape[0]):
        k = doubts[j]
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
        if code == ledger.LOOPS_WANTED:
            return code
        if code == ledger.FINISHED:
            for i in range(n):
                out[j, i] = y[i]
        doubts[j] = READ
        counters[ledger.FIELD_CALLS] += spent[ledger.FIELD_CALLS]
        counters[ledger.JACOBIAN_CALLS] += spent[ledger.JACOBIAN_CALLS]
        counters[ledger.DECOMPOSITIONS] += spent[ledger.DECOMPOSITIONS]
    return ledger.FINISHED
