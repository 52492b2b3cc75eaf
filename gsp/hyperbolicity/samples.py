"""A branch over samples of a region: its fast eigenvalues there, the worst of them, and the kind that they tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.critical_manifold import solve_critical
from gsp.critical.sampling import Sampler
from gsp.errors import BranchError
from gsp.hyperbolicity.exclusion import ASIDE, Exclusion
from gsp.hyperbolicity.losses.ends import crossed, ends_on_grid, sheet_ends
from gsp.hyperbolicity.losses.examination import Examination, examine
from gsp.hyperbolicity.losses.kinds import Contact, Loss
from gsp.hyperbolicity.losses.locator import signed_gap, unstable
from gsp.hyperbolicity.losses.saturation import named_by_switch
from gsp.hyperbolicity.losses.whole_branch import singular_points
from gsp.systems.flow import LARGEST, in_words
from gsp.systems.region import ImageBox, Interval, shown_region


@dataclass(frozen=True, eq=False)
class Samples:
    """Points `z` (m, n) of a branch in the region, their eigenvalues, pairs of linked ones, and how many are missing.

    `ends` are samples each with a slow point next to them that has none.
    """

    z: np.ndarray
    eigenvalues: np.ndarray
    links: tuple[np.ndarray, np.ndarray]
    missing: int
    ends: list[tuple[np.ndarray, np.ndarray]]

    def with_more(self, sampler: Sampler, exclusion: Exclusion) -> Samples:
        """With the points that were sampled between them."""
        values = sampler.eigenvalues(exclusion.points)
        finite = np.isfinite(values).all(axis=1)
        more, origins = exclusion.points[finite], exclusion.origins[finite]
        a, b = self.links
        return Samples(
            np.vstack([self.z, more]),
            np.vstack([self.eigenvalues, values[finite]]),
            (np.vstack([a, origins]), np.vstack([b, more])),
            self.missing + len(exclusion.ends) + int((~finite).sum()),
            [*self.ends, *exclusion.ends],
        )


def off_removable_zeros(sampler: Sampler, x: np.ndarray, box: Mapping[str, Interval]) -> np.ndarray:
    """The slow points `x` (m, n), those at which a formula is 0/0 though it goes on smoothly moved aside by `ASIDE`.

    Rates of gates such as v/(1 - exp(-v)) are written so; grids hit such places.
    """
    if not sampler.branch.is_explicit:
        return x

    def values(at: np.ndarray) -> np.ndarray:
        y, _ = sampler.over(at, None)
        return np.hstack([y, sampler.rates(np.hstack([at, y]))])

    lost = np.flatnonzero(~np.isfinite(values(x)).all(axis=1))
    if not len(lost):
        return x
    low, high = np.array([box[s.name] for s in sampler.system.x]).T
    inward = np.where(x[lost] < (low + high) / 2, 1.0, -1.0) * ASIDE * (high - low)
    moved, further, across = (x[lost] + k * inward for k in (1, 2, -1))
    here = values(moved)
    # How far values on both sides of a removable zero may differ, relative to 1 + their size; towards a pole
    # they double.
    margin = 1e-3 * (1.0 + np.abs(here))
    smooth = (np.abs(values(further) - here) <= margin).all(axis=1)
    outside = ((across < low) | (across > high)).any(axis=1)
    smooth &= outside | (np.abs(values(across) - here) <= margin).all(axis=1)
    result = x.copy()
    result[lost[smooth]] = moved[smooth]
    return result


def sampled(sampler: Sampler, box: Mapping[str, Interval]) -> Samples:
    branch = sampler.branch
    x = off_removable_zeros(sampler, sampler.grid(box), box)
    z, rows = points_of(sampler, x, box)
    without = np.setdiff1d(np.arange(len(x)), rows)
    without = without[sampler.counted(x[without], box)]
    if isinstance(box, ImageBox) and sampler.branch.seed is not None:
        z, rows, without = _around_corners(sampler, x, z, rows, without)
    ends = ends_on_grid(z, rows, x) if len(without) else []
    for beyond, aside in crossed(sampler, ends):
        # Samples may lie where the sheets meet.
        for moved in (x, x + aside):
            y, good = sampler.over(moved[without], np.tile(beyond, (len(without), 1)))
            z = np.vstack([z, np.hstack([moved[without], y])[good]])
            rows, without = np.append(rows, without[good]), without[~good]
    missing = len(without)
    bounded = sampler.inside(z, box)
    links = sampler.links(z[bounded], rows[bounded], x)
    z = z[bounded]
    if len(z) == 0:
        raise _nothing_inside(branch, box)
    refuse_beyond_doubles(branch, z, box)
    eigenvalues = sampler.eigenvalues(z)
    finite = np.isfinite(eigenvalues).all(axis=1)
    missing += int((~finite).sum())
    return Samples(z[finite], eigenvalues[finite], links, missing, ends)


def _around_corners(
    sampler: Sampler, x: np.ndarray, z: np.ndarray, rows: np.ndarray, without: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples of a sheet with those that are met from others of it: the straight way to them may leave an image."""
    widths = np.ptp(x, axis=0)
    while len(without) and len(z):
        scaled = z[:, : x.shape[1]] / widths
        nearest = [int(np.argmin(np.abs(scaled - point).sum(axis=1))) for point in x[without] / widths]
        y, good = sampler.over(x[without], z[nearest])
        if not good.any():
            break
        z = np.vstack([z, np.hstack([x[without], y])[good]])
        rows, without = np.append(rows, without[good]), without[~good]
    return z, rows, without


