"""What a run gives at the times asked for: its dense output, and better values where that of a method is corrected."""

from __future__ import annotations

import numpy as np

from gsp.integration.loop import Numbers
from gsp.integration.methods import SOLVERS
from gsp.integration.run_array import Record, RecordInArray
from gsp.kernels import ledger
from gsp.kernels.grid import read_grid
from gsp.kernels.landing import correct
from gsp.kernels.launch import read_explicit_room, read_room
from gsp.lowering.compiled_flow import CompiledFlow


def read(
    compiled: CompiledFlow, p: Numbers, record: Record, grid: np.ndarray, *, rtol: float, atol: float
) -> tuple[np.ndarray, int]:
    """The states (reached, n) at the times `grid` (m,) that `record` covers, writable, and how many those are.

    What that costs is added to the record's counters.
    """
    out, solver = np.empty((len(grid), compiled.size)), SOLVERS[record.method]
    if type(record) is RecordInArray:
        # In one call, without cutting the record out.
        if solver.corrects:
            reached = read_explicit_room(solver.program(compiled), record.run_array, grid, out)
            # Counted in the run's array.
            record.forget_counters()
        else:
            reached = read_room(record.run_array, grid, out)
        return (out if reached == len(grid) else out[:reached]), reached
    part = record.times, record.states, record.dense
    reached = read_grid(*part, grid, 0, out)
    if solver.corrects and len(record.dense):
        counters, memory = np.zeros(ledger.COUNTERS_SIZE, np.int64), np.zeros(solver.memory_size(compiled.size))
        program = solver.program(compiled)
        correct(program, np.array(p, float), rtol, atol, *part, grid, 0, reached, out, counters, memory)
        for i, spent in enumerate(counters[: len(record.counters)].tolist()):
            record.counters[i] += spent
    return (out if reached == len(grid) else out[:reached]), reached
