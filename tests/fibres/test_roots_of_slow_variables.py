"""Layers that begin where a slow variable is at the zero of its root, or on its kink: series that end, and say so."""

import numpy as np
import pytest
import sympy as sp

from gsp.choice.choice import choose
from gsp.choice.verdict import Answer
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import DeclarationError, UnsupportedFunctionError
from gsp.fibres.base_points import project
from gsp.fibres.composite_solution import composite
from gsp.fibres.inner_expansion import expand_inner
from gsp.integration.methods import Method
from gsp.integration.trajectory import integrate
from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem
from tests.cases import crossed
from tests.example_systems import epsilon, x, y

ONE = sp.Integer(1)
START = {"x": 0, "y": 1}


def declared(f, g) -> SlowFastSystem:
    return SlowFastSystem(slow={x: f}, fast={y: g}, epsilon=epsilon)


def scene(f, g, **changes) -> Scene:
    options = {"region": {"x": (0, 4)}, "start": START, "span": (0, 1), "epsilon": 0.01, "tolerance": 1e-2}
    return Scene(declared(f, g), **{**options, **changes})


@pytest.mark.parametrize(
    ("power", "order"), [("5/2", 3), ("3/2", 2), ("1/2", 1), ("1/3", 1), ("7/3", 3), ("pi", 4)]
)
def test_the_series_goes_as_far_as_the_power_vanishes(power: str, order: int) -> None:
    # X = epsilon tau + ..., so that x^p = O(epsilon^p) adds to no coefficient of g below epsilon^p.
    p = sp.pi if power == "pi" else sp.Rational(power)
    f = 1 + y / 3
    (rooted,), (plain,) = (solve_critical(declared(f, g)).branches for g in (-y + x**p - x * y, -y - x * y))
    found = expand_inner(rooted, START, order=5)
    exact = expand_inner(plain, START, order=order).base["x"]
    assert found.order == order
    assert [float(b) for b in found.base["x"]] == pytest.approx([float(b) for b in exact], rel=1e-12)
    assert "no power series in epsilon" in found.ending
    with pytest.raises(DeclarationError, match="known through order"):
        found.require(order + 1)


def test_what_the_series_leaves_out_is_of_the_order_that_it_says() -> None:
    # x' = 1 + y and y = -y + x^(3/2) ... : X is known through epsilon^2, and what is left falls like epsilon^(5/2).
    system = declared(1 + y, -y + x ** sp.Rational(3, 2))
    (branch,) = solve_critical(system).branches
    terms, tau = expand_inner(branch, START, order=4).terms["x"], np.array([3.0])
    values = [float((u.decaying(tau) + np.polyval([float(c) for c in u.outer[::-1]], tau))[0]) for u in terms]
    sizes, left = (4e-3, 1e-3), []
    for small in sizes:
        span, method = (0, small * 3.0), Method.DOP853
        full = integrate(system, start=START, span=span, epsilon=small, rtol=1e-13, atol=1e-15, method=method)
        left.append(abs(full["x"][-1] - sum(small**k * value for k, value in enumerate(values))))
    assert np.log(left[0] / left[1]) / np.log(sizes[0] / sizes[1]) == pytest.approx(2.5, abs=0.1)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("slow", "power", "where"),
    crossed([ONE, 1 - x, 1 + x**2], [sp.Rational(5, 2), sp.Rational(3, 2)], ["fast", "slow"]),
)
def test_a_scene_that_starts_at_the_zero_of_a_power_is_reduced_as_one_beside_it(slow, power, where) -> None:
    f, g = (slow + y * 0, -y + x**power) if where == "fast" else (slow + x**power, -y + x)
    at, beside = (choose(scene(f, g, start={"x": s, "y": 1})) for s in (0, 1e-3))
    assert at.verdict.answer is not Answer.NO
    assert at.measured < 1e-2
    assert beside.verdict.answer is not Answer.NO
    # The same question is answered by `project`.
    assert project(at.study.branch, START, epsilon=0.01)["x"] == pytest.approx(0.0, abs=1e-12)


def test_where_a_base_point_lies_beyond_the_root_it_is_told_that_no_higher_order_begins() -> None:
    # b_1 = -1: the runs of order 1 and more would begin at x < 0, and that of order 0 at x = 0.
    found = choose(scene(1 - y + x ** sp.Rational(5, 2), x - y))
    assert found.verdict.answer is Answer.NO
    assert "nothing tells its error" in found.verdict.accuracy
    assert "The series of the layer from x = 0, y = 1 is known through order 3" in found.verdict.accuracy
    assert project(found.study.branch, START, epsilon=0.01, order=1)["x"] == pytest.approx(-0.01)


@pytest.mark.exhaustive
@pytest.mark.parametrize("g", [-y + sp.sqrt(x), -y + x ** sp.Rational(1, 3)])
def test_a_root_whose_slope_is_infinite_at_the_start_is_no_obstacle(g) -> None:
    found = choose(scene(1 + y / 50, g, tolerance=0.1))
    assert "cannot be reduced" not in found.verdict.accuracy
    assert "normal rate" not in found.verdict.accuracy
    base = project(found.study.branch, START, epsilon=0.01, order=0)
    assert (base["x"], base.order) == (0.0, 0)


def test_an_error_that_no_term_tells_is_not_a_number() -> None:
    (branch,) = solve_critical(declared(ONE, -y + sp.sqrt(x))).branches
    found = project(branch, START, epsilon=0.01)
    assert np.isnan(found.error)
    assert "error not told" in str(found)


@pytest.mark.parametrize("g", [-y + sp.Max(x, 0), -y + sp.Abs(x) ** sp.Rational(3, 2), -y + sp.Abs(x) / 2])
def test_a_start_on_a_kink_is_known_as_far_as_its_sides_agree(g) -> None:
    (branch,) = solve_critical(declared(1 + y, g)).branches
    found = expand_inner(branch, START, order=4)
    assert found.order == 1
    assert [float(b) for b in found.base["x"]] == pytest.approx([0.0, 1.0])


def test_a_start_on_a_jump_is_refused_as_before() -> None:
    (branch,) = solve_critical(declared(1 + sp.sign(x) / 2, x - y)).branches
    with pytest.raises(UnsupportedFunctionError, match="no power series across that kink"):
        expand_inner(branch, START, order=2)


def test_a_composite_goes_as_far_as_its_fast_part_is_known() -> None:
    (branch,) = solve_critical(declared(ONE, -y + x ** sp.Rational(5, 2))).branches
    with pytest.raises(DeclarationError, match="known through order 3"):
        composite(branch, START, span=(0, 1), epsilon=0.01, order=3)
    # Y = x^(5/2) - (5/2) epsilon x^(3/2) + exp(-tau) to epsilon^2.
    found = composite(branch, START, span=(0, 1), epsilon=0.01, order=1)
    assert found.at(0.5)[1] == pytest.approx(0.5**2.5 - 0.025 * 0.5**1.5, abs=1e-9)
