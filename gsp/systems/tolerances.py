"""The tolerances of runs: an absolute one is what the smallest state needs, where it is known."""

from __future__ import annotations

from collections.abc import Mapping

from gsp.systems.region import Interval, state_sizes

# Those of `integrate`.
RTOL, ATOL = 1e-8, 1e-10
# Of rtol times the size of the smallest state: from this share of it on its digits are controlled by rtol.
SHARE = 1e-2


def absolute_tolerance(rtol: float, region: Mapping[str, Interval], *starts: Mapping[str, float]) -> float:
    """SHARE times `rtol` times the size of the smallest state, or 1 where nothing is known of any.

    A state is as large as the furthest end of its interval in `region`, or its values in `starts`; one that is 0 in
    all of them says nothing of its size. Moles in a litre are 1e-9 and less, of which 1e-10 would be a tenth.

    >>> absolute_tolerance(1e-8, {"x": (0, 2)}, {"x": 1.0, "y": 0.0}) == 2e-10
    True
    >>> f"{absolute_tolerance(1e-8, {'x': (0, 2e-9)}, {'x': 0.0}):.3g}"
    '2e-19'
    """
    return float(rtol * SHARE * min(state_sizes(region, *starts).values(), default=1.0))
