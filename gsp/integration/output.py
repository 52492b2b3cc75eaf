"""What a run gives at the times asked for: its dense output, and better values where that of a method is corrected."""

from __future__ import annotations

import numpy as np

from gsp.integration.loop import Control, Numbers
from gsp.integration.methods import SOLVERS
from gsp.integration.run_array import RecordInArray, RunRecord
from gsp.kernels import integrator
from gsp.kernels.grid import read_grid
from gsp.kernels.landing import correct
from gsp.kernels.launch import read_explicit_run, read_run
from gsp.lowering.compiled_flow import CompiledFlow


def read(
    compiled: CompiledFlow, p: Numbers, record: RunRecord, grid: np.ndarray, *, control: Control
) -> tuple[np.ndarray, RunRecord]:
    """The states (reached, n) at those of the times `grid` (m,) that `record` covers, writable.

    And the record, in whose counters is what that costs.
    """
    out, solver = np.empty((len(grid), compiled.size)), SOLVERS[record.method]
    if type(record) is RecordInArray:
        # In one call, without cutting the record out; counted in the run's array.
        array = record.run_array
        reached = (
            read_explicit_run(solver.program(compiled), array, grid, out)
            if solver.corrects
            else read_run(array, grid, out)
        )
    else:
        part = record.steps
        reached = read_grid(*part, grid, 0, out)
        if solver.corrects and len(record.dense):
            counters, memory = (
                np.zeros(integrator.COUNTERS_SIZE, np.int64),
                np.zeros(solver.memory_size(compiled.size)),
            )
            program, p = solver.program(compiled), np.array(p, float)
            _, rtol, atol, _ = control
            correct(program, p, (rtol, atol), tuple(part), grid[:reached], out[:reached], counters, memory)
            record = record._replace(counters=[a + b for a, b in zip(record.counters, counters.tolist())])
    return (out if reached == len(grid) else out[:reached]), record
