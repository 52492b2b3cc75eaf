"""A run from its start, as Python calls it: each array of a call costs 50 ns, and all of a run lies in one.

    launch(program, run_array)

begins the run that the array describes, or goes on with it, by the method of `program`; the codes are `integrator`'s.
`run_array` (k,) is, one part behind the other,

    whole numbers     the limit of steps and what HEAD names, as bits
    counters          those of `integrator`
    given             the time of the start, the tolerances, a first step to try or 0, then y (n,), which moves with the
                      run, then p, then the stops
    work              the integrator's memory, the signs of what is watched, the rate (n,)
    record            times (length + 1,), states (length + 1, n) and dense (length or 0, rows, n), the start in row 0

Before the first call the numbers of HEAD and `given` are there, and BEGUN is NOT_BEGUN or, where y begins with the slow
variables over which the run begins, OVER_SLOW; nothing else need be. A run whose record is full goes on in an array
with another record, in front of which all is the same.
"""

from __future__ import annotations

import numpy as np

from gsp.kernels import integrator
from gsp.kernels.addresses import call_method
from gsp.kernels.call import call
from gsp.kernels.compilation import inlined_kernel, kernel
from gsp.kernels.grid import read_grid
from gsp.kernels.landing import correct
from gsp.kernels.scan import WATCHED, begins_clear, clear_of_zero, reach_start
from gsp.kernels.uncounted import uncounted

# Whole numbers: whether the run is begun, or y holds slow variables over which it is to begin; the bound on its
# attempted steps; how many states, entries of p, stops, entries of the integrator's memory, functions that are watched,
# rows of a record, of them with a dense output, and rows of that.
BEGUN, LIMIT, STATES, CONSTANTS, STOPS, MEMORY, WATCHES, LENGTH, DENSE, ROWS = range(10)
HEAD = 10
# BEGUN.
NOT_BEGUN, HAS_BEGUN, OVER_SLOW = range(3)
COUNTERS = HEAD
GIVEN = COUNTERS + integrator.COUNTERS_SIZE
# given.
FIRST, RTOL, ATOL, FIRST_STEP = range(GIVEN, GIVEN + 4)
Y = GIVEN + 4


def before_record(n, constants, stops, memory, watches):
    """Where the record begins."""
    return Y + n + constants + stops + memory + watches + n


_before_record = inlined_kernel(before_record)


@inlined_kernel
def _record(head):
    """Where the times, the states and the dense output of the record begin."""
    times = _before_record(head[STATES], head[CONSTANTS], head[STOPS], head[MEMORY], head[WATCHES])
    states = times + head[LENGTH] + 1
    return times, states, states + (head[LENGTH] + 1) * head[STATES]


@inlined_kernel
def _steps_ahead(head, run_array):
    """Room for the times, the states and the dense output of the record's steps, behind the start."""
    n = head[STATES]
    record, states, dense = _record(head)
    return (
        run_array[record + 1 : states],
        run_array[states + n : dense].reshape((head[LENGTH], n)),
        run_array[dense : dense + head[DENSE] * head[ROWS] * n].reshape((head[DENSE], head[ROWS], n)),
    )


@kernel
def launch(program, run_array):
    """Begin a run, or go on with it."""
    program, run_array = uncounted(program), uncounted(run_array)
    head = run_array[:HEAD].view(np.int64)
    counters = run_array[COUNTERS:GIVEN].view(np.int64)
    n = head[STATES]
    constants = Y + n
    stops = constants + head[CONSTANTS]
    work = stops + head[STOPS]
    record, states, _ = _record(head)
    rate = record - n
    memory = run_array[work : work + head[MEMORY]]
    y = run_array[Y:constants]
    p = run_array[constants:stops]
    if head[BEGUN] == NOT_BEGUN:
        head[BEGUN] = HAS_BEGUN
        counters[:] = 0
        run_array[work:record] = 0.0
        memory[integrator.TIME] = run_array[FIRST]
        if run_array[FIRST_STEP] != 0.0:
            memory[integrator.STEP] = run_array[FIRST_STEP]
            call(program[integrator.FIELD], run_array[FIRST], y, p, run_array[rate:record])
    run_array[record] = memory[integrator.TIME]
    for i in range(n):
        run_array[states + i] = y[i]
    return call_method(
        program[integrator.METHOD],
        (program, p),
        run_array[stops:work],
        (run_array[RTOL], run_array[ATOL], head[LIMIT]),
        (y, run_array[rate:record], memory, counters),
        _steps_ahead(head, run_array),
    )


