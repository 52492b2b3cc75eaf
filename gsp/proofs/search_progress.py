"""How far the search for a proof is, as `progress` is told."""

from __future__ import annotations

import math
from collections.abc import Callable


class SearchProgress:
    """Tells the share of a search that is done, which never falls; a search ends when its bracket is narrow enough.

    Nobody knows how many proofs a search will try: the share is that of the halvings of a bracket from `WIDEST` on.
    """

    # From one value to the next that is tried while nothing is known.
    WIDEST = 4.0

    def __init__(self, progress: Callable[[float], object] | None = None) -> None:
        self._progress, self._share = progress, 0.0
        self._begin, self._end = 0.0, 1.0

    def part(self, begin: float, end: float) -> None:
        """What follows takes the search from one share to another."""
        self._begin, self._end = begin, end
        self.reached(0.0)

    def reached(self, share: float) -> None:
        """A share of the part is done."""
        self._share = max(self._share, self._begin + (self._end - self._begin) * min(max(share, 0.0), 1.0))
        self.looked()

    def bracketed(self, good: float, bad: float, resolution: float) -> None:
        """What the part looks for is between two values, and is known when their quotient is the `resolution`."""
        left = bad / good if 0.0 < good <= bad < math.inf else self.WIDEST
        halvings = [math.log2(max(math.log(v), 1e-300) / math.log(resolution)) for v in (left, self.WIDEST)]
        self.reached(1.0 - max(halvings[0], 0.0) / halvings[1])

    def looked(self) -> None:
        """One more look within a step, without a new share: progress is where Ctrl-C is seen."""
        if self._progress is not None:
            self._progress(self._share)
