"""The times at which a dense output is in doubt, landed on: the method goes again from the start of their step.

    land(program, p, rtol, atol, times, states, grid, doubts, out, counters, memory, record)

replaces the rows of `out` (m, n) that are in doubt, with `doubts` (m,) as `grid.read_grid` leaves it. `memory`, of the
method's size, and `record`, the (times, states, dense) of a few steps, are scratch. Where the run fails, what was read
stays.
"""

from __future__ import annotations

import numpy as np

from gsp.kernels import ledger
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.dop853 import dop853
from gsp.kernels.radau import radau
from gsp.kernels.rodas5p import rodas5p
from gsp.kernels.step_control import all_finite

# What was one step is a step or two again.
MOST_STEPS = 100
# Rows of scratch.
LANDING_RECORD = 4


@kernel
def begin_landing(program, p, t, y, stop, memory, rate):
    """Enter `y` at `t` as the start of a run whose first step leads to `stop`; False where there is none."""
    memory[:] = 0.0
    memory[ledger.TIME] = t
    memory[ledger.STEP] = stop - t
    call(program[ledger.FIELD], t, y, p, rate)
    return all_finite(rate)


@kernel
def end_landing(code, y, row, spent, counters):
    """Enter the state `y` that a run with this code reached in `row`, and what it `spent`."""
    if code == ledger.FINISHED:
        row[:] = y
    counters[ledger.FIELD_CALLS] += spent[ledger.FIELD_CALLS] + 1
    counters[ledger.JACOBIAN_CALLS] += spent[ledger.JACOBIAN_CALLS]
    counters[ledger.DECOMPOSITIONS] += spent[ledger.DECOMPOSITIONS]


@kernel
def land_rodas5p(program, p, rtol, atol, times, states, grid, doubts, out, counters, memory, record):
    """Rodas5P."""
    rate = np.empty(states.shape[1])
    for j in range(grid.shape[0]):
        k = doubts[j]
        if k < 0:
            continue
        y, stops, spent = states[k].copy(), grid[j : j + 1], np.zeros(ledger.COUNTERS_SIZE, np.int64)
        code = ledger.RECORD_FULL
        if begin_landing(program, p, times[k], y, grid[j], memory, rate):
            while code == ledger.RECORD_FULL:
                code = rodas5p(program, p, stops, rtol, atol, MOST_STEPS, y, rate, memory, spent, *record)
        end_landing(code, y, out[j], spent, counters)


@kernel
def land_radau(program, p, rtol, atol, times, states, grid, doubts, out, counters, memory, record):
    """The Radau methods."""
    rate = np.empty(states.shape[1])
    for j in range(grid.shape[0]):
        k = doubts[j]
        if k < 0:
            continue
        y, stops, spent = states[k].copy(), grid[j : j + 1], np.zeros(ledger.COUNTERS_SIZE, np.int64)
        code = ledger.RECORD_FULL
        if begin_landing(program, p, times[k], y, grid[j], memory, rate):
            while code == ledger.RECORD_FULL:
                code = radau(program, p, stops, rtol, atol, MOST_STEPS, y, rate, memory, spent, *record)
        end_landing(code, y, out[j], spent, counters)


@kernel
def land_dop853(program, p, rtol, atol, times, states, grid, doubts, out, counters, memory, record):
    """DOP853."""
    rate = np.empty(states.shape[1])
    for j in range(grid.shape[0]):
        k = doubts[j]
        if k < 0:
            continue
        y, stops, spent = states[k].copy(), grid[j : j + 1], np.zeros(ledger.COUNTERS_SIZE, np.int64)
        code = ledger.RECORD_FULL
        if begin_landing(program, p, times[k], y, grid[j], memory, rate):
            while code == ledger.RECORD_FULL:
                code = dop853(program, p, stops, rtol, atol, MOST_STEPS, y, rate, memory, spent, *record)
        end_landing(code, y, out[j], spent, counters)
