"""Base points and sheets in units in which the states are tiny: relative errors are what they are in others."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp import SlowFastSystem, project, solve_critical
from gsp.slow.truncation import errors, units

x, y, epsilon = sp.symbols("x y epsilon", real=True)


def scaled(unit: sp.Expr) -> SlowFastSystem:
    """Van der Pol's system with both states in `unit`."""
    X, Y = x / unit, y / unit
    return SlowFastSystem(slow={x: -unit * Y}, fast={y: unit * (X - Y**3 / 3 + Y)}, epsilon=epsilon)


@pytest.mark.parametrize("power", [-6, -9])
def test_points_of_an_implicit_sheet_have_all_their_digits(power: int) -> None:
    unit = 10.0**power
    (branch,) = solve_critical(scaled(sp.Integer(10) ** power)).branches
    sheet = branch.through({"x": 0.3 * unit, "y": 1.5 * unit})
    places = np.array([-0.5, 0.1, 0.7])
    exact = np.array([np.roots([-1 / 3, 0.0, 1.0, value]).real.max() for value in places])
    assert sheet.points({"x": places * unit}).ravel() / unit == pytest.approx(exact, rel=1e-14)
    each = [sheet.points({"x": float(value) * unit})[0] / unit for value in places]
    assert each == pytest.approx(exact, rel=1e-14)


def test_a_layer_of_tiny_states_is_not_taken_for_a_linear_one() -> None:
    found = []
    for power in (0, -9):
        unit = 10.0**power
        (branch,) = solve_critical(scaled(sp.Integer(10) ** power)).branches
        start = {"x": 0.3 * unit, "y": 1.5 * unit}
        found.append(project(branch.through(start), start, epsilon=0.01, order=2)["x"] / unit)
    assert abs(found[0] - 0.3) > 1e-3
    assert found[1] == pytest.approx(found[0], rel=1e-12)


def test_rounding_is_a_share_of_tiny_states_too() -> None:
    sizes = np.array([[1.0, 1e-6, 1e-12, 1e-18, 1e-24]])
    plain = errors(sizes, 2, unit=units(np.array([[1.0]])))
    tiny = errors(1e-9 * sizes, 2, unit=units(np.array([[1e-9]])))
    assert tiny == pytest.approx(1e-9 * plain, rel=1e-12)
