"""Meshes that spread a weight evenly."""

from __future__ import annotations

import numpy as np

from gsp.collocation.mesh import equidistributed


def test_every_element_has_the_same_share_of_the_weight() -> None:
    rng = np.random.default_rng(3)
    mesh = np.append(0.0, np.cumsum(rng.uniform(0.1, 1.0, 9)))
    mesh /= mesh[-1]
    weights = rng.uniform(0.0, 5.0, 9) ** 3
    found = equidistributed(mesh, weights, 23)
    assert (found[0], found[-1], len(found)) == (0.0, 1.0, 24)
    # Each weight lies evenly over its element: what is below a place is linear between the points of the old mesh.
    below = np.interp(found, mesh, np.append(0.0, np.cumsum(weights)))
    np.testing.assert_allclose(np.diff(below), weights.sum() / 23, rtol=1e-9)


def test_no_element_is_empty_where_doubles_are_too_few() -> None:
    near = np.nextafter(0.5, 1.0)
    found = equidistributed(np.array([0.0, 0.5, near, 1.0]), np.array([1.0, 1e6, 1.0]), 100)
    assert (np.diff(found) > 0.0).all()
    assert (found[0], found[-1]) == (0.0, 1.0)
    assert len(found) < 10
