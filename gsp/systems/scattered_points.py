"""Points that fill a box evenly, the same in every run."""

from __future__ import annotations

import numpy as np
import sympy as sp

# Places at which a box is looked at where no structure says where: a few seen in each direction of six.
PLACES = 64


def halton(dimension: int, count: int) -> np.ndarray:
    """The first `count` points of Halton's sequence in the unit cube, (count, dimension), the origin first.

    Coordinate j of point i has the digits of i in the j-th prime base behind its point, in reverse (J. H. Halton,
    Numer. Math. 2, 1960). They are those of `scipy.stats.qmc.Halton`, whose package takes half a second to import.

    >>> halton(2, 4)[:, 0]
    array([0.  , 0.5 , 0.25, 0.75])
    """
    points = np.zeros((count, dimension))
    for j in range(dimension):
        base = int(sp.prime(j + 1))
        left, weight = np.arange(count), 1.0 / base
        while left.any():
            left, digits = np.divmod(left, base)
            points[:, j] += digits * weight
            weight /= base
    return points
