"""The places where functions of a clock switch or peak, for values of the parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, islice
from typing import NamedTuple

import numpy as np

from gsp.algebra.clocks import Clock
from gsp.lowering.compiled_function import CompiledFunction

# Of a pair of roots that rounding has parted, each is off by its root, relative to itself.
PARTED = float(np.sqrt(np.finfo(float).eps))


class Wave(NamedTuple):
    """The places `first` + k `period` for every whole k."""

    first: float
    period: float


Places = tuple[float | Wave, ...]


class CompiledClock:
    """A clock with a `function` for its rate and all numbers of its zeros in order; the flow has `size` states."""

    def __init__(self, clock: Clock, function: CompiledFunction, size: int) -> None:
        self.state = clock.state
        self._clock, self._function, self._size = clock, function, size
        self._last: tuple[tuple[float, ...], tuple[float, Places, Places]] | None = None

    def places(self, p: tuple[float, ...]) -> tuple[float, Places, Places]:
        """The clock's rate, and where rates switch and functions peak, for p = (epsilon, *parameters)."""
        last = self._last
        # Where there is no epsilon it is NaN, which equals nothing.
        key = p if p[0] == p[0] else p[1:]
        if last is None or last[0] != key:
            # Neither the rate nor a number depends on the states.
            rate, *numbers = self._function(np.zeros(self._size), p).tolist()
            rest = iter(numbers)
            switches, peaks = (
                tuple(chain.from_iterable(_roots(list(islice(rest, len(z.numbers))), z.is_wave) for z in of))
                for of in (self._clock.switches, self._clock.peaks)
            )
            last = self._last = key, (rate, switches, peaks)
        return last[1]


def places_within(places: Iterable[float | Wave], low: float, high: float, most: float) -> Iterator[float]:
    """The places from `low` to `high`; of a wave none where these are more than `most`."""
    for place in places:
        if not isinstance(place, Wave):
            yield place
        elif 0.0 < high - low <= most * place.period:
            begin, end = ((bound - place.first) / place.period for bound in (low, high))
            yield from (place.first + k * place.period for k in range(math.ceil(begin), math.floor(end) + 1))


def _roots(numbers: Sequence[float], is_wave: bool) -> list[float] | list[Wave]:
    """The real roots, of a pair that rounding has parted both."""
    if not np.isfinite(numbers).all():
        return []
    if not is_wave:
        # Beside a leading coefficient that is next to nothing all else is infinite, as is one of the roots.
        while numbers and not (numbers[0] and np.isfinite([n / numbers[0] for n in numbers]).all()):
            numbers = numbers[1:]
        if len(numbers) == 2:
            return [-numbers[1] / numbers[0]]
        roots = np.roots(numbers)
        return roots.real[np.abs(roots.imag) <= PARTED * np.abs(roots)].tolist()
    slope, phase, sine, cosine, constant = numbers
    size = math.hypot(sine, cosine)
    if slope == 0.0 or not abs(constant) <= size or size == 0.0:
        return []
    # sine sin + cosine cos = size cos(angle - middle).
    middle, beside = math.atan2(sine, cosine), math.acos(-constant / size)
    angles = dict.fromkeys((middle - beside, middle + beside))
    waves = [Wave((angle - phase) / slope, abs(2.0 * math.pi / slope)) for angle in angles]
    return [wave for wave in waves if np.isfinite(wave).all()]
