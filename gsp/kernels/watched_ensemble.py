"""Many runs of one flow whose test functions keep clear of zero, looked at as the single run looks at them."""

from __future__ import annotations

import numpy as np

from gsp.kernels import ensemble, integrator
from gsp.kernels.compilation import kernel
from gsp.kernels.scan import begins_clear, clear_of_zero
from gsp.kernels.uncounted import uncounted


@kernel
def begin_members(functions, constants, first, starts, signs, clear):
    """Whether each member begins as `scan.begins_clear` wants it, into `clear` (members,), and with which `signs`."""
    functions, constants, starts = uncounted(functions), uncounted(constants), uncounted(starts)
    signs, clear = uncounted(signs), uncounted(clear)
    for i in range(starts.shape[0]):
        clear[i] = begins_clear(functions, constants[i], signs[i], first, starts[i])


@kernel
def run_watched_members(shared, tests, low, high, halt, arrays, ordinary, scratch):
    """`ensemble.run_members`, each record of steps looked at by `clear_of_zero` as it is full.

    `tests` are (functions, signs (members, w)) for `clear_of_zero`. A member whose entry of `ordinary` (members,) is
    False is not begun; the entry becomes False, and the member is left where it is, when a look does not find its steps
    clear.
    """
    shared, arrays, scratch = ensemble.uncounted_members(shared, arrays, scratch)
    _, memory, (times, states, dense) = scratch
    _, reached, _, _, codes = arrays
    spare = np.empty_like(memory)
    functions, signs = uncounted(tests[0]), uncounted(tests[1])
    for i in range(low, high):
        if halt[0] != 0:
            return
        if not ordinary[i]:
            continue
        code, before = ensemble.begin_member(shared[3], scratch)
        while code == integrator.RECORD_FULL and halt[0] == 0 and ordinary[i]:
            code, new, before = ensemble.run_piece(shared, arrays, scratch, i, before, spare)
            steps = (times[1 : new + 1], states[1:], dense)
            ordinary[i] = clear_of_zero(functions, shared[2][i], signs[i], (times[0], states[0]), steps)
        reached[i] = memory[integrator.TIME]
        codes[i] = code
