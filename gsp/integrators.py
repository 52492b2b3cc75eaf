"""The integrators that there are, which one is taken, and the loop that runs a kernel to its end."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from operator import attrgetter, index, methodcaller
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gsp.errors import DeclarationError, Status, nearest
from gsp.flow import Flow
from gsp.kernels import dop853_tableau, ledger, radau_tableau, rodas5p_tableau
from gsp.kernels.dop853 import dop853
from gsp.kernels.launch import launch_dop853, launch_radau, launch_rodas5p, launch_taylor, rate_at_start
from gsp.kernels.radau import radau
from gsp.kernels.radau_block import memory_size
from gsp.kernels.rodas5p import rodas5p
from gsp.kernels.step_control import largest_rate
from gsp.kernels.taylor import taylor
from gsp.lowering import CompiledFlow
from gsp.machine_code.taylor import dense_rows

# Rounding in a step is a few units in the last place; a tolerance nearer to it than this is never met.
_SMALLEST_RTOL = 1e-14
# Steps between two returns to Python, where Ctrl-C and progress are seen: milliseconds. Most runs end within the
# first record, whose arrays are small enough to come from the heap.
FIRST_RECORD = 256
RECORD = 1024
# Which method meets a tolerance in the least time, measured over the eight stiff problems of `benchmarks/problems.py`
# with each method's code for the flow, interleaved in one run, geometric means of the time at equal error. Rodas5P and
# Radau of order 9 cross at an error of 5e-5 at the end and of 1e-4 over an output grid, orders 9 and 13 at 1e-8 and at
# 2e-6. What counts is the ladder of tolerances that they make. It is flat: with the first border anywhere from 1e-4 to
# 1e-3 and the second from 3e-7 to 3e-5 no target from 1e-3 to 1e-11, at the end or over the grid, takes 5 % more.
_TIGHT_RTOL = 3e-4
_TIGHTEST_RTOL = 1e-6
# The default does not wait longer for its code than half a second: so many products, and parts of the expressions.
_MOST_PRODUCTS = 5_000
_MOST_PARTS = 3_000


class Method(Enum):
    """How to integrate.

    RODAS5P: Rosenbrock, order 5, stiffly accurate; for fields with a fast time scale.
    RADAU5, RADAU9, RADAU13: Radau IIA, implicit Runge-Kutta, order 5, 9, 13; the same, for tight tolerances.
    RADAU: these three, the order following the convergence of the iteration from step to step.
    DOP853: explicit Runge-Kutta, order 8; for reduced flows and other fields on one time scale.
    TAYLOR: explicit, order 12 to 20 by the tolerance; for smooth fields that are barely stiff or not at all, code for
    which takes a tenth of a second to build.
    """

    RODAS5P = "rodas5p"
    RADAU5 = "radau5"
    RADAU9 = "radau9"
    RADAU13 = "radau13"
    RADAU = "radau"
    DOP853 = "dop853"
    TAYLOR = "taylor"

    # There is one of each: their identity serves as the key of the tables below, and costs less than their text.
    __hash__ = object.__hash__


class Solver(NamedTuple):
    """A kernel and its `launch`, the rows of its dense output, and the program of a flow that they take."""

    kernel: Callable[..., int]
    launch: Callable[..., int]
    rows: int
    program: Callable[[CompiledFlow], np.ndarray]

    def memory_size(self, n: int) -> int:
        """Entries of `memory` for `n` states."""
        return memory_size(self.rows, n) if self.kernel is radau else ledger.MEMORY_SIZE


_SOLVERS = {
    Method.RODAS5P: Solver(
        rodas5p, launch_rodas5p, rodas5p_tableau.DENSE_ROWS, attrgetter("rosenbrock_program")
    ),
    **{
        method: Solver(radau, launch_radau, stages, methodcaller("collocation_program", stages))
        for method, stages in zip((Method.RADAU5, Method.RADAU9, Method.RADAU13), radau_tableau.STAGES)
    },
    Method.RADAU: Solver(radau, launch_radau, radau_tableau.STAGES[-1], attrgetter("variable_program")),
    Method.DOP853: Solver(dop853, launch_dop853, dop853_tableau.DENSE_ROWS, attrgetter("explicit_program")),
}
# Orders of Taylor series, each from a tolerance on. On nine problems, at errors from 1e-3 to 1e-11 on a grid, these
# take 1 to 7 % longer than the best of the even orders from 8 to 24 (geometric means).
_TAYLOR_ORDERS = ((1e-5, 12), (1e-9, 16), (0.0, 20))
_TAYLOR = {
    order: Solver(taylor, launch_taylor, dense_rows(order), methodcaller("taylor_program", order))
    for _, order in _TAYLOR_ORDERS
}
STATUS = {
    ledger.FINISHED: Status.SUCCESS,
    ledger.STEP_TOO_SMALL: Status.STEP_TOO_SMALL,
    ledger.TOO_MANY_STEPS: Status.TOO_MANY_STEPS,
    ledger.NON_FINITE: Status.NON_FINITE,
    ledger.SINGULAR_JACOBIAN: Status.SINGULAR_JACOBIAN,
}


@dataclass(frozen=True)
class Stats:
    """What an integration cost. `stiff` is a finding of the explicit method: stability bounds its step."""

    method: Method
    steps: int
    rejected: int
    field_calls: int
    jacobian_calls: int
    decompositions: int
    stiff: bool = False


def remedy_of(status: Status, stats: Stats) -> str:
    """What to do about a run that ended so; `status.remedy` where the counters add nothing to it."""
    if status is Status.TOO_MANY_STEPS and stats.stiff:
        return "the field is stiff here: use method=Method.RODAS5P"
    if status is Status.SINGULAR_JACOBIAN:
        return "the Jacobian is infinite here, or too large: start beside this point or use Method.DOP853"
    return status.remedy


Numbers = Sequence[float] | np.ndarray
Watch = Callable[[np.ndarray, np.ndarray, np.ndarray], bool]


class Record(NamedTuple):
    """What a run leaves: the ends of its steps with the start in front, `dense` output, status, method and counters.

    `counters` are the ledger's up to STIFF.
    """

    times: np.ndarray
    states: np.ndarray
    dense: np.ndarray
    status: Status
    method: Method
    counters: list[int]

    @property
    def stats(self) -> Stats:
        """Method and counters by name."""
        *counts, stiff = self.counters
        return Stats(self.method, *counts, stiff=stiff == 1)

    @property
    def attempts(self) -> int:
        """Steps taken and rejected."""
        return self.counters[ledger.STEPS] + self.counters[ledger.REJECTED]


def run(
    compiled: CompiledFlow,
    p: Numbers,
    y: Numbers,
    first: float,
    stops: np.ndarray,
    *,
    method: Method | None,
    rtol: float,
    atol: float,
    max_steps: int,
    dense: bool = True,
    progress: Callable[[float], object] | None = None,
    watch: Watch | None = None,
    rows_kept: int = RECORD,
) -> Record:
    """`advance` by `method`, or by default as `choose_method` says, explicitly where the start is not stiff.

    The explicit method has the few steps that such a span takes. If they do not suffice, or it fails, the implicit one
    goes on from there, and is the method that `stats` names. A watched run keeps to one method: the caller names it.
    """
    chosen = method or choose_method(compiled.flow, rtol)
    trial = Trial.of(compiled, rtol) if method is None else None
    record = _advance(
        compiled,
        p,
        y,
        first,
        stops,
        chosen,
        rtol,
        atol,
        max_steps,
        dense,
        progress,
        watch,
        rows_kept,
        0.0,
        trial,
    )
    if trial is None or record.method is not trial.method:
        return record
    used = record.attempts
    if record.status in (Status.SUCCESS, Status.INTERRUPTED) or used >= max_steps:
        return record
    t = record.times[-1]
    ahead = stops[stops > t] if stops[-1] > t else stops[stops < t]
    rest = advance(
        compiled, p, record.states[-1], float(t), ahead, method=chosen, rtol=rtol, atol=atol,
        max_steps=max_steps - used, dense=dense, progress=progress,
    )  # fmt: skip
    return _joined(record, rest)


@dataclass(frozen=True)
class Trial:
    """What a flow that is declared stiff begins with where |J| (t1 - t0) is `border` or less at the start."""

    method: Method
    border: float
    attempts: int

    @staticmethod
    def of(compiled: CompiledFlow, rtol: float) -> Trial | None:
        """None for a flow that is not declared stiff, whose method is explicit anyway."""
        if not compiled.flow.is_stiff:
            return None
        if not compiled.has_series(taylor_order(rtol), products=_MOST_PRODUCTS, parts=_MOST_PARTS):
            return _WITHOUT_SERIES
        return _WITH_SERIES if rtol >= _TIGHT_RTOL else _WITH_SERIES_TIGHT

    def begins(self, compiled: CompiledFlow, p: np.ndarray, y: np.ndarray, first: float, last: float) -> bool:
        """Whether there are so few fast times in the span that it is tried."""
        return bool(largest_rate(compiled.jacobian, first, y, p) * abs(last - first) <= self.border)


# Measured on the sleigh from epsilon = 0.01 to 3.2, linear fields, van der Pol's oscillator and others, with code for
# each method's step. Taylor series draw level with Rodas5P at 150 (sleigh) to 600 (van der Pol, mu = 10) fast times,
# with the Radau methods at 200 (linear fields) to 700 (van der Pol); below they take down to half of the time, on
# oscillators a third. A step takes a quarter of a microsecond for six states. DOP853, for fields without series, takes
# 1.0 to 1.5 times as long as the Radau methods and half to twice as long as Rodas5P; above 60 stability sets its step,
# and its dense output errs by 100 tolerances.
_WITHOUT_SERIES = Trial(Method.DOP853, 60.0, 120)
_WITH_SERIES = Trial(Method.TAYLOR, 200.0, 250)
_WITH_SERIES_TIGHT = Trial(Method.TAYLOR, 300.0, 250)


def _joined(one: Record, two: Record) -> Record:
    """Both runs, the second from the end of the first; a dense output with fewer rows is filled up with zeros."""
    rows = max(one.dense.shape[1], two.dense.shape[1])
    dense = [np.pad(record.dense, ((0, 0), (0, rows - record.dense.shape[1]), (0, 0))) for record in (one, two)]
    counters = [a + b for a, b in zip(one.counters, two.counters)]
    counters[ledger.STIFF] = max(one.counters[ledger.STIFF], two.counters[ledger.STIFF])
    return Record(
        np.concatenate([one.times, two.times[1:]]),
        np.concatenate([one.states, two.states[1:]]),
        np.concatenate(dense),
        two.status,
        two.method,
        counters,
    )


def advance(
    compiled: CompiledFlow,
    p: Numbers,
    y: Numbers,
    first: float,
    stops: np.ndarray,
    *,
    method: Method,
    rtol: float,
    atol: float,
    max_steps: int,
    dense: bool = True,
    progress: Callable[[float], object] | None = None,
    watch: Watch | None = None,
    rows_kept: int = RECORD,
    first_step: float = 0.0,
) -> Record:
    """Run `method` from `y` (n,) at `first` to the last of `stops` (s,); `p` is (epsilon, *parameters).

    `watch(times, states, dense)` sees every `rows_kept` steps as they are made, without the start, and ends the run
    by returning True. `first_step`, signed, is tried first in place of an estimate. Without `dense` the record's
    `dense` has no rows. Ctrl-C ends it with the steps that were made.
    """
    return _advance(
        compiled,
        p,
        y,
        first,
        stops,
        method,
        rtol,
        atol,
        max_steps,
        dense,
        progress,
        watch,
        rows_kept,
        first_step,
    )


def _advance(
    compiled: CompiledFlow,
    p: Numbers,
    y: Numbers,
    first: float,
    stops: np.ndarray,
    method: Method,
    rtol: float,
    atol: float,
    max_steps: int,
    dense: bool,
    progress: Callable[[float], object] | None,
    watch: Watch | None,
    rows_kept: int,
    first_step: float = 0.0,
    trial: Trial | None = None,
) -> Record:
    """What `advance` says; where the start is such, by the method of `trial` and with its attempts."""
    n = len(y)
    given = np.array((first, rtol, atol, *y, *p), float)
    if trial is not None:
        fast_times = rate_at_start(compiled.loops_program, given, n) * abs(stops[-1] - first)
        if fast_times <= trial.border:
            method, max_steps = trial.method, min(trial.attempts, max_steps)
    solver = solver_of(method, rtol)
    program = solver.program(compiled)
    launch = solver.launch
    work = np.zeros(solver.memory_size(n) + n)
    if first_step != 0.0:
        work[ledger.STEP], work[-n:] = first_step, compiled.rates(y, p)
    counters = np.zeros(ledger.COUNTERS_SIZE, np.int64)
    # The start is row 0, so that a run of one piece is its own record.
    length = min(FIRST_RECORD, rows_kept)
    all_times, all_states = times, states = np.empty(length + 1), np.empty((length + 1, n))
    records = np.empty((length if dense else 0, solver.rows, n))
    pieces = []
    kept = 0
    code = ledger.RECORD_FULL
    status = None
    try:
        while True:
            code = launch(program, given, stops, max_steps, work, counters, times, states, records)
            if watch is not None:
                new = int(counters[ledger.STEPS]) - kept
                if watch(times[1 : new + 1], states[1 : new + 1], records[:new]):
                    status = Status.EVENT_REACHED
            if progress is not None:
                progress((float(work[ledger.TIME]) - first) / (float(stops[-1]) - first))
            if code != ledger.RECORD_FULL or status is not None:
                break
            pieces.append((times[1:], states[1:], records))
            kept += len(times) - 1
            times, states = np.empty(rows_kept + 1), np.empty((rows_kept + 1, n))
            records = np.empty((rows_kept if dense else 0, solver.rows, n))
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
        # It may have come between any two lines above, even before the start was entered.
        all_times[0], all_states[0] = first, y
    # What counts is what the counters say.
    counts = counters.tolist()[: ledger.STIFF + 1]
    steps = counts[ledger.STEPS]
    if not pieces:
        all_times, all_states, records = all_times[: steps + 1], all_states[: steps + 1], records[:steps]
    else:
        new = steps - sum(len(piece[0]) for piece in pieces)
        pieces[0] = (all_times, all_states, pieces[0][2])
        pieces.append((times[1 : new + 1], states[1 : new + 1], records[:new]))
        all_times, all_states, records = (np.concatenate(arrays) for arrays in zip(*pieces))
    return Record(all_times, all_states, records, status or STATUS[code], method, counts)


def solver_of(method: Method, rtol: float) -> Solver:
    """The solver of `method` at the tolerance."""
    return _TAYLOR[taylor_order(rtol)] if method is Method.TAYLOR else _SOLVERS[method]


def taylor_order(rtol: float) -> int:
    """The order of a Taylor series at a tolerance."""
    if rtol >= _TAYLOR_ORDERS[0][0]:
        return _TAYLOR_ORDERS[0][1]
    return _TAYLOR_ORDERS[1][1] if rtol >= _TAYLOR_ORDERS[1][0] else _TAYLOR_ORDERS[2][1]


def program_of(compiled: CompiledFlow, method: Method, rtol: float) -> np.ndarray:
    """The addresses that the kernel of `method` takes; see `ledger`. What is missing is compiled.

    Raises `UnsupportedFunctionError` for `Method.TAYLOR` where the field has no Taylor series.
    """
    return solver_of(method, rtol).program(compiled)


def standing(t: float, y: np.ndarray, status: Status, method: Method) -> Record:
    """The record of a run that does not begin."""
    counters = [0] * (ledger.STIFF + 1)
    return Record(np.array([t]), y[np.newaxis].copy(), np.empty((0, 1, y.size)), status, method, counters)


def check_span(span: tuple[float, float]) -> tuple[float, float]:
    """The two ends as floats; raises `DeclarationError` unless finite and different."""
    try:
        first, last = map(float, span)
    except (TypeError, ValueError):
        raise DeclarationError(f"span is two numbers, (t0, t1). Got {span!r}.") from None
    if first != last and math.isfinite(last - first):
        return first, last
    if not (math.isfinite(first) and math.isfinite(last)):
        raise DeclarationError(f"span must be finite. Got {span!r}. Give the times of the start and the end.")
    raise DeclarationError(f"span must have a length. Got {span!r}. Give an end that differs from the start.")


def check_tolerances(rtol: float, atol: float) -> None:
    """Raises `DeclarationError` unless both are finite, positive and above rounding."""
    try:
        if _SMALLEST_RTOL <= rtol < math.inf and 0.0 < atol < math.inf:
            return
    except (TypeError, ValueError):
        pass
    for name, value, smallest in (("rtol", rtol, _SMALLEST_RTOL), ("atol", atol, 0.0)):
        try:
            fine = math.isfinite(value) and value > 0.0 and value >= smallest
        except TypeError:
            fine = False
        if not fine:
            bound = f"at least {smallest:g}, which is near rounding" if smallest else "positive"
            raise DeclarationError(
                f"{name} is a finite number, {bound}. Got {value!r}. The defaults serve most uses."
            )


def check_grid(at: ArrayLike, first: float, last: float) -> np.ndarray:
    """Times (m,) inside the span and monotone along it; raises `DeclarationError` otherwise."""
    try:
        grid = np.array(at, dtype=float)
    except (TypeError, ValueError):
        raise DeclarationError(f"at is a sequence of times. Got {at!r}.") from None
    if grid.ndim != 1 or grid.size == 0:
        raise DeclarationError(f"at is a sequence of one or more times. Got the shape {grid.shape}.")
    start, end = float(grid[0]), float(grid[-1])
    if last > first:
        steps, inside = grid[1:] - grid[:-1], first <= start and end <= last
    else:
        steps, inside = grid[:-1] - grid[1:], first >= start and end >= last
    if inside and (steps.size == 0 or steps.min() > 0.0):
        # Sorted, so that the ends decide for all; NaN fails one comparison or the other.
        return grid
    low, high = min(first, last), max(first, last)
    outside = grid[~((grid >= low) & (grid <= high))]
    if outside.size:
        raise DeclarationError(
            f"at must lie inside the span ({first:g}, {last:g}). Got {outside[0]:.17g}. "
            "Drop it or lengthen the span."
        )
    i = int(np.argmin(steps > 0.0))
    raise DeclarationError(
        f"at must run from the start to the end of the span, without repeats. Got {grid[i]:.17g}, then "
        f"{grid[i + 1]:.17g}. Sort it."
    )


def stops_of(grid: np.ndarray | None, first: float, last: float) -> np.ndarray:
    """Times (s,) at which steps end: those of the grid ahead of the start, and the end."""
    if grid is None:
        stops = np.empty(1)
        stops[0] = last
        return stops
    ahead = grid[1:] if grid[0] == first else grid
    return ahead.copy() if ahead.size and ahead[-1] == last else np.append(ahead, last)


def choose_method(flow: Flow, rtol: float) -> Method:
    """What was measured to be fastest for such a flow at this tolerance."""
    if not flow.is_stiff:
        return Method.DOP853
    if rtol >= _TIGHT_RTOL:
        return Method.RODAS5P
    return Method.RADAU9 if rtol >= _TIGHTEST_RTOL else Method.RADAU13


def check_method(method: Method | str | None) -> Method | None:
    """The method asked for; raises `DeclarationError` when there is none such."""
    if method is None or isinstance(method, Method):
        return method
    try:
        return Method(method)
    except ValueError:
        names = [member.value for member in Method]
        raise DeclarationError(
            f"{method!r} is no method. The methods are {', '.join(names)}." + nearest(str(method), names)
        ) from None


def check_step_limit(max_steps: int) -> int:
    """The bound on attempted steps as an int that fits a counter; raises `DeclarationError` otherwise."""
    try:
        limit = index(max_steps)
    except TypeError:
        limit = 0
    if limit < 1:
        raise DeclarationError(f"max_steps is an integer, 1 or more. Got {max_steps!r}.")
    return min(limit, 2**62)
