"""Many runs of one flow: members one after the other in compiled code, several calls side by side in threads."""

from __future__ import annotations

import numpy as np

from gsp.kernels import integrator
from gsp.kernels.addresses import call_method
from gsp.kernels.call import call
from gsp.kernels.compilation import inlined_kernel, kernel
from gsp.kernels.grid import read_grid
from gsp.kernels.landing import correct
from gsp.kernels.uncounted import uncounted, uncounted_record

# Codes beside those of `integrator`: 0, its RECORD_FULL, of a member that has not begun or was interrupted.
NOT_FINISHED = integrator.RECORD_FULL


@kernel
def _keep(corrects, flow, control, made, wanted, scratch):
    """Enter the states at those of a grid (m,) that steps reach in `kept` (m, n); returns how many are entered by now.

    `made` is a record with the start in row 0, how many steps of it are new, and where the run ends; `wanted` the grid,
    how many of it are entered, and `kept`. Where it `corrects` they are as `landing.correct` makes them; `scratch`
    are the counters and a memory.
    """
    (times, states, dense), new, stop = made
    grid, before, kept = wanted
    rtol, atol, _ = control
    if before == grid.shape[0] or (grid.shape[0] == 1 and grid[0] == stop):
        # The end alone, where a step ends, is not read between steps.
        if before < grid.shape[0] and new > 0 and times[new] == stop:
            for i in range(states.shape[1]):
                kept[before, i] = states[new, i]
            before += 1
        return before
    program, p = flow
    counters, memory = scratch
    ends = times[: new + 1]
    reached = read_grid(ends, states[: new + 1], dense, grid, before, kept)
    if corrects and dense.shape[0] > 0:
        correct(
            program, p, (rtol, atol), (ends, states[: new + 1], dense), grid[before:reached], kept[before:reached],
            counters, memory,
        )  # fmt: skip
    return reached


@inlined_kernel
def uncounted_members(shared, arrays, scratch):
    """What `run_members` takes, each array uncounted."""
    corrects, program, constants, first, (stops, spans), grid, control = shared
    ends, reached, kept, counters, codes = arrays
    rate, memory, record = scratch
    return (
        (
            corrects,
            uncounted(program),
            uncounted(constants),
            first,
            (uncounted(stops), uncounted(spans)),
            uncounted(grid),
            control,
        ),
        (uncounted(ends), uncounted(reached), uncounted(kept), uncounted(counters), uncounted(codes)),
        (uncounted(rate), uncounted(memory), uncounted_record(record)),
    )


@inlined_kernel
def begin_member(first, scratch):
    """Put an integrator at the start of a run: the code and the number of times kept to begin with."""
    rate, memory, _ = scratch
    memory[:] = 0.0
    memory[integrator.TIME] = first
    rate[:] = 0.0
    return integrator.RECORD_FULL, 0


@kernel
def run_piece(shared, arrays, scratch, i, before, spare):
    """Advance member `i` by a record of steps; the code, how many steps, and how many of the grid are kept by now.

    Row 0 of the record receives where the member stands, of which `before` times are kept. `spare`, of the memory's
    size, is scratch.
    """
    corrects, program, constants, _, (stops, spans), grid, control = shared
    stops = stops[spans[i, 0] : spans[i, 1]]
    ends, _, kept, counters, _ = arrays
    rate, memory, record = scratch
    times, states, dense = record
    times[0] = memory[integrator.TIME]
    for k in range(ends.shape[1]):
        states[0, k] = ends[i, k]
    begun = counters[i, integrator.STEPS]
    flow = (program, constants[i])
    code = call_method(
        program[integrator.METHOD],
        flow,
        stops,
        control,
        (ends[i], rate, memory, counters[i]),
        (times[1:], states[1:], dense),
    )
    new = counters[i, integrator.STEPS] - begun
    made, wanted = (record, new, stops[-1]), (grid, before, kept[i])
    return code, new, _keep(corrects, flow, control, made, wanted, (counters[i], spare))


@kernel
def run_members(shared, low, high, halt, arrays, scratch):
    """Run the members low to high - 1 from a time to the last of some stops, each as if it were alone.

    `shared` are whether values between steps are corrected, the program, with its loops, p of each member (members, k),
    the time of the start, the stops of all members with the span (members, 2) of each in them, the grid (m,) and
    (rtol, atol, max_steps). Row i of `arrays` is member i's: its state (the start, then what was reached), the time
    reached, the states at the grid, where `shared` says so as `landing.correct` makes them, the integrator's counters,
    and the code. `scratch` are a rate (n,), the integrator's memory and a record with a row for the start. No step is
    begun with a fresh record once `halt` (1,) is not 0.
    """
    shared, arrays, scratch = uncounted_members(shared, arrays, scratch)
    _, memory, _ = scratch
    _, reached, _, _, codes = arrays
    spare = np.empty_like(memory)
    for i in range(low, high):
        if halt[0] != 0:
            return
        code, before = begin_member(shared[3], scratch)
        while code == integrator.RECORD_FULL and halt[0] == 0:
            code, _, before = run_piece(shared, arrays, scratch, i, before, spare)
        reached[i] = memory[integrator.TIME]
        codes[i] = code


@kernel
def evaluate_members(address, kept, constants, out):
    """Fill `out` (members, times, outputs) with the function at `kept` (members, times, n) and each member's p."""
    for i in range(kept.shape[0]):
        for j in range(kept.shape[1]):
            call(address, 0.0, kept[i, j], constants[i], out[i, j])