def _nothing_inside(branch: Branch, box: Mapping[str, Interval]) -> BranchError:
    """What to say of a branch, or of its one sheet that is singled out, without a point in the region."""
    if branch.seed is None:
        critical = solve_critical(branch.system)
        graphs = [str(each) for each in critical.branches if each.equations != branch.equations]
        further = f" Other branches are {', '.join(graphs)}." if graphs else ""
        if critical.no_graph:
            further += f" The critical manifold is more than graphs: there is {critical.no_graph} too."
        return BranchError(
            f"the branch {branch} has no real point in the region {shown_region(box)}.{further}",
            "Move the region, or start near another branch." if graphs else "Move the region.",
        )
    values = (*branch.seed[0], *branch.seed[1])
    through = branch.system.place(zip(branch.system.states, values))
    return BranchError(
        f"the sheet of the branch {branch} through {through}, to which the run from the start belongs, has no point in "
        f"the region {shown_region(box)}.",
        "Start over slow values at which the region holds a point of the branch, or move the region.",
    )


def refuse_beyond_doubles(branch: Branch, z: np.ndarray, box: Mapping[str, Interval]) -> None:
    """Raise `BranchError` when the branch goes where no region may: losses are told by third powers."""
    place, k = np.unravel_index(np.argmax(np.where(np.isfinite(z), np.abs(z), 0.0)), z.shape)
    if abs(z[place, k]) > LARGEST:
        names = [s.name for s in branch.system.states]
        at = in_words(zip(names, z[place]))
        raise BranchError(
            f"the branch {branch} reaches beyond {LARGEST:g} in the region {shown_region(box)}: {at}.",
            f"Rescale {names[k]}, or bound it in the region.",
        )


