"""The integrators that there are, which one is taken, and the loop that runs a kernel to its end."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gsp.errors import DeclarationError, Status, nearest
from gsp.flow import Flow
from gsp.kernels import dop853_tableau, ledger, radau_tableau, rodas5p_tableau
from gsp.kernels.dop853 import dop853
from gsp.kernels.radau import memory_size, radau
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
# Which method meets a tolerance in the least time, measured by `benchmarks/integrators.py` on its eight stiff problems,
# interleaved in one run, geometric means. Rodas5P and Radau of order 9 cross at an error of 3e-7 at the end and of 2e-6
# over an output grid, orders 9 and 13 at 3e-11 and 1e-8. What counts is the ladder of tolerances that they make: with
# the first border at 5e-6 an error of 1e-7 at the end takes 12 % less time than with 5e-7, 9 % less than with 5e-5, and
# no target between 1e-3 and 1e-11, at the end or over a grid, takes more.
_TIGHT_RTOL = 5e-6
_TIGHTEST_RTOL = 5e-9
# The default does not wait longer for its code than half a second: so many products, and parts of the expressions.
_MOST_PRODUCTS = 5_000
_MOST_PARTS = 3_000


class Method(Enum):
    """How to integrate.

    RODAS5P: Rosenbrock, order 5, stiffly accurate; for fields with a fast time scale.
    RADAU5, RADAU9, RADAU13: Radau IIA, implicit Runge-Kutta, order 5, 9, 13; the same, for tight tolerances.
    DOP853: explicit Runge-Kutta, order 8; for reduced flows and other fields on one time scale.
    TAYLOR: explicit, order 12 to 20 by the tolerance; for smooth fields that are barely stiff or not at all, code for
    which takes a tenth of a second to build.
    """

    RODAS5P = "rodas5p"
    RADAU5 = "radau5"
    RADAU9 = "radau9"
    RADAU13 = "radau13"
    DOP853 = "dop853"
    TAYLOR = "taylor"


# The kernel and the rows of its dense output; of a Taylor series they depend on the order.
_KERNELS = {
    Method.RODAS5P: (rodas5p, rodas5p_tableau.DENSE_ROWS),
    Method.RADAU5: (radau, radau_tableau.STAGES[0]),
    Method.RADAU9: (radau, radau_tableau.STAGES[1]),
    Method.RADAU13: (radau, radau_tableau.STAGES[2]),
    Method.DOP853: (dop853, dop853_tableau.DENSE_ROWS),
}
# Orders of Taylor series, each from a tolerance on. On nine problems, at errors from 1e-3 to 1e-11 on a grid, these
# take 1 to 7 % longer than the best of the even orders from 8 to 24 (geometric means).
_TAYLOR_ORDERS = ((1e-5, 12), (1e-9, 16), (0.0, 20))
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


@dataclass(frozen=True)
class Record:
    """What a run leaves: the ends of its steps with the start in front, `dense` output, status and counters."""

    times: np.ndarray
    states: np.ndarray
    dense: np.ndarray
    status: Status
    stats: Stats


def run(
    compiled: CompiledFlow,
    p: np.ndarray,
    y: np.ndarray,
    first: float,
    stops: np.ndarray,
    *,
    method: Method | None,
    rtol: float,
    atol: float,
    max_steps: int,
    dense: bool = True,
    progress: Callable[[float], object] | None = None,
    watch: Callable[[np.ndarray, np.ndarray, np.ndarray], bool] | None = None,
    rows_kept: int = RECORD,
) -> Record:
    """`advance` by `method`, or by default as `choose_method` says, explicitly where the start is not stiff.

    The explicit method has the few steps that such a span takes. If they do not suffice, or it fails, the implicit one
    goes on from there, and is the method that `stats` names. A watched run keeps to one method: the caller names it.
    """
    chosen = method or choose_method(compiled.flow, rtol)
    trial = Trial.of(compiled, rtol) if method is None else None
    if trial is not None and trial.begins(compiled, p, y, first, stops[-1]):
        record = advance(
            compiled, p, y, first, stops, method=trial.method, rtol=rtol, atol=atol,
            max_steps=min(trial.attempts, max_steps), dense=dense, progress=progress,
        )  # fmt: skip
        used = record.stats.steps + record.stats.rejected
        if record.status in (Status.SUCCESS, Status.INTERRUPTED) or used >= max_steps:
            return record
        t = record.times[-1]
        ahead = stops[stops > t] if stops[-1] > t else stops[stops < t]
        rest = advance(
            compiled, p, y, float(t), ahead, method=chosen, rtol=rtol, atol=atol,
            max_steps=max_steps - used, dense=dense, progress=progress,
        )  # fmt: skip
        return _joined(record, rest)
    return advance(
        compiled, p, y, first, stops, method=chosen, rtol=rtol, atol=atol,
        max_steps=max_steps, dense=dense, progress=progress, watch=watch, rows_kept=rows_kept,
    )  # fmt: skip


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


# Measured on the sleigh from epsilon = 0.01 to 3.2, linear fields, van der Pol's oscillator and others. Taylor series
# draw level with Rodas5P at 150 (sleigh) to 600 (van der Pol, mu = 10) fast times, with the Radau methods at 700 to
# 2000; below they take down to a third of the time. At the border stability makes as many as 190 steps, of a quarter of
# a microsecond each for six states. DOP853, for fields without series, draws level with Rodas5P at 92 and takes half
# the Radau methods' time at 66; up to 300 it is faster than these, but there stability sets its step and its dense
# output errs by 100 tolerances.
_WITHOUT_SERIES = Trial(Method.DOP853, 60.0, 120)
_WITH_SERIES = Trial(Method.TAYLOR, 200.0, 250)
_WITH_SERIES_TIGHT = Trial(Method.TAYLOR, 1000.0, 250)


def _joined(one: Record, two: Record) -> Record:
    """Both runs, the second from the end of the first; a dense output with fewer rows is filled up with zeros."""
    rows = max(one.dense.shape[1], two.dense.shape[1])
    dense = [np.pad(record.dense, ((0, 0), (0, rows - record.dense.shape[1]), (0, 0))) for record in (one, two)]
    a, b = one.stats, two.stats
    return Record(
        np.concatenate([one.times, two.times[1:]]),
        np.concatenate([one.states, two.states[1:]]),
        np.concatenate(dense),
        two.status,
        Stats(
            b.method,
            a.steps + b.steps,
            a.rejected + b.rejected,
            a.field_calls + b.field_calls,
            a.jacobian_calls + b.jacobian_calls,
            a.decompositions + b.decompositions,
            a.stiff or b.stiff,
        ),
    )


def advance(
    compiled: CompiledFlow,
    p: np.ndarray,
    y: np.ndarray,
    first: float,
    stops: np.ndarray,
    *,
    method: Method,
    rtol: float,
    atol: float,
    max_steps: int,
    dense: bool = True,
    progress: Callable[[float], object] | None = None,
    watch: Callable[[np.ndarray, np.ndarray, np.ndarray], bool] | None = None,
    rows_kept: int = RECORD,
    first_step: float = 0.0,
) -> Record:
    """Run `method` from `y` (n,), which it overwrites, at `first` to the last of `stops` (s,); see `ledger`.

    `watch(times, states, dense)` sees every `rows_kept` steps as they are made, without the start, and ends the run
    by returning True. `first_step`, signed, is tried first in place of an estimate. Without `dense` the record's
    `dense` has no rows. Ctrl-C ends it with the steps that were made.
    """
    kernel, rows = kernel_of(method, rtol)
    program = program_of(compiled, method, rtol)
    n = y.size
    memory = np.zeros(memory_size(rows, n) if kernel is radau else ledger.MEMORY_SIZE)
    memory[ledger.TIME] = first
    counters = np.zeros(ledger.COUNTERS_SIZE, dtype=np.int64)
    rate = np.zeros(n)
    if first_step != 0.0:
        memory[ledger.STEP] = first_step
        rate[:] = compiled.rates(y, p)
    # The start is row 0, so that a run of one piece is its own record.
    length = min(FIRST_RECORD, rows_kept)
    all_times, all_states = np.empty(length + 1), np.empty((length + 1, n))
    all_times[0], all_states[0] = first, y
    times, states = all_times[1:], all_states[1:]
    records = np.empty((length if dense else 0, rows, n))
    pieces = []
    kept = 0
    code = ledger.RECORD_FULL
    status = None
    try:
        while True:
            code = kernel(
                program, p, stops, rtol, atol, max_steps,
                y, rate, memory, counters, times, states, records,
            )  # fmt: skip
            new = int(counters[ledger.STEPS]) - kept
            if watch is not None and watch(times[:new], states[:new], records[:new]):
                status = Status.EVENT_REACHED
            if progress is not None:
                progress((float(memory[ledger.TIME]) - first) / (float(stops[-1]) - first))
            if code != ledger.RECORD_FULL or status is not None:
                break
            pieces.append((times, states, records))
            kept += new
            times, states = np.empty(rows_kept), np.empty((rows_kept, n))
            records = np.empty((rows_kept if dense else 0, rows, n))
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
    # The interrupt may have come between any two lines above: what counts is what the counters say.
    steps, rejected, field_calls, jacobian_calls, decompositions, stiff = counters.tolist()[: ledger.STIFF + 1]
    if not pieces:
        record = all_times[: steps + 1], all_states[: steps + 1], records[:steps]
    else:
        new = steps - sum(len(piece[0]) for piece in pieces)
        pieces[0] = (all_times, all_states, pieces[0][2])
        pieces.append((times[:new], states[:new], records[:new]))
        record = [np.concatenate(arrays) for arrays in zip(*pieces)]
    return Record(
        *record,
        status=status or STATUS[code],
        stats=Stats(method, steps, rejected, field_calls, jacobian_calls, decompositions, stiff == 1),
    )


def kernel_of(method: Method, rtol: float) -> tuple[Any, int]:
    """The kernel of `method` and the rows of its dense output at the tolerance."""
    if method is Method.TAYLOR:
        return taylor, dense_rows(taylor_order(rtol))
    return _KERNELS[method]


def taylor_order(rtol: float) -> int:
    """The order of a Taylor series at a tolerance."""
    return next(order for least, order in _TAYLOR_ORDERS if rtol >= least)


def program_of(compiled: CompiledFlow, method: Method, rtol: float) -> np.ndarray:
    """The addresses that the kernel of `method` takes; see `ledger`. What is missing is compiled.

    Raises `UnsupportedFunctionError` for `Method.TAYLOR` where the field has no Taylor series.
    """
    if method is Method.DOP853:
        return np.array([compiled.field, 0, 0])
    if method is Method.TAYLOR:
        return np.array([compiled.field, 0, *compiled.taylor(taylor_order(rtol)).program])
    code = compiled.rosenbrock if method is Method.RODAS5P else None
    if code is None:
        return np.array([compiled.field, compiled.jacobian, 0])
    return np.array([compiled.field, compiled.jacobian, *code.program])


def check_span(span: tuple[float, float]) -> tuple[float, float]:
    """The two ends as floats; raises `DeclarationError` unless finite and different."""
    try:
        first, last = map(float, span)
    except (TypeError, ValueError):
        raise DeclarationError(f"span is two numbers, (t0, t1). Got {span!r}.") from None
    if not (math.isfinite(first) and math.isfinite(last)):
        raise DeclarationError(f"span must be finite. Got {span!r}. Give the times of the start and the end.")
    if first == last or not math.isfinite(last - first):
        raise DeclarationError(
            f"span must have a length. Got {span!r}. Give an end that differs from the start."
        )
    return first, last


def check_tolerances(rtol: float, atol: float) -> None:
    """Raises `DeclarationError` unless both are finite, positive and above rounding."""
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
        return np.array([last])
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
        limit = operator.index(max_steps)
    except TypeError:
        limit = 0
    if limit < 1:
        raise DeclarationError(f"max_steps is an integer, 1 or more. Got {max_steps!r}.")
    return min(limit, 2**62)
