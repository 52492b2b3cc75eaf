"""Where the normal rate does not dominate the tangential one: the worst place, the direction, and where it does."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.sampling import Sampler
from gsp.critical.slow_metric import least_metric
from gsp.errors import BranchError
from gsp.hyperbolicity.losses.shrinking import LEAST, TRIED, SubRegion
from gsp.systems.flow import in_words
from gsp.systems.region import Interval, with_sides


@dataclass(frozen=True, eq=False)
class Shortfall:
    """The largest tangential `rate` (below 0: neighbours approach) at `point`, with its `direction` along the slow
    variables in widths of the region, largest part 1; `allowed` is the normal rate in slow time at `epsilon`.

    `parts` are intervals of one slow variable each, at all samples over which the rate is allowed, those with most of
    the region first.
    """

    rate: float
    allowed: float
    epsilon: float
    point: Mapping[str, float]
    direction: Mapping[str, float]
    parts: tuple[tuple[str, Interval], ...]

    def __str__(self) -> str:
        at = in_words(self.point, 4)
        # Components of a direction below this share of the largest, in widths of the region, are left out.
        along = ", ".join(f"{name} {share:.2g}" for name, share in self.direction.items() if abs(share) >= 0.05)
        what = "part" if self.rate > 0.0 else "approach"
        return (
            f"neighbours on the branch {what} at a rate of up to {abs(self.rate):.4g}, where {self.allowed:.4g} is "
            f"allowed: at {at}, along {along} in widths of the region"
        )


def shortfall(
    sampler: Sampler, z: np.ndarray, box: Mapping[str, Interval], *, gap: float, epsilon: float
) -> Shortfall | None:
    """The shortfall among the samples `z` (m, n); None where no rate is known."""
    A, usable = sampler.slow_jacobians(z)
    if not usable.any():
        return None
    allowed = gap / epsilon
    names = [s.name for s in sampler.system.x]
    metric, at = least_metric(A), z[usable]
    i, rate, direction = metric.extreme(A)
    direction = direction / [high - low for low, high in (box[name] for name in names)]
    direction /= direction[np.abs(direction).argmax()]
    good = np.zeros(len(z), dtype=bool)
    good[usable] = metric.rates(A) <= allowed
    return Shortfall(
        rate,
        allowed,
        epsilon,
        dict(zip((s.name for s in sampler.system.states), map(float, at[i]))),
        dict(zip(names, map(float, direction))),
        tuple(_longest(z[:, : len(names)], good, names, box)),
    )


def _longest(
    x: np.ndarray, good: np.ndarray, names: list[str], box: Mapping[str, Interval]
) -> Iterator[tuple[str, Interval]]:
    found: list[tuple[float, str, Interval]] = []
    for k, name in enumerate(names):
        bad = np.unique(x[~good, k])
        edges = np.unique([*x[:, k], *box[name]])
        # From one sample that falls short to the next, those in between.
        for low, high in zip([-np.inf, *bad], [*bad, np.inf]):
            between = edges[(edges > low) & (edges < high)]
            if len(between) > 1:
                width = box[name][1] - box[name][0]
                found.append(
                    ((between[-1] - between[0]) / width, name, (float(between[0]), float(between[-1])))
                )
    for share, name, interval in sorted(found, reverse=True):
        if LEAST <= share < 1.0:
            yield name, interval


def dominated(
    branch: Branch, region: Mapping[str, Interval], found: Shortfall, *, judge: Callable[..., Any]
) -> SubRegion | None:
    """The longest of the `parts` that `judge` (`classify`) finds to hold; None when there is none."""
    for axis, interval in found.parts[:TRIED]:
        part = with_sides(region, {axis: interval})
        try:
            verdict = judge(branch, region=part, epsilon=found.epsilon)
        except BranchError:
            continue
        if verdict.holds:
            return SubRegion(axis, interval, part, str(verdict.kind), {})
    return None