@dataclass(frozen=True, eq=False)
class Judged:
    """What the samples say: the losses, the gap, and the numbers of unstable directions."""

    found: Examination
    losses: tuple[Loss, ...]
    kinds: np.ndarray
    lost: bool

    @property
    def gap(self) -> float:
        return self.found.gap

    @property
    def may_touch(self) -> bool:
        """Whether all that is lost is an eigenvalue which comes so near to the axis that doubles take it for on it."""
        losses = [loss for loss in self.losses if not loss.is_hyperbolic]
        return bool(losses) and all(loss.crossing in (Contact.ZERO, Contact.PAIR) for loss in losses)

    @property
    def notes(self) -> tuple[str, ...]:
        """What is to be said beside the losses; a sheet that ends at a switching surface meets it."""
        met = {loss.test for loss in self.losses}
        smooth = (
            f"{switch.source} is not smooth, but the branch does not cross where it switches"
            for switch in self.found.unmet
            if str(switch.surface) not in met
        )
        return (*smooth, *self.found.notes)


def judged_samples(
    sampler: Sampler,
    box: Mapping[str, Interval],
    samples: Samples,
    epsilon: float | None,
    *,
    distance: float = 0.0,
) -> Judged:
    """What the samples say, no eigenvalue being nearer to the imaginary axis than a proved `distance`."""
    branch = sampler.branch
    scale = float(np.abs(samples.eigenvalues).max(initial=0.0)) or 1.0
    kinds = np.unique(unstable(samples.eigenvalues))
    found = examine(
        sampler,
        box,
        scale,
        samples.z,
        samples.eigenvalues,
        samples.links,
        epsilon=epsilon,
        distance=distance,
    )
    losses = found.losses
    if samples.ends and not losses and found.diagnosis is not None:
        losses = tuple(sheet_ends(found.diagnosis, samples.ends))
    if found.diagnosis is not None and (losses or samples.missing):
        losses = named_by_switch(found.diagnosis, losses, samples.ends)
    lost = any(not loss.is_hyperbolic for loss in losses) or samples.missing > 0 or found.gap <= found.zero
    if len(kinds) > 1 and not lost and not branch.is_explicit and branch.seed is None:
        raise BranchError(
            f"the branch {branch} has sheets of different type in the region {shown_region(box)}: "
            f"{', '.join(kind_of(int(k), len(sampler.system.y)) for k in kinds)}.",
            "Fix one with branch.through({...}), or bound the fast variables.",
        )
    return Judged(found, losses, kinds, lost)


def is_worse(sampler: Sampler, exclusion: Exclusion, judged: Judged) -> bool:
    """Whether points between the samples change the verdict: a smaller gap, another type, or no point."""
    if exclusion.ends or not len(exclusion.points):
        return bool(exclusion.ends)
    values = sampler.eigenvalues(exclusion.points)
    least = signed_gap(values, np.full(len(values), judged.kinds[0]))
    # The least gap is refined to about this share of it.
    return bool((~(least >= judged.gap * (1.0 - 1e-6))).any())


def points_of(sampler: Sampler, x: np.ndarray, box: Mapping[str, Interval]) -> tuple[np.ndarray, np.ndarray]:
    """Samples over the grid x and their rows; where Newton's method finds none, those of a singular branch."""
    reason = None
    try:
        z, rows = sampler.points(x, box)
    except BranchError as error:
        z, rows, reason = np.empty((0, len(sampler.system.states))), np.empty(0, dtype=int), error
    if not sampler.branch.is_explicit and (len(z) < len(x) // 2 or sampler.is_singular(z)):
        singular = singular_points(sampler, box, x)
        if len(singular):
            nx = x.shape[1]
            return singular, np.array(
                [int(np.argmin(np.abs(x - point[:nx]).sum(axis=1))) for point in singular]
            )
    if reason is not None:
        raise reason
    return z, rows


class Kind(StrEnum):
    """Type of normal hyperbolicity."""

    ATTRACTING = "attracting"
    REPELLING = "repelling"
    SADDLE = "saddle"
    LOST = "lost"

    @property
    def adjective(self) -> str:
        """What follows "the branch is"."""
        return "of saddle type" if self is Kind.SADDLE else str(self)


def kind_of(unstable: int, fast: int) -> Kind:
    if unstable == 0:
        return Kind.ATTRACTING
    return Kind.REPELLING if unstable == fast else Kind.SADDLE
