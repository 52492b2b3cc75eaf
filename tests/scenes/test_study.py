"""A scene placed in standard form: its start, region and branch in slow and fast coordinates."""

from dataclasses import replace

import pytest
import sympy as sp

from gsp import models
from gsp.errors import BranchError, DeclarationError, SplittingError
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of
from gsp.systems.system import SlowFastSystem, VectorField

x, y, z, eps = sp.symbols("x y z epsilon")


def scene(field, **changes) -> Scene:
    values = {
        "region": {"x": (-1, 1), "y": (-2, 2)},
        "start": {"x": 0.5, "y": 0.5},
        "span": (0, 1),
        "epsilon": 0.01,
        "epsilons": (0.02, 0.01),
        "tolerance": 1e-6,
    }
    return Scene(field, **{**values, **changes})


def test_the_sleigh_is_placed_in_its_slow_momentum() -> None:
    home = models.load("chaplygin_sleigh")
    study = study_of(home)
    omega, w = home.start["omega"], home.start["w"]
    assert study.start["p"] == pytest.approx(1.04 * omega + 0.2 * w)
    # p = J omega + m a w is linear, so the hull of the box is attained at its corners.
    low, high = study.region["p"]
    assert (low, high) == pytest.approx((-1.04 * 2 - 0.2, 1.04 * 2 + 0.2))
    assert study.region["w"] == (-1.0, 1.0)


def test_a_standard_system_keeps_its_names_and_numbers() -> None:
    home = models.load("michaelis_menten")
    study = study_of(home)
    assert study.splitting is None
    assert study.start == home.start
    assert study.region == home.region


def test_the_sheet_is_the_one_nearest_to_the_start() -> None:
    left = replace(models.load("van_der_pol"), start={"x": 2.0, "y": 0.5})
    assert study_of(left).branch.points({"y": 0.5})[0] > 1


def test_a_nonlinear_slow_coordinate_gets_the_hull_of_sampled_points() -> None:
    field = VectorField({x: (y - x**2) / eps, y: x * (y - x**2) / eps + 1}, epsilon=eps)
    study = study_of(scene(field, region={"x": (0.5, 1), "y": (-2, 2)}, start={"x": 0.7, "y": 0.5}))
    assert study.region["p"] == pytest.approx((0.25 - 4, 1 + 4))


def test_a_raw_state_without_an_interval_is_named() -> None:
    field = VectorField({x: (y - x) / eps, y: (x - y) / eps - y}, epsilon=eps)
    with pytest.raises(DeclarationError, match=r"no interval for x.*p = x \+ y"):
        study_of(scene(field, region={"y": (-2, 2)}))


def test_a_field_that_stays_non_standard_is_refused_with_its_leading_order() -> None:
    fast = x - y
    field = VectorField(
        {x: (y + x**2 + sp.sin(x * y) + 5) * fast / eps, y: (x**3 + sp.cos(y) + 9) * fast / eps + 1},
        epsilon=eps,
    )
    with pytest.raises(SplittingError, match="no standard form"):
        study_of(scene(field))


def test_a_branch_that_has_vanished_is_refused() -> None:
    system = SlowFastSystem(slow={x: -x}, fast={y: y**2 + x**2 + 1}, epsilon=eps)
    with pytest.raises(BranchError, match="no real"):
        study_of(scene(system))
