"""Where the samples of a function may be joined to a curve."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def are_joined(
    function: Callable[[np.ndarray], np.ndarray], start: np.ndarray, end: np.ndarray, *, seen: float = 0.0
) -> np.ndarray:
    """Whether `function`, (m, n) to (m,), goes on from each point of `start` (m, n) to the one of `end`: (m,) bools.

    Each step is halved towards the larger change. Where the function goes on, that falls below a quarter of what it
    was; at a pole and at a jump it does not, however short the step. A change up to `seen` is none.
    """
    start, end = start.copy(), end.copy()
    first, last = function(start), function(end)
    with np.errstate(invalid="ignore"):
        whole = np.abs(last - first)
    joined = whole <= seen
    # What is no number at an end is joined to nothing.
    left = np.flatnonzero(~joined & np.isfinite(whole))
    # After so many halvings of a step there is no number within it.
    for _ in range(np.finfo(float).nmant + 1):
        if not left.size:
            break
        middle = (start[left] + end[left]) / 2
        value = function(middle)
        before, after = np.abs(value - first[left]), np.abs(last[left] - value)
        is_before = before >= after
        end[left[is_before]], last[left[is_before]] = middle[is_before], value[is_before]
        start[left[~is_before]], first[left[~is_before]] = middle[~is_before], value[~is_before]
        change = np.maximum(before, after)
        # A jump may have a value in its middle, as sign(0) is, which leaves half of it.
        joined[left] = (change < whole[left] / 4) | (change <= seen)
        left = left[~joined[left] & np.isfinite(change)]
    return joined
