"""Many runs of one flow: members one after the other in compiled code, several calls side by side in threads."""

from __future__ import annotations

import numpy as np

from gsp.kernels import ledger
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.dop853 import dop853
from gsp.kernels.radau import radau
from gsp.kernels.rodas5p import rodas5p
from gsp.kernels.step_control import largest_rate
from gsp.kernels.taylor import taylor

# Which kernel runs.
RODAS5P = 0
RADAU = 1
DOP853 = 2
TAYLOR = 3

# Codes beside the ledger's: 0, its RECORD_FULL, of a member that has not begun or was interrupted.
NOT_FINISHED = ledger.RECORD_FULL


@kernel
def advance(kernel, program, p, stops, control, y, rate, memory, counters, record):
    """Call the integrator numbered `kernel`."""
    rtol, atol, max_steps = control
    times, states, dense = record
    if kernel == RODAS5P:
        return rodas5p(
            program, p, stops, rtol, atol, max_steps, y, rate, memory, counters, times, states, dense
        )
    if kernel == RADAU:
        return radau(program, p, stops, rtol, atol, max_steps, y, rate, memory, counters, times, states, dense)
    if kernel == TAYLOR:
        return taylor(program, p, stops, rtol, atol, max_steps, y, rate, memory, counters, times, states, dense)
    return dop853(program, p, stops, rtol, atol, max_steps, y, rate, memory, counters, times, states, dense)


@kernel
def keep(times, states, new, stop, stops, before, kept):
    """Enter the states of the first `new` rows that end on `stops`, from number `stop` on, in `kept` (times, n)."""
    columns, n = kept.shape
    for row in range(new):
        # Steps end on the stops exactly, so that equality is meant here.
        if stop < stops.shape[0] and times[row] == stops[stop]:
            if before + stop < columns:
                for j in range(n):
                    kept[before + stop, j] = states[row, j]
            stop += 1


@kernel
def _run_member(
    kernel, program, p, stops, before, control, halt, y, kept, counters, rate, memory, record
):  # fmt: skip
    """One member to the last stop or a failure, from where `memory`, `y` and `counters` stand."""
    times, states, _ = record
    code = ledger.RECORD_FULL
    while code == ledger.RECORD_FULL and halt[0] == 0:
        begun = counters[ledger.STEPS]
        stop = counters[ledger.NEXT_STOP]
        code = advance(kernel, program, p, stops, control, y, rate, memory, counters, record)
        keep(times, states, counters[ledger.STEPS] - begun, stop, stops, before, kept)
    return code


@kernel
def _begins(jacobian, p, first, last, y, border):
    """Whether a member's start has so few fast times before it that the trial is made."""
    return largest_rate(jacobian, first, y, p) * abs(last - first) <= border


@kernel
def any_begins(jacobian, constants, first, last, starts, border):
    """Whether the trial is made for any member."""
    for i in range(starts.shape[0]):  # noqa: SIM110 - a generator does not compile
        if _begins(jacobian, constants[i], first, last, starts[i], border):
            return True
    return False


@kernel
def run_members(
    kernel, program, constants, first, stops, before, control, trial, low, high, halt,
    ends, reached, kept, counters, codes, explicit, rate, memory, record, trial_record,
):  # fmt: skip
    """Run the members low to high - 1 from `first` to the last of `stops` (s,), each as if it were alone.

    Row i of `constants` (members, k), `ends` (members, n), `counters`, `reached`, `codes` and `explicit` (members,) is
    member i's: p, its state (the start, then what was reached), the ledger's counters, the time reached, the code,
    and whether the trial went all the way. Column before + q of `kept` (members, times, n) receives the state at
    stops[q], if there is such a column. `control` is (rtol, atol, max_steps). `trial` is (kernel, program,
    border, attempts): where |J| times the span is at most the border at the start, that kernel has so many attempts
    first, as in `integrators.run`.
    `rate` (n,), `memory` and the records (times, states, dense) are scratch of this call. No step is begun with a
    fresh record once `halt` (1,) is not 0.
    """
    rtol, atol, max_steps = control
    first_kernel, first_program, border, attempts = trial
    spent = np.zeros(ledger.COUNTERS_SIZE, np.int64)
    for i in range(low, high):
        if halt[0] != 0:
            return
        memory[:] = 0.0
        memory[ledger.TIME] = first
        rate[:] = 0.0
        spent[:] = 0
        code = ledger.RECORD_FULL
        explicit[i] = False
        if border > 0.0:
            begins = _begins(program[ledger.JACOBIAN], constants[i], first, stops[-1], ends[i], border)
            if begins:
                limited = (rtol, atol, min(attempts, max_steps))
                code = _run_member(
                    first_kernel, first_program, constants[i], stops, before, limited, halt,
                    ends[i], kept[i], counters[i], rate, memory, trial_record,
                )  # fmt: skip
                used = counters[i, ledger.STEPS] + counters[i, ledger.REJECTED]
                explicit[i] = code == ledger.FINISHED or halt[0] != 0 or used >= max_steps
                if not explicit[i]:
                    # The implicit method goes on from here, as one that begins.
                    spent[:] = counters[i]
                    counters[i] = 0
                    counters[i, ledger.NEXT_STOP] = spent[ledger.NEXT_STOP]
                    here = memory[ledger.TIME]
                    memory[:] = 0.0
                    memory[ledger.TIME] = here
                    rate[:] = 0.0
        if not explicit[i]:
            left = (rtol, atol, max_steps - spent[ledger.STEPS] - spent[ledger.REJECTED])
            code = _run_member(
                kernel, program, constants[i], stops, before, left, halt,
                ends[i], kept[i], counters[i], rate, memory, record,
            )  # fmt: skip
            for k in range(ledger.STIFF):
                counters[i, k] += spent[k]
            counters[i, ledger.STIFF] = max(counters[i, ledger.STIFF], spent[ledger.STIFF])
        reached[i] = memory[ledger.TIME]
        codes[i] = code


@kernel
def evaluate_members(address, kept, constants, out):
    """Fill `out` (members, times, outputs) with the function at `kept` (members, times, n) and each member's p."""
    for i in range(kept.shape[0]):
        for j in range(kept.shape[1]):
            call(address, 0.0, kept[i, j], constants[i], out[i, j])
