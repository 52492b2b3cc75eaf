"""Curves are joined where the function goes on, and a line of zeros is no line of poles."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp import SlowFastSystem, analyse, charts
from gsp.charts.continuity import are_joined
from gsp.charts.critical_lines import critical_lines
from gsp.scenes.scene import Scene

x, y, epsilon = sp.symbols("x y epsilon")
PLACE = 0.70711
STEPS = np.linspace(-1.0, 2.0, 400)[:, None]


def breaks(function) -> list[float]:
    """Where a function of [-1, 2] is not joined to itself, in the middle of the step."""
    with np.errstate(all="ignore"):
        joined = are_joined(lambda at: function(at[:, 0]), STEPS[:-1], STEPS[1:])
    return ((STEPS[:-1] + STEPS[1:]) / 2)[~joined, 0].tolist()


@pytest.mark.parametrize(
    "function",
    [
        lambda t: 1 / (t - PLACE),
        lambda t: 3 * t - 1e-4 / (t - PLACE),
        lambda t: np.tan(t - PLACE + np.pi / 2),
        lambda t: np.sign(t - PLACE),
        lambda t: t + np.sign(t - PLACE) / 4,
        lambda t: np.where(t < PLACE, t, t + 1),
        lambda t: np.exp(np.minimum(1 / (t - PLACE), 700)),
    ],
)
def test_a_function_is_not_joined_across_a_pole_or_a_jump(function) -> None:
    assert breaks(function) == pytest.approx([PLACE], abs=3 / 399)


@pytest.mark.parametrize(
    "function",
    [
        lambda t: t**2,
        lambda t: np.sin(40 * t),
        lambda t: np.abs(t - PLACE),
        lambda t: np.cbrt(t - PLACE),
        lambda t: np.sqrt(np.abs(t - PLACE)),
        lambda t: np.tanh(1e8 * (t - PLACE)),
        lambda t: 1 / (1e-8 + np.abs(t - PLACE)),
        lambda t: np.ones_like(t),
    ],
)
def test_a_function_that_goes_on_is_joined_however_steep(function) -> None:
    assert breaks(function) == []


def test_nothing_is_joined_to_what_is_no_number_and_only_steps_that_are_steep_are_looked_into() -> None:
    looked = []

    def root(at: np.ndarray) -> np.ndarray:
        looked.append(len(at))
        with np.errstate(invalid="ignore"):
            return np.sqrt(at[:, 0])

    joined = are_joined(root, STEPS[:-1], STEPS[1:], seen=0.05)
    np.testing.assert_array_equal(joined, STEPS[:-1, 0] >= 0)
    assert sum(looked[2:]) < 10


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("g", "sheets"),
    [
        (y - x**2 / (3 * x - 1), 1),
        (x**2 - (3 * x - 1) * y, 1),
        (y - x + sp.Rational(1, 10**4) / (3 * x - 1), 1),
        (sp.sign(3 * x - 1) - y, 1),
        (sp.tan(5 * y) - x, 5),
        ((y - x / 2) * (y + 1) / (3 * x - 1), 2),
        ((y - x / 2) * (1 + sp.Rational(1, 10) / (y + x**2)), 2),
    ],
)
def test_lines_of_the_critical_manifold_are_its_zeros_all_of_them_and_no_poles(g: sp.Expr, sheets: int) -> None:
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: g}, epsilon=epsilon)
    low, high = np.array([-1.0, -1.5]), np.array([1.0, 1.5])
    lines = critical_lines(system, low, high)
    # To a cell of the mesh each point of a line has a change of sign of the numerator beside it.
    numerator = sp.lambdify((x, y), sp.fraction(sp.together(g.rewrite(sp.cos)))[0], "numpy")
    ways = (np.array(list(np.ndindex(3, 3))) - 1) * (high - low) / 399
    signs = [np.sign(numerator(*(np.concatenate(lines) + way).T)) for way in ways]
    assert (np.ptp(signs, axis=0) > 0).all()
    # And each vertical is met as often as there are sheets.
    for at in (-0.83, -0.111, 0.62, 0.871):
        values = numerator(at, np.linspace(low[1], high[1], 20001))
        expected = int((np.diff(np.sign(values)) != 0).sum())
        assert sum(int((np.diff(line[:, 0] > at)).sum()) for line in lines) == expected
        assert expected <= sheets


@pytest.mark.exhaustive
@pytest.mark.parametrize("rate", [sp.sign(x - sp.Rational(1, 3)) - y, sp.Abs(3 * x - 1) / (3 * x - 1) - y])
def test_the_slow_manifold_is_not_drawn_across_a_jump(rate: sp.Expr) -> None:
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: rate}, epsilon=epsilon)
    scene = Scene(system, region={"x": (0, 1)}, start={"x": 0.5, "y": 0}, span=(0, 0.2), epsilon=0.02)
    analysis = analyse(scene)
    for draw in (charts.manifold, charts.phase_portrait):
        drawn = draw(analysis).lines
        curves = [line for line in drawn if "M_" in line.get_label() or "critical" in line.get_label()]
        assert len(curves) >= 2
        for curve in curves:
            heights = np.asarray(curve.get_ydata(), dtype=float)
            assert np.nanmax(np.abs(np.diff(heights))) < 0.1
