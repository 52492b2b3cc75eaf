"""Ensembles: many runs of one flow, over starts, epsilon and parameters, on all cores."""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from textwrap import indent
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from gsp.errors import GspError, Status
from gsp.integration.clock_stops import stops_of_members
from gsp.integration.explanations import Explanation
from gsp.integration.loop import (
    STATUS,
    Stats,
    check_grid,
    check_span,
    check_step_limit,
    check_tolerances,
)
from gsp.integration.member import SHOWN_STATES, Member
from gsp.integration.members import Column, Columns, Members, Starts, members_of
from gsp.integration.methods import (
    SOLVERS,
    Method,
    check_method,
    choose_method,
)
from gsp.integration.parallel import Work, check_threads, share
from gsp.integration.watched import LOOK
from gsp.kernels import ensemble as kernels
from gsp.kernels import integrator
from gsp.lowering.compiled_flow import compile_flow
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.systems.arguments import check_noun, check_progress
from gsp.systems.flow import Flow, frozen

if TYPE_CHECKING:
    from gsp.integration.watched_members import WatchedMembers

_QUANTILES = (0.05, 0.5, 0.95)
_WORST_FIRST = (
    Status.NON_FINITE,
    Status.SINGULAR_JACOBIAN,
    Status.STEP_TOO_SMALL,
    Status.TOO_MANY_STEPS,
    Status.HYPERBOLICITY_LOST,
    Status.SERIES_ENDS,
    Status.FOLD_REACHED,
    Status.JUMP_REACHED,
    Status.INTERRUPTED,
    Status.SUCCESS,
)


