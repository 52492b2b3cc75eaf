"""Where a sheet ends although no loss was met in the region: a fold, a switching surface, the domain, or none found.

The fold may lie outside the bounds on the fast variables: over the slow variables the sheet ends there all the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gsp.algebra.switching_functions import switches
from gsp.critical.loss_kind import LossKind
from gsp.critical.sampling import Sampler, neighbours
from gsp.critical.sheet_points import EQUAL, signs
from gsp.hyperbolicity.losses import consequences
from gsp.hyperbolicity.losses.components import named_losses
from gsp.hyperbolicity.losses.consequences import LossConsequence
from gsp.hyperbolicity.losses.diagnosis import EDGE, Diagnosis, Found
from gsp.hyperbolicity.losses.kinds import Contact, Loss
from gsp.hyperbolicity.losses.locator import ZERO_TOLERANCE, Locator

# A switching function is zero at an end below this, relative to its size over the samples.
AT_END = 1e-4
# Share of the way from the seed, over which a sheet that meets another at its end is looked for beyond it.
ACROSS = 1e-4

DOMAIN = LossConsequence(
    "the field has no real value beyond; orbits that get there leave the model",
    False,
    "shrink the region to the domain of the field",
)
SURFACE = LossConsequence(
    "the equilibria end at a switching surface: orbits cross it or slide along it",
    False,
    "shrink the region to this side, or use Filippov's rule on the surface",
)

Pair = tuple[np.ndarray, np.ndarray]


def ends_on_grid(z: np.ndarray, rows: np.ndarray, x: np.ndarray) -> list[Pair]:
    """Samples of `z` over the rows `rows` of the grid `x`, each with a neighbouring row of it that has none."""
    has = np.zeros(len(x), dtype=bool)
    has[rows] = True
    first, second = neighbours(len(x), x.shape[1])
    pairs = [(a, b) for a, b in [*zip(first, second), *zip(second, first)] if has[a] and not has[b]]
    return [(z[int(np.argmax(rows == a))], x[b]) for a, b in _spread(pairs)]


def _spread(pairs: Sequence[tuple[Any, Any]]) -> list[tuple[Any, Any]]:
    # Two ends are located: to give a sheet up is slow.
    return [pairs[int(i)] for i in np.linspace(0, len(pairs) - 1, min(len(pairs), 2))]


def sheet_ends(diagnosis: Diagnosis, pairs: Sequence[Pair]) -> list[Loss]:
    """Losses at ends of sheets, between samples (n,) and slow points (n_slow,) over which they have none.

    The samples are those of one sheet whatever its fast coordinates, or those within the bounds on these.
    """
    sampler, box = diagnosis.sampler, diagnosis.box
    one_sheet = sampler.branch.is_explicit or sampler.branch.seed is not None
    if one_sheet:
        box = {s.name: box[s.name] for s in sampler.system.x}
    ends = [_end(sampler, z, x) for z, x in _spread(pairs)]
    ends = [end for end in ends if sampler.inside(end[None, :], box)[0]]
    folds, losses = [], []
    for end in ends:
        locator = Locator(sampler, box, diagnosis.scale, usual=_usual(diagnosis), samples=diagnosis.samples)
        fold = _fold(diagnosis, locator, end)
        if fold is None:
            losses.append(_loss(diagnosis, end))
        else:
            folds.append(fold)
    return [*named_losses(diagnosis, folds), *losses]


def _fold(diagnosis: Diagnosis, locator: Locator, end: np.ndarray) -> Found | None:
    """Where an eigenvalue vanishes next to the end of a sheet; None without such a place."""
    nx = diagnosis.nx
    locator.zeros(end[None, :], at_end=True)
    # From an end on an edge of the region Newton's method may come to its fold a little beyond, but not along the edge.
    edges = np.array([diagnosis.box[s.name] for s in diagnosis.sampler.system.x])
    held = (np.abs(edges - end[:nx, None]) <= EDGE * diagnosis.widths[:, None]).any(axis=1)
    if held.any():
        locator.zeros(end[None, :], at_end=True, held=np.flatnonzero(held).tolist())
    sizes = np.append(AT_END * diagnosis.widths, AT_END**0.5 * np.ptp(diagnosis.samples[:, nx:], axis=0))
    # An end may be the fold itself, to rounding.
    # An eigenvalue that creeps towards zero without ever being there is no smaller than this share at a zero of
    # Newton's.
    vanished = max(1e-2 * _least(diagnosis, end), ZERO_TOLERANCE * locator.usual)
    near = [
        found
        for found in locator.found
        if (np.abs(found.z - end) <= sizes + EQUAL * diagnosis.units).all()
        and _least(diagnosis, found.z) <= vanished
    ]
    return near[0] if near else None


def _usual(diagnosis: Diagnosis) -> float:
    return float(np.median(np.abs(diagnosis.sampler.eigenvalues(diagnosis.samples)).min(axis=1)))


def _least(diagnosis: Diagnosis, z: np.ndarray) -> float:
    return float(np.abs(diagnosis.sampler.eigenvalues(z[None, :])[0]).min())


def crossed(sampler: Sampler, pairs: Sequence[Pair]) -> list[Pair]:
    """Points (n,) of a seed's sheet right beyond ends at which it meets another and goes on, and the ways (n_slow,)
    there from the ends.
    """
    branch, nx, found = sampler.branch, len(sampler.system.x), []
    if branch.seed is None:
        return []
    # From a sample at the end itself the other sheet might be followed.
    seed = np.hstack(branch.seed)
    for _, x in pairs:
        end, way = _end(sampler, seed, x), ACROSS * (x - seed[:nx])
        places = end[:nx] + np.array([-way, way])
        y, followed = sampler.over(places[:1], None)
        beyond, reached = branch.nearest(places[1:], y)
        sides = signs(np.nan_to_num(sampler.fast_jacobian(np.hstack([places, np.vstack([y, beyond])]))))
        # Beyond a fold Newton's method comes to a sheet that is far away, if to any.
        lengths = sampler.fast_lengths(np.vstack([seed, end]))
        near = (np.abs(beyond[0] - end[nx:]) <= ACROSS**0.5 * lengths).all()
        if followed[0] and reached[0] and near and sides[0] == sides[1]:
            found.append((np.append(places[1], beyond), way))
    return found


def _end(sampler: Sampler, low: np.ndarray, high_x: np.ndarray) -> np.ndarray:
    """The last point of the sheet of `low` on the way to `high_x`, by bisection."""
    target = np.append(high_x, low[len(high_x) :])
    ends, _ = sampler.bisected(
        low[None, :], target[None, :], lambda z: np.ones(len(z), dtype=bool), halvings=24
    )
    return ends[0]


def _loss(diagnosis: Diagnosis, end: np.ndarray) -> Loss:
    sampler = diagnosis.sampler
    value = _least(diagnosis, end)
    for switch in switches([*sampler.f, *sampler.g], sampler.system.states):
        function = sampler.compiled([switch.surface])
        here = float(function(end[None, :], sampler.p)[0, 0])
        typical = np.abs(function(diagnosis.samples, sampler.p)[:, 0]).max()
        if abs(here) <= AT_END * typical:
            note = f"{switch.source} switches at {switch.surface} = 0"
            return diagnosis.loss(
                end, Contact.END, LossKind.NON_SMOOTH, str(switch.surface), here, SURFACE, note=note
            )
    # The field ends, rather than its hyperbolicity, where it has no real value right beside.
    steps = np.diag(AT_END * diagnosis.units)
    if not np.isfinite(
        sampler.compiled([*sampler.f, *sampler.g])(end + np.concatenate([steps, -steps]), sampler.p)
    ).all():
        return diagnosis.loss(end, Contact.END, LossKind.DOMAIN_END, "least |lambda|", value, DOMAIN)
    note = "no zero eigenvalue, pole or switching surface was found where it ends"
    return diagnosis.loss(
        end, Contact.END, LossKind.DEGENERATE, "least |lambda|", value, consequences.DEGENERATE, note=note
    )
