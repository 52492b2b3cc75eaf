"""What methods for slow manifolds are measured against: orbit segments through the very points, or pointwise values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.common_units import common_units
from gsp.errors import DeclarationError, Status
from gsp.slow.orbit_segments import Segments, SegmentSolver
from gsp.slow.slow_points import zero_derivative
from gsp.slow.solved_manifold import SAFETY


@dataclass(frozen=True, eq=False)
class Reference:
    """h (m, n_fast) at the points, its largest `error`, where it is from, and how far the other route is from it.

    `second_route` is nan where that has no value at some point.
    """

    y: np.ndarray
    error: float
    source: str
    second_route: float


def reference_at(branch: Branch, x: np.ndarray, epsilon: float) -> Reference:
    """The slow manifold over the points `x` (m, n_slow), as exactly as it can be had.

    Orbit segments of the full flow through the points themselves, so that no surface has to be resolved between them;
    the zero-derivative principle where its estimated error is the smaller one at the worst point. That knows the field
    at the point alone: where it is further from the segments than the errors of both, as beside a kink, it is no
    reference. Raises `DeclarationError` when neither gives values.
    """
    pointwise = zero_derivative(branch, x, epsilon=epsilon, tolerance=1e-15)
    start = branch.points(x)
    # Segments are solved, and rounding is measured, where the numbers of each state are common ones.
    units = common_units(branch.system, np.hstack([x, start]))
    x_units, y_units = np.split(units, [x.shape[1]])
    segments = _segments(branch.moved_into(units), x / x_units, start / y_units, epsilon)
    along = _Route("orbit segments", np.full_like(start, np.nan), np.inf)
    why = "the points are not on one kind of normally hyperbolic branch"
    if segments is not None:
        error = SAFETY * float(segments.error.max() * y_units.max())
        along = _Route("orbit segments", segments.y * y_units, error)
        worst = int(np.argmax(segments.error))
        place = branch.system.place(zip(branch.system.x, x[worst]))
        why = f"orbit segments fail at {place}: {segments.status[worst].meaning}"
    settled = pointwise.status is Status.SUCCESS
    principle = _Route(
        "zero-derivative principle", pointwise.y, float(np.max(pointwise.error)) if settled else np.inf
    )
    apart = float(np.abs(along.y - principle.y).max())
    is_local = apart > along.error + principle.error
    best = along if is_local else min(along, principle, key=lambda route: route.error)
    if not best.error < np.inf:
        raise DeclarationError(
            f"there is no reference at {branch.system.epsilon} = {epsilon:g}: {why}; {pointwise.message}.",
            "Move the points, shrink the region or take smaller epsilons.",
        )
    rounding = 4 * float(np.finfo(float).eps) * float((y_units + np.abs(best.y)).max())
    return Reference(best.y, max(best.error, rounding), best.name, apart)


class _Route(NamedTuple):
    """One way to h at the points, and its estimated error at the worst of them."""

    name: str
    y: np.ndarray
    error: float


def _segments(branch: Branch, x: np.ndarray, start: np.ndarray, epsilon: float) -> Segments | None:
    """Segments through all points; None where M0 is not of one type there."""

    def solver(unstable: int) -> SegmentSolver:
        # Tolerance of the segments, which is near rounding.
        return SegmentSolver(branch, epsilon=epsilon, unstable=unstable, tolerance=1e-13)

    real = np.real(np.linalg.eigvals(solver(0).fast_jacobian(np.hstack([x, start]))))
    counts = np.unique((real > 0).sum(axis=1))
    if len(counts) > 1 or (real == 0).any():
        return None
    return solver(int(counts[0])).solve(x, start)
