"""A clock's rate and the places where functions of it switch or peak, for values of the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np

from gsp.algebra.clocks import Clock
from gsp.lowering.compiled_function import CompiledFunction

# Of a pair of roots that rounding has parted, each is off by its root, relative to itself.
PARTED = float(np.sqrt(np.finfo(float).eps))


class Places(NamedTuple):
    """The clock's `rate`, and its values where a rate has a kink or a jump, and where a smooth function peaks."""

    rate: float
    switches: tuple[float, ...]
    peaks: tuple[float, ...]


class CompiledClock:
    """A clock with a `function` for its rate and all its coefficients in order; the flow has `size` states."""

    def __init__(self, clock: Clock, function: CompiledFunction, size: int) -> None:
        self.state = clock.state
        self._clock, self._function, self._size = clock, function, size
        self._last: tuple[tuple[float, ...], Places] | None = None

    def places(self, p: tuple[float, ...]) -> Places:
        """The places for p = (epsilon, *parameters); those of the last p are kept."""
        last = self._last
        if last is None or last[0] != p:
            # Neither the rate nor a coefficient depends on the states.
            rate, *numbers = self._function(np.zeros(self._size), p).tolist()
            rest = iter(numbers)
            switches, peaks = (
                tuple(root for polynomial in of for root in _real_roots(list(islice(rest, len(polynomial)))))
                for of in (self._clock.switches, self._clock.peaks)
            )
            last = self._last = p, Places(rate, switches, peaks)
        return last[1]


def _real_roots(coefficients: Sequence[float]) -> list[float]:
    """The real roots of a polynomial, the highest coefficient first; both of a pair that rounding has parted."""
    if not np.isfinite(coefficients).all():
        return []
    roots = np.roots(coefficients)
    return roots.real[np.abs(roots.imag) <= PARTED * np.abs(roots)].tolist()
