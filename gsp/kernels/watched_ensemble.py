"""Many runs of one flow whose test functions keep clear of zero, looked at as the single run looks at them."""

from __future__ import annotations

import numpy as np

from gsp.kernels import ensemble, integrator
from gsp.kernels.compilation import kernel
from gsp.kernels.scan import begins_clear, clear_of_zero
from gsp.kernels.uncounted import uncounted, uncounted_record


@kernel
def begin_members(functions, constants, first, starts, signs, clear):
    """Whether each member begins as `scan.begins_clear` wants it, into `clear` (members,), and with which `signs`."""
    functions, constants, starts = uncounted(functions), uncounted(constants), uncounted(starts)
    signs, clear = uncounted(signs), uncounted(clear)
    for i in range(starts.shape[0]):
        clear[i] = begins_clear(functions, constants[i], signs[i], first, starts[i])


@kernel
def run_watched_members(
    corrects, program, constants, first, stops, grid, control, tests, low, high, halt,
    ends, reached, kept, counters, codes, ordinary, rate, memory, record,
):  # fmt: skip
    """`ensemble.run_members`, each record of steps looked at by `clear_of_zero` as it is full.

    `tests` are (functions, signs (members, w)) for `clear_of_zero`. A member whose entry of `ordinary` (members,) is
    False is not begun; the entry becomes False, and the member is left where it is, when a look does not find its steps
    clear.
    """
    program, stops, grid = uncounted(program), uncounted(stops), uncounted(grid)
    constants, ends, kept, counters = (
        uncounted(constants),
        uncounted(ends),
        uncounted(kept),
        uncounted(counters),
    )
    rate, memory, record = uncounted(rate), uncounted(memory), uncounted_record(record)
    times, states, dense = record
    scratch = np.empty_like(memory)
    functions, signs = uncounted(tests[0]), uncounted(tests[1])
    for i in range(low, high):
        if halt[0] != 0:
            return
        if not ordinary[i]:
            continue
        memory[:] = 0.0
        memory[integrator.TIME] = first
        rate[:] = 0.0
        code = integrator.RECORD_FULL
        before = 0
        while code == integrator.RECORD_FULL and halt[0] == 0 and ordinary[i]:
            code, new = ensemble.run_piece(
                program, constants[i], stops, control, ends[i], rate, memory, counters[i], record
            )
            before = ensemble.keep(
                corrects,
                program,
                constants[i],
                control,
                record,
                new,
                stops[-1],
                grid,
                before,
                kept[i],
                counters[i],
                scratch,
            )
            ordinary[i] = clear_of_zero(
                functions, constants[i], signs[i], times[0], states[0], times[1 : new + 1], states[1:], dense
            )
        reached[i] = memory[integrator.TIME]
        codes[i] = code
