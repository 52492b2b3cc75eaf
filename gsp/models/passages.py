"""Passages through a loss of normal hyperbolicity."""

from __future__ import annotations

import sympy as sp

from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem


def shishkova() -> Scene:
    """tau' = 1, epsilon z' = (tau + i) z + epsilon a with z = x + i y: a pair of eigenvalues lost at tau = 0.

    The critical manifold z = 0 attracts for tau < 0. With a = 0 it is invariant, and a run that comes in at
    tau = -T leaves it at tau = T. With a = 1 the slow manifold of tau < 0 and that of tau > 0 differ by a multiple
    of exp(-1/(2 epsilon)), so that no run stays beyond the buffer point tau = 1. `distance` is |z|. The span ends
    before the loss.

    Source: M. A. Shishkova, "Examination of a system of differential equations with a small parameter in the
    highest derivatives", Soviet Mathematics Doklady 14 (1973) 483-487; A. I. Neishtadt, "Persistence of stability
    loss for dynamical bifurcations I", Differential Equations 23 (1987) 1385-1391.
    """
    tau, x, y, a, distance, epsilon = sp.symbols("tau x y a distance epsilon")
    return Scene(
        SlowFastSystem(
            slow={tau: sp.Integer(1)},
            fast={x: tau * x - y + epsilon * a, y: x + tau * y},
            epsilon=epsilon,
            parameters={a: sp.Integer(1)},
            observables={distance: sp.sqrt(x**2 + y**2)},
            name="shishkova",
        ),
        region={"tau": (-2, -0.5), "x": (-1, 1), "y": (-1, 1)},
        start={"tau": -2, "x": 0.5, "y": 0},
        span=(0, 1.4),
        epsilon=0.05,
        source=(
            "M. A. Shishkova, Soviet Mathematics Doklady 14 (1973) 483-487; A. I. Neishtadt, Differential Equations "
            "23 (1987) 1385-1391"
        ),
        description="A focus loses its stability, and runs leave it late: at the way out, or at the buffer point.",
    )
