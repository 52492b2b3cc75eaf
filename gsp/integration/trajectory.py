"""Integration: a flow, a start and a span of time to a `Trajectory`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from gsp.errors import DeclarationError, GspError, Status
from gsp.integration.clock_stops import clock_stops, stops_of
from gsp.integration.events import NOT_MET, Crossings, Event, compile_events
from gsp.integration.explanations import lost_below
from gsp.integration.loop import (
    ALONE,
    NOBODY,
    RECORD,
    Control,
    Looks,
    Run,
    Stats,
    check_grid,
    check_span,
    check_step_limit,
    check_tolerances,
    run,
)
from gsp.integration.member import SHOWN_STATES
from gsp.integration.methods import SOLVERS, Method, check_method
from gsp.integration.output import read
from gsp.integration.run_array import RecordedSteps, RunRecord
from gsp.integration.watched import LOOK
from gsp.integration.watching import examined
from gsp.kernels.dense_output import interpolate_many
from gsp.kernels.evaluate import observe
from gsp.lowering.compiled_flow import compile_flow
from gsp.results.bounds import as_given
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.systems.arguments import check_array, check_flag, check_noun, check_progress, check_times
from gsp.systems.flow import Flow, Point, Question, frozen, values_by_name
from gsp.systems.tolerances import ATOL, RTOL, absolute_tolerance

if TYPE_CHECKING:
    from gsp.integration.reduced_flow import ReducedFlow


class RunOutcome(NamedTuple):
    """What a run came to: its flow and record, how it was controlled, and what is told of it, as `Findings` has that.

    `times` (m,) and `states` (m, n) are those asked for, None where these are the record's own. Values between steps
    are corrected where the method's are and `is_corrected`.
    """

    flow: Flow
    epsilon: float | None
    record: RunRecord
    control: Control
    is_corrected: bool
    times: np.ndarray | None
    states: np.ndarray | None
    events: Mapping[str, Crossings]
    note: str
    remedy: str


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Drawn, Tabular):
    """A solution z(t) of a flow: `t` (m,) and `y` (n_states, m), read-only, in the order of integration.

    `trajectory["name"]` is a state or an observable over `t`, `.at(t)` the state at any time covered,
    `.sample(t)` a trajectory on other times. `.status` says how it ended; when that is not SUCCESS, `t` and `y`
    hold what was reached. `.events` maps the name of each event asked for to its `Crossings`, (times, states).
    """

    # One field, since a frozen class takes as long for each as a run takes for two steps.
    _outcome: RunOutcome

    @property
    def flow(self) -> Flow:
        """What was integrated."""
        return self._outcome.flow

    @property
    def epsilon(self) -> float | None:
        """Its small parameter, if it has one."""
        return self._outcome.epsilon

    @property
    def _record(self) -> RunRecord:
        return self._outcome.record

    @cached_property
    def _steps(self) -> RecordedSteps:
        return self._record.steps

    @cached_property
    def t(self) -> np.ndarray:
        """The times (m,), in the order of integration."""
        times = self._outcome.times
        return frozen(self._steps.times if times is None else times)

    @cached_property
    def y(self) -> np.ndarray:
        """The states (n_states, m) over `t`."""
        states = self._outcome.states
        return frozen(frozen(self._steps.states if states is None else states).T)

    @property
    def events(self) -> Mapping[str, Crossings]:
        """Where each event was met, by its name."""
        return self._outcome.events

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self._record.status

    @cached_property
    def stats(self) -> Stats:
        """What it cost."""
        return self._record.stats

    def __getitem__(self, key: str | sp.Symbol) -> np.ndarray:
        """Values (m,) over `t` of a state or an observable; raises `GspError` for any other name."""
        name = key if type(key) is str else key.name if isinstance(key, sp.Symbol) else key
        for i, symbol in enumerate(self.flow.states):
            if symbol.name == name:
                return self.y[i]
        for k, symbol in enumerate(self.flow.observables):
            if symbol.name == name:
                return self._observed[:, k]
        known = [symbol.name for symbol in (*self.flow.states, *self.flow.observables)]
        raise GspError.none_of(known, name, f"{name!r} is no state and no observable.", "Those are")

    def at(self, t: ArrayLike) -> np.ndarray:
        """State (n,) at a time, or (n, m) at times (m,), as `at=` gives it.

        It is read off the dense output, of order 6 for RADAU9 and 8 for RADAU13, which is as good as the steps. That of
        DOP853, of order 7, is corrected where its error would be above the tolerance, or a step ends there.

        Raises `GspError` outside the interval covered.
        """
        times = check_times(t).copy(order="C")
        if times.ndim > 1:
            raise GspError(
                "t is a number or a one-dimensional array.", got=f"the shape {times.shape}", value=times.shape
            )
        ends, states, dense = map(frozen, self._steps)
        if len(dense) < len(ends) - 1:
            raise GspError(
                "the trajectory holds no values between its steps.",
                "It was integrated with dense=False. Leave dense out, or name the times as at=...",
            )
        flat = times if times.ndim else times.reshape(1)
        out = np.empty((states.shape[1], flat.size))
        outside = interpolate_many(ends, states, dense, flat, out)
        if outside < 0:
            self._check(flat, out)
        if outside >= 0:
            low, high = sorted((float(ends[0]), float(ends[-1])))
            raise GspError(
                f"the trajectory covers [{as_given(low)}, {as_given(high)}].",
                "Ask inside, or integrate over a longer span.",
                got=f"t = {as_given(float(flat[outside]))}",
            )
        return out if times.ndim else out[:, 0]

    def _check(self, t: np.ndarray, out: np.ndarray) -> None:
        """Put in `out` (n, m) what `at=` gives at the times (m,), where the dense output alone does not do."""
        record = self._record
        if not (self._outcome.is_corrected and SOLVERS[record.method].corrects and len(record.dense)):
            return
        grid, places = np.unique(t, return_inverse=True)
        if record.times[-1] < record.times[0]:
            grid, places = grid[::-1].copy(), len(grid) - 1 - places
        compiled = compile_flow(self.flow)
        p = compiled.parameters(self.epsilon)
        # Apart, since the run is not to count what is done for a reader.
        values, _ = read(compiled, p, record.apart(), grid, control=self._outcome.control)
        out[:] = values.T[:, places]

    def sample(self, t: ArrayLike) -> Trajectory:
        """The same solution with `.t` = `t` (m,), for `["name"]` on other times; as exact as `.at`."""
        times = np.atleast_1d(check_array(t, what="t", be="a sequence of times")).copy(order="C")
        return Trajectory(self._outcome._replace(times=times, states=self.at(times).T))

    def moved_to(self, flow: Flow, centre: np.ndarray, told: str) -> Trajectory:
        """The same as a run of `flow`, where this is one of that about the `centre` (n,), which is `told` in words."""
        outcome, record = self._outcome, self._record.apart()
        events = {name: met._replace(states=met.states + centre[:, None]) for name, met in self.events.items()}
        return Trajectory(
            outcome._replace(
                flow=flow,
                record=record._replace(states=record.states + centre),
                states=None if outcome.states is None else outcome.states + centre,
                events=events,
                note=outcome.note and f"{outcome.note}, counted from {told}",
            )
        )

    @cached_property
    def _observed(self) -> np.ndarray:
        """All observables over `t`, (m, k), read-only."""
        compiled, states = compile_flow(self.flow), self.y.T
        if not states.flags.c_contiguous:
            states = frozen(states.copy())
        out = np.empty((len(states), len(self.flow.observables)))
        epsilon = np.nan if self.epsilon is None else self.epsilon
        observe(compiled.observables.address, states, epsilon, compiled.constants, out)
        return frozen(out)

    def _ends(self, variables: Sequence[sp.Symbol]) -> Iterator[tuple[sp.Symbol, float, float]]:
        """Each state or observable of `variables` with its values where the run begins and ends."""
        # What was sampled of a run may leave its ends out.
        run = Trajectory(self._outcome._replace(times=None, states=None))
        for symbol in variables:
            values = run[symbol]
            yield symbol, values[0], values[-1]

    @property
    def message(self) -> str:
        """One line: how it ended, where, and what to do about it."""
        steps = f"{self.stats.steps} step" + ("" if self.stats.steps == 1 else "s")
        if self.status.ok:
            head, control = f"reached the end after {steps}: {self.end_in_words}", self._outcome.control
            told = lost_below(self.flow, self._record, control.rtol, control.atol)
        else:
            head = f"stopped after {steps}: {self.status.name} at {self.end_in_words}"
            told = self._outcome.note, self._outcome.remedy
        return "; ".join(filter(None, (head, *told)))

    @property
    def end_in_words(self) -> str:
        """The time and the state at which it ended, in words."""
        variables = self.flow.variables_shown
        shown = [f"{s.name} = {last:.6g}" for s, _, last in self._ends(variables[:SHOWN_STATES])]
        if len(variables) > SHOWN_STATES:
            shown.append("...")
        return f"t = {self._record.times[-1]:.6g}, {', '.join(shown)}"

    def __repr__(self) -> str:
        names = ", ".join(symbol.name for symbol in self.flow.states)
        times = self._record.times
        return (
            f"Trajectory([{names}], t={times[0]:.6g}..{times[-1]:.6g}, points={self.t.size}, "
            f"{self.status.name})"
        )

    def __str__(self) -> str:
        variables = self.flow.variables_shown
        width = max(len(symbol.name) for symbol in variables)
        stats = self.stats
        lines = [
            f"trajectory, {stats.method.value}"
            + ("" if self.epsilon is None else f", {self.flow.epsilon} = {self.epsilon:g}")
        ]
        lines += [
            f"  {symbol.name:>{width}}  {first:>13.6g} -> {last:<13.6g}".rstrip()
            for symbol, first, last in self._ends(variables)
        ]
        lines.append(
            f"  {stats.steps} steps, {stats.rejected} rejected, {stats.field_calls} calls of the field, "
            f"{stats.jacobian_calls} of the Jacobian"
        )
        lines.append(f"  {self.message}")
        return "\n".join(lines)


def integrate(
    flow: Flow | Question,
    *,
    start: Point | None = None,
    span: tuple[float, float] | None = None,
    epsilon: float | None = None,
    rtol: float = RTOL,
    atol: float | None = None,
    at: ArrayLike | None = None,
    method: Method | str | None = None,
    dense: bool = True,
    max_steps: int = 1_000_000,
    events: Event | Iterable[Event] = (),
    progress: Callable[[float], object] | None = None,
) -> Trajectory:
    """Integrate z' = F(z, epsilon) from `start` over `span` = (t0, t1), forward or backward.

    A `Scene` brings its own field, start, span and epsilon, in whose place those of the call stand where given.

    Each step's error estimate e satisfies RMS(e/(atol + rtol |z|)) <= 1; the Radau methods, whose estimate is of
    lower order than their results, transform the tolerance so that the results meet it. `atol` is by default 1e-10, or
    what the smallest state of a `Scene` needs, by its region and start. With `at` (m,), times inside the span in its
    direction, the result's `t` is `at`: values there are as good as the steps, read off the dense output, which is
    corrected for DOP853; else `t` are the ends of the steps. `method` is by default DOP853 for a flow that is not
    stiff, and for a stiff one RADAU9 for rtol from 2e-5 up and RADAU13 below. Above 40 states a sparse Jacobian is used
    as one. `dense=False` keeps nothing between the steps, for speed; `.at` is then refused. `max_steps` bounds the
    attempted steps. `events` are zeros to be found along the run, which a terminal one ends; see `Event`. `progress` is
    called now and then with the fraction done.

    A reduced flow ends where its reduction does: at a fold, at another loss of normal hyperbolicity, or where its
    series in epsilon stops being asymptotic. A computation that stops early, also by Ctrl-C, returns what it reached,
    with a `status`. Raises `DeclarationError` for arguments that are not well formed, `HyperbolicityError`
    for a reduced flow started on a loss.

    >>> from gsp import VectorField
    >>> x = sp.Symbol("x")
    >>> decay = VectorField(states={x: -x}, epsilon=None)
    >>> integrate(decay, start={"x": 1}, span=(0, 1), at=[0.5, 1.0])["x"].round(8)
    array([0.60653066, 0.36787944])
    """
    if not isinstance(flow, Flow):
        if isinstance(flow, Question):
            # A scene says all of it; what the call says as well stands in its place.
            region = flow.region
            flow, start, span, epsilon = flow.setting(start, span, epsilon)
            if atol is None:
                atol = absolute_tolerance(
                    check_tolerances(rtol, ATOL)[0], region, values_by_name(start, what="start")
                )
        check_noun(flow, Flow, verb="integrate")
    if start is None or span is None:
        missing = "start" if start is None else "span"
        raise DeclarationError(f"{missing} is missing.", "Only a Scene has one of its own.", got="None")
    # By their places, which takes half the time that their names do.
    options = RunOptions._make((method, dense, max_steps, events, progress, True, False, None))
    return trajectory_of(flow, start, span, epsilon, rtol, ATOL if atol is None else atol, at, options)


class RunOptions(NamedTuple):
    """What else a run may be asked for: five arguments of `integrate`, and what is of use within other verbs alone.

    Ctrl-C ends a run that `returns_partial` with what was made until then. With `stops_at_times` a step ends
    on every time of `at`, whose values are then better than the tolerance by as much as the steps are: for references.
    `state` is what `flow.initial(start)` gives, where that is known.
    """

    method: Method | str | None = None
    dense: bool = True
    max_steps: int = 1_000_000
    events: Event | Iterable[Event] = ()
    progress: Callable[[float], object] | None = None
    returns_partial: bool = False
    stops_at_times: bool = False
    state: tuple[float, ...] | None = None


PLAIN = RunOptions()


def trajectory_of(
    flow: Flow,
    start: Point,
    span: tuple[float, float],
    epsilon: float | None = None,
    rtol: float = RTOL,
    atol: float = ATOL,
    at: ArrayLike | None = None,
    options: RunOptions = PLAIN,
) -> Trajectory:
    """`integrate` inside another verb: Ctrl-C ends that verb too, lest a result be made of half a run."""
    method, dense, max_steps, events, progress, returns_partial, stops_at_times, state = options
    first, last = check_span(span)
    rtol, atol = check_tolerances(rtol, atol)
    dense = dense is True or check_flag(dense, what="dense")
    if progress is not None:
        check_progress(progress)
    grid = None if at is None else check_grid(at, first, last)
    chosen = None if method is None else check_method(method)
    control = Control._make((chosen, rtol, atol, check_step_limit(max_steps)))
    compiled = compile_flow(flow)
    p = compiled.parameters(epsilon)
    compiled_events = (
        None if isinstance(events, tuple) and not events else compile_events(flow, events, np.array(p))
    )
    reduced = flow.is_reduced
    # Most runs of a reduced flow keep clear of every loss; what is seen of one that does not is made and told again.
    tests = (
        cast("ReducedFlow", flow).tests if reduced and compiled_events is None and progress is None else None
    )
    # When a clock strikes is told by the state itself.
    needs_state = tests is None or state is not None or compiled.clocks
    over_slow = None if needs_state else cast("ReducedFlow", flow).slow_start(start)
    y = state or over_slow or _start(flow, start)
    # Steps end on the times of a grid where the field has kinks and jumps, of which a dense output knows nothing, and
    # where events are looked for, since a step may pass over a pulse.
    reads = (
        grid is not None and compiled_events is None and not stops_at_times and compiled.expressions.is_smooth
    )
    places = clock_stops(compiled, p, y, first, last, control.max_steps) if compiled.clocks else ()
    landed = None if reads else grid
    stops = (last,) if landed is None and not places else stops_of(landed, first, last, places)
    looks = ALONE if returns_partial else NOBODY
    if tests is not None or progress is not None:
        rows = RECORD if tests is None else LOOK
        looks = Looks(returns_partial, progress, None, rows, tests, over_slow is not None)
    request = Run(compiled, p, y, first, stops, control, dense or reads or reduced, 0.0, looks)
    record = run(request) if tests is not None or not (reduced or compiled_events is not None) else None
    met, note, remedy = NOT_MET, "", ""
    if (
        record is None
        or record.status is not Status.SUCCESS
        or (reduced and cast("ReducedFlow", flow).leaves_pairs)
    ):
        if over_slow is not None:
            request = request._replace(y=_start(flow, start))
            if record is not None and record.status is Status.INTERRUPTED:
                # It may have come before the start was found.
                record.states[0] = request.y
        record, met, note, remedy = examined(flow, request, record, compiled_events, grid)
    t = states = None
    if grid is not None:
        states, record = read(compiled, p, record, grid, control=control)
        # What was not reached is left out.
        t = grid if len(states) == len(grid) else grid[: len(states)]
        if not dense:
            record = record.without_dense()
    # The checked float, which prints.
    value = None if flow.epsilon is None else p[0]
    return Trajectory(RunOutcome._make((flow, value, record, control, dense, t, states, met, note, remedy)))


def _start(flow: Flow, start: Point) -> tuple[float, ...]:
    y = flow.initial(start)
    if len(y) != len(flow.states):
        raise GspError(
            f"the flow has {len(flow.states)} states.", f"Its initial() gave {len(y)}. Report this as a bug."
        )
    return y
