"""Which places in slow and fast coordinates have a state of a region that is given in raw states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import CompiledFunction, compile_function
from gsp.splitting.splitting import Splitting
from gsp.systems.region import Interval
from gsp.systems.scattered_points import PLACES, halton

# A state on the border counts, to rounding, relative to the width of the region.
BESIDE = 1e-9


@dataclass(frozen=True, eq=False)
class RawStates:
    """The states of `region`, intervals of raw states, seen in the coordinates of `splitting`."""

    splitting: Splitting
    region: Mapping[str, Interval]

    def have(self, points: np.ndarray) -> np.ndarray:
        """Over which slow coordinates of `points` (m, n) there is a state of the region: (m,) bool.

        Fast coordinates are tried within their own bounds; those of the points are tried too, where they are numbers.
        """
        system = self.splitting.system
        assert system is not None
        nx, fast = len(system.x), [self.region.get(y.name, (np.nan, np.nan)) for y in system.y]
        low, high = np.array(fast).T
        tried = low + halton(len(fast), PLACES) * (high - low)
        found = self._are_states(points)
        left = np.flatnonzero(~found)
        every = np.hstack([np.repeat(points[left, :nx], PLACES, axis=0), np.tile(tried, (len(left), 1))])
        found[left] = self._are_states(every).reshape(len(left), PLACES).any(axis=1)
        return found

    def values(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """The raw states by name, (m,) each, at `points` (m, n)."""
        raw = self._raw(points, compile_flow(self.splitting.field).constants)
        return {state.name: raw[:, k] for k, state in enumerate(self.splitting.inverse)}

    def _are_states(self, points: np.ndarray) -> np.ndarray:
        good = np.ones(len(points), dtype=bool)
        for name, value in self.values(points).items():
            if name in self.region:
                low, high = self.region[name]
                slack = BESIDE * (high - low)
                good &= (value >= low - slack) & (value <= high + slack)
        return good

    @cached_property
    def _raw(self) -> CompiledFunction:
        system = self.splitting.system
        assert system is not None
        return compile_function(
            tuple(self.splitting.inverse.values()),
            arguments=system.states,
            parameters=tuple(self.splitting.field.parameters),
        )
