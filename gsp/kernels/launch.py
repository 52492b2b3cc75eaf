"""A run from its start, as Python calls it: few arrays, because each costs 50 ns, and what is cheap here done here.

    launch(program, given, stops, max_steps, work, counters, times, states, dense)

calls the integrator of `program` with the start, tolerances, y and p of `given`, with `memory` and `rate` from `work`,
and with a record behind row 0 of `times` (k + 1,) and `states` (k + 1, n), which is filled with where the run stands.
Before that `counters` holds zeros, and `work` too, but for a step to try first with its rate. The same `given`, `work`
and `counters` go on with a run whose record is full. The code is the ledger's.
"""

from __future__ import annotations

from gsp.kernels import ledger
from gsp.kernels.addresses import call_method
from gsp.kernels.compilation import kernel
from gsp.kernels.scan import WATCHED, begins_clear, clear_of_zero
from gsp.kernels.step_control import largest_rate

# given: the time of the start and the tolerances; then y (n,), which moves with the run, then p.
FIRST = 0
RTOL = 1
ATOL = 2
Y = 3


@kernel
def rate_at_start(program, given, n):
    """`largest_rate` where a run starts."""
    return largest_rate(program, given[FIRST], given[Y : Y + n], given[Y + n :])


@kernel
def launch(program, given, stops, max_steps, work, counters, times, states, dense):
    """Begin a run, or go on with it."""
    n = states.shape[1]
    times[0] = given[FIRST] if counters[ledger.FIELD_CALLS] == 0 else work[ledger.TIME]
    work[ledger.TIME] = times[0]
    for i in range(n):
        states[0, i] = given[Y + i]
    return call_method(
        program[ledger.METHOD], program, given[Y + n :], stops, given[RTOL], given[ATOL], max_steps,
        given[Y : Y + n], work[-n:], work[:-n], counters, times[1:], states[1:], dense,
    )  # fmt: skip


@kernel
def launch_watched(program, functions, given, stops, max_steps, work, counters, times, states, dense):
    """`launch`, with a look along the steps that are made: LOOK_WANTED where a watched function may pass through zero.

    `functions` are as `scan` takes them; their signs, zeros at first, stand in `work` between `memory` and `rate`.
    """
    n = states.shape[1]
    signs = work[work.size - n - functions[WATCHED] : work.size - n]
    before = counters[ledger.STEPS]
    code = launch(program, given, stops, max_steps, work, counters, times, states, dense)
    new = counters[ledger.STEPS] - before
    p = given[Y + n :]
    if signs[0] == 0.0 and (new == 0 or not begins_clear(functions, p, signs, times[0], states[0])):
        return ledger.LOOK_WANTED
    if new and not clear_of_zero(
        functions, p, signs, times[0], states[0], times[1 : new + 1], states[1:], dense
    ):
        return ledger.LOOK_WANTED
    return code
