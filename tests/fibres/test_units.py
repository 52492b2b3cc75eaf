"""Base points and sheets in units in which the states are tiny: relative errors are what they are in others."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp import SlowFastSystem, project, solve_critical, solve_manifold, zero_derivative
from gsp.slow.truncation import errors, units
from tests.rescaling import in_units

x, y, w, epsilon = sp.symbols("x y w epsilon")
SYSTEMS = {
    "implicit": ({x: y}, {y: x - y**3 / 3 + y}, {"x": 0.3, "y": 1.5}, {"x": (0.2, 0.8)}),
    "of nothing at 0": ({x: -x}, {y: x**2 - y}, {"x": 1.0, "y": 0.0}, {"x": (-0.5, 1.5)}),
    "two slow": (
        {x: w - x, w: -x * y},
        {y: x + w - y - y**3 / 5},
        {"x": 1.0, "w": 0.5, "y": 1.0},
        {"x": (0.5, 1.2), "w": (0.1, 0.7)},
    ),
}


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


def answers(name: str, powers: dict[str, int]) -> dict[str, np.ndarray]:
    """Points, base points and their errors of one system, all in the units of its declaration."""
    slow, fast, start, region = SYSTEMS[name]
    sizes = {n: 10.0**power for n, power in powers.items()}
    (branch,) = solve_critical(
        SlowFastSystem(slow=in_units(slow, powers), fast=in_units(fast, powers), epsilon=epsilon)
    ).branches
    start = {n: value * sizes[n] for n, value in start.items()}
    places = {n: start[n] for n in region}
    box = {n: (low * sizes[n], high * sizes[n]) for n, (low, high) in region.items()}
    branch = branch if branch.is_explicit else branch.through(start, region=box)
    solved = solve_manifold(branch, region=box, epsilon=0.02, tolerance=1e-11)
    found = {
        "pointwise": zero_derivative(branch, places, epsilon=0.02).y / sizes["y"],
        "solved": solved.evaluate(places) / sizes["y"],
        "estimate": np.array([solved.error_estimate / sizes["y"] < 1e-6]),
    }
    for route, words in {"series": {}, "shadowing": {"numeric": True}, "surface": {"numeric": True}}.items():
        manifold = solved if route == "surface" else branch
        base = project(manifold, start, epsilon=0.02 if route == "surface" else 0.01, **words)
        found[route] = np.array([base[n] / sizes[n] for n in region])
        found[f"errors by {route}"] = np.array([base.errors[n] / sizes[n] < 1e-3 for n in region])
    return found


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("powers", [(-13, -13), (-9, 9), (9, -9), (13, 13)])
def test_points_surfaces_and_base_points_have_the_same_digits_in_all_units(
    name: str, powers: tuple[int, int]
) -> None:
    """Picomoles and gigawatts: every digit that is told in other units, of each state whatever the others' are."""
    states = [s.name for part in SYSTEMS[name][:2] for s in part]
    plain = answers(name, dict.fromkeys(states, 0))
    other = answers(name, {n: powers[n == "y"] for n in states})
    for what, value in plain.items():
        assert other[what] == pytest.approx(value, rel=1e-9), what
