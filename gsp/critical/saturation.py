"""Fast variables in which the layer problem saturates: far off it no longer depends on them, as on a switch.

In z' = F(z, phi(s/epsilon)) that holds of v = s/epsilon on either side, where F is one of the two fields X+ and X-.
"""

from __future__ import annotations

import numpy as np

from gsp.critical.layer_problem import LayerProblem

# So far off phi is at its limit, to rounding, along any tail; the fourth power is no overflow yet.
FAR = 1e75
BOTH = (1, -1)


def far_off(u: np.ndarray, column: int, side: int, distance: float = FAR) -> np.ndarray:
    """Points `u` (..., N) with the unknown of `column` far off on a `side`."""
    moved = np.array(u, dtype=float)
    moved[..., column] = side * distance
    return moved


@np.errstate(all="ignore")
def saturates(problem: LayerProblem, u: np.ndarray, column: int) -> bool:
    """Whether g at `u` (N,) tends to values, not all 0, as the unknown of `column` goes to infinity on both sides."""
    for side in BOTH:
        values = [problem.residual(far_off(u, column, side, k * FAR)) for k in (1.0, 2.0)]
        if not (np.isfinite(values).all() and np.allclose(*values, rtol=1e-12, atol=0.0)):
            return False
    here = problem.residual(far_off(u, column, BOTH[0]))
    return not np.array_equal(here, problem.residual(u))
