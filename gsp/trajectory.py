"""Integration: a flow, a start and a span of time to a `Trajectory`."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from gsp.errors import DeclarationError, GspError, Status, nearest
from gsp.flow import Flow, Point
from gsp.kernels import dop853_tableau, ledger, radau_tableau, rodas5p_tableau
from gsp.kernels.dense_output import interpolate_many
from gsp.kernels.dop853 import dop853
from gsp.kernels.radau import memory_size, radau
from gsp.kernels.rodas5p import rodas5p
from gsp.lowering import compile_flow, parameter_vector

# Rounding in a step is a few units in the last place; a tolerance nearer to it than this is never met.
_SMALLEST_RTOL = 1e-14
# Steps between two returns to Python, where Ctrl-C and progress are seen: milliseconds.
_RECORD = 1024
_SHOWN_STATES = 4
# Which method meets a tolerance in the least time, measured on van der Pol's oscillator (mu = 1e3), Robertson's
# and the HIRES problem, the Oregonator and the sleigh (epsilon = 1e-3), interleaved in one run, geometric means. At
# equal error at the end Rodas5P and Radau of order 9 cross at an error of 1e-7, orders 9 and 13 at 3e-10; at equal
# rtol, which is equal error of the dense output, at 1e-7 and 1e-8. The borders lie in between.
_TIGHT_RTOL = 5e-7
_TIGHTEST_RTOL = 5e-9


class Method(Enum):
    """How to integrate.

    RODAS5P: Rosenbrock, order 5, stiffly accurate; for fields with a fast time scale.
    RADAU5, RADAU9, RADAU13: Radau IIA, implicit Runge-Kutta, order 5, 9, 13; the same, for tight tolerances.
    DOP853: explicit Runge-Kutta, order 8; for reduced flows and other fields on one time scale.
    """

    RODAS5P = "rodas5p"
    RADAU5 = "radau5"
    RADAU9 = "radau9"
    RADAU13 = "radau13"
    DOP853 = "dop853"


_KERNELS = {
    Method.RODAS5P: (rodas5p, rodas5p_tableau.DENSE_ROWS),
    Method.RADAU5: (radau, radau_tableau.STAGES[0]),
    Method.RADAU9: (radau, radau_tableau.STAGES[1]),
    Method.RADAU13: (radau, radau_tableau.STAGES[2]),
    Method.DOP853: (dop853, dop853_tableau.DENSE_ROWS),
}
_STATUS = {
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


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """A solution z(t) of a flow: `t` (m,) and `y` (n_states, m), read-only, in the order of integration.

    `trajectory["name"]` is a state or an observable over `t`, `.at(t)` the state at any time covered,
    `.sample(t)` a trajectory on other times. `.status` says how it ended; when that is not SUCCESS, `t` and `y`
    hold what was reached.
    """

    flow: Flow
    epsilon: float | None
    t: np.ndarray
    y: np.ndarray
    status: Status
    stats: Stats
    _times: np.ndarray = field(repr=False)
    _states: np.ndarray = field(repr=False)
    _dense: np.ndarray = field(repr=False)

    def __getitem__(self, key: str | sp.Symbol) -> np.ndarray:
        """Values (m,) over `t` of a state or an observable; raises `GspError` for any other name."""
        name = key.name if isinstance(key, sp.Symbol) else key
        states = [symbol.name for symbol in self.flow.states]
        if name in states:
            return self.y[states.index(name)]
        observables = [symbol.name for symbol in self.flow.observables]
        if name in observables:
            values = compile_flow(self.flow).observables(self.y.T, parameter_vector(self.flow, self.epsilon))
            return _frozen(values[:, observables.index(name)].copy())
        known = [*states, *observables]
        raise GspError(
            f"{name!r} is no state and no observable. Those are {', '.join(known)}." + nearest(str(name), known)
        )

    def at(self, t: ArrayLike) -> np.ndarray:
        """State (n,) at a time, or (n, m) at times (m,), from the method's dense output.

        It is of order 4 for RODAS5P, 7 for DOP853, and 4, 6 and 8 for RADAU5, RADAU9 and RADAU13.

        Raises `GspError` outside the interval covered.
        """
        times = np.array(t, dtype=float, order="C")
        if times.ndim > 1:
            raise GspError(f"t is a number or a one-dimensional array. Got the shape {times.shape}.")
        flat = np.atleast_1d(times)
        low, high = sorted((float(self._times[0]), float(self._times[-1])))
        outside = flat[~((flat >= low) & (flat <= high))]
        if outside.size:
            raise GspError(
                f"the trajectory covers [{low:.17g}, {high:.17g}]. Got t = {outside[0]:.17g}. "
                "Ask inside, or integrate over a longer span."
            )
        out = np.empty((self._states.shape[1], flat.size))
        interpolate_many(self._times, self._states, self._dense, flat, out)
        return out if times.ndim else out[:, 0]

    def sample(self, t: ArrayLike) -> Trajectory:
        """The same solution with `.t` = `t` (m,), for `["name"]` on other times; as exact as `.at`."""
        times = np.array(t, dtype=float, ndmin=1, order="C")
        return Trajectory(
            flow=self.flow,
            epsilon=self.epsilon,
            t=_frozen(times),
            y=_frozen(self.at(times)),
            status=self.status,
            stats=self.stats,
            _times=self._times,
            _states=self._states,
            _dense=self._dense,
        )

    @property
    def message(self) -> str:
        """One line: how it ended, where, and what to do about it."""
        steps = f"{self.stats.steps} step" + ("" if self.stats.steps == 1 else "s")
        last = self._states[-1]
        shown = [f"{s.name} = {value:.6g}" for s, value in zip(self.flow.states, last)][:_SHOWN_STATES]
        if len(last) > _SHOWN_STATES:
            shown.append("...")
        where = f"t = {self._times[-1]:.6g}, {', '.join(shown)}"
        if self.status.ok:
            return f"reached the end after {steps}: {where}"
        remedy = self.status.remedy
        if self.status is Status.TOO_MANY_STEPS and self.stats.stiff:
            remedy = "the field is stiff here: use method=Method.RODAS5P"
        elif self.status is Status.SINGULAR_JACOBIAN:
            remedy = "the Jacobian is infinite here, or too large: start beside this point or use Method.DOP853"
        return f"stopped after {steps}: {self.status.name} at {where}; {remedy}"

    def __repr__(self) -> str:
        names = ", ".join(symbol.name for symbol in self.flow.states)
        return (
            f"Trajectory([{names}], t={self._times[0]:.6g}..{self._times[-1]:.6g}, points={self.t.size}, "
            f"{self.status.name})"
        )

    def __str__(self) -> str:
        names = [symbol.name for symbol in self.flow.states]
        width = max(map(len, names))
        stats = self.stats
        lines = [
            f"trajectory, {stats.method.value}"
            + ("" if self.epsilon is None else f", epsilon = {self.epsilon:g}")
        ]
        lines += [
            f"  {name:>{width}}  {first:>13.6g} -> {last:<13.6g}".rstrip()
            for name, first, last in zip(names, self._states[0], self._states[-1])
        ]
        lines.append(
            f"  {stats.steps} steps, {stats.rejected} rejected, {stats.field_calls} calls of the field, "
            f"{stats.jacobian_calls} of the Jacobian"
        )
        lines.append(f"  {self.message}")
        return "\n".join(lines)


def integrate(
    flow: Flow,
    *,
    start: Point,
    span: tuple[float, float],
    epsilon: float | None = None,
    rtol: float = 1e-8,
    atol: float = 1e-10,
    at: ArrayLike | None = None,
    method: Method | str | None = None,
    max_steps: int = 1_000_000,
    progress: Callable[[float], object] | None = None,
) -> Trajectory:
    """Integrate z' = F(z, epsilon) from `start` over `span` = (t0, t1), forward or backward.

    Each step's error estimate e satisfies RMS(e/(atol + rtol |z|)) <= 1; the Radau methods, whose estimate is of
    lower order than their results, transform the tolerance so that the results meet it. With `at` (m,), times
    inside the span in its direction, the result's `t` is `at`, and steps end on each, so that values there have
    the method's full order; else `t` are the ends of the steps. `method` is by default DOP853 for a flow that is
    not stiff, and for a stiff one what was measured to be fastest at the tolerance: RODAS5P for rtol >= 5e-7,
    RADAU9 down to 5e-9, RADAU13 below. `max_steps` bounds the attempted steps. `progress` is called now and then
    with the fraction done.

    A computation that stops early, also by Ctrl-C, returns what it reached, with a `status`. Raises
    `DeclarationError` for arguments that are not well formed.

    >>> from gsp import VectorField
    >>> x = sp.Symbol("x")
    >>> decay = VectorField(states={x: -x}, epsilon=None)
    >>> integrate(decay, start={"x": 1}, span=(0, 1), at=[0.5, 1.0])["x"].round(8)
    array([0.60653066, 0.36787944])
    """
    y = _start(flow, start)
    first, last = _span(span)
    _check_tolerances(rtol, atol)
    grid = None if at is None else _grid(at, first, last)
    chosen = _method(flow, method, rtol)
    limit = _step_limit(max_steps)
    p = parameter_vector(flow, epsilon)
    compiled = compile_flow(flow)
    kernel, rows = _KERNELS[chosen]
    jacobian = 0 if chosen is Method.DOP853 else compiled.jacobian

    n = y.size
    stops = _stops(grid, first, last)
    memory = np.zeros(memory_size(rows, n) if kernel is radau else ledger.MEMORY_SIZE)
    memory[ledger.TIME] = first
    counters = np.zeros(ledger.COUNTERS_SIZE, dtype=np.int64)
    rate = np.zeros(n)
    times, states, dense = np.empty(_RECORD), np.empty((_RECORD, n)), np.empty((_RECORD, rows, n))
    pieces = [(np.array([first]), y[np.newaxis].copy(), dense[:0])]
    kept = 0
    code = ledger.RECORD_FULL
    status = None
    try:
        while code == ledger.RECORD_FULL:
            code = kernel(
                compiled.field, jacobian, p, stops, rtol, atol, limit,
                y, rate, memory, counters, times, states, dense,
            )  # fmt: skip
            new = int(counters[ledger.STEPS]) - kept
            if code == ledger.RECORD_FULL:
                pieces.append((times.copy(), states.copy(), dense.copy()))
            else:
                pieces.append((times[:new], states[:new], dense[:new]))
            kept += new
            if progress is not None:
                progress((float(memory[ledger.TIME]) - first) / (last - first))
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
        # Counted anew: the interrupt may have come between any two lines above.
        new = int(counters[ledger.STEPS]) + 1 - sum(len(piece[0]) for piece in pieces)
        pieces.append((times[:new], states[:new], dense[:new]))
    record = [np.concatenate(arrays) for arrays in zip(*pieces)]
    return _trajectory(flow, epsilon, grid, record, status or _STATUS[code], chosen, counters)


def _trajectory(
    flow: Flow,
    epsilon: float | None,
    grid: np.ndarray | None,
    record: list[np.ndarray],
    status: Status,
    method: Method,
    counters: np.ndarray,
) -> Trajectory:
    times, states, dense = map(_frozen, record)
    if grid is None:
        t, y = times, states.T
    else:
        # Steps end on the grid exactly, so that equality is meant here; what was not reached is left out.
        sign = 1.0 if grid[-1] >= times[0] else -1.0
        t = grid[: np.searchsorted(sign * grid, sign * times[-1], side="right")]
        y = _frozen(states[np.searchsorted(sign * times, sign * t)].T)
    steps, rejected, field_calls, jacobian_calls, decompositions, stiff = map(int, counters[: ledger.STIFF + 1])
    return Trajectory(
        flow=flow,
        epsilon=epsilon,
        t=_frozen(t),
        y=y,
        status=status,
        stats=Stats(method, steps, rejected, field_calls, jacobian_calls, decompositions, bool(stiff)),
        _times=times,
        _states=states,
        _dense=dense,
    )


def _start(flow: Flow, start: Point) -> np.ndarray:
    y = np.array(flow.initial(start), dtype=float)
    if y.shape != (len(flow.states),):
        raise GspError(
            f"the flow has {len(flow.states)} states. Its initial() gave {y.shape}. Report this as a bug."
        )
    return y


def _span(span: tuple[float, float]) -> tuple[float, float]:
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


def _check_tolerances(rtol: float, atol: float) -> None:
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


def _grid(at: ArrayLike, first: float, last: float) -> np.ndarray:
    try:
        grid = np.array(at, dtype=float)
    except (TypeError, ValueError):
        raise DeclarationError(f"at is a sequence of times. Got {at!r}.") from None
    if grid.ndim != 1 or grid.size == 0:
        raise DeclarationError(f"at is a sequence of one or more times. Got the shape {grid.shape}.")
    low, high = min(first, last), max(first, last)
    outside = grid[~((grid >= low) & (grid <= high))]
    if outside.size:
        raise DeclarationError(
            f"at must lie inside the span ({first:g}, {last:g}). Got {outside[0]:.17g}. "
            "Drop it or lengthen the span."
        )
    steps = np.diff(grid) if last > first else -np.diff(grid)
    if not (steps > 0.0).all():
        i = int(np.argmin(steps > 0.0))
        raise DeclarationError(
            f"at must run from the start to the end of the span, without repeats. Got {grid[i]:.17g}, then "
            f"{grid[i + 1]:.17g}. Sort it."
        )
    return grid


def _stops(grid: np.ndarray | None, first: float, last: float) -> np.ndarray:
    if grid is None:
        return np.array([last])
    ahead = grid[1:] if grid[0] == first else grid
    return ahead.copy() if ahead.size and ahead[-1] == last else np.append(ahead, last)


def _method(flow: Flow, method: Method | str | None, rtol: float) -> Method:
    if method is None:
        if not flow.is_stiff:
            return Method.DOP853
        if rtol >= _TIGHT_RTOL:
            return Method.RODAS5P
        return Method.RADAU9 if rtol >= _TIGHTEST_RTOL else Method.RADAU13
    try:
        return Method(method)
    except ValueError:
        names = [member.value for member in Method]
        raise DeclarationError(
            f"{method!r} is no method. The methods are {', '.join(names)}." + nearest(str(method), names)
        ) from None


def _step_limit(max_steps: int) -> int:
    try:
        limit = operator.index(max_steps)
    except TypeError:
        limit = 0
    if limit < 1:
        raise DeclarationError(f"max_steps is an integer, 1 or more. Got {max_steps!r}.")
    return min(limit, 2**62)


def _frozen(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array
