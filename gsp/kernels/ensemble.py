"""Many runs of one flow: members one after the other in compiled code, several calls side by side in threads."""

from __future__ import annotations

from numba import njit

from gsp.kernels import ledger
from gsp.kernels.call import call
from gsp.kernels.dop853 import dop853
from gsp.kernels.radau import radau
from gsp.kernels.rodas5p import rodas5p

# Which kernel runs.
RODAS5P = 0
RADAU = 1
DOP853 = 2

# Codes beside the ledger's: 0, its RECORD_FULL, of a member that has not begun or was interrupted.
NOT_FINISHED = ledger.RECORD_FULL


@njit(cache=True, error_model="numpy", nogil=True)
def _advance(kernel, field, jacobian, p, stops, control, y, rate, memory, counters, record):
    rtol, atol, max_steps = control
    times, states, dense = record
    if kernel == RODAS5P:
        return rodas5p(
            field, jacobian, p, stops, rtol, atol, max_steps, y, rate, memory, counters, times, states, dense
        )
    if kernel == RADAU:
        return radau(
            field, jacobian, p, stops, rtol, atol, max_steps, y, rate, memory, counters, times, states, dense
        )
    return dop853(
        field, jacobian, p, stops, rtol, atol, max_steps, y, rate, memory, counters, times, states, dense
    )


@njit(cache=True, error_model="numpy", nogil=True)
def run_members(
    kernel, field, jacobian, constants, first, stops, before, control, low, high, halt,
    ends, reached, kept, counters, codes, rate, memory, record,
):  # fmt: skip
    """Run the members low to high - 1 from `first` to the last of `stops` (s,), each as if it were alone.

    Row i of `constants` (members, k), `ends` (members, n), `counters`, `reached` and `codes` (members,) is member i's:
    p, its state (the start, then what was reached), the ledger's counters, the time reached and the code. Column
    before + q of `kept` (members, times, n) receives the state at stops[q], if there is such a column. `control` is
    (rtol, atol, max_steps). `rate` (n,), `memory` and `record` = (times, states, dense) are scratch of this call. No
    step is begun with a fresh record once `halt` (1,) is not 0.
    """
    times, states, _ = record
    columns = kept.shape[1]
    n = ends.shape[1]
    for i in range(low, high):
        if halt[0] != 0:
            return
        memory[:] = 0.0
        memory[ledger.TIME] = first
        rate[:] = 0.0
        code = ledger.RECORD_FULL
        while code == ledger.RECORD_FULL and halt[0] == 0:
            begun = counters[i, ledger.STEPS]
            stop = counters[i, ledger.NEXT_STOP]
            code = _advance(
                kernel,
                field,
                jacobian,
                constants[i],
                stops,
                control,
                ends[i],
                rate,
                memory,
                counters[i],
                record,
            )
            for row in range(counters[i, ledger.STEPS] - begun):
                # Steps end on the stops exactly, so that equality is meant here.
                if stop < stops.shape[0] and times[row] == stops[stop]:
                    if before + stop < columns:
                        for j in range(n):
                            kept[i, before + stop, j] = states[row, j]
                    stop += 1
        reached[i] = memory[ledger.TIME]
        codes[i] = code


@njit(cache=True, error_model="numpy", nogil=True)
def evaluate_members(address, kept, constants, out):
    """Fill `out` (members, times, outputs) with the function at `kept` (members, times, n) and each member's p."""
    for i in range(kept.shape[0]):
        for j in range(kept.shape[1]):
            call(address, 0.0, kept[i, j], constants[i], out[i, j])