@kernel
def launch_watched(program, functions, run_array):
    """`launch`, with a look along the steps that are made: LOOK_WANTED where a watched function may pass through zero.

    `functions` are as `scan` takes them; their signs stand in the array. LOOK_WANTED also where y holds
    slow variables and compiled code finds no point over them.
    """
    program, functions, run_array = uncounted(program), uncounted(functions), uncounted(run_array)
    head = run_array[:HEAD].view(np.int64)
    counters = run_array[COUNTERS:GIVEN].view(np.int64)
    begins = head[BEGUN] != HAS_BEGUN
    if head[BEGUN] == OVER_SLOW:
        if not reach_start(functions, run_array[Y : Y + head[STATES]]):
            return integrator.LOOK_WANTED
        head[BEGUN] = NOT_BEGUN
    before = 0 if begins else counters[integrator.STEPS]
    code = launch(program, run_array)
    new = counters[integrator.STEPS] - before
    n = head[STATES]
    p = run_array[Y + n : Y + n + head[CONSTANTS]]
    record, states, _ = _record(head)
    signs = run_array[record - n - functions[WATCHED] : record - n]
    start = run_array[states : states + n]
    if begins and (new == 0 or not begins_clear(functions, p, signs, run_array[record], start)):
        return integrator.LOOK_WANTED
    times, later, between = _steps_ahead(head, run_array)
    if new and not clear_of_zero(
        functions, p, signs, (run_array[record], start), (times[:new], later, between)
    ):
        return integrator.LOOK_WANTED
    return code


@inlined_kernel
def _steps_made(head, steps, run_array):
    """The record's times, states and dense output of so many steps, with the start."""
    n = head[STATES]
    record, states, dense = _record(head)
    between = min(steps, head[DENSE])
    return (
        run_array[record : record + steps + 1],
        run_array[states : states + (steps + 1) * n].reshape((steps + 1, n)),
        run_array[dense : dense + between * head[ROWS] * n].reshape((between, head[ROWS], n)),
    )


@kernel
def read_run(run_array, grid, out):
    """`grid.read_grid` from the record in an array: how many of `grid` (m,) are read."""
    run_array, grid, out = uncounted(run_array), uncounted(grid), uncounted(out)
    head = run_array[:HEAD].view(np.int64)
    times, states, dense = _steps_made(
        head, run_array[COUNTERS:GIVEN].view(np.int64)[integrator.STEPS], run_array
    )
    return read_grid(times, states, dense, grid, 0, out)


@kernel
def read_explicit_run(program, run_array, grid, out):
    """`read_run`, and `landing.correct`, counted in the array."""
    program, run_array, grid, out = uncounted(program), uncounted(run_array), uncounted(grid), uncounted(out)
    reached = read_run(run_array, grid, out)
    head = run_array[:HEAD].view(np.int64)
    counters = run_array[COUNTERS:GIVEN].view(np.int64)
    p = run_array[Y + head[STATES] : Y + head[STATES] + head[CONSTANTS]]
    steps = _steps_made(head, counters[integrator.STEPS], run_array)
    if steps[2].shape[0] > 0:
        correct(
            program, p, (run_array[RTOL], run_array[ATOL]), steps, grid[:reached], out[:reached], counters,
            np.empty(head[MEMORY]),
        )  # fmt: skip
    return reached
