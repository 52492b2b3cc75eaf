"""Where a sheet ends although no eigenvalue was found on the axis: a switching surface, the domain, or none found."""

from __future__ import annotations

import numpy as np

from gsp.losses import consequences, kinds
from gsp.losses.consequences import Verdict
from gsp.losses.diagnosis import Diagnosis
from gsp.losses.kinds import Loss, LossKind
from gsp.losses.switching import switches
from gsp.sampling import neighbours

# Ends that are located, and halvings for each: to give a sheet up is slow.
ENDS = 2
HALVINGS = 24
# A switching function is zero at an end below this, relative to its size over the samples.
AT_END = 1e-4

# The field ends rather than its hyperbolicity where the least |lambda| is this share of what it is over the samples.
HYPERBOLIC = 1e-3

DOMAIN = Verdict(
    "the field has no real value beyond; orbits that get there leave the model",
    False,
    "shrink the region to the domain of the field",
)
SURFACE = Verdict(
    "the equilibria end at a switching surface: orbits cross it or slide along it",
    False,
    "shrink the region to this side, or use Filippov's rule on the surface",
)


def sheet_ends(diagnosis: Diagnosis, z: np.ndarray, rows: np.ndarray, x: np.ndarray) -> list[Loss]:
    """Losses at ends of sheets, between samples `z` over the rows `rows` of the grid `x` and rows that have none."""
    has = np.zeros(len(x), dtype=bool)
    has[rows] = True
    first, second = neighbours(len(x), x.shape[1])
    pairs = [(a, b) for a, b in [*zip(first, second), *zip(second, first)] if has[a] and not has[b]]
    chosen = [pairs[i] for i in np.linspace(0, len(pairs) - 1, min(len(pairs), ENDS)).astype(int)]
    ends = [_end(diagnosis, z[int(np.argmax(rows == a))], x[b]) for a, b in chosen]
    return [_loss(diagnosis, end) for end in ends if diagnosis.sampler.inside(end[None, :], diagnosis.box)[0]]


def _end(diagnosis: Diagnosis, low: np.ndarray, high_x: np.ndarray) -> np.ndarray:
    """The last point of the sheet of `low` on the way to `high_x`, by bisection."""
    nx = diagnosis.nx
    for _ in range(HALVINGS):
        x = 0.5 * (low[:nx] + high_x)
        y, good = diagnosis.sampler.over(x[None, :], low[None, :])
        if good[0]:
            low = np.concatenate([x, y[0]])
        else:
            high_x = x
    return low


def _loss(diagnosis: Diagnosis, end: np.ndarray) -> Loss:
    sampler = diagnosis.sampler
    value = float(np.abs(sampler.eigenvalues(end[None, :])[0]).min())
    for switch in switches([*sampler.f, *sampler.g], sampler.system.states):
        function = sampler.compiled([switch.surface])
        here = float(function(end[None, :], sampler.p)[0, 0])
        typical = np.abs(function(diagnosis.samples, sampler.p)[:, 0]).max()
        if abs(here) <= AT_END * typical:
            note = f"{switch.source} switches at {switch.surface} = 0"
            return diagnosis.loss(
                end, kinds.END, LossKind.NON_SMOOTH, str(switch.surface), here, SURFACE, note=note
            )
    usual = float(np.median(np.abs(sampler.eigenvalues(diagnosis.samples)).min(axis=1)))
    if value > HYPERBOLIC * usual:
        return diagnosis.loss(end, kinds.END, LossKind.DOMAIN_END, "least |lambda|", value, DOMAIN)
    note = "no zero eigenvalue, pole or switching surface was found where it ends"
    return diagnosis.loss(
        end, kinds.END, LossKind.DEGENERATE, "least |lambda|", value, consequences.DEGENERATE, note=note
    )