@dataclass(frozen=True, eq=False, repr=False)
class Ensemble(Drawn, Tabular):
    """Many solutions of a flow at the times `t` (k,): `y` (m, n_states, k), read-only, member i in row i.

    `ensemble["name"]` (m, k) is a state or an observable, `.member(i)` one run, iteration runs over all; `.epsilon` and
    `.parameters` are what each was given. `.statuses` (m,) says how each ended; `y` is NaN at times that a member did
    not reach, `.last` (m, n_states) is its state at the end `.reached` (m,) of its last step.
    """

    flow: Flow
    method: Method
    members: Members
    t: np.ndarray
    y: np.ndarray
    statuses: tuple[Status, ...]
    reached: np.ndarray
    last: np.ndarray
    _counters: np.ndarray = field(repr=False)
    _explanations: Mapping[int, Explanation] = field(repr=False)

    def __len__(self) -> int:
        return len(self.statuses)

    def __iter__(self) -> Iterator[Member]:
        return (self.member(i) for i in range(len(self)))

    def __getitem__(self, key: str | sp.Symbol) -> np.ndarray:
        """Values (m, k) of a state or an observable, NaN where not reached; raises `GspError` for any other name."""
        name = key.name if isinstance(key, sp.Symbol) else key
        states = [symbol.name for symbol in self.flow.states]
        if name in states:
            return self.y[:, states.index(name)]
        observables = [symbol.name for symbol in self.flow.observables]
        if name not in observables:
            known = [*states, *observables]
            raise GspError.none_of(known, name, f"{name!r} is no state and no observable.", "Those are")
        # Copies: compiled code takes writable contiguous arrays only.
        kept = np.array(self.y.transpose(0, 2, 1), order="C")
        out = np.empty((*kept.shape[:2], len(observables)))
        constants = np.array(self.members.constants)
        kernels.evaluate_members(compile_flow(self.flow).observables.address, kept, constants, out)
        # An observable may be finite where the state is not a number.
        values = np.where(np.isnan(kept[:, :, 0]), np.nan, out[:, :, observables.index(name)])
        return frozen(values)

    def member(self, i: int) -> Member:
        """The run with index `i`, from 0; raises `GspError` when there is none."""
        if not 0 <= operator.index(i) < len(self):
            raise GspError(f"the members are numbered 0 to {len(self) - 1}.", got=i)
        states = [symbol.name for symbol in self.flow.states]
        epsilon, *parameters = self.members.constants[i].tolist()
        steps, rejected, field_calls, jacobian_calls, decompositions, stiff = self._counters[i].tolist()
        return Member(
            index=i,
            start=dict(zip(states, self.members.starts[i].tolist())),
            epsilon=None if self.flow.epsilon is None else epsilon,
            parameters={symbol.name: value for symbol, value in zip(self.flow.parameters, parameters)},
            status=self.statuses[i],
            reached=float(self.reached[i]),
            last=dict(zip(states, self.last[i].tolist())),
            t=self.t,
            y=self.y[i],
            stats=Stats(
                self.method,
                steps,
                rejected,
                field_calls,
                jacobian_calls,
                decompositions,
                bool(stiff),
            ),
            _explanation=self._explanations.get(i),
        )

    @property
    def starts(self) -> np.ndarray:
        """States at the start, (m, n_states)."""
        return self.members.starts

    @property
    def epsilon(self) -> np.ndarray | None:
        """Each member's epsilon, (m,); `None` for a flow that has none."""
        return None if self.flow.epsilon is None else self.members.constants[:, 0]

    @property
    def parameters(self) -> Mapping[str, np.ndarray]:
        """Each member's value (m,) of every parameter, by name."""
        columns = self.members.constants.T[1:]
        return {symbol.name: column for symbol, column in zip(self.flow.parameters, columns)}

    @property
    def failed(self) -> np.ndarray:
        """Indices of the members that did not reach the end."""
        return np.flatnonzero([not status.ok for status in self.statuses])

    @property
    def steps(self) -> np.ndarray:
        """Accepted steps of each member, (m,)."""
        return self._counters[:, integrator.STEPS]

    @property
    def message(self) -> str:
        """A line for each way that members ended, the worst first, with the first such member and what to do."""
        counts = Counter(self.statuses)
        if len(counts) == 1 and Status.SUCCESS in counts:
            return (
                "the member reached the end" if len(self) == 1 else f"all {len(self)} members reached the end"
            )
        lines = []
        for status in sorted(counts, key=_WORST_FIRST.index):
            share = f"{counts[status]} of {len(self)}"
            if status.ok:
                lines.append(f"{share} reached the end")
            else:
                first = self.member(self.statuses.index(status))
                lines.append(f"{share} {status.name}, first member {first.index} at {first._words}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        names = ", ".join(symbol.name for symbol in self.flow.states)
        counts = Counter(status.name for status in self.statuses)
        return (
            f"Ensemble([{names}], members={len(self)}, times={self.t.size}, "
            + ", ".join(f"{name}: {count}" for name, count in counts.items())
            + ")"
        )

    def __str__(self) -> str:
        rows: list[tuple[str, np.ndarray]] = []
        for symbol in self.flow.states[:SHOWN_STATES]:
            values = self[symbol][:, -1]
            rows.append((symbol.name, values[~np.isnan(values)]))
        if len(self.flow.states) > SHOWN_STATES:
            rows.append(("...", np.empty(0)))
        rows.append(("steps", self.steps))
        width = max(len(name) for name, _ in rows)
        lines = [f"ensemble of {len(self)}, {self.method.value}{_range(self.flow.epsilon, self.epsilon)}"]
        heads = "".join(f"{f'{100 * q:g} %':>14}" for q in _QUANTILES)
        lines.append(f"  {'':>{width}}{heads}  at t = {self.t[-1]:g}")
        for name, values in rows:
            found = np.quantile(values, _QUANTILES) if values.size else ()
            lines.append(f"  {name:>{width}}" + "".join(f"{value:14.6g}" for value in found))
        return "\n".join([*lines, indent(self.message, "  ")])


def integrate_many(
    flow: Flow,
    starts: Starts,
    *,
    span: tuple[float, float],
    epsilon: Column | None = None,
    parameters: Columns | None = None,
    rtol: float = 1e-8,
    atol: float = 1e-10,
    at: ArrayLike | None = None,
    method: Method | str | None = None,
    max_steps: int = 1_000_000,
    threads: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> Ensemble:
    """Integrate `flow` once for each member: start, epsilon and parameter values, one for all or one for each.

    `starts` is a mapping of names to numbers or arrays (m,), a sequence of mappings, or an array (m, n) in the order of
    the flow's states. `epsilon` is a number or (m,), `parameters` a mapping of names to numbers or (m,), which stand in
    for the flow's own. `at` (k,) are the times that are kept, by default the end of the span; nothing else is, so
    that memory does not grow with the steps. The other arguments are those of `integrate`.

    Every number is, bit for bit, what `integrate` returns for that member alone, whatever `threads` (by default one for
    each core). A member that stops early, one of a reduced flow also at a fold or another loss of normal hyperbolicity,
    has its own status and does not affect the others. `progress` is called with the fraction of members done; Ctrl-C
    returns what is done, with the rest INTERRUPTED. Raises `DeclarationError` for arguments that are not well formed
    and `HyperbolicityError` for a start on a loss, naming the member.

    >>> from gsp import VectorField
    >>> x, k = sp.symbols("x k")
    >>> decay = VectorField(states={x: -k * x}, epsilon=None, parameters={k: 1})
    >>> integrate_many(decay, {"x": 1}, parameters={"k": [1, 2, 3]}, span=(0, 1))["x"][:, -1].round(6)
    array([0.367879, 0.135335, 0.049787])
    """
    check_noun(flow, Flow, verb="integrate_many")
    first, last = check_span(span)
    rtol, atol = check_tolerances(rtol, atol)
    check_progress(progress)
    grid = None if at is None else check_grid(at, first, last)
    named_method = check_method(method)
    compiled = compile_flow(flow)
    # As in `integrate`: read between the steps, or landed on.
    reads = grid is not None and compiled.expressions.is_smooth
    chosen = named_method or choose_method(compiled, rtol)
    limit = check_step_limit(max_steps)
    count = check_threads(threads)
    members = members_of(flow, starts, epsilon=epsilon, parameters=parameters)
    m, n = members.starts.shape
    t = np.array([last]) if grid is None else grid
    solver = SOLVERS[chosen]
    program = solver.program(compiled)
    # Compiled code does not come back for them in the middle of a member.
    solver.give_loops(program)
    # Addresses are asked for here: two threads would compile twice.
    control = (float(rtol), float(atol), limit)
    stops = stops_of_members(compiled, members, None if reads else grid, first, last, limit)
    shared = solver.corrects, program, members.constants.copy(), first, stops, t.copy(), control
    watched = None
    if flow.is_reduced:
        watched = _watched(flow, members, t, span=(first, last), method=chosen, control=control)
    # Steps between two looks at an interrupt; a watched run looks at its steps as often as `integrate` does.
    length = 128 if watched is None else LOOK
    ends = members.starts.copy()
    reached = np.full(m, first)
    kept = np.full((m, t.size, n), np.nan)
    if t[0] == first:
        kept[:, 0] = ends
    counters = np.zeros((m, integrator.COUNTERS_SIZE), dtype=np.int64)
    codes = np.full(m, kernels.NOT_FINISHED, dtype=np.int64)
    arrays = (ends, reached, kept, counters, codes)

    def worker() -> Work:
        memory = np.zeros(solver.memory_size(n))
        times, states = np.empty(length + 1), np.empty((length + 1, n))
        # DOP853 computes its dense output, as in `integrate`, since that can fail by itself.
        dense = reads or watched is not None or chosen is Method.DOP853
        record = times, states, np.empty((length if dense else 0, solver.rows, n))
        rate = np.zeros(n)

        def work(low: int, high: int, halt: np.ndarray) -> None:
            scratch = (rate, memory, record)
            if watched is None:
                kernels.run_members(shared, low, high, halt, arrays, scratch)
            else:
                watched.run(shared, low, high, halt, arrays, scratch)

        return work

    share(worker, m, threads=min(count, m), progress=progress)
    endings = {kernels.NOT_FINISHED: Status.INTERRUPTED, **STATUS}
    statuses = [endings[code] for code in codes.tolist()]
    explanations = {}
    for i, trajectory in (watched.alone if watched else {}).items():
        statuses[i] = trajectory.status
        explanations[i] = Explanation(trajectory._outcome.note, trajectory._outcome.remedy)
    return Ensemble(
        flow=flow,
        method=chosen,
        members=members,
        t=frozen(t),
        y=frozen(kept).transpose(0, 2, 1),
        statuses=tuple(statuses),
        reached=frozen(reached),
        last=frozen(ends),
        _counters=frozen(counters[:, : integrator.STIFF + 1].copy()),
        _explanations=explanations,
    )


def _watched(flow: Flow, members: Members, t: np.ndarray, **options) -> WatchedMembers:
    # Imported here, as in `trajectory`: all that series need would be a good part of the first solve.
    from gsp.integration.reduced_flow import ReducedFlow
    from gsp.integration.watched_members import WatchedMembers

    assert isinstance(flow, ReducedFlow)
    return WatchedMembers(flow, members, t, **options)


def _range(epsilon: sp.Symbol | None, values: np.ndarray | None) -> str:
    if values is None:
        return ""
    low, high = values.min(), values.max()
    return f", {epsilon} = {low:g}" + ("" if low == high else f" to {high:g}")
