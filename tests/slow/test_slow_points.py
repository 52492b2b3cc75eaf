"""The zero-derivative principle: its theorem, its agreement with other routes, and its honesty."""

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.errors import BranchError, DeclarationError, Status, UnsupportedFunctionError
from gsp.slow.series import expand
from gsp.slow.slow_points import zero_derivative
from gsp.systems.system import SlowFastSystem
from tests import example_systems as systems
from tests.example_systems import epsilon, x, y, z

# Followed forward from large s, in 40 digits, epsilon = 0.1; s = 1/10, 1/2, 1, 5.
MICHAELIS_MENTEN = [
    [0.09425575388359942063535],
    [0.3380962858730661398517],
    [0.5030315116239185527709],
    [0.8335251284935477027363],
]
# w over (v, p/J) = (1, 1), (-1, 1), (1/2, -2) at epsilon = 0.1, by Newton's method in 40 digits.
SLEIGH = [[-0.0987164908384117188756], [0.0950569759766681569363], [0.0847862203708975205359]]
SLEIGH_POINTS = [[1, 1.04], [-1, 1.04], [0.5, -2.08]]


def branch_of(system, point=None):
    branch = solve_critical(system).branches[0]
    return branch.through(point) if point else branch


CASES = {
    "explicit": (branch_of(systems.michaelis_menten()), [[0.3], [1.0], [2.0]]),
    "two slow": (branch_of(systems.sleigh()), [[0.7, 0.6], [0.2, -0.8]]),
    "implicit": (branch_of(systems.van_der_pol(), {"x": 2, "y": 0.6}), [[0.7], [1.5]]),
    "repelling": (branch_of(systems.van_der_pol(), {"x": 0.1, "y": -0.1}), [[0.1], [-0.1]]),
    "saddle": (branch_of(systems.saddle()), [[0.5], [-0.8]]),
    "two fast": (branch_of(systems.coupled(), {"x": 0.5, "y": 0.3, "z": 0.2}), [[0.5], [0.8]]),
    "functions": (branch_of(systems.transcendental(), {"x": 0.5, "y": 0.3}), [[0.5], [0.9]]),
    "folded": (branch_of(systems.koper(), {"x": 2.4, "y": 0, "z": 0.5}), [[0.0, 0.5], [0.3, 0.2]]),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_order_m_has_an_error_of_order_epsilon_to_the_m_plus_1(name: str, order: int) -> None:
    branch, points = CASES[name]
    # Higher orders reach rounding sooner.
    epsilons = np.array([4e-3, 2e-3, 1e-3]) * (1 if order < 2 else 4)
    errors = []
    for value in epsilons:
        best = zero_derivative(branch, points, epsilon=value)
        found = zero_derivative(branch, points, epsilon=value, order=order)
        assert best.status.ok
        assert found.status.ok
        assert (found.order == order).all()
        errors.append(np.abs(found.y - best.y).max())
    if errors[-1] < 1e-13:
        # The saddle's series ends, and nothing is left to measure at rounding.
        return
    slopes = np.diff(np.log(errors)) / np.diff(np.log(epsilons))
    assert slopes[-1] > order + 0.8, slopes


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", CASES)
def test_it_agrees_with_the_exact_series(name: str) -> None:
    branch, points = CASES[name]
    near = branch.points(points)
    series = expand(branch, order=2).evaluate(points, 1e-5, near=near)
    found = zero_derivative(branch, points, epsilon=1e-5)
    np.testing.assert_allclose(found.y, series, rtol=0, atol=1e-12)
    assert (found.error < 1e-12).all()


def test_michaelis_menten_to_twelve_digits() -> None:
    branch, _ = CASES["explicit"]
    found = zero_derivative(branch, [0.1, 0.5, 1, 5], epsilon=0.1)
    np.testing.assert_allclose(found.y, MICHAELIS_MENTEN, rtol=0, atol=1e-12)
    small = zero_derivative(branch, np.linspace(0.05, 5, 50), epsilon=0.01)
    series = expand(branch, order=8).evaluate(np.linspace(0.05, 5, 50), 0.01)
    np.testing.assert_allclose(small.y, series, rtol=0, atol=1e-12)
    assert small.order.max() <= 6


def test_the_sleigh_to_twelve_digits() -> None:
    found = zero_derivative(CASES["two slow"][0], SLEIGH_POINTS, epsilon=0.1)
    np.testing.assert_allclose(found.y, SLEIGH, rtol=0, atol=1e-12)


def test_exact_manifolds_come_out_to_rounding() -> None:
    points = np.linspace(-1, 2, 31)
    value = 0.1
    s = points
    exact = np.stack([-(s**2) / (1 + 2 * value), -(s**3) / ((1 + 2 * value) * (1 - 3 * value))], axis=1)
    found = zero_derivative(CASES["saddle"][0], points, epsilon=value)
    np.testing.assert_allclose(found.y, exact, rtol=0, atol=1e-12)
    y1, y2 = sp.symbols("y1 y2")
    davis_skodje = SlowFastSystem(
        slow={y1: -y1}, fast={y2: -y2 + ((1 - epsilon) * y1 + y1**2) / (1 + y1) ** 2}, epsilon=epsilon
    )
    grid = np.linspace(0, 3, 31)
    found = zero_derivative(branch_of(davis_skodje), grid, epsilon=0.05)
    np.testing.assert_allclose(found.y[:, 0], grid / (1 + grid), rtol=0, atol=4e-13)


@pytest.mark.parametrize("value", [0.01, 0.05, 0.1, 0.2])
def test_the_estimated_error_is_honest_also_past_optimal_truncation(value: float) -> None:
    # The poles of the forcing at t = i and -i make the series diverge for every epsilon.
    t, u = sp.symbols("t u")
    system = SlowFastSystem(slow={t: 1}, fast={u: -u + 1 / (1 + t**2)}, epsilon=epsilon)
    branch = branch_of(system)
    points = np.linspace(-2, 2, 21)
    # h = integral from 0 to infinity of exp(-s) forcing(t - epsilon s) ds
    nodes, weights = np.polynomial.legendre.leggauss(20)
    s = (np.arange(40)[:, None] + 0.5 * (1 + nodes)).ravel()
    forcing = 1 / (1 + (points[:, None] - value * s) ** 2)
    exact = (0.5 * np.tile(weights, 40) * np.exp(-s) * forcing).sum(axis=1)
    found = zero_derivative(branch, points, epsilon=value)
    error = np.abs(found.y[:, 0] - exact)
    assert found.status.ok
    assert (error <= 10 * found.error + 1e-14).all()
    assert found.error.max() < 1e3 * error.max() + 1e-12


def test_the_order_is_the_lowest_that_meets_the_tolerance() -> None:
    branch, points = CASES["explicit"]
    previous = -1
    for tolerance in (1e-4, 1e-7, 1e-10, 1e-13):
        found = zero_derivative(branch, points, epsilon=0.02, tolerance=tolerance)
        exact = zero_derivative(branch, points, epsilon=0.02).y
        assert np.abs(found.y - exact).max() < 4 * tolerance
        assert found.order.max() > previous
        previous = found.order.max()


def test_the_order_in_which_variables_are_declared_does_not_matter() -> None:
    system = systems.sleigh()
    (v, f), (p, g) = system.slow.items()
    swapped = SlowFastSystem(slow={p: g, v: f}, fast=system.fast, epsilon=epsilon, parameters=system.parameters)
    points = {"v": [0.7, 0.2], "p": [0.6, -0.8]}
    one = zero_derivative(branch_of(system), points, epsilon=0.05)
    other = zero_derivative(branch_of(swapped), points, epsilon=0.05)
    np.testing.assert_allclose(one.y, other.y, rtol=0, atol=1e-15)
    fast = dict(reversed(systems.coupled().fast.items()))
    turned = SlowFastSystem(slow=systems.coupled().slow, fast=fast, epsilon=epsilon)
    one = zero_derivative(CASES["two fast"][0], [0.5], epsilon=0.02)
    other = zero_derivative(branch_of(turned, {"x": 0.5, "y": 0.3, "z": 0.2}), [0.5], epsilon=0.02)
    np.testing.assert_allclose(one.y, other.y[:, ::-1], rtol=0, atol=1e-14)


def test_few_jets_are_enough() -> None:
    for name in ("explicit", "two slow", "saddle"):
        branch, points = CASES[name]
        rows = np.repeat(points, 50, axis=0)
        assert zero_derivative(branch, rows, epsilon=0.01, order=8).jets <= 3 * len(rows)
        assert zero_derivative(branch, rows, epsilon=0.01).jets <= 3 * len(rows)


def test_one_point_loses_the_leading_axis_and_names_are_taken() -> None:
    branch, _ = CASES["two slow"]
    one = zero_derivative(branch, {"v": 0.7, "p": 0.6}, epsilon=0.05)
    many = zero_derivative(branch, [[0.7, 0.6]], epsilon=0.05)
    assert one.y.shape == (1,)
    assert many.y.shape == (1, 1)
    assert many.order.shape == many.error.shape == (1,)
    assert one.y[0] == many.y[0, 0]
    assert not many.y.flags.writeable
    assert "largest estimated error" in one.message


def test_near_chooses_the_sheet() -> None:
    branch = branch_of(systems.van_der_pol())
    sheets = [zero_derivative(branch, [0.0], epsilon=0.01, near=[start]).y[0, 0] for start in (-1.8, 0.1, 1.8)]
    assert sheets[0] < -1 < sheets[1] < 1 < sheets[2]


def test_points_beside_a_fold_say_that_they_are_bad() -> None:
    branch = branch_of(systems.van_der_pol(), {"x": 2, "y": 0.6})
    found = zero_derivative(branch, [-0.66, 0.5], epsilon=0.05)
    bad = ~np.isfinite(found.y[0]) | (found.error[0] > 1e-3)
    assert bad.all()
    assert found.error[1] < 1e-6
    assert "y = -0.66" in found.message
    assert "1 does not meet the tolerance 1e-13: solve_manifold goes further" in found.message
    both = zero_derivative(branch, [-0.66, -0.655], epsilon=0.05, tolerance=1e-6)
    assert "2 do not meet the tolerance 1e-06" in both.message
    assert "meet" not in zero_derivative(branch, [0.5], epsilon=0.05, tolerance=1e-6).message


def test_a_field_that_is_not_finite_is_named_with_its_place() -> None:
    system = SlowFastSystem(slow={x: sp.log(x)}, fast={y: x - y + epsilon * sp.log(x)}, epsilon=epsilon)
    found = zero_derivative(branch_of(system), [1.0, -0.5, 2.0], epsilon=0.01)
    assert found.status is Status.NON_FINITE
    assert "1 of 3" in found.message
    assert "x = -0.5" in found.message
    assert np.isnan(found.y[1]).all()
    assert np.isfinite(found.y[[0, 2]]).all()
    assert list(found.order >= 0) == [True, False, True]
    given = zero_derivative(branch_of(system), [1.0, -0.5, 2.0], epsilon=0.01, order=2)
    assert given.order.tolist() == [2, -1, 2]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"tolerance": 0.0}, "tolerance is a positive number"),
        ({"x": [float("nan")]}, "x must be finite"),
        ({"x": {"t": 1}}, 'x names "t"'),
    ],
)
def test_a_wrong_call_raises(change, words) -> None:
    arguments = {"x": [1.0], "epsilon": 0.1, **change}
    with pytest.raises(DeclarationError, match=words):
        zero_derivative(CASES["explicit"][0], arguments.pop("x"), **arguments)


