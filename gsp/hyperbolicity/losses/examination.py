"""`examine`: every loss of a sampled branch, located, named and merged, and the gap that is left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gsp.algebra.switching_functions import SwitchingFunction
from gsp.critical.sampling import Sampler
from gsp.critical.spectrum import is_singular
from gsp.hyperbolicity.losses.components import named_losses
from gsp.hyperbolicity.losses.diagnosis import Diagnosis
from gsp.hyperbolicity.losses.kinds import Contact, Loss
from gsp.hyperbolicity.losses.locator import (
    LOCATED,
    REFINED,
    SAME,
    ZERO_TOLERANCE,
    Locator,
    signed_gap,
    spread,
    unstable,
)
from gsp.hyperbolicity.losses.naming import name_loss
from gsp.hyperbolicity.losses.poles import poles
from gsp.hyperbolicity.losses.switching import meetings
from gsp.hyperbolicity.losses.whole_branch import ZERO_SINGULAR, centre_branch, degenerate_branch
from gsp.systems.region import Interval

Links = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Examination:
    """What was found on a branch: `losses`, `looked_at` (no losses), `notes`, and the `gap`, 0 with a loss.

    Gaps up to `zero` count as none. `unmet` are the switches of the field that no sample meets.
    """

    diagnosis: Diagnosis | None
    losses: tuple[Loss, ...]
    looked_at: tuple[Loss, ...]
    notes: tuple[str, ...]
    gap: float
    zero: float = 0.0
    unmet: tuple[SwitchingFunction, ...] = ()


def examine(
    sampler: Sampler,
    box: Mapping[str, Interval],
    scale: float,
    z: np.ndarray,
    eigenvalues: np.ndarray,
    links: Links,
    *,
    epsilon: float | None = None,
    distance: float = 0.0,
) -> Examination:
    """The losses among the samples `z` (m, n) of a branch, their `eigenvalues` finite, linked along `links`.

    `scale` is the largest |lambda|. With `epsilon` rates that differ by more than 1/epsilon are noted. Where every
    eigenvalue is proved to be `distance` off the axis, no place near it counts as on it.
    """
    if len(z) == 0:
        return Examination(None, (), (), (), 0.0)
    diagnosis = Diagnosis(sampler, box, scale, z)
    everywhere = None if distance else _whole_branch(diagnosis, z, eigenvalues)
    if everywhere is not None:
        return Examination(diagnosis, (everywhere,), (), (), 0.0)
    # Rates are compared with what they are elsewhere on the branch, not with faster ones.
    usual = float(np.median(np.abs(np.real(eigenvalues)).min(axis=1)))
    locator = Locator(sampler, box, scale, usual=usual, samples=z)
    gap = _locate(locator, z, eigenvalues, links, distance)
    rough, unmet = meetings(diagnosis, z, links)
    losses = _joined(diagnosis, named_losses(diagnosis, locator.found), rough)
    neutral = [name_loss(diagnosis, place) for place in locator.sums(*links)[:1]]
    return Examination(
        diagnosis,
        tuple(losses),
        tuple(neutral),
        (*locator.notes, *_spread_rates(sampler, z, eigenvalues, epsilon)),
        gap,
        0.0 if distance else ZERO_TOLERANCE * usual,
        tuple(unmet),
    )


def _joined(diagnosis: Diagnosis, losses: list[Loss], rough: list[Loss]) -> list[Loss]:
    """All losses, an eigenvalue that jumps and the switching surface where it does being one."""
    names = [s.name for s in diagnosis.sampler.system.x]
    jumps = [loss for loss in losses if loss.crossing is Contact.JUMP]
    result = [loss for loss in losses if loss.crossing is not Contact.JUMP]
    for loss in rough:
        here = [
            jump
            for jump in jumps
            if all(
                abs(jump.point[n] - loss.point[n]) <= SAME * width for n, width in zip(names, diagnosis.widths)
            )
        ]
        if here:
            jumps = [jump for jump in jumps if jump is not here[0]]
            loss = replace(
                here[0], test=loss.test, value=loss.value, coefficients=loss.coefficients, note=loss.note
            )
        result.append(loss)
    return [*result, *jumps]


def _whole_branch(diagnosis: Diagnosis, z: np.ndarray, eigenvalues: np.ndarray) -> Loss | None:
    """The loss of a branch on which every sample is singular, or has an imaginary pair."""
    sizes = np.abs(eigenvalues).min(axis=1)
    if _is_singular_throughout(diagnosis.in_units(diagnosis.sampler.fast_jacobian(z))) or (
        sizes.max() <= ZERO_TOLERANCE * diagnosis.scale and _has_zero_row(diagnosis, z)
    ):
        return degenerate_branch(diagnosis, z)
    # A rate that is small beside the others is a rate all the same; beside its own frequency it is none.
    if (np.abs(np.real(eigenvalues)) <= ZERO_TOLERANCE * np.abs(eigenvalues)).any(axis=1).all():
        return centre_branch(diagnosis, z)
    return None


def _is_singular_throughout(matrices: np.ndarray) -> bool:
    """Whether most of the matrices (m, n, n) are singular to rounding, and the others as far as points are exact."""

    def is_nearly(matrix: np.ndarray) -> bool:
        sizes = np.linalg.svd(matrix, compute_uv=False)
        return bool(sizes[-1] <= ZERO_SINGULAR * sizes[0])

    # One matrix after the other: the first that is not singular decides. Points of multiple zeros are inexact, by how
    # much is up to the order in which a processor adds.
    nearly = all(is_singular(matrix[None])[0] or is_nearly(matrix) for matrix in matrices)
    return nearly and bool(2 * is_singular(matrices).sum() > len(matrices))


def _has_zero_row(diagnosis: Diagnosis, z: np.ndarray) -> bool:
    """Whether some row of g_y nearly vanishes on the branch beside what it is off it, whatever the other rows are."""
    nx = diagnosis.nx
    beside = z.copy()
    y = beside[:, nx:]
    y += (diagnosis.units[diagnosis.nx :] + np.abs(y)) * np.random.default_rng(0).uniform(-1.0, 1.0, y.shape)
    rows = [np.abs(diagnosis.sampler.fast_jacobian(points)).sum(axis=2) for points in (z, beside)]
    on, off = (np.max(np.where(np.isfinite(part), part, 0.0), axis=0) for part in rows)
    # Rows of g_y on the branch below this share of what they are beside it are zero, as far as points are
    # exact.
    return bool((on <= 1e-6 * np.maximum(on, off)).any())


def _locate(locator: Locator, z: np.ndarray, eigenvalues: np.ndarray, links: Links, distance: float) -> float:
    """The least |Re lambda|, refined next to the worst samples; 0 with a loss. Fills the locator."""
    sampler = locator.sampler
    sizes = np.abs(eigenvalues).min(axis=1)
    a, b = links
    changed = np.flatnonzero(unstable(sampler.eigenvalues(a)) != unstable(sampler.eigenvalues(b)))
    # Spread over all changes, so that no part of a long curve of losses takes every place.
    changed = changed[np.linspace(0, len(changed) - 1, min(len(changed), LOCATED)).astype(int)]
    starts = REFINED if sampler.is_large else LOCATED
    nearest = np.argsort(sizes)[:starts] if len(sampler.system.x) == 1 else spread(z, sizes, starts)
    # A matrix that is the same everywhere has its zeros everywhere.
    searched = not (sampler.is_large and sampler.is_constant)
    if not distance:
        locator.zeros(np.vstack([a[changed], z[nearest]]) if searched else z[:0])
        locator.changes(a[changed], b[changed])
    for place, crossing, only_x in poles(sampler, z, LOCATED, locator.box, locator.notes, units=locator.units):
        locator.add(place, crossing, only_x=only_x)
    gaps = signed_gap(eigenvalues, unstable(eigenvalues))
    if any(not place.is_pole for place in locator.found):
        return 0.0
    if not searched:
        return float(gaps.min())
    refined = locator.refine(z[np.argsort(gaps)[:REFINED]], only_gap=distance > 0.0)
    if any(not place.is_pole for place in locator.found):
        return 0.0
    return max(float(min(refined, gaps.min())), distance)


def _spread_rates(sampler: Sampler, z: np.ndarray, eigenvalues: np.ndarray, epsilon: float | None) -> list[str]:
    """A note when the slowest fast rate is slower than the fastest by more than epsilon."""
    # One that only counts orders, and is 1 for the model itself, tells no rates apart.
    if epsilon is None or epsilon >= 1.0 or eigenvalues.shape[1] < 2:
        return []
    sizes = np.sort(np.abs(eigenvalues), axis=1)
    ratio = float((sizes[:, 0] / sizes[:, -1]).min())
    # A rate that is zero is a loss, which is named as such.
    if not 0.0 < ratio <= epsilon:
        return []
    faster = float(sizes[:, 0].min()) / epsilon
    slow = sampler.tangential_rate(z)
    what = (
        "at this epsilon the slowest fast direction is no faster than the slow variables"
        if faster <= slow
        else "there are three time scales, and the slowest fast direction is still faster than the slow variables"
    )
    return [
        f"the fast rates differ by a factor {1.0 / ratio:.3g}, more than 1/epsilon = {1.0 / epsilon:.3g}: {what}"
    ]
