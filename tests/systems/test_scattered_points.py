"""Halton's points are those of SciPy, bit for bit."""

import numpy as np
import pytest
from scipy.stats import qmc

from gsp.systems.scattered_points import halton


@pytest.mark.parametrize(("dimension", "count"), [(1, 1), (1, 400), (2, 64), (3, 2187), (12, 100), (40, 50)])
def test_points_are_those_of_scipy(dimension: int, count: int) -> None:
    assert np.array_equal(halton(dimension, count), qmc.Halton(d=dimension, scramble=False).random(count))
