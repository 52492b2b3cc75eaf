"""Crossings: where along the steps of a run watched functions pass through zero.

Every step is looked at in several parts of its dense output (`pieces`), and in twice as many until cubics through the
points tell what lies between them, or that it keeps clear of zero. A change of sign between neighbouring points is a
crossing, or three where the extremes of the cubic between them have other signs, and so are the two of a dip: where
|g| has a minimum among the points, it is searched for a point of the other sign in between. The crossing is located
on the dense output to rounding, and then by running the method again from the step's start to the crossing, so that
time and state are as good as the steps are. Functions that are on their zeros together to rounding, on the dense
output, are so in one instant, which is located once for all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gsp.integration.pieces import RunPiece
from gsp.integration.run_array import Record, RunRecord
from gsp.integration.watched import Settled, Stepper, Watched
from gsp.kernels import integrator
from gsp.kernels.scan import DIP
from gsp.roots import least, root

TINY = 1e-300
# A function is on its zero within so many units of rounding: of its terms, and of the time and the step.
ROUNDING = 16 * 2.0**-52
# A minimum that is this share of the values on both sides of it is zero: `least` comes to 4e-9 of the interval at a
# kink, and to the square of that at a zero of even order.
TOUCHED = 1e-6


class Instant(NamedTuple):
    """A time of the dense output in a step of this length, and what is met there: columns, each with its sense."""

    t: float
    step: float
    met: dict[int, int]


class Seen(NamedTuple):
    """What a search has looked at: `rows` up to `time` and `state`, the `signs` there, and what it knew then.

    `counts` are of the crossings found, `pieces` of the steps kept; `end` is the crossing that ends the run.
    """

    rows: int
    time: np.ndarray
    state: np.ndarray
    signs: np.ndarray
    counts: tuple[int, ...]
    pieces: int
    end: Settled | None = None


class Search:
    """Looks for crossings in the steps of a run as they are made: the `watch` of a `Run`.

    `values(t, states)` gives the watched functions (m, w) at times (m,) and states (m, n), `signs` (w,) the signs at
    the start, 0 where the first sign that comes is to count. Where a function is not a number no sign is known.
    `quiet(time, state, times, states, dense)` may say of steps at once that nothing happens in them, and
    `stuck(time, times, states)` that the run ends with them, since it gets nowhere. An event that is on its
    zero to rounding at the end of the `span` is met, as no run that begins there will meet it; nan is no such end.
    """

    def __init__(
        self,
        values: Callable[[np.ndarray, np.ndarray], np.ndarray],
        watched: Sequence[Watched],
        signs: np.ndarray,
        stepper: Stepper,
        span: tuple[float, float],
        y: np.ndarray,
        quiet: Callable[..., bool] | None = None,
        stuck: Callable[[float, np.ndarray, np.ndarray], Settled | None] | None = None,
    ) -> None:
        self.values = values
        self.quiet = quiet
        self.stuck = stuck
        first, self.last = span
        self.watched = tuple(watched)
        self.stepper = stepper
        self.found: list[list[Settled]] = [[] for _ in watched]
        self.spent: list[Sequence[int]] = []
        # Columns, each with a time at which it comes to zero and keeps its sign.
        self.touched: set[tuple[int, float]] = set()
        self.can_end = any(one.limit for one in self.watched)
        start = np.array([first]), y[np.newaxis].copy()
        self._pieces = [start]
        self._signs = signs.copy()
        self._seen = Seen(0, *start, self._signs, (0,) * len(self.watched), 1)

    @property
    def rows(self) -> int:
        """How many rows of the record count: those looked at, or those before the end that was found."""
        return self._seen.rows

    @property
    def end(self) -> Settled | None:
        """The crossing that ends the run, if one was met."""
        return self._seen.end

    def __call__(self, times: np.ndarray, states: np.ndarray, dense: np.ndarray) -> bool:
        """Look at these steps; they count as looked at once all of it is done, wherever Ctrl-C comes."""
        seen = self._seen
        if seen.end is not None or len(times) == 0:
            return seen.end is not None
        # What a look that did not come to its end has left is found again.
        for found, count in zip(self.found, seen.counts):
            del found[count:]
        del self._pieces[seen.pieces :]
        self._signs = seen.signs.copy()
        end = None if self.stuck is None else self.stuck(seen.time[0], times, states)
        if end is not None:
            self._pass(times, states)
            self._seen = self._seen._replace(end=end)
            return True
        if self.quiet is not None and self.quiet(seen.time[0], seen.state[0], times, states, dense):
            self._pass(times, states)
            return False
        piece = RunPiece(
            np.concatenate([seen.time, times]), np.concatenate([seen.state, states]), dense[: len(times)]
        )
        t, g = piece.sample(self.values)
        crossings = []
        for column in range(len(self.watched)):
            for a, b, sense in self._brackets(column, t, g[:, column], piece):
                crossings.append((self._crossed(column, a, b, sense, piece), sense, column))
        crossings.sort(reverse=bool(piece.times[-1] < piece.times[0]))
        for instant in self._instants(crossings, piece):
            end = self._enter(instant, piece)
            if end is not None:
                rows = seen.rows + piece.step(instant.t) if end.row is None else end.row
                self._seen = seen._replace(rows=rows, end=end)
                return True
        self._pass(times, states)
        return False

    def _instants(self, crossings: Sequence[tuple[float, int, int]], piece: RunPiece) -> list[Instant]:
        """The crossings (time, sense, column), in the order of the run, by their instants."""
        instants: list[Instant] = []
        for t, sense, column in crossings:
            if instants and column not in instants[-1].met and self._is_met(column, t, instants[-1], piece):
                instants[-1].met[column] = sense
            else:
                k = piece.step(t)
                instants.append(Instant(t, abs(piece.times[k + 1] - piece.times[k]), {column: sense}))
        end, columns = float(piece.times[-1]), set(range(len(self.watched)))
        if not (instants and _same(instants[-1], end)):
            if end != self.last:
                return instants
            instants.append(Instant(end, abs(end - piece.times[-2]), {}))
            columns = {c for c in columns if self.watched[c].settle is settle_event}
        # Rounding may have left the crossing of one function to these steps, of another to those that follow.
        forward = float(np.sign(end - piece.times[0]))
        for column in columns - set(instants[-1].met):
            sense = int(np.sign(self._slope(column, end, piece)[0]) * forward)
            if sense == -self._signs[column] != 0 and self._is_met(column, end, instants[-1], piece):
                instants[-1].met[column] = sense
                self._signs[column] = sense
        return instants

    def _is_met(self, column: int, t: float, instant: Instant, piece: RunPiece) -> bool:
        """Whether a function that passes through zero at `t` is on its zero at the instant already."""
        if abs(t - instant.t) > instant.step:
            return False
        y = piece.at(np.array([instant.t]))[0]
        slope, (_, value, _), _ = self._slope(column, instant.t, piece)
        time = abs(instant.t) + instant.step
        # Written so that what is not a number is not met.
        return abs(value) <= ROUNDING * (self.watched[column].size(instant.t, y) + abs(slope) * time)

    def _enter(self, instant: Instant, piece: RunPiece) -> Settled | None:
        """Enter what is met at an instant, located once for all events; the crossing that ends the run, if one does.

        Where a reduced flow ends is told first: there it ends, whatever else is met.
        """
        located = end = None
        columns = [c for c, sense in instant.met.items() if self.watched[c].direction in (0, sense)]
        for column in sorted(columns, key=lambda c: (self.watched[c].settle is settle_event, c)):
            one = self.watched[column]
            if located is None or one.settle is not settle_event:
                settled = one.settle(self, column, instant.t, piece)
            elif self._slope(column, instant.t, piece)[2]:
                continue
            else:
                settled = replace(located, note=_note(one))
            if settled is None:
                continue
            located = located or settled
            self.found[column].append(settled)
            if end is None and one.limit and len(self.found[column]) >= one.limit:
                end = settled
        return end

    def _pass(self, times: np.ndarray, states: np.ndarray) -> None:
        if self.can_end:
            self._pieces.append((times, states))
        # In one assignment, which Ctrl-C cannot divide.
        self._seen = Seen(
            self._seen.rows + len(times), times[-1:], states[-1:], self._signs,
            tuple(map(len, self.found)), len(self._pieces),
        )  # fmt: skip

    def history(self, k: int, piece: RunPiece) -> tuple[np.ndarray, np.ndarray]:
        """Times and states of all steps up to the start of step `k` of `piece`, the one that is looked at."""
        times, states = zip(*self._pieces)
        return (
            np.concatenate([*times, piece.times[1 : k + 1]]),
            np.concatenate([*states, piece.states[1 : k + 1]]),
        )

    def truncated(self, record: RunRecord) -> RunRecord:
        """`record` up to the end that was found, with the cost of locating everything added."""
        end = self.end
        if end is None and not self.spent:
            return record
        times, states, dense, status = record.times, record.states, record.dense, record.status
        if end is not None:
            rows = self.rows
            times, states, dense, status = times[: rows + 1], states[: rows + 1], dense[:rows], end.status
            if end.tail is not None and len(end.tail.dense):
                times = np.concatenate([times, end.tail.times[1:]])
                states = np.concatenate([states, end.tail.states[1:]])
                dense = np.concatenate([dense, end.tail.dense])
        counters = [sum(column) for column in zip(record.counters, *self.spent)]
        counters[integrator.STEPS], counters[integrator.STIFF] = (
            len(times) - 1,
            record.counters[integrator.STIFF],
        )
        return Record(times, states, dense, status, record.method, counters)

    def run(self, first: float, y: np.ndarray, last: float) -> Record:
        """`Stepper.between`, counted."""
        record = self.stepper.between(first, y, last)
        self.spent.append(record.counters)
        return record

    def refined(self, column: int, t: float, piece: RunPiece) -> Settled:
        """The crossing near `t` by secant steps, each with the method's own run from the start of the step.

        Near a tangency, where they do not converge, the best of them stands. At a pole it is the reciprocal that
        passes through zero.
        """
        k = piece.step(t)
        start, y, end = float(piece.times[k]), piece.states[k], float(piece.times[k + 1])
        low, high = min(start, end), max(start, end)
        slope, _, is_pole = self._slope(column, t, piece)
        best: tuple[float, Settled] | None = None
        last = (0.0, 0.0)
        # Secant steps with the method's own result: two or three are taken.
        for _ in range(8):
            settled = Settled(start, y, None, is_pole=is_pole)
            if t != start:
                record = self.run(start, y, t)
                settled = Settled(float(record.times[-1]), record.states[-1], record, is_pole=is_pole)
                if not record.status.ok:
                    # The border of the field's domain, or a step too short to be divided: as far as it gets.
                    return settled if best is None else best[1]
            value = self._evaluate(column, settled.t, settled.y)
            if is_pole:
                value = _reciprocal(value)
            if best is not None:
                if not abs(value) < best[0]:
                    break
                slope = (value - last[1]) / (t - last[0])
            best = (abs(value), settled)
            last = (t, value)
            moved = t - value / slope if slope != 0.0 else t
            t = min(max(moved, low), high)
            if value == 0.0 or not np.isfinite(slope) or t == last[0]:
                break
        assert best is not None
        return best[1]

    def _slope(self, column: int, t: float, piece: RunPiece) -> tuple[float, list[float], bool]:
        """On the dense output about `t`: the slope, or that of the reciprocal at a pole, three values, and which."""
        k = piece.step(t)
        low, high = sorted((float(piece.times[k]), float(piece.times[k + 1])))
        # Width of the difference quotient on the dense output that starts them, as a share of the step.
        width = 1e-3 * (high - low)
        a, b = max(low, t - width), min(high, t + width)
        values = left, middle, right = [self._value(column, at, piece) for at in (a, t, b)]
        # Beside an end of the step the other side alone tells.
        is_pole = (a == low or abs(middle) > abs(left)) and (b == high or abs(middle) > abs(right))
        if is_pole:
            left, right = _reciprocal(left), _reciprocal(right)
        return (right - left) / (b - a) if b > a else 0.0, values, is_pole

    def _evaluate(self, column: int, t: float, y: np.ndarray) -> float:
        return float(self.values(np.array([t]), y[np.newaxis])[0, column])

    def _value(self, column: int, t: float, piece: RunPiece) -> float:
        return self._evaluate(column, t, piece.at(np.array([t]))[0])

    def _brackets(self, column: int, t: np.ndarray, g: np.ndarray, piece: RunPiece):
        """Intervals (a, b, sense) over which `g` changes its sign; keeps the sign it ends with."""
        before = self._signs[column]
        with np.errstate(invalid="ignore", over="ignore"):
            bend = np.abs(g[2:] - 2.0 * g[1:-1] + g[:-2])
        if np.isfinite(g).all():
            low, high = g.min(), g.max()
            # Far from zero on one side, as most functions are most of the time.
            if min(abs(low), abs(high)) > DIP * bend.max() and (
                (low > 0.0 and before >= 0.0) or (high < 0.0 and before <= 0.0)
            ):
                self._signs[column] = 1.0 if low > 0.0 else -1.0
                return []
        sign = np.where(np.isnan(g), np.nan, np.sign(g))
        if before != 0.0:
            sign[0] = before
        else:
            sign[0] = 0.0 if not np.isnan(sign[0]) else np.nan
        result = []
        known = np.flatnonzero(sign != 0.0)
        begins, ends = known[:-1], known[1:]
        dips = self._may_dip(begins, ends, np.abs(g), bend) & (sign[begins] == sign[ends])
        for k in np.flatnonzero(dips | (sign[begins] * sign[ends] < 0.0)):
            of = self._dip if dips[k] else self._between
            result += of(column, int(begins[k]), int(ends[k]), sign, t, g, piece)
        self._signs[column] = 0.0 if len(known) == 0 or np.isnan(sign[known[-1]]) else sign[known[-1]]
        return result

    def _between(self, column, i, j, sign, t, g, piece):
        """The crossing between points i and j of different signs, or all of them where the cubic through four points
        has its extremes on the other sides."""
        points, signs = [float(t[i])], [int(sign[i])]
        near = slice(max(i - 1, 0), j + 2)
        if j == i + 1 and np.isfinite(g[near]).all() and len(g[near]) == 4:
            s = (t[near] - t[i]) / (t[j] - t[i])
            # Beside a far shorter step the powers are dependent to rounding, and what is found is of no use.
            cubic = np.linalg.lstsq(np.vander(s, 4), g[near] / np.abs(g[near]).max())[0]
            extremes = np.roots(np.polyder(cubic))
            for share in sorted(
                extremes[(extremes.imag == 0.0) & (extremes.real > 0.0) & (extremes.real < 1.0)].real
            ):
                at = float(t[i] + share * (t[j] - t[i]))
                if self._value(column, at, piece) * signs[-1] < 0.0:
                    points.append(at)
                    signs.append(-signs[-1])
        if signs[-1] == sign[i]:
            points.append(float(t[j]))
            signs.append(int(sign[j]))
        return list(zip(points, points[1:], signs[1:]))

    def _crossed(self, column: int, a: float, b: float, sense: int, piece: RunPiece) -> float:
        """The change of sign between `a`, where the sign is -sense, and `b`, to rounding."""
        if a == b:
            return a

        def value(t: float) -> float:
            found = sense * self._value(column, t, piece)
            # What is not a number lies beyond the crossing.
            return np.inf if np.isnan(found) else found

        # A value that rounding has left without its sign has it still.
        ends = min(value(a), -TINY), max(value(b), TINY)
        found = root(value, a, b, ends=ends)
        assert found is not None
        return found

    @staticmethod
    def _may_dip(i: np.ndarray, j: np.ndarray, size: np.ndarray, bend: np.ndarray) -> np.ndarray:
        """Whether between the points i and j (k,) a function of this size (m,) may dip through zero."""
        # The second differences at the points from i - 1 to i + 2.
        bound = DIP * np.lib.stride_tricks.sliding_window_view(np.pad(bend, 2), 4).max(axis=1)[i]
        # A minimum between i and j shows as a descent before and an ascent after, or at the ends of what is known.
        falls = ~(size[i] > size[np.maximum(i - 1, 0)])
        rises = ~(size[j] > size[np.minimum(j + 1, len(size) - 1)])
        return (j > i + 1) | (~(np.minimum(size[i], size[j]) > bound) & falls & rises)

    def _dip(self, column, i, j, sign, t, g, piece):
        """The two crossings between points i and j of the same sign, where |g| dips through zero between them, or the
        one instant at which it comes to zero."""
        a, b = float(t[i]), float(t[j])
        # Beside a start on the zero rounding alone is below it: a function that only touches zero does not dip.
        below = -ROUNDING * self.watched[column].size(a, piece.at(np.array([a]))[0])
        lowest, value = least(lambda s: sign[i] * self._value(column, s, piece), a, b, below=below)
        if not value < below:
            # One of the two points may be on the zero itself.
            low, high = sorted((abs(g[i]), abs(g[j])))
            if not (self.watched[column].touches and value <= max(TOUCHED * low, TOUCHED**2 * high)):
                return []
            self.touched.add((column, lowest))
            return [(lowest, lowest, -int(sign[i]))]
        return [(a, lowest, -int(sign[i])), (lowest, b, int(sign[i]))]


def _reciprocal(value: float) -> float:
    return 1.0 / value if value != 0.0 else np.inf


def _same(instant: Instant, t: float) -> bool:
    return abs(t - instant.t) <= ROUNDING * (abs(t) + instant.step)


def _note(watched: Watched) -> str:
    return f"event {watched.name}"


def settle_event(search: Search, column: int, t: float, piece: RunPiece) -> Settled | None:
    """A user's event: the refined crossing; a change of sign through a pole is no zero."""
    settled = search.refined(column, t, piece)
    if settled.is_pole:
        return None
    return replace(settled, note=_note(search.watched[column]))
