"""The one array of a run: what is entered there before it, and what is read there after it; see `kernels.launch`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from struct import Struct
from typing import NamedTuple

import numpy as np

from gsp.errors import Status
from gsp.integration.methods import SOLVERS, Method, Solver
from gsp.kernels import integrator
from gsp.kernels import launch as kernels
from gsp.kernels.launch import before_record
from gsp.lowering.compiled_flow import CompiledFlow

# Entries of an array that is kept for a result that needs a part of it: 512 kB, of which those that were never written
# take no memory: to cut an array out takes half as long as a short run.
MOST_KEPT = 1 << 16


class Layout(NamedTuple):
    """What the arrays of one method's runs over one flow have in common.

    `enter(run_array, 0, *numbers)` writes HEAD, the time of the start, the tolerances, the first step, y, p and one
    stop, and zeros for the counters.
    """

    solver: Solver
    program: np.ndarray
    enter: Callable[..., None]
    constants: int
    memory: int
    before: int
    """Where the record begins in an array with one stop in which nothing is watched."""


def layout_of(compiled: CompiledFlow, method: Method) -> Layout:
    """The layout for a method."""
    known = compiled.layouts
    found = known.get(method)
    if found is None:
        found = known[method] = _laid_out(compiled, SOLVERS[method])
    return found


def _laid_out(compiled: CompiledFlow, solver: Solver) -> Layout:
    n, constants = compiled.size, len(compiled.constants)
    memory = solver.memory_size(n)
    # Counters are the bytes that are skipped, which makes them zeros.
    skipped = 8 * integrator.COUNTERS_SIZE
    enter = Struct(f"{kernels.HEAD}q{skipped}x{kernels.Y - kernels.GIVEN + n + constants + 1}d").pack_into
    return Layout(
        solver, solver.program(compiled), enter, constants, memory, before_record(n, constants, 1, memory, 0)
    )


class RecordedSteps(NamedTuple):
    """Steps one after the other: `times` (k + 1,) and `states` (k + 1, n) with the start, `dense` (k or 0, rows, n)."""

    times: np.ndarray
    states: np.ndarray
    dense: np.ndarray


def recorded_steps(run_array: np.ndarray, earlier: int = 0) -> RecordedSteps:
    """The steps in the record of an array, where `earlier` ones were made in other arrays."""
    numbers = run_array[: kernels.COUNTERS + integrator.STEPS + 1].view(np.int64).tolist()
    _, _, n, constants, stops, memory, watches, length, dense, rows = numbers[: kernels.HEAD]
    count = numbers[-1] - earlier
    times = before_record(n, constants, stops, memory, watches)
    states = times + length + 1
    between = states + (length + 1) * n
    kept = count if dense else 0
    return RecordedSteps(
        run_array[times : times + count + 1],
        run_array[states : states + (count + 1) * n].reshape(count + 1, n),
        run_array[between : between + kept * rows * n].reshape(kept, rows, n),
    )


def counters_in(run_array: np.ndarray) -> list[int]:
    """The integrator's counters up to STIFF."""
    return run_array[kernels.COUNTERS : kernels.COUNTERS + integrator.STIFF + 1].view(np.int64).tolist()


def steps_in(run_array: np.ndarray) -> int:
    """How many steps were made by now, in this array and those before it."""
    return counters_in(run_array)[integrator.STEPS]


def time_in(run_array: np.ndarray) -> float:
    """How far the run has come."""
    _, _, n, constants, stops, *_ = run_array[: kernels.HEAD].view(np.int64).tolist()
    return float(run_array[kernels.Y + n + constants + stops + integrator.TIME])


def next_run_array(run_array: np.ndarray, length: int) -> np.ndarray:
    """An array with an empty record of so many rows, in which the run goes on."""
    _, _, n, constants, stops, memory, watches, _, dense, rows = (
        run_array[: kernels.HEAD].view(np.int64).tolist()
    )
    before = before_record(n, constants, stops, memory, watches)
    ahead = np.empty(before + (length + 1) * (1 + n) + (length * rows * n if dense else 0))
    ahead[:before] = run_array[:before]
    head = ahead[: kernels.HEAD].view(np.int64)
    head[kernels.LENGTH], head[kernels.DENSE] = length, length if dense else 0
    return ahead


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


class Record(NamedTuple):
    """What a run leaves: the ends of its steps with the start in front, `dense` output, status, method and counters.

    `counters` are the integrator's up to STIFF.
    """

    times: np.ndarray
    states: np.ndarray
    dense: np.ndarray
    status: Status
    method: Method
    counters: Sequence[int]

    @property
    def steps(self) -> RecordedSteps:
        """Times, states and dense output."""
        return RecordedSteps(self.times, self.states, self.dense)

    @property
    def stats(self) -> Stats:
        """Method and counters by name."""
        return _stats(self)

    def without_dense(self) -> Record:
        """The same with nothing between the steps."""
        return self._replace(times=self.times.copy(), states=self.states.copy(), dense=self.dense[:0].copy())

    def apart(self) -> Record:
        """The record as a value of its own."""
        return self


class _InArray(NamedTuple):
    run_array: np.ndarray
    status: Status
    method: Method
    holds_dense: bool = True


class RecordInArray(_InArray):
    """A record that lies in the one array of its run, from which it is cut when it is read.

    To cut it takes half as long as a short run. What compiled code reads there it counts there.
    """

    @property
    def steps(self) -> RecordedSteps:
        """Times, states and dense output."""
        steps = recorded_steps(self.run_array)
        return steps if self.holds_dense else steps._replace(dense=steps.dense[:0])

    @property
    def times(self) -> np.ndarray:
        """Ends of the steps (k + 1,), with the start."""
        return self.steps.times

    @property
    def states(self) -> np.ndarray:
        """States there (k + 1, n)."""
        return self.steps.states

    @property
    def dense(self) -> np.ndarray:
        """Dense output (k or 0, rows, n)."""
        return self.steps.dense

    @property
    def counters(self) -> list[int]:
        """As a record has them."""
        return counters_in(self.run_array)

    @property
    def stats(self) -> Stats:
        """As a record has them."""
        return _stats(self)

    def without_dense(self) -> Record | RecordInArray:
        """As a record has it; a small array is kept whole, since to cut it takes half as long as a short run."""
        if self.run_array.size > MOST_KEPT:
            return self.apart().without_dense()
        return RecordInArray(self.run_array, self.status, self.method, False)

    def apart(self) -> Record:
        """The record as a value of its own."""
        return Record(*self.steps, self.status, self.method, self.counters)

    def __reduce__(self) -> tuple:
        return Record, tuple(self.apart())


RunRecord = Record | RecordInArray


def _stats(record: RunRecord) -> Stats:
    *counts, stiff = record.counters
    return Stats(record.method, *counts, stiff=stiff == 1)
