"""Where a layer ends: the attracting equilibrium of y' = g(x_0, y, 0) to which a start is led."""

from __future__ import annotations

import numpy as np

from gsp.fibres.layer_flow import LayerFlow
from gsp.fibres.layer_orbit import SPREAD
from gsp.integration.trajectory import trajectory_of

# The first look, in units of the fastest time at the start, and the e-folds of the slowest rate that a layer may have:
# after so many all of it is gone to rounding.
PATIENCE, E_FOLDS = 10.0, 40.0
# The orbit only has to come near: Newton's method makes the point.
RTOL = 1e-8


# A layer that escapes may pass the largest number: infinity lies beyond every bound.
@np.errstate(over="ignore", invalid="ignore")
def end_of_layer(layer: LayerFlow, y: np.ndarray) -> np.ndarray | None:
    """The attracting equilibrium to which the layer from `y` (n_fast,) leads; None where it settles on none.

    Both are in the system's units.
    """
    here = y / layer.units
    matrix = layer.jacobian(here[None, :])[0]
    fastest = np.abs(np.linalg.eigvals(matrix)).max() if np.isfinite(matrix).all() else 0.0
    names = [s.name for s in layer.system.y]
    time = 1.0 / (fastest or 1.0)
    span = PATIENCE * time
    while span <= E_FOLDS * SPREAD * time:
        run = trajectory_of(
            layer.flow(), dict(zip(names, map(float, here))), (0.0, span), rtol=RTOL, atol=0.01 * RTOL
        )
        here = run.y[:, -1]
        if not run.status.ok or not np.isfinite(here).all():
            return None
        landed = attractor_at(layer, here)
        if landed is not None:
            return landed * layer.units
        span *= 2.0
    return None


def attractor_at(layer: LayerFlow, here: np.ndarray) -> np.ndarray | None:
    """The attracting equilibrium at `here`, by Newton's method, in the layer's units; None where there is none yet."""
    y = here.copy()
    for _ in range(20):
        g, g_y = layer.rates(y[None, :])[0], layer.jacobian(y[None, :])[0]
        try:
            step = np.linalg.solve(g_y, g)
        except np.linalg.LinAlgError:
            return None
        y = y - step
        if not np.isfinite(y).all():
            return None
        if np.linalg.norm(step) <= 1e-13 * (1.0 + np.linalg.norm(y)):
            break
    matrix = layer.jacobian(y[None, :])[0]
    near = np.linalg.norm(y - here) <= 1e-4 * (1.0 + np.linalg.norm(y)) and np.isfinite(matrix).all()
    return y if near and np.linalg.eigvals(matrix).real.max() < 0.0 else None
