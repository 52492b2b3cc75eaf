"""The absolute tolerance of a scene's runs: what its smallest state needs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsp.systems.region import Interval

# Of rtol, for states of size one; those of this size and more are controlled by rtol then.
SHARE = 1e-2


def absolute_tolerance(rtol: float, region: Mapping[str, Interval], *starts: Mapping[str, float]) -> float:
    """SHARE times `rtol`, or `rtol` times the size of the smallest state where that is less.

    A state is as large as the furthest end of its interval in `region`, or its values in `starts`; one that is 0 in
    all of them says nothing of its size. Moles in a litre are 1e-9 and less, of which 1e-10 would be a tenth.

    >>> absolute_tolerance(1e-8, {"x": (0, 2)}, {"x": 1.0, "y": 0.0}) == 1e-10
    True
    >>> absolute_tolerance(1e-8, {"x": (0, 2e-9)}, {"x": 0.0}) == 2e-17
    True
    """
    sizes = {name: max(abs(float(low)), abs(float(high))) for name, (low, high) in region.items()}
    for start in starts:
        for name, value in start.items():
            sizes[name] = max(sizes.get(name, 0.0), abs(float(value)))
    return float(rtol * min([SHARE, *(size for size in sizes.values() if size > np.finfo(float).tiny)]))
