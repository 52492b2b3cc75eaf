"""A branch in common units: the same branch, in numbers near 1."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp import SlowFastSystem, solve_critical
from gsp.critical.common_units import common_units, own_sizes

x, y, z, epsilon = sp.symbols("x y z epsilon")


def system(unit: sp.Expr) -> SlowFastSystem:
    return SlowFastSystem(
        slow={x: -x}, fast={y: unit * (x / unit + y / unit - (y / unit) ** 3), z: y - z}, epsilon=epsilon
    )


def test_a_model_of_common_numbers_keeps_its_units() -> None:
    points = np.array([[0.2, 1.0, 100.0], [0.0, np.nan, 0.0]])
    assert common_units(system(sp.Integer(1)), points, np.array([3.0, 0.0])).tolist() == [1.0] * 5


@pytest.mark.parametrize(("sizes", "more"), [([0.2, 1.0, 1e-5], 3.0), ([0.2, 1.0, 1.0], 1e6)])
def test_else_units_are_the_powers_of_two_next_to_its_numbers(sizes, more) -> None:
    units = common_units(system(sp.Integer(1)), np.array([sizes, [0.0, np.nan, 0.0]]), np.array([more, 0.0]))
    assert (np.log2(units) % 1.0 == 0.0).all()
    numbers = np.array([*sizes, more]) / units[:-1]
    assert ((numbers > 0.7) & (numbers < 1.5)).all()
    assert units[-1] == 1.0


@pytest.mark.parametrize("power", [-12, 0, 9])
def test_the_branch_in_its_units_is_the_same_branch(power: int) -> None:
    size = 10.0**power
    (branch,) = solve_critical(system(sp.Integer(10) ** power)).branches
    start, region = {"x": 0.5 * size, "y": 1.2 * size, "z": 1.2 * size}, dict.fromkeys("xyz", (0.0, 2.0 * size))
    sheet = branch.through(start, region=region)
    points = np.array([[0.4, 1.3, 1.3], [0.5, np.nan, 0.0]]) * size
    units = common_units(sheet.system, points)
    own = sheet.moved_into(units)
    assert (own is sheet) == (power == 0)
    places = np.linspace(0.3, 0.6, 4)[:, None] * size
    assert own.points(places / units[0]) * units[1:] == pytest.approx(sheet.points(places), rel=1e-13)


@pytest.mark.parametrize("power", [-9, 0, 9])
def test_a_state_that_is_nothing_has_the_size_at_which_it_matters(power: int) -> None:
    """y = x^2 over x = 0: what is fast is 0 there, and matters where it is as large as the square of x."""
    one = sp.Integer(10) ** power
    (branch,) = solve_critical(
        SlowFastSystem(slow={x: one}, fast={y: x**2 / one - y}, epsilon=epsilon)
    ).branches
    units = common_units(branch.system, np.array([[1.0, 1e-20]]) * 10.0**power)
    assert 0.1 <= units[1] / units[0] <= 10.0


@pytest.mark.parametrize("power", [-9, -6, 3, 9])
def test_states_that_are_all_nothing_have_the_sizes_at_which_the_fast_rates_bend(power: int) -> None:
    # FitzHugh and Nagumo's neuron with a ramp x rests at 0: all units were 1 there, and a ramp was given up at once.
    def sizes(unit: sp.Expr) -> np.ndarray:
        u, v, w = x / unit, y / unit, z / unit
        rate = -v * (v - sp.Rational(1, 10)) * (v - 1) - w + u
        system = SlowFastSystem(slow={x: unit}, fast={y: unit * rate, z: unit * (v - w) / 20}, epsilon=epsilon)
        return own_sizes(system, np.zeros(3))

    assert sizes(sp.Integer(10) ** power) == pytest.approx(10.0**power * sizes(sp.Integer(1)), rel=1e-12)
