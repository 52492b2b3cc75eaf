"""Integration: a flow, a start and a span of time to a `Trajectory`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from gsp.errors import GspError, Status, nearest
from gsp.flow import Flow, Point
from gsp.integrators import (
    Method,
    Record,
    Stats,
    check_grid,
    check_method,
    check_span,
    check_step_limit,
    check_tolerances,
    run,
    stops_of,
)
from gsp.kernels.dense_output import interpolate_many
from gsp.lowering import compile_flow, parameter_vector

_SHOWN_STATES = 4


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

        It is of order 4 for RODAS5P, 7 for DOP853, and 4, 6 and 8 for RADAU5, RADAU9 and RADAU13. The implicit
        methods choose their steps so that its error stays near the tolerance in slaved fast variables too; where
        these carry a time scale of their own, RODAS5P falls to order 3 between the steps, and RADAU9 serves better.

        Raises `GspError` outside the interval covered.
        """
        times = np.array(t, dtype=float, order="C")
        if times.ndim > 1:
            raise GspError(f"t is a number or a one-dimensional array. Got the shape {times.shape}.")
        if len(self._dense) < len(self._times) - 1:
            raise GspError(
                "the trajectory holds no values between its steps. It was integrated with dense=False. "
                "Leave dense out, or name the times as at=..."
            )
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
    dense: bool = True,
    max_steps: int = 1_000_000,
    progress: Callable[[float], object] | None = None,
) -> Trajectory:
    """Integrate z' = F(z, epsilon) from `start` over `span` = (t0, t1), forward or backward.

    Each step's error estimate e satisfies RMS(e/(atol + rtol |z|)) <= 1; the Radau methods, whose estimate is of
    lower order than their results, transform the tolerance so that the results meet it. With `at` (m,), times
    inside the span in its direction, the result's `t` is `at`, and steps end on each, so that values there have
    the method's full order; else `t` are the ends of the steps. `method` is by default DOP853 for a flow that is
    not stiff, and for a stiff one what was measured to be fastest at the tolerance: RODAS5P for rtol >= 5e-7,
    RADAU9 down to 5e-9, RADAU13 below; but DOP853 too where the Jacobian at the start makes the span no more than
    some hundred fast times, unless that proves wrong on the way. `dense=False` keeps nothing between the steps, for
    speed; `.at` is then refused. `max_steps` bounds the attempted steps. `progress` is called now and then with the
    fraction done.

    A computation that stops early, also by Ctrl-C, returns what it reached, with a `status`. Raises
    `DeclarationError` for arguments that are not well formed.

    >>> from gsp import VectorField
    >>> x = sp.Symbol("x")
    >>> decay = VectorField(states={x: -x}, epsilon=None)
    >>> integrate(decay, start={"x": 1}, span=(0, 1), at=[0.5, 1.0])["x"].round(8)
    array([0.60653066, 0.36787944])
    """
    y = _start(flow, start)
    first, last = check_span(span)
    check_tolerances(rtol, atol)
    grid = None if at is None else check_grid(at, first, last)
    chosen = check_method(method)
    limit = check_step_limit(max_steps)
    record = run(
        compile_flow(flow),
        parameter_vector(flow, epsilon),
        y,
        first,
        stops_of(grid, first, last),
        method=chosen,
        rtol=rtol,
        atol=atol,
        max_steps=limit,
        dense=dense,
        progress=progress,
    )
    return _trajectory(flow, epsilon, grid, record)


def _trajectory(flow: Flow, epsilon: float | None, grid: np.ndarray | None, record: Record) -> Trajectory:
    times, states, dense = map(_frozen, (record.times, record.states, record.dense))
    if grid is None:
        t, y = times, states.T
    else:
        # Steps end on the grid exactly, so that equality is meant here; what was not reached is left out.
        t, ends = (grid, times) if grid[-1] >= times[0] else (-grid, -times)
        if not record.status.ok:
            reached = t.searchsorted(ends[-1], side="right")
            t, grid = t[:reached], grid[:reached]
        y = _frozen(states[ends.searchsorted(t)].T)
        t = grid
    return Trajectory(
        flow=flow,
        epsilon=epsilon,
        t=_frozen(t),
        y=y,
        status=record.status,
        stats=record.stats,
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


def _frozen(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array
