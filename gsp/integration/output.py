"""What a run gives at the times asked for: its dense output, better values or steps where that is in doubt."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsp.integration.loop import Numbers
from gsp.integration.methods import SOLVERS, Solver
from gsp.integration.room import Record, RecordInRoom
from gsp.kernels import grid as kernels
from gsp.kernels import ledger
from gsp.kernels.corrections import correct_grid
from gsp.kernels.landing import LANDING_RECORD, land
from gsp.kernels.launch import doubt_room, read_explicit_room, read_room
from gsp.lowering.compiled_flow import CompiledFlow


def read(
    compiled: CompiledFlow, p: Numbers, record: Record, grid: np.ndarray, *, rtol: float, atol: float
) -> tuple[np.ndarray, int]:
    """The states (reached, n) at the times `grid` (m,) that `record` covers, writable, and how many those are.

    What that costs is added to the record's counters.
    """
    out, solver = np.empty((len(grid), compiled.size)), SOLVERS[record.method]
    if type(record) is RecordInRoom:
        # In one call, without cutting the record out.
        if solver.check == kernels.CORRECTS:
            program, doubts = solver.program(compiled), np.empty(len(grid), np.int64)
            reached = read_explicit_room(solver.check, program, record.room, grid, out, doubts)
            # Counted in the room.
            record.forget_counters()
        else:
            reached, looks = divmod(read_room(solver.check, record.room, grid, out), 2)
            if looks:
                _look(solver, compiled, p, record, grid[:reached], out[:reached], rtol, atol)
        return (out if reached == len(grid) else out[:reached]), reached
    part = record.times, record.states, record.dense
    reached, looks = kernels.read_grid(solver.check, rtol, atol, *part, grid, 0, out)
    if looks:
        program, constants = solver.program(compiled), np.array(p, float)
        doubts, counters = np.empty(reached, np.int64), np.zeros(ledger.COUNTERS_SIZE, np.int64)
        asked = program, constants, rtol, atol, *part, grid, 0, reached
        if (
            correct_grid(*asked, out, doubts, counters)
            if solver.check == kernels.CORRECTS
            else kernels.doubt_grid(*asked, doubts, counters)
        ):
            _land(solver, program, constants, part, grid[:reached], doubts, out[:reached], counters, rtol, atol)
        _count(record, counters)
    return (out if reached == len(grid) else out[:reached]), reached


def _look(
    solver: Solver,
    compiled: CompiledFlow,
    p: Numbers,
    record: RecordInRoom,
    grid: np.ndarray,
    out: np.ndarray,
    rtol: float,
    atol: float,
) -> None:
    """Land on those of the times `grid` (m,) that are in doubt, by an implicit method, into their rows of `out`."""
    program, doubts = solver.program(compiled), np.empty(len(grid), np.int64)
    # Counted in the room.
    record.forget_counters()
    if doubt_room(solver.check, program, record.room, grid, doubts):
        counters = np.zeros(ledger.COUNTERS_SIZE, np.int64)
        part = record.times, record.states, record.dense
        _land(solver, program, np.array(p, float), part, grid, doubts, out, counters, rtol, atol)
        _count(record, counters)


def _count(record: Record, counters: np.ndarray) -> None:
    """Add what reading cost to what the run cost."""
    for i, spent in enumerate(counters[: len(record.counters)].tolist()):
        record.counters[i] += spent


def _land(
    solver: Solver,
    program: np.ndarray,
    p: np.ndarray,
    part: Sequence[np.ndarray],
    grid: np.ndarray,
    doubts: np.ndarray,
    out: np.ndarray,
    counters: np.ndarray,
    rtol: float,
    atol: float,
) -> None:
    """Replace the rows of `out` (m, n) that are in doubt by landing on their times `grid` (m,).

    `part` is times, states and dense output of the steps in question.
    """
    times, states, _ = part
    n = states.shape[1]
    scratch = (np.empty(LANDING_RECORD), np.empty((LANDING_RECORD, n)), np.empty((0, solver.rows, n)))
    memory = np.zeros(solver.memory_size(n))
    while (
        land(program, p, rtol, atol, times, states, grid, doubts, out, counters, memory, scratch)
        == ledger.LOOPS_WANTED
    ):
        solver.give_loops(program)
