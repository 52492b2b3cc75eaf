"""One member of an ensemble: where it started, and how its run ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gsp.errors import Status
from gsp.integration.explanations import Explanation
from gsp.integration.loop import (
    Stats,
    remedy_of,
)

# States that a one-line summary shows.
SHOWN_STATES = 4


@dataclass(frozen=True, eq=False, repr=False)
class Member:
    """One run of an ensemble in plain numbers: what it was given, how far it came, what it cost.

    `y` (n, k) over the ensemble's `t` (k,) is NaN where the run did not come; `last` by name is the state at
    `reached`, the end of its last step.
    """

    index: int
    start: Mapping[str, float]
    epsilon: float | None
    parameters: Mapping[str, float]
    status: Status
    reached: float
    last: Mapping[str, float]
    t: np.ndarray
    y: np.ndarray
    stats: Stats
    _explanation: Explanation | None = None

    @property
    def message(self) -> str:
        """One line: how it ended, where, and what to do about it."""
        if self.status.ok:
            return f"member {self.index} reached the end: {self.place}"
        return f"member {self.index} stopped: {self.status.name} at {self._words}"

    @property
    def _words(self) -> str:
        """Where it stopped, why, and the remedy, as far as they are known."""
        note, remedy = self._explanation or ("", remedy_of(self.status, self.stats))
        return "; ".join(filter(None, (self.place, note, remedy)))

    @property
    def place(self) -> str:
        """Time and state at the end of the last step, in words."""
        shown = [f"{name} = {value:.6g}" for name, value in self.last.items()]
        more = ["..."] if len(shown) > SHOWN_STATES else []
        return ", ".join([f"t = {self.reached:.6g}", *shown[:SHOWN_STATES], *more])

    def __repr__(self) -> str:
        return f"Member({self.index}, t={self.reached:.6g}, {self.status.name})"

    def __str__(self) -> str:
        values = {
            **({} if self.epsilon is None else {"epsilon": self.epsilon}),
            **self.parameters,
        }
        width = max(map(len, [*self.start, *values]))
        lines = [f"member {self.index}, {self.stats.method.value}"]
        lines += [
            f"  {name:>{width}}  {first:>13.6g} -> {self.last[name]:<13.6g}".rstrip()
            for name, first in self.start.items()
        ]
        lines += [f"  {name:>{width}}  {value:>13.6g}" for name, value in values.items()]
        return "\n".join([*lines, f"  {self.message}"])
