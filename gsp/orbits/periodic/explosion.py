"""Explosions along a family: stretches on which cycles grow while the parameter all but stands still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# A stretch explodes while the parameter moves, as a share of its range, by less than this share of what the amplitude
# does, as a share of its largest; and counts when it grows by GROWN of that over at least ROWS rows, which a plain
# fold of cycles does not.
STEEP = 1e-2
GROWN = 0.2
ROWS = 4


@dataclass(frozen=True)
class Explosion:
    """Rows `first` to `last` of a family, both included, and the steepest one, `row`, with the parameter's `value`.

    Over all of them the parameter varies by `width`.
    """

    value: float
    width: float
    row: int
    first: int
    last: int

    @property
    def rows(self) -> slice:
        """The rows as a slice of the family's arrays."""
        return slice(self.first, self.last + 1)


def explosions(values: np.ndarray, amplitudes: np.ndarray) -> tuple[Explosion, ...]:
    """The explosions along parameter values (m,) and amplitudes (n, m) of the states."""
    if len(values) < ROWS:
        return ()
    moved = np.abs(np.diff(values)) / (np.ptp(values) or 1.0)
    largest = amplitudes.max(axis=1, keepdims=True)
    relative = amplitudes / np.where(largest > 0.0, largest, 1.0)
    grown = np.abs(np.diff(relative, axis=1)).max(axis=0)
    slopes = np.where(grown > 0.0, moved / np.where(grown > 0.0, grown, 1.0), np.inf)
    steep = np.concatenate([[False], slopes < STEEP, [False]])
    edges = np.flatnonzero(steep[1:] != steep[:-1])
    found = []
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist()):
        if last - first + 1 < ROWS or np.ptp(relative[:, first : last + 1], axis=1).max() < GROWN:
            continue
        own = slopes[first:last]
        # Where rounding decides which step is the steepest, the one in the middle.
        # The parameter per amplitude counts as standing still below this share of the range: rounding.
        flat = np.flatnonzero(own <= max(float(own.min()), 1e-13))
        row = first + int(flat[len(flat) // 2])
        found.append(
            Explosion(float(values[row]), float(np.ptp(values[first : last + 1])), row, int(first), int(last))
        )
    return tuple(found)
