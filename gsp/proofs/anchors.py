"""Where a branch is known: a point over the region, found by doubles, and a ball that is proved to hold it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import sympy as sp
from flint import arb

from gsp.critical.branch import Branch
from gsp.errors import BranchError, UnsupportedFunctionError
from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction
from gsp.proofs.covering import unstable_near
from gsp.proofs.equations import EnclosedEquations
from gsp.proofs.tubes import Box, enclose, middle_of
from gsp.systems.scattered_points import PLACES, halton


def point_over(
    branch: Branch, equations: EnclosedEquations, box: Box, fast: Mapping[str, tuple[float, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """A point (x, y) of the branch in the box, as near the middle as it is found, by doubles.

    Where there is one that has no eigenvalue on the imaginary axis it is of these: the others have no type.
    """
    low, high = np.array(box).T
    own = len(branch.system.x)
    defaults = [float(branch.system.parameters[p]) for p in equations.x[own:]]
    unit = halton(len(box), PLACES)
    unit = unit[np.argsort(np.abs(unit - 0.5).max(axis=1), kind="stable")]
    reason: BranchError | None = None
    without_type: tuple[np.ndarray, np.ndarray] | None = None
    for x in [middle_of(box), *(low + unit * (high - low))]:
        try:
            y = _point(branch, x[:own], fast)
        except BranchError as error:
            reason = reason or error
            continue
        if y is None:
            continue
        # The branch is known at the system's own parameter values; from there it is followed to those of the box.
        found = equations.followed(np.concatenate([x[:own], defaults]), x, y)
        if found is None or found[0] != 1.0:
            continue
        if unstable_near(equations, x, found[1]) >= 0:
            return x, found[1]
        without_type = without_type or (x, found[1])
    if without_type is not None:
        return without_type
    raise reason or BranchError(
        f"the branch {branch} has no real point that was found in the region.",
        "Move the region, or start near another branch.",
    )


def _point(branch: Branch, x: np.ndarray, fast: Mapping[str, tuple[float, float]]) -> np.ndarray | None:
    if branch.seed is not None or not fast:
        y = branch.points(x[None])[0]
    else:
        roots = branch.roots(x[None], bounds=fast)
        if len(roots) > 1:
            raise BranchError(
                f"the branch {branch} has {len(roots)} sheets within the bounds on {', '.join(fast)}.",
                "Fix one with branch.through({...}), or tighten the bounds.",
            )
        if not len(roots):
            return None
        y = roots[0]
    names = [s.name for s in branch.system.y]
    inside = all(fast[n][0] <= v <= fast[n][1] for n, v in zip(names, y) if n in fast)
    return y if inside and np.isfinite(y).all() else None


def ball_at(
    equations: EnclosedEquations, point: tuple[np.ndarray, np.ndarray], graph: tuple[sp.Expr, ...] | None
) -> list[arb] | None:
    """A ball (m,) that holds the branch's point over x, proved; None where it is not.

    Of an explicit branch it is the value of its `graph`. Of an implicit one the only zero near the point that was
    found, and that it is meant is what doubles say.
    """
    x, y = point
    if graph is not None:
        try:
            heights = BallFunction(equations.x, graph)([balls.exact(float(v)) for v in x])
        except UnsupportedFunctionError:
            heights = []
        if heights and all(value.is_finite() for value in heights):
            return heights
    tube = enclose(equations, tuple((float(v), float(v)) for v in x), y)
    return None if tube is None else tube.over([balls.exact(float(v)) for v in x])
