"""Where the steps of a run must end: on a grid, and where functions of a clock switch or peak.

A step sees a field at a few points. A pulse between them, as of a dose or a kick, leaves no trace in its error
estimate, however high it is. Of a pulse that is a function of a clock it is known when it comes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsp.integration.members import Members
from gsp.lowering.compiled_clock import Wave, places_within
from gsp.lowering.compiled_flow import CompiledFlow

# A clock's sum over a run's steps is off by so many roundings; a step ends so far before a jump and so far after it.
ROUNDING = 16 * float(np.finfo(float).eps)


def stops_of(
    grid: np.ndarray | None, first: float, last: float, others: Sequence[tuple[float, float]] = ()
) -> np.ndarray:
    """Times (s,) at which steps end: those of the grid ahead of the start, the others within the span, and the end.

    Each of the others is a pair of times, just before a jump and just after, or the same one twice. What lies between,
    or on the second, stands twice, as `gsp.kernels.integrator` asks for.
    """
    ahead = np.empty(0) if grid is None else grid[1:] if grid[0] == first else grid
    ahead = ahead.copy() if ahead.size and ahead[-1] == last else np.append(ahead, last)
    sign = 1.0 if last > first else -1.0
    begin, end = sign * first, sign * last
    pairs = sorted((a, b) if sign > 0.0 else (-b, -a) for a, b in others)
    pairs = [(a, min(b, end)) for a, b in pairs if b > begin and a < end]
    if not pairs:
        return ahead
    stops: list[float] = []
    begun, behind = 0, begin
    for stop in sorted({*(a for a, _ in pairs if a > begin), *(b for _, b in pairs), *(sign * ahead).tolist()}):
        while begun < len(pairs) and pairs[begun][0] < stop:
            behind = max(behind, pairs[begun][1])
            begun += 1
        stops += [sign * stop] * (2 if stop <= behind else 1)
    return np.array(stops)


def stops_of_members(
    compiled: CompiledFlow, members: Members, grid: np.ndarray | None, first: float, last: float, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """The stops of all members in one array, and where those of each begin and end in it (m, 2)."""
    if not compiled.clocks:
        stops = stops_of(grid, first, last)
        return stops, np.tile([0, stops.size], (len(members), 1))
    known: dict[tuple[tuple[float, float], ...], tuple[int, int]] = {}
    parts, spans, end = [], np.empty((len(members), 2), np.int64), 0
    for i, (p, y) in enumerate(zip(members.constants, members.starts)):
        others = tuple(clock_stops(compiled, tuple(p.tolist()), y, first, last, most))
        if others not in known:
            parts.append(stops_of(grid, first, last, others))
            known[others] = end, end + parts[-1].size
            end += parts[-1].size
        spans[i] = known[others]
    return np.concatenate(parts), spans


def clock_stops(
    compiled: CompiledFlow, p: tuple[float, ...], y: Sequence[float], first: float, last: float, most: int
) -> list[tuple[float, float]]:
    """Pairs of times just before and just after functions of clocks switch, or both where they peak, in any order.

    There are none of waves that together may have more than `most`, a step for each of which is too many.
    """
    found: list[tuple[float, float]] = []
    for clock in compiled.clocks:
        now, (rate, switches, peaks) = float(y[clock.state]), clock.places(p)
        if not 0.0 < abs(rate) < float("inf"):
            continue
        low, high = sorted((now, now + rate * (last - first)))
        share = most / (1 + sum(isinstance(place, Wave) for place in (*peaks, *switches, *switches)))
        times = (first + (place - now) / rate for place in places_within(peaks, low, high, share))
        found += [(time, time) for time in times]
        for place in places_within(switches, low, high, share):
            time = first + (place - now) / rate
            apart = ROUNDING * max(abs(first), abs(last), abs(place / rate), abs(now / rate))
            found.append((time - apart, time + apart))
    return found
