"""The loop that runs an integrator to its end, and what it leaves."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gsp.errors import DeclarationError, Status
from gsp.integration.methods import Method, choose_method
from gsp.integration.run_array import (
    Record,
    RecordInArray,
    RunRecord,
    Stats,
    counters_in,
    layout_of,
    next_run_array,
    recorded_steps,
    steps_in,
    time_in,
)
from gsp.kernels import integrator
from gsp.kernels.grid import runs_along
from gsp.kernels.launch import NOT_BEGUN, OVER_SLOW, Y, launch, launch_watched
from gsp.lowering.compiled_flow import CompiledFlow
from gsp.results.bounds import as_given
from gsp.systems.arguments import as_float, check_array, check_number, check_whole, shown

# Rounding in a step is a few units in the last place; a tolerance nearer to it than this is never met.
_SMALLEST_RTOL = 1e-14
# Steps between two returns to Python, where Ctrl-C and progress are seen: milliseconds. Most runs end within the
# first record, whose arrays are small enough to come from the heap.
FIRST_RECORD = 256
RECORD = 1024
STATUS = {
    integrator.FINISHED: Status.SUCCESS,
    integrator.STEP_TOO_SMALL: Status.STEP_TOO_SMALL,
    integrator.TOO_MANY_STEPS: Status.TOO_MANY_STEPS,
    integrator.NON_FINITE: Status.NON_FINITE,
    integrator.SINGULAR_JACOBIAN: Status.SINGULAR_JACOBIAN,
    integrator.LOOK_WANTED: Status.EVENT_REACHED,
}


def remedy_of(status: Status, stats: Stats) -> str:
    """What to do about a run that ended so; `status.remedy` where the counters add nothing to it."""
    if status is Status.TOO_MANY_STEPS and stats.stiff:
        return "the field is stiff here: use method=Method.RADAU9"
    if status is Status.SINGULAR_JACOBIAN:
        return "the Jacobian is infinite here, or too large: start beside this point or use Method.DOP853"
    return status.remedy


Numbers = Sequence[float] | np.ndarray
Watch = Callable[[np.ndarray, np.ndarray, np.ndarray], bool]


class Tests(NamedTuple):
    """So many `functions` that must keep their signs along a run, as `kernels.scan` takes them."""

    functions: np.ndarray
    count: int


class Control(NamedTuple):
    """How a run is made: by which method, or the one that is chosen, how exactly, and in how many attempted steps."""

    method: Method | None
    rtol: float
    atol: float
    max_steps: int


class Looks(NamedTuple):
    """Who looks at a run while it is made, and what Ctrl-C does.

    `watch(times, states, dense)` sees every `rows_kept` steps as they are made, without the start, and ends the run by
    returning True. Compiled code looks along the steps, and ends the run so where one of the `tests` may pass through
    zero; `y` may then begin with slow variables alone, `over_slow`.
    Ctrl-C goes on to the caller; where the caller `returns_partial`, it ends the run with the steps made.
    """

    returns_partial: bool = False
    progress: Callable[[float], object] | None = None
    watch: Watch | None = None
    rows_kept: int = RECORD
    tests: Tests | None = None
    over_slow: bool = False


# Of a run within another verb, and of one that is asked for alone.
NOBODY, ALONE = Looks(), Looks(returns_partial=True)


class Run(NamedTuple):
    """What is to be run: `compiled` with p = (epsilon, *parameters), from `y` (n,) at `first` to the last of `stops`.

    `first_step`, signed, is tried first in place of an estimate. Without `dense` the record's `dense` has no rows.
    """

    compiled: CompiledFlow
    p: Numbers
    y: Numbers
    first: float
    stops: Numbers
    control: Control
    dense: bool = True
    first_step: float = 0.0
    looks: Looks = NOBODY


def run(request: Run) -> RunRecord:
    """The run by its method, or the one that `choose_method` names."""
    compiled, p, y, first, stops, (method, rtol, atol, max_steps), dense, first_step, looks = request
    returns_partial, progress, watch, rows_kept, tests, over_slow = looks
    method = method or choose_method(compiled, rtol)
    n, many = len(y), len(stops)
    watches = 0 if tests is None else tests.count
    length = FIRST_RECORD if rows_kept > FIRST_RECORD else rows_kept
    between = length if dense else 0
    solver, program, enter, constants, memory, before = layout_of(compiled, method)
    rows = solver.rows
    run_array = np.empty(before + many - 1 + watches + (length + 1) * (1 + n) + between * rows * n)
    # As `kernels.launch` orders them.
    enter(
        run_array, 0,
        OVER_SLOW if over_slow else NOT_BEGUN, max_steps, n, constants, many, memory, watches, length, between,
        rows, first, rtol, atol, first_step, *y, *p, stops[0],
    )  # fmt: skip
    if many > 1:
        end = Y + n + constants
        run_array[end : end + many] = stops
    full: list[np.ndarray] = []
    code = integrator.RECORD_FULL
    status = None
    try:
        while True:
            code = (
                launch(program, run_array)
                if tests is None
                else launch_watched(program, tests.functions, run_array)
            )
            if watch is not None:
                made = recorded_steps(run_array, steps_in(full[-1]) if full else 0)
                if watch(made.times[1:], made.states[1:], made.dense):
                    status = Status.EVENT_REACHED
            if progress is not None:
                progress((time_in(run_array) - first) / (float(stops[-1]) - first))
            if status is not None or (code != integrator.RECORD_FULL and code != integrator.LOOPS_WANTED):
                break
            if code == integrator.LOOPS_WANTED:
                solver.give_loops(program)
            full, run_array = [*full, run_array], next_run_array(run_array, rows_kept)
    except KeyboardInterrupt:
        if not returns_partial:
            raise
        status = Status.INTERRUPTED
        # It may have come between any two lines above, even before the start was entered.
        start = recorded_steps((full or [run_array])[0])
        start.times[0], start.states[0] = first, y
    status = status or STATUS[code]
    if not full:
        return RecordInArray(run_array, status, method)
    return _gathered([*full, run_array], status, method)


def _gathered(run_arrays: list[np.ndarray], status: Status, method: Method) -> Record:
    """The record of a run that has gone through several arrays."""
    earlier = [0, *map(steps_in, run_arrays[:-1])]
    begun, *rest = [recorded_steps(run_array, steps) for run_array, steps in zip(run_arrays, earlier)]
    return Record(
        np.concatenate([begun.times, *(piece.times[1:] for piece in rest)]),
        np.concatenate([begun.states, *(piece.states[1:] for piece in rest)]),
        np.concatenate([begun.dense, *(piece.dense for piece in rest)]),
        status,
        method,
        counters_in(run_arrays[-1]),
    )


def standing(t: float, y: np.ndarray, status: Status, method: Method) -> Record:
    """The record of a run that does not begin."""
    counters = [0] * (integrator.STIFF + 1)
    return Record(np.array([t]), y[np.newaxis].copy(), np.empty((0, 1, y.size)), status, method, counters)


def check_span(span: tuple[float, float]) -> tuple[float, float]:
    """The two ends as floats; raises `DeclarationError` unless finite and different."""
    try:
        first, last = span
    except (TypeError, ValueError):
        raise DeclarationError("span is two numbers, (t0, t1).", got=shown(span), value=span) from None
    t0 = first if type(first) is float else as_float(first)
    t1 = last if type(last) is float else as_float(last)
    if t0 != t1 and math.isfinite(t1 - t0):
        return t0, t1
    for end, number in ((first, t0), (last, t1)):
        if math.isnan(number) and not isinstance(end, (float, np.floating)):
            raise DeclarationError("span is two numbers, (t0, t1).", got=f"{shown(end)} in it", value=end)
    if t0 == t1 and math.isfinite(t0):
        remedy = "Give an end that differs from the start."
        raise DeclarationError("span must have a length.", remedy, got=shown(span), value=span)
    raise DeclarationError(
        "span must be finite, and its length.",
        "Give the times of the start and the end.",
        got=shown(span),
        value=span,
    )


def check_tolerances(rtol: float, atol: float) -> tuple[float, float]:
    """Both as floats; raises `DeclarationError` unless they are finite, positive and above rounding."""
    if type(rtol) is type(atol) is float and _SMALLEST_RTOL <= rtol < math.inf and 0.0 < atol < math.inf:
        return rtol, atol
    remedy = "The defaults serve most uses."
    return (
        check_number(
            rtol,
            what="rtol",
            be=f"a finite number, at least {_SMALLEST_RTOL:g}, which is near rounding",
            least=_SMALLEST_RTOL,
            remedy=remedy,
        ),
        check_number(
            atol, what="atol", be="a finite number, positive, one for all states", above=0.0, remedy=remedy
        ),
    )


def check_grid(at: ArrayLike, first: float, last: float) -> np.ndarray:
    """Times (m,) inside the span and monotone along it; raises `DeclarationError` otherwise."""
    if type(at) is np.ndarray and at.dtype == float:
        grid = at.copy()
    else:
        grid = check_array(at, what="at", be="a sequence of times")
    if grid.ndim != 1 or grid.size == 0:
        raise DeclarationError(
            "at is a sequence of one or more times.", got=f"the shape {grid.shape}", value=grid.shape
        )
    if runs_along(grid, first, last):
        return grid
    low, high = min(first, last), max(first, last)
    outside = grid[~((grid >= low) & (grid <= high))]
    if outside.size:
        raise DeclarationError(
            f"at must lie inside the span ({first:g}, {last:g}).",
            "Drop it or lengthen the span.",
            got=as_given(outside[0]),
        )
    i = int(np.argmin((grid[1:] - grid[:-1]) * (last - first) > 0.0))
    raise DeclarationError(
        "at must run from the start to the end of the span, without repeats.",
        "Sort it.",
        got=f"{as_given(grid[i])}, then {as_given(grid[i + 1])}",
    )


def check_step_limit(max_steps: int) -> int:
    """The bound on attempted steps as an int that fits a counter; raises `DeclarationError` otherwise."""
    if type(max_steps) is int and 1 <= max_steps <= 2**62:
        return max_steps
    return min(check_whole(max_steps, what="max_steps", least=1, be="an integer, 1 or more"), 2**62)
