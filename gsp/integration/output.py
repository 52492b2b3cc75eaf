"""What a run gives at the times asked for: its dense output, and steps of the method where that is in doubt."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gsp.integration.loop import Numbers, Record
from gsp.integration.methods import Method, solver_of
from gsp.kernels import grid as kernels
from gsp.kernels import ledger
from gsp.kernels.landing import LANDING_RECORD, land
from gsp.lowering.compiled_flow import CompiledFlow


class Output(NamedTuple):
    """The states (reached, n) at the first times of a grid, as many as a run `reached`."""

    states: np.ndarray
    reached: int


def read(
    compiled: CompiledFlow, p: Numbers, record: Record, grid: np.ndarray, *, rtol: float, atol: float
) -> Output:
    """The states at the times `grid` (m,), writable, that `record` covers; what that costs is added to its counters.

    The first `record.series` steps were made by Taylor series, before its method went on.
    """
    times, states, dense, series = record.times, record.states, record.dense, record.series
    constants = np.array(p, float)
    out = np.empty((len(grid), states.shape[1]))
    doubts = np.empty(len(grid), np.int64)
    counters = np.zeros(ledger.COUNTERS_SIZE, np.int64)
    parts = [(record.method, times, states, dense)]
    if series:
        parts = [
            (Method.TAYLOR, times[: series + 1], states[: series + 1], dense[:series]),
            (record.method, times[series:], states[series:], dense[series:]),
        ]
    reached = 0
    for method, ends, values, between in parts:
        solver = solver_of(method, rtol)
        before = reached
        program = solver.program(compiled)
        reached, in_doubt = kernels.read_grid(
            solver.check, program, constants, rtol, atol, ends, values, between, grid, before, out, doubts, counters
        )  # fmt: skip
        if in_doubt:
            new, n = slice(before, reached), states.shape[1]
            scratch = (
                np.empty(LANDING_RECORD), np.empty((LANDING_RECORD, n)), np.empty((0, solver.rows, n))
            )  # fmt: skip
            memory = np.zeros(solver.memory_size(n))
            while (
                land(
                    program, constants, rtol, atol, ends, values, grid[new], doubts[new], out[new], counters,
                    memory, scratch,
                )
                == ledger.LOOPS_WANTED
            ):  # fmt: skip
                solver.give_loops(program)
    if counters[ledger.FIELD_CALLS]:
        for i, spent in enumerate(counters.tolist()[: len(record.counters)]):
            record.counters[i] += spent
    return Output(out if reached == len(grid) else out[:reached], reached)
