"""`Watched`: a function that is watched along a run; `Stepper` goes over a step again, `Settled` is what is met."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsp.errors import Status
from gsp.integration.loop import Control, Looks, Run, Watch, run
from gsp.integration.methods import Method
from gsp.integration.pieces import RunPiece
from gsp.integration.run_array import Record
from gsp.lowering.compiled_flow import CompiledFlow

# Steps between two looks when a run may end: what lies beyond its end is wasted.
LOOK = 64


@dataclass(frozen=True)
class Stepper:
    """The method of a run, to go again over a part of a step."""

    compiled: CompiledFlow
    p: np.ndarray
    method: Method
    rtol: float
    atol: float

    def between(self, first: float, y: np.ndarray, last: float) -> Record:
        """The run from `y` at `first` to `last`, in one step when its error allows."""
        return self.through(y, first, np.array([last]), max_steps=1000, first_step=last - first)

    def through(
        self, y: np.ndarray, first: float, stops: np.ndarray, *,
        max_steps: int, watch: Watch | None = None, first_step: float = 0.0,
    ) -> Record:  # fmt: skip
        """The run from `y` at `first` through the `stops`, with short records; the last three are the run's own."""
        control = Control(self.method, self.rtol, self.atol, max_steps)
        looks = Looks(watch=watch, rows_kept=LOOK)
        return run(Run(self.compiled, self.p, y, first, stops, control, True, first_step, looks)).apart()


@dataclass(frozen=True)
class Settled:
    """A crossing as it is reported; `tail` is what replaces the run from `row` on, the start of the crossed step.

    `is_pole` where the function changes its sign through infinity.
    """

    t: float
    y: np.ndarray
    tail: Record | None
    status: Status = Status.EVENT_REACHED
    note: str = ""
    remedy: str = ""
    row: int | None = None
    is_pole: bool = False


Settle = Callable[[Any, int, float, RunPiece], Settled | None]


@dataclass(frozen=True)
class Watched:
    """One watched function: which sign changes count, and the crossing of which number ends the run (0: none).

    `settle` makes a crossing of the dense output, given as the search, the column, its time and its piece, into
    what is reported; None says that it was none. `size(t, y)` is that of the function's terms, where it is known.
    With `touches` a function that comes to zero and keeps its sign counts as one that passes through it.
    """

    name: str
    direction: int
    limit: int
    settle: Settle
    size: Callable[[float, np.ndarray], float] = lambda t, y: 0.0
    touches: bool = False
