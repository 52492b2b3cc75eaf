"""Grids over a box of slow variables on which M0 is resolved: what it tells of M_epsilon, which is M0 to leading order.

Points on M0 cost a thousandth of segments of the full flow, so that they are looked at first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from gsp.critical.branch import Branch
from gsp.errors import BranchError
from gsp.slow.chebyshev import ChebyshevSurface, interpolate, nodes
from gsp.systems.region import Interval

# Points an axis at first and at most, by the number of slow variables.
FIRST_SIZE = {1: 17, 2: 9, 3: 9}
LARGEST_SIZE = {1: 1025, 2: 129, 3: 33}
# Shares of the tolerance: of the last coefficients, below which the degree is high enough, and of those left out.
ROUGH, CHOPPED = 0.1, 0.01


@dataclass(frozen=True, eq=False)
class Rest:
    """M0 interpolated on a grid of `sizes`: `left` is the largest share of its size that is not resolved, along the
    axes that are `rough` by more than what was asked for."""

    sizes: list[int]
    surface: ChebyshevSurface
    scale: float
    left: float
    rough: np.ndarray


def coarse_rest(branch: Branch, intervals: np.ndarray, allowed: Callable[[list[int]], bool]) -> Rest | None:
    """M0 on the last grid that is allowed where that leaves too much of it; None where one resolves it, or where M0
    has no point somewhere over `intervals` (d, 2)."""
    # Where as many points as may be solved for leave this share of M0 unresolved, no segment is solved.
    for rest in _refined(branch, intervals, 1e-2):
        if not rest.rough.any():
            return None
        finer = doubled(rest.sizes, rest.rough)
        if max(finer) > LARGEST_SIZE[len(intervals)] or not allowed(finer):
            return rest
    return None


def resting_coefficients(
    branch: Branch, *, region: Mapping[str, Interval], tolerance: float, enough: int
) -> int:
    """How many coefficients the interpolant of M0 has over `region`, or has on a coarse grid when over `enough`.

    0 where M0 has no point somewhere, and over more slow variables than a surface has.
    """
    intervals = np.array([region[s.name] for s in branch.system.x])
    found = 0
    for rest in _refined(branch, intervals, ROUGH * tolerance):
        found = math.prod(rest.surface.chopped(CHOPPED * tolerance * rest.scale).coefficients.shape)
        if found > enough:
            return found
    return found


def doubled(sizes: list[int], growing: np.ndarray) -> list[int]:
    """The sizes of the next grid, which holds the points of this one."""
    return [2 * n - 1 if grows else n for n, grows in zip(sizes, growing)]


def _refined(branch: Branch, intervals: np.ndarray, share: float) -> Iterator[Rest]:
    """M0 on finer and finer grids until less than `share` of its size is left or the grids end."""
    d = len(intervals)
    if d not in FIRST_SIZE:
        return
    sizes = [FIRST_SIZE[d]] * d
    while True:
        try:
            y = branch.points(nodes(intervals, sizes).reshape(-1, d))
        except BranchError:
            # Told with its place where a segment is to be solved there.
            return
        surface, scale = interpolate(intervals, y.reshape(*sizes, -1)), max(1.0, float(np.abs(y).max()))
        left = surface.tails() / scale
        rough = left > share
        yield Rest(sizes, surface, scale, float(left.max()), rough)
        growing = rough & (np.array(sizes) < LARGEST_SIZE[d])
        if not growing.any():
            return
        sizes = doubled(sizes, growing)
