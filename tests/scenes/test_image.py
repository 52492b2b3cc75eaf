"""The interval of a slow coordinate over a box of states: exact at corners, else sampled, in digits that are read."""

import sympy as sp

from gsp.scenes.image import image_interval

x, y, p, k = sp.symbols("x y p k")


def test_a_multilinear_coordinate_has_the_decimals_of_its_corners() -> None:
    """1.9 + 0.38 is 2.2800000000000002 in doubles."""
    assert image_interval(p, x + k * y, {x: (0, 1.9), y: (-1, 1)}, {k: sp.Rational("0.38")}) == (-0.38, 2.28)


def test_any_other_is_told_in_no_more_digits_than_its_accuracy_has() -> None:
    low, high = image_interval(p, sp.cos(x) * y, {x: (-1, 1), y: (-sp.pi, sp.pi)}, {})
    assert low == -high
    assert 0 <= high - sp.pi < 1e-7
    assert len(repr(high)) < 12
