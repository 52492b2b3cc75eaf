"""The part of a region over which the conditions hold, cut along one slow axis at the losses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.sampling import Sampler, grid
from gsp.errors import BranchError
from gsp.hyperbolicity.losses.kinds import Loss
from gsp.systems.flow import in_words
from gsp.systems.region import Interval, shown_ends, with_sides

# Share of a part that is left free next to a loss, parts tried, and the least share of the region worth naming.
MARGIN = 0.02
TRIED = 6
LEAST = 0.02
PREFERRED = "attracting"


@dataclass(frozen=True)
class SubRegion:
    """A part of a region where a branch is normally hyperbolic of the type `kind`: `axis` in `interval`, and the sheet
    through the point `through` when several lie over it (empty otherwise).
    """

    axis: str
    interval: Interval
    region: Mapping[str, Interval]
    kind: str
    through: Mapping[str, float]

    def __str__(self) -> str:
        low, high = shown_ends(self.interval)
        sheet = ""
        if self.through:
            sheet = " on the sheet through " + in_words(self.through, 4)
        return f"for {self.axis} in [{low}, {high}]{sheet} ({self.kind})"


def largest_sub_region(
    branch: Branch, region: Mapping[str, Interval], losses: Sequence[Loss], *, judge: Callable[..., Any]
) -> SubRegion | None:
    """The largest part, of a few, that `judge` (`classify`) finds to hold; None when there is none.

    An attracting one is preferred when it is at least half as long.
    """
    best: SubRegion | None = None
    longest = 0.0
    for axis, interval in _parts(branch, region, losses):
        share = (interval[1] - interval[0]) / (region[axis][1] - region[axis][0])
        if best is not None and share < 0.5 * longest:
            break
        part = with_sides(region, {axis: interval})
        try:
            for candidate, through in _sheets(branch, part):
                if not _is_graph(candidate, part):
                    continue
                verdict = judge(candidate, region=part)
                if not verdict.holds:
                    continue
                found = SubRegion(axis, interval, part, str(verdict.kind), through)
                if found.kind == PREFERRED:
                    return found
                if best is None:
                    best, longest = found, share
                break
        except BranchError:
            continue
    return best


def _is_graph(branch: Branch, part: Mapping[str, Interval]) -> bool:
    """Whether the branch has a real point over each of some points of the grid, at all of which `classify` needs one.

    A fold may pass through a part in a direction along which no part is cut: then the searches of a whole judgement,
    most of them beyond the fold, come to nothing.
    """
    # Every so many points of the grid over a part are followed before the part is judged.
    x = grid(np.array([part[s.name] for s in branch.system.x]))[::8]
    return bool(Sampler(branch).over(x, None)[1].all())


def _parts(
    branch: Branch, region: Mapping[str, Interval], losses: Sequence[Loss]
) -> Iterator[tuple[str, Interval]]:
    parts = []
    for symbol in branch.system.x:
        low, high = region[symbol.name]
        bad = sorted(
            loss.extent.get(symbol.name, (loss.point[symbol.name],) * 2)
            for loss in losses
            if not loss.crossing.is_everywhere
        )
        edge = low
        for start, end in [*bad, (high, high)]:
            if start > edge:
                free = MARGIN * (start - edge)
                parts.append((symbol.name, (edge + free * (edge > low), start - free * (start < high))))
            edge = max(edge, end)
    if not any(loss.crossing.is_everywhere for loss in losses):
        shares = [(b - a) / (region[name][1] - region[name][0]) for name, (a, b) in parts]
        for i in np.argsort(shares)[::-1][:TRIED]:
            if LEAST <= shares[i] < 1.0:
                yield parts[i]


def _sheets(branch: Branch, part: Mapping[str, Interval]) -> Iterator[tuple[Branch, Mapping[str, float]]]:
    """The branch when one sheet is meant, else its sheets over the middle of `part`, attracting ones first."""
    if branch.is_explicit or branch.seed is not None:
        yield branch, {}
        return
    system = branch.system
    middle = np.array([0.5 * sum(part[s.name]) for s in system.x])
    bounds = {s.name: part[s.name] for s in system.y if s.name in part}
    roots = branch.roots(middle[None, :], bounds=bounds)
    z = np.hstack([np.broadcast_to(middle, (len(roots), len(middle))), roots])
    values = Sampler(branch).eigenvalues(z)
    for i in np.argsort(np.nan_to_num(np.real(values).max(axis=1, initial=-np.inf), nan=np.inf)):
        point = dict(zip((s.name for s in system.states), map(float, z[i])))
        yield branch.through(point), point