def test_a_field_without_jets_and_a_place_off_the_branch_raise() -> None:
    system = SlowFastSystem(slow={x: -x}, fast={y: sp.floor(x) - y}, epsilon=epsilon)
    with pytest.raises(UnsupportedFunctionError, match="no power series rule"):
        zero_derivative(branch_of(system), [1.0], epsilon=0.1)
    with pytest.raises(BranchError, match="over y = 0"):
        zero_derivative(branch_of(systems.van_der_pol()), [0.0], epsilon=0.1)


def test_fast_rates_far_apart_cost_orders_and_are_told() -> None:
    system = SlowFastSystem(
        slow={x: -x}, fast={y: sp.sin(x) - y + z, z: -1000 * (z - x**2) + y}, epsilon=epsilon
    )
    branch = branch_of(system)
    points = [0.2, 0.5, 0.9]
    exact = expand(branch, order=6).evaluate(points, 0.01)
    found = zero_derivative(branch, points, epsilon=0.01)
    assert found.status.ok
    error = np.linalg.norm(found.y - exact, axis=1)
    assert (error <= 10 * found.error + 1e-10).all()
    too_high = zero_derivative(branch, points, epsilon=0.01, order=9)
    assert too_high.status is Status.SINGULAR_JACOBIAN
    assert "too far apart" in too_high.message
    assert np.isnan(too_high.y).all()


def test_three_slow_variables() -> None:
    u = sp.Symbol("u")
    system = SlowFastSystem(slow={x: -x, z: x - z, u: -2 * u}, fast={y: x * z + sp.cos(u) - y}, epsilon=epsilon)
    points = np.random.default_rng(0).uniform(-1, 1, (20, 3))
    found = zero_derivative(branch_of(system), points, epsilon=1e-3)
    series = expand(branch_of(system), order=5).evaluate(points, 1e-3)
    np.testing.assert_allclose(found.y, series, rtol=0, atol=1e-12)
