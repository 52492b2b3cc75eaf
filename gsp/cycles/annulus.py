"""What lies between two lines of edges in the plane of a slow and a fast variable: an annulus, or a strip."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

Cut = tuple[int, int]


class Band:
    """What lies to the left of the edges of `outer` and to the right of those of `inner`, vertices (k, 2).

    `cuts` are segments across it from a vertex of `outer` to one of `inner` (by their places), in the order of
    `outer`. From each cut to the next is a sector, in which in turn the slow and the fast rate keep their sign.
    """

    outer: np.ndarray
    inner: np.ndarray
    cuts: tuple[Cut, ...]

    @property
    def sides(self) -> list[tuple[Cut, Cut]]:
        """The two cuts of each sector."""
        raise NotImplementedError

    def is_slow(self, k: int) -> bool:
        """Whether it is the slow rate that keeps its sign in a sector."""
        return k % 2 == 0

    @property
    def sectors(self) -> list[np.ndarray]:
        """The polygons (k, 2) between each cut and the next, counterclockwise."""
        found = []
        for (o, i), (p, j) in self.sides:
            found.append(np.vstack([_chain(self.outer, o, p), _chain(self.inner, i, j)[::-1]]))
        return found

    def ends(self, k: int) -> list[list[float]]:
        """Intervals of the slow variable on the two cuts of a sector."""
        return [sorted((float(self.outer[o, 0]), float(self.inner[i, 0]))) for o, i in self.sides[k]]

    def grid(self, k: int, fineness: int) -> list[float]:
        """Ends of strips that cover a sector, along the slow variable in slow ones and the fast one in others: 2
        `fineness` of them, the ends of the cuts, and ever narrower strips next to these.
        """
        slow = self.is_slow(k)
        along = self.sectors[k][:, 0 if slow else 1]
        found = set(np.linspace(along.min(), along.max(), 2 * fineness + 1).tolist())
        if slow:
            (first, low), (high, last) = sorted(self.ends(k))
            found |= {first, low, high, last}
            least = max(low - first, last - high)
        else:
            # Where jumps begin and end the fast rate is small.
            low, high = min(found), max(found)
            least = (high - low) / (16 * fineness)
        step = 0.5 * (high - low)
        while step > least > 0.0:
            found |= {low + step, high - step}
            step *= 0.5
        return sorted(found)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self.outer)} and {len(self.inner)} vertices)"


@dataclass(frozen=True, eq=False, repr=False)
class Annulus(Band):
    """Between the polygon `inner` and the polygon `outer` about it, both counterclockwise.

    The cuts lie along the slow variable. The slow rate keeps its sign between the first and the second.
    """

    outer: np.ndarray
    inner: np.ndarray
    cuts: tuple[Cut, ...]

    @property
    def sides(self) -> list[tuple[Cut, Cut]]:
        """The last sector ends at the first cut."""
        return list(zip(self.cuts, (*self.cuts[1:], self.cuts[0])))


@dataclass(frozen=True, eq=False, repr=False)
class Strip(Band):
    """Between the entry section, the first cut, and the exit section, the last: from the first vertices of both lines
    to their last ones.

    The entry section, `outer` and the exit section go counterclockwise around it. `slow_first` says which rate keeps
    its sign in the first sector. With `cornered` the fast rate vanishes with its slopes at (0, 0), a vertex.
    """

    outer: np.ndarray
    inner: np.ndarray
    cuts: tuple[Cut, ...]
    slow_first: bool = True
    cornered: bool = False

    @property
    def sides(self) -> list[tuple[Cut, Cut]]:
        """Each sector leads from one cut to the next."""
        return list(pairwise(self.cuts))

    def is_slow(self, k: int) -> bool:
        """Whether it is the slow rate that keeps its sign in a sector."""
        return (k % 2 == 0) == self.slow_first


def _chain(polygon: np.ndarray, first: int, last: int) -> np.ndarray:
    """The vertices from `first` to `last`, both with it, going round."""
    return polygon[np.arange(first, last + 1 + len(polygon) * (last < first)) % len(polygon)]
