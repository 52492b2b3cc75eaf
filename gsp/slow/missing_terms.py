"""Why a term of a series has no value at a point."""

from __future__ import annotations

import numpy as np

from gsp.critical.critical_manifold import Branch
from gsp.critical.sampling import Sampler
from gsp.errors import HyperbolicityError


def without_value(branch: Branch, x: np.ndarray, terms: np.ndarray) -> HyperbolicityError:
    """Why a term is not finite over x (n,), where they are `terms` (k, n_fast)."""
    place = branch.system.place(zip(branch.system.x, x))
    g_y = Sampler(branch).fast_jacobian(np.concatenate([x, terms[0]])[None, :])[0]
    if np.isfinite(g_y).all() and np.linalg.matrix_rank(g_y) == len(g_y):
        order = int(np.argmin(np.isfinite(terms).all(axis=1)))
        return HyperbolicityError(
            f"the term of order {order} has no value in double precision at {place}, where powers in it are too large "
            "or too small.",
            "Take a lower order, or count states and parameters in units in which they are near 1.",
        )
    return HyperbolicityError(
        f"the series is singular at {place}: the fast Jacobian or a denominator vanishes there.",
        "Stay on the normally hyperbolic part of the branch; classify() says where that is.",
    )
