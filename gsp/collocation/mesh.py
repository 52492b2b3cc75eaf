"""Meshes on the unit interval that spread a weight evenly over their elements."""

from __future__ import annotations

import numpy as np


def equidistributed(mesh: np.ndarray, weights: np.ndarray, elements: int) -> np.ndarray:
    """The mesh (at most elements + 1,) of equal shares of `weights` (m,), each even over its element of `mesh`."""
    total = np.append(0.0, np.cumsum(weights))
    found = np.interp(np.linspace(0.0, total[-1], elements + 1), total, mesh)
    found[0], found[-1] = 0.0, 1.0
    # Where more points are wanted than there are places in double precision, those that there are.
    return np.unique(found)
