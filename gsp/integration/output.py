"""What a run gives at the times asked for: its dense output, and steps of the method where that is in doubt."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gsp.integration.loop import Numbers, Record
from gsp.integration.methods import Method, Solver, solver_of
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
    out = np.empty((len(grid), states.shape[1]))
    parts = [(record.method, times, states, dense)]
    if series:
        parts = [
            (Method.TAYLOR, times[: series + 1], states[: series + 1], dense[:series]),
            (record.method, times[series:], states[series:], dense[series:]),
        ]
    reached = 0
    for method, ends, values, between in parts:
        before = reached
        solver = solver_of(method, rtol)
        reached, looks = kernels.read_grid(solver.check, rtol, atol, ends, values, between, grid, before, out)
        if looks:
            new = slice(before, reached)
            spent = _land(compiled, p, solver, ends, values, between, grid[new], out[new], rtol=rtol, atol=atol)
            for i in range(len(record.counters)):
                record.counters[i] += spent[i]
    return Output(out if reached == len(grid) else out[:reached], reached)


def _land(
    compiled: CompiledFlow,
    p: Numbers,
    solver: Solver,
    times: np.ndarray,
    states: np.ndarray,
    dense: np.ndarray,
    grid: np.ndarray,
    out: np.ndarray,
    *,
    rtol: float,
    atol: float,
) -> list[int]:
    """Replace the rows of `out` (m, n) that are in doubt by landing on their times `grid` (m,); what that costs."""
    program, constants = solver.program(compiled), np.array(p, float)
    doubts, counters = np.empty(len(grid), np.int64), np.zeros(ledger.COUNTERS_SIZE, np.int64)
    linear = None if solver.check == kernels.CHECKS_EXPLICIT else program
    if kernels.doubt_grid(
        solver.check, program, linear, constants, rtol, atol, times, states, dense, grid, 0, len(grid), doubts,
        counters,
    ):  # fmt: skip
        n = states.shape[1]
        scratch = (np.empty(LANDING_RECORD), np.empty((LANDING_RECORD, n)), np.empty((0, solver.rows, n)))
        memory = np.zeros(solver.memory_size(n))
        while (
            land(program, constants, rtol, atol, times, states, grid, doubts, out, counters, memory, scratch)
            == ledger.LOOPS_WANTED
        ):
            solver.give_loops(program)
    return counters.tolist()
