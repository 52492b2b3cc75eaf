"""Meshes of a cycle: the error of its polynomials, and the mesh that spreads it evenly.

On an interval of length h the error is constant * h^(m+1) |u^(m+1)| to leading order, for polynomials of degree m.
u^(m+1) is read off the jumps of the m-th derivative between intervals, as in C. de Boor, "Good approximation by splines
with variable knots II", Lecture Notes in Mathematics 363 (1974) 12-20, and in AUTO.
"""

from __future__ import annotations

import numpy as np

from gsp.collocation.mesh import equidistributed
from gsp.orbits.periodic.collocation import Cycle, OrbitProblem

# More intervals than the estimate asks for.
MARGIN = 1.15
# Fewest intervals: with less a polynomial spans a third of the cycle and no estimate holds.
FEWEST = 12
# Growth of perturbations over one interval, as a power of e.
GROWTH = 2.0


def interval_errors(cycle: Cycle, scales: np.ndarray) -> np.ndarray:
    """Estimated largest error (N,) in each interval, in units of `scales` (n,) or (N, n)."""
    return (_density(cycle, scales) * cycle.widths) ** (cycle.scheme.degree + 1)


def _density(cycle: Cycle, scales: np.ndarray) -> np.ndarray:
    """(constant |u^(m+1)|)^(1/(m+1)) on each interval (N,)."""
    m, h = cycle.scheme.degree, cycle.widths[:, None]
    top = np.einsum("i,jin->jn", cycle.scheme.leading, cycle.values) / h**m
    jump = np.abs(np.roll(top, -1, axis=0) - top) / (0.5 * (h + np.roll(h, -1, axis=0)))
    size = np.maximum(jump, np.roll(jump, 1, axis=0)) / scales
    return (cycle.scheme.constant * size.max(axis=1)) ** (1.0 / (m + 1))


def growth_density(problem: OrbitProblem, cycle: Cycle) -> np.ndarray:
    """Intervals per phase (N,) that resolve growth: over one of them perturbations grow by exp(GROWTH) at most.

    A stretch along a repelling manifold is held there by what grows, which must be as large in the discrete equations
    as it is; without this, canards move the parameter by far more than exp(-c/epsilon). Where more grows than decays
    the same is asked of decay instead, as time reversed makes the one the other.
    """
    real = np.linalg.eigvals(problem.jacobians(cycle)).real
    growth = cycle.period * np.maximum(real.max(axis=2), 0.0).max(axis=1)
    decay = cycle.period * np.maximum(-real.min(axis=2), 0.0).max(axis=1)
    chosen = growth if (growth * cycle.widths).sum() <= (decay * cycle.widths).sum() else decay
    return chosen / GROWTH


def adapted(
    cycle: Cycle, scales: np.ndarray, tolerance: float, *, most: int, least: np.ndarray | float = 0.0
) -> np.ndarray:
    """The mesh that equidistributes the estimated error, with as many intervals as `tolerance` takes.

    `least` (N,) is a number of intervals per phase to be had in any case.
    """
    density, widths = _density(cycle, scales), cycle.widths
    # Averaged over neighbours: an estimate from differences of differences is rough.
    density = (np.roll(density, 1) + 2.0 * density + np.roll(density, -1)) / 4.0
    if not np.isfinite(density).all():
        return cycle.mesh
    # Some points everywhere: the estimate is of leading order only, and layers move along a family.
    density = np.maximum(density, 0.2 * float((density * widths).sum()))
    density = np.maximum(MARGIN * density / tolerance ** (1.0 / (cycle.scheme.degree + 1)), least)
    intervals = float((density * widths).sum())
    if not np.isfinite(intervals):
        return cycle.mesh
    return equidistributed(cycle.mesh, density * widths, int(min(max(np.ceil(intervals), FEWEST), most)))
