"""Many runs of one flow: members one after the other in compiled code, several calls side by side in threads."""

from __future__ import annotations

import numpy as np

from gsp.kernels import integrator
from gsp.kernels.addresses import call_method
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.grid import read_grid
from gsp.kernels.landing import correct
from gsp.kernels.uncounted import uncounted, uncounted_record

# Codes beside those of `integrator`: 0, its RECORD_FULL, of a member that has not begun or was interrupted.
NOT_FINISHED = integrator.RECORD_FULL


@kernel
def keep(corrects, program, p, control, record, new, stop, grid, before, kept, counters, memory):
    """Enter the states at those of `grid` (m,) that the first `new` steps reach in `kept` (m, n), from number `before`.

    `record` has the start in row 0; the run ends at `stop`. Where it `corrects` they are as `landing.correct` makes
    them, with `memory` as scratch. Returns how many of the grid are entered by now.
    """
    rtol, atol, _ = control
    times, states, dense = record
    n = states.shape[1]
    if before == grid.shape[0] or (grid.shape[0] == 1 and grid[0] == stop):
        # The end alone, where a step ends, is not read between steps.
        if before < grid.shape[0] and new > 0 and times[new] == stop:
            for i in range(n):
                kept[before, i] = states[new, i]
            before += 1
        return before
    ends = times[: new + 1]
    reached = read_grid(ends, states[: new + 1], dense, grid, before, kept)
    if corrects and dense.shape[0] > 0:
        correct(
            program, p, (rtol, atol), (ends, states[: new + 1], dense), grid[before:reached], kept[before:reached],
            counters, memory,
        )  # fmt: skip
    return reached


@kernel
def run_piece(program, p, stops, control, y, rate, memory, counters, record):
    """Advance a member by a record of steps behind row 0, which receives where it stands; the code and the steps."""
    times, states, dense = record
    rtol, atol, max_steps = control
    times[0] = memory[integrator.TIME]
    for i in range(y.shape[0]):
        states[0, i] = y[i]
    begun = counters[integrator.STEPS]
    code = call_method(
        program[integrator.METHOD], program, p, stops, rtol, atol, max_steps,
        y, rate, memory, counters, times[1:], states[1:], dense,
    )  # fmt: skip
    return code, counters[integrator.STEPS] - begun


@kernel
def run_members(
    corrects, program, constants, first, stops, grid, control, low, high, halt,
    ends, reached, kept, counters, codes, rate, memory, record,
):  # fmt: skip
    """Run the members low to high - 1 from `first` to the last of `stops` (s,), each as if it were alone.

    Row i of `constants` (members, k), `ends` (members, n), `counters`, `reached` and `codes` (members,) is member i's:
    p, its state (the start, then what was reached), the integrator's counters, the time reached and the code. `kept`
    (members, m, n) receives the states at `grid` (m,), where `corrects` as
    `landing.correct` makes them. `program` has its
    loops. `control` is (rtol, atol, max_steps). `rate` (n,), `memory` and `record` (times, states, dense), with a row
    for the start, are scratch of this call. No step is begun with a fresh record once `halt` (1,) is not 0.
    """
    program, stops, grid = uncounted(program), uncounted(stops), uncounted(grid)
    constants, ends, kept, counters = (
        uncounted(constants),
        uncounted(ends),
        uncounted(kept),
        uncounted(counters),
    )
    rate, memory, record = uncounted(rate), uncounted(memory), uncounted_record(record)
    scratch = np.empty_like(memory)
    for i in range(low, high):
        if halt[0] != 0:
            return
        memory[:] = 0.0
        memory[integrator.TIME] = first
        rate[:] = 0.0
        code = integrator.RECORD_FULL
        before = 0
        while code == integrator.RECORD_FULL and halt[0] == 0:
            code, new = run_piece(
                program, constants[i], stops, control, ends[i], rate, memory, counters[i], record
            )
            before = keep(
                corrects, program, constants[i], control, record, new, stops[-1], grid, before, kept[i], counters[i],
                scratch,
            )  # fmt: skip
        reached[i] = memory[integrator.TIME]
        codes[i] = code


@kernel
def evaluate_members(address, kept, constants, out):
    """Fill `out` (members, times, outputs) with the function at `kept` (members, times, n) and each member's p."""
    for i in range(kept.shape[0]):
        for j in range(kept.shape[1]):
            call(address, 0.0, kept[i, j], constants[i], out[i, j])
