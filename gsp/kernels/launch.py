"""A run from its start, as Python calls it: few arguments, because each costs 50 ns, and what is cheap here done here.

    launch(program, given, stops, max_steps, work, counters, times, states, dense)

calls the integrator of `ledger` with p and y from `given`, `memory` and `rate` from `work`, and rows of the record
that leave row 0 of `times` (k + 1,) and `states` (k + 1, n) to the start. Before the first call `work` and `counters`
hold zeros; the same `given`, `work` and `counters` go on with a run whose record is full. The code is the ledger's,
or DECLINED: nothing was done, for the start is as mild as `given` says.
"""

from __future__ import annotations

from numba import njit

from gsp.kernels import ledger
from gsp.kernels.call import call
from gsp.kernels.dop853 import dop853
from gsp.kernels.radau import radau
from gsp.kernels.rodas5p import rodas5p
from gsp.kernels.step_control import largest_rate

# given: the time of the start, the step to try first or 0, the tolerances, the largest |J| times span for which the
# answer is DECLINED or 0; then y (n,), which moves with the run, then p.
FIRST = 0
FIRST_STEP = 1
RTOL = 2
ATOL = 3
MILDEST = 4
Y = 5

# Beside the ledger's codes.
DECLINED = -1


@njit(cache=True, error_model="numpy", nogil=True)
def _parts(given, work, n):
    """(y, p, memory, rate)."""
    return given[Y : Y + n], given[Y + n :], work[:-n], work[-n:]


@njit(cache=True, error_model="numpy", nogil=True)
def _begins(program, given, y, p, stops, memory, rate, times, states):
    """Enter the start of a run that has not begun; False for a mild one."""
    first = given[FIRST]
    if memory[ledger.STEP] != 0.0:
        return True
    mildest = given[MILDEST]
    if (
        mildest > 0.0
        and largest_rate(program[ledger.JACOBIAN], first, y, p) * abs(stops[-1] - first) <= mildest
    ):
        return False
    times[0] = first
    states[0] = y
    memory[ledger.TIME] = first
    if given[FIRST_STEP] != 0.0:
        memory[ledger.STEP] = given[FIRST_STEP]
        call(program[ledger.FIELD], first, y, p, rate)
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def launch_rodas5p(program, given, stops, max_steps, work, counters, times, states, dense):
    """Rodas5P."""
    y, p, memory, rate = _parts(given, work, states.shape[1])
    if not _begins(program, given, y, p, stops, memory, rate, times, states):
        return DECLINED
    return rodas5p(
        program, p, stops, given[RTOL], given[ATOL], max_steps,
        y, rate, memory, counters, times[1:], states[1:], dense,
    )  # fmt: skip


@njit(cache=True, error_model="numpy", nogil=True)
def launch_radau(program, given, stops, max_steps, work, counters, times, states, dense):
    """The Radau methods."""
    y, p, memory, rate = _parts(given, work, states.shape[1])
    if not _begins(program, given, y, p, stops, memory, rate, times, states):
        return DECLINED
    return radau(
        program, p, stops, given[RTOL], given[ATOL], max_steps,
        y, rate, memory, counters, times[1:], states[1:], dense,
    )  # fmt: skip


@njit(cache=True, error_model="numpy", nogil=True)
def launch_dop853(program, given, stops, max_steps, work, counters, times, states, dense):
    """DOP853."""
    y, p, memory, rate = _parts(given, work, states.shape[1])
    if not _begins(program, given, y, p, stops, memory, rate, times, states):
        return DECLINED
    return dop853(
        program, p, stops, given[RTOL], given[ATOL], max_steps,
        y, rate, memory, counters, times[1:], states[1:], dense,
    )  # fmt: skip
