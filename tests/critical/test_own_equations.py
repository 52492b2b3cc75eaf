"""Points of implicit branches about the centres of their system: where the origin lies costs no digits."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.continuation.curve_continuation import continue_critical
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import Status
from gsp.systems.system import SlowFastSystem

x, y, z, eps = sp.symbols("x y z epsilon")


def shifted(fast: dict, by: int) -> SlowFastSystem:
    """x' = 1 beside the `fast` rates, with every state's numbers greater by that much."""
    back = {s: s - by for s in (x, y, z)}
    return SlowFastSystem(slow={x: 1}, fast={s: e.xreplace(back) for s, e in fast.items()}, epsilon=eps)


OTHER = 3 * x - 2 * y
ONE = {y: 50 * OTHER**2 * y**4 + (1 + OTHER**2) * (2 + y**4) * (OTHER - 6 * y**2)}
TWO = {y: x + z - sp.exp(y) - y**3, z: y - z - z**5 / 9}


@pytest.mark.parametrize("fast", [ONE, TWO])
@pytest.mark.parametrize("by", [1_000, -1_000_000])
def test_points_are_as_exact_as_they_can_be_written(fast: dict, by: int) -> None:
    box = {s.name: (-4.0, 4.0) for s in fast}
    far = {name: (low + by, high + by) for name, (low, high) in box.items()}
    places = np.linspace(0.4, 0.6, 5)
    for at in places + by:
        # What is left of the place where it is written far from the origin.
        expected = solve_critical(shifted(fast, 0)).branches[0].roots(np.array([[at - by]]), bounds=box)
        found = solve_critical(shifted(fast, by)).branches[0].roots(np.array([[at]]), bounds=far)
        assert found - by == pytest.approx(expected, rel=1e-11, abs=abs(by) * np.finfo(float).eps)


@pytest.mark.parametrize("fast", [ONE, TWO])
def test_a_sheet_is_followed_as_far_as_it_goes(fast: dict) -> None:
    by, seeds = 1_000_000, []
    for branch, shift in ((solve_critical(shifted(fast, c)).branches[0], c) for c in (0, by)):
        sheet = branch.through({x: 0.5 + shift, **dict.fromkeys(fast, 0.5 + shift)})
        followed, good = sheet.follow(np.linspace(0.5, 0.8, 7)[:, None] + shift)
        assert good.all()
        seeds.append(followed - shift)
    assert seeds[1] == pytest.approx(seeds[0], abs=4 * by * np.finfo(float).eps)


@pytest.mark.parametrize("by", [1_000, -1_000_000])
def test_curves_have_the_folds_that_they_have_at_the_origin(by: int) -> None:
    """One in a corner that is 500 times narrower than the box, which is passed where steps are too long."""
    rate = sp.Rational(2, 3) * x * (sp.Rational(1, 1250) - y) / (sp.Rational(1, 1250) + y) + y * (1 - y)
    near = continue_critical(
        shifted({y: rate}, 0), start={"x": 0.1, "y": 0.9}, bounds={"x": (-0.5, 0.8), "y": (-0.1, 1.7)}
    )
    far = continue_critical(
        shifted({y: rate}, by),
        start={"x": 0.1 + by, "y": 0.9 + by},
        bounds={"x": (-0.5 + by, 0.8 + by), "y": (-0.1 + by, 1.7 + by)},
    )
    assert [point.kind for point in far.special] == [point.kind for point in near.special]
    assert len(near.special) == 2
    for one, other in zip(near.special, far.special):
        assert other["y"] - by == pytest.approx(one["y"], abs=1e-8)


def test_a_curve_far_from_the_origin_has_not_run_away() -> None:
    by, width = 1_000_000, 0.1
    system = shifted({y: x - y - y**3}, by)
    curve = continue_critical(
        system,
        start={"x": by, "y": by},
        bounds={"x": (by - width, by + width), "y": (by - width, by + width)},
    )
    assert {stop.ending for stop in curve.stops} == {Status.BOUND_REACHED}
