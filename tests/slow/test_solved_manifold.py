"""The slow manifold solved: reference values, invariance, two routes to one answer, and failures with their place."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.special import airy

from gsp import load
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import BranchError, DeclarationError, GspError, Status
from gsp.hyperbolicity.hyperbolicity import Kind
from gsp.integration.trajectory import integrate
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.scenes.study import study
from gsp.slow import orbit_segments, slow_track, solved_manifold
from gsp.slow.chebyshev import interpolate, nodes
from gsp.slow.series import expand
from gsp.slow.slow_points import zero_derivative
from gsp.slow.solved_manifold import solve_manifold
from gsp.systems.system import SlowFastSystem
from tests import example_systems as systems
from tests.cases import thinned
from tests.example_systems import epsilon, x, y, z
from tests.slow.test_slow_points import MICHAELIS_MENTEN, SLEIGH, SLEIGH_POINTS

t, u, w = sp.symbols("t u w")
TIGHT = 1e-13


def branch_of(system, point=None):
    branch = solve_critical(system).branches[0]
    return branch.through(point) if point else branch


def inside(manifold, count=200):
    box = np.array([manifold.region[s.name] for s in manifold.branch.system.x])
    return box[:, 0] + np.random.default_rng(3).random((count, len(box))) * (box[:, 1] - box[:, 0])


def saddle_exact(points, value):
    s = points[:, 0]
    return np.stack([-(s**2) / (1 + 2 * value), -(s**3) / ((1 + 2 * value) * (1 - 3 * value))], axis=1)


def oscillating_exact(points, value):
    s = points[:, 0]
    rows = [np.sin(s) + value * np.cos(s), np.cos(s) + value * np.sin(s)]
    return np.stack(rows, axis=1) / (1 + value**2)


def airy_exact(sign):
    """w of epsilon w' = u - w^2, u' = sign: -sqrt(u) followed from u = +infinity is a quotient of Airy functions."""

    def exact(points, value):
        scale = value ** (1 / 3)
        ai, slope, _, _ = airy(points[:, 0] / scale**2)
        return -sign * (scale * -slope / ai)[:, None]

    return exact


OSCILLATING = SlowFastSystem(slow={t: 1}, fast={x: x - sp.sin(t), y: -y + sp.cos(t)}, epsilon=epsilon)
DAVIS_SKODJE = SlowFastSystem(
    slow={x: -x}, fast={y: -y + ((1 - epsilon) * x + x**2) / (1 + x) ** 2}, epsilon=epsilon
)
LINEAR = SlowFastSystem(slow={y: -y}, fast={x: y - x}, epsilon=epsilon)
UPWARDS = SlowFastSystem(slow={u: 1}, fast={w: u - w**2}, epsilon=epsilon)
DOWNWARDS = SlowFastSystem(slow={u: -1}, fast={w: u - w**2}, epsilon=epsilon)

EXACT = {
    "saddle": (branch_of(systems.saddle()), {"x": (-1, 2)}, Kind.SADDLE, saddle_exact),
    "oscillating saddle": (branch_of(OSCILLATING), {"t": (0, 7)}, Kind.SADDLE, oscillating_exact),
    "Davis-Skodje": (branch_of(DAVIS_SKODJE), {"x": (0, 3.5)}, Kind.ATTRACTING, lambda p, e: p / (1 + p)),
    "linear": (branch_of(LINEAR), {"y": (-1, 3)}, Kind.ATTRACTING, lambda p, e: p / (1 - e)),
    "Airy, repelling": (
        branch_of(UPWARDS, {"u": 1, "w": -1}), {"u": (0.2, 2)}, Kind.REPELLING, airy_exact(1),
    ),
    "Airy, attracting": (
        solve_critical(DOWNWARDS).nearest({"u": 1, "w": 1}), {"u": (0.2, 2)}, Kind.ATTRACTING, airy_exact(-1),
    ),
}  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", EXACT)
@pytest.mark.parametrize("value", [0.1, 0.01])
def test_exact_manifolds(name: str, value: float) -> None:
    branch, region, kind, exact = EXACT[name]
    manifold = solve_manifold(branch, region=region, epsilon=value, tolerance=TIGHT)
    assert manifold.status.ok, manifold.message
    assert manifold.kind is kind
    points = inside(manifold)
    true = exact(points, value)
    scale = 1 + np.abs(true).max()
    assert np.abs(manifold.evaluate(points) - true).max() < 3e-13 * scale


@pytest.mark.parametrize("name", thinned(EXACT, 3))
@pytest.mark.parametrize("tolerance", [1e-4, 1e-7, 1e-10])
def test_the_estimated_error_is_honest(name: str, tolerance: float) -> None:
    branch, region, _, exact = EXACT[name]
    manifold = solve_manifold(branch, region=region, epsilon=0.1, tolerance=tolerance)
    points = inside(manifold)
    true = exact(points, 0.1)
    error = np.linalg.norm(manifold.evaluate(points) - true, axis=1).max()
    rounding = 1e-14 * (1 + np.abs(true).max())
    assert error < 10 * manifold.error_estimate + rounding
    assert manifold.error_estimate < max(1000 * (error + rounding), tolerance)
    assert manifold.error_estimate < 10 * tolerance * (1 + np.abs(true).max())


@pytest.mark.exhaustive
def test_michaelis_menten_is_followed_forward_from_large_s() -> None:
    manifold = solve_manifold(
        branch_of(systems.michaelis_menten()), region={"s": (0.1, 5)}, epsilon=0.1, tolerance=TIGHT
    )
    assert manifold.status.ok
    np.testing.assert_allclose(manifold.evaluate([0.1, 0.5, 1, 5]), MICHAELIS_MENTEN, rtol=0, atol=1e-13)
    assert manifold.error_estimate < 1e-12


@pytest.mark.exhaustive
def test_the_sleigh() -> None:
    region = {"v": (-1.2, 1.2), "p": (-2.2, 1.2)}
    manifold = solve_manifold(branch_of(systems.sleigh()), region=region, epsilon=0.1, tolerance=TIGHT)
    assert manifold.status.ok
    np.testing.assert_allclose(manifold.evaluate(SLEIGH_POINTS), SLEIGH, rtol=0, atol=1e-13)
    # v = a/(m epsilon), w = -a omega is an exact solution for every epsilon: 2 and p = J omega + m a w = omega.
    edge = solve_manifold(
        branch_of(systems.sleigh()), region={"v": (1.5, 2), "p": (0.5, 1)}, epsilon=0.1, tolerance=TIGHT
    )
    np.testing.assert_allclose(edge.evaluate([[2, 0.5], [2, 1]]), [[-0.1], [-0.2]], rtol=0, atol=1e-13)


@pytest.mark.exhaustive
@pytest.mark.parametrize("value", [1e-4, 1e-2])
def test_segel_and_slemrods_michaelis_menten(value: float) -> None:
    # s' = (-(kappa + 1) s + (kappa - sigma + s) c)/sigma, epsilon c' = s - c (kappa + s)/(kappa + 1): the scaling
    # of Patsatzis, Fabiani, Russo and Siettos (2023), kappa = 10, sigma = 100, s up to 1.
    s, c = sp.symbols("s c")
    system = SlowFastSystem(
        slow={s: (-11 * s + (s - 90) * c) / 100}, fast={c: s - c * (10 + s) / 11}, epsilon=epsilon
    )
    branch = branch_of(system)
    manifold = solve_manifold(branch, region={"s": (1e-6, 1)}, epsilon=value, tolerance=1e-12)
    assert manifold.status.ok
    assert manifold.error_estimate < 1e-11
    points = np.linspace(1e-6, 1, 40)
    other = zero_derivative(branch, points, epsilon=value).y
    np.testing.assert_allclose(manifold.evaluate(points), other, rtol=0, atol=2e-12)


def test_the_middle_sheet_of_van_der_pol_is_followed_backward() -> None:
    value = 0.01
    region = {"y": (-0.3, 0.1), "x": (-0.9, 0.9)}
    manifold = solve_manifold(branch_of(systems.van_der_pol()), region=region, epsilon=value, tolerance=1e-12)
    assert manifold.status.ok, manifold.message
    assert manifold.kind is Kind.REPELLING
    # Backward in time the sheet attracts: what starts next to it upwards is on it long before y = 0.1.
    start = {"y": 0.55, "x": float(branch_of(systems.van_der_pol()).points([0.55], near=[-0.6])[0, 0])}
    at = np.linspace(0, -0.9, 181)
    run = integrate(
        systems.van_der_pol(), start=start, span=(0, -0.9), epsilon=value, rtol=1e-13, atol=1e-14, at=at
    )
    assert run.status.ok
    on = (run["y"] < 0.1) & (run["y"] > -0.3)
    assert on.sum() > 20
    np.testing.assert_allclose(manifold.evaluate(run["y"][on])[:, 0], run["x"][on], rtol=0, atol=1e-10)


FOCUS = SlowFastSystem(
    slow={u: 1 + w**2, w: -w + u},
    fast={x: -x + 5 * y + sp.sin(u), y: -5 * x - y + w, z: z - u * w + x},
    epsilon=epsilon,
)
CASES = {
    "saddle with a focus": (branch_of(FOCUS), {"u": (0.1, 0.5), "w": (-0.5, 0.5)}),
    "two slow": (branch_of(systems.sleigh()), {"v": (0.2, 1), "p": (0.2, 1)}),
    "implicit": (branch_of(systems.van_der_pol()), {"y": (0.4, 1.4), "x": (1.2, 3)}),
    "seeded": (branch_of(systems.van_der_pol(), {"y": 0.7, "x": 2}), {"y": (0.4, 1.4)}),
    "two fast": (branch_of(systems.coupled(), {"x": 0.5, "y": 0.3, "z": 0.2}), {"x": (0.3, 0.7)}),
    "functions": (branch_of(systems.transcendental()), {"x": (0.3, 1.2), "y": (-3, 3)}),
    "folded": (branch_of(systems.koper()), {"y": (0.0, 0.5), "z": (0.2, 0.8), "x": (1.2, 3)}),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", CASES)
def test_three_methods_agree(name: str) -> None:
    branch, region = CASES[name]
    manifold = solve_manifold(branch, region=region, epsilon=0.01, tolerance=1e-11)
    assert manifold.status.ok, manifold.message
    points = inside(manifold, 50)
    found = manifold.evaluate(points)
    other = zero_derivative(manifold.branch, points, epsilon=0.01)
    np.testing.assert_allclose(found, other.y, rtol=0, atol=1e-10)
    assert np.abs(manifold.residual(points)).max() < 1e-9
    assert (np.abs(manifold.residual(points)) > 0).any()


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["two slow", "implicit", "two fast", "folded"])
def test_the_full_flow_stays_on_it(name: str) -> None:
    branch, region = CASES[name]
    manifold = solve_manifold(branch, region=region, epsilon=0.01, tolerance=1e-11)
    system = branch.system
    centre = [0.5 * sum(manifold.region[s.name]) for s in system.x]
    start = dict(zip((s.name for s in system.states), [*centre, *manifold.evaluate([centre])[0]]))
    run = integrate(system, start=start, span=(0, 0.1), epsilon=0.01, rtol=1e-12, atol=1e-13)
    slow = np.stack([run[s.name] for s in system.x], axis=1)
    fast = np.stack([run[s.name] for s in system.y], axis=1)
    assert np.abs(slow[-1] - slow[0]).max() > 1e-3
    np.testing.assert_allclose(fast, manifold.evaluate(slow), rtol=0, atol=1e-9)


@pytest.mark.exhaustive
def test_the_slope_is_the_derivative_and_the_residual_is_what_it_says() -> None:
    branch, region = CASES["folded"]
    manifold = solve_manifold(branch, region=region, epsilon=0.01)
    points = inside(manifold, 5)
    h = 1e-6
    for j in range(2):
        shift = h * np.eye(2)[j]
        difference = (manifold.evaluate(points + shift) - manifold.evaluate(points - shift)) / (2 * h)
        np.testing.assert_allclose(manifold.slope(points)[:, :, j], difference, rtol=0, atol=1e-8)
    rates = compile_flow(branch.system).rates(
        np.hstack([points, manifold.evaluate(points)]), parameter_vector(branch.system, 0.01)
    )
    defect = 0.01 * (np.einsum("mij,mj->mi", manifold.slope(points), rates[:, :2]) - rates[:, 2:])
    np.testing.assert_allclose(manifold.residual(points), defect, rtol=0, atol=1e-15)


@pytest.mark.exhaustive
def test_three_slow_variables_and_the_order_of_names() -> None:
    region = {"x": (0.2, 0.6), "z": (-0.5, 0.5), "u": (0, 0.5)}
    slow = {x: -x + y, z: x - z, u: -u * x}
    fast = {y: x * z + sp.cos(u) - y}
    one = SlowFastSystem(slow=slow, fast=fast, epsilon=epsilon)
    other = SlowFastSystem(slow=dict(reversed(slow.items())), fast=fast, epsilon=epsilon)
    points = {"x": [0.3, 0.5], "z": [-0.2, 0.4], "u": [0.1, 0.45]}
    values = []
    for system in (one, other):
        manifold = solve_manifold(branch_of(system), region=region, epsilon=0.02, tolerance=1e-8)
        assert manifold.status.ok
        assert manifold.nodes.shape == (len(manifold.values), 3)
        values.append(manifold.evaluate(points))
    np.testing.assert_allclose(values[0], values[1], rtol=0, atol=1e-13)
    reference = zero_derivative(branch_of(one), points, epsilon=0.02).y
    np.testing.assert_allclose(values[0], reference, rtol=0, atol=1e-7)


@pytest.mark.exhaustive
def test_a_field_without_jets_is_solved_all_the_same() -> None:
    system = SlowFastSystem(slow={u: -1}, fast={w: sp.Max(u, 0) - w}, epsilon=epsilon)
    manifold = solve_manifold(branch_of(system), region={"u": (0.5, 1.5)}, epsilon=0.05, tolerance=1e-12)
    assert manifold.status.ok
    points = inside(manifold)
    np.testing.assert_allclose(manifold.evaluate(points), points + 0.05, rtol=0, atol=1e-11)


def test_work_and_shapes() -> None:
    manifold = solve_manifold(branch_of(systems.saddle()), region={"x": (-1, 1)}, epsilon=0.05)
    assert len(manifold.nodes) == 17
    assert manifold.nodes.shape == (17, 1)
    assert manifold.values.shape == (17, 2)
    assert manifold.node_errors.shape == (17,)
    assert (manifold.node_errors < 1e-10).all()
    assert not manifold.values.flags.writeable
    assert manifold.evaluate(0.3).shape == manifold.residual(0.3).shape == (2,)
    assert manifold.evaluate([0.3]).shape == (1, 2)
    assert manifold.slope(0.3).shape == (2, 1)
    assert manifold.evaluate({"x": [0.1, 0.2]}).shape == (2, 2)
    assert "saddle" in repr(manifold)
    again = solve_manifold(branch_of(systems.saddle()), region={"x": (-1, 1)}, epsilon=0.05)
    assert np.array_equal(again.values, manifold.values)


# -- what cannot be done ---------------------------------------------------------------------------


@pytest.mark.exhaustive
def test_a_fold_in_the_region_is_told_with_its_place() -> None:
    branch = branch_of(systems.van_der_pol(), {"y": 0.7, "x": 2})
    for low in (-0.6666666666666666, -1.0):
        manifold = solve_manifold(branch, region={"y": (low, 1)}, epsilon=0.01)
        assert manifold.status is Status.FOLD_REACHED
        assert manifold.kind is Kind.LOST
        assert np.isnan(manifold.evaluate(0.5)).all()
        assert manifold.error_estimate == float("inf")
    assert "y = -" in manifold.message


def test_a_region_outside_the_branch_is_told_with_its_place() -> None:
    system = SlowFastSystem(slow={u: -u}, fast={w: sp.log(u) - w}, epsilon=epsilon)
    manifold = solve_manifold(branch_of(system), region={"u": (-1, 1)}, epsilon=0.01)
    assert not manifold.status.ok
    assert "u = -1" in manifold.message


def test_a_pole_in_the_region_is_told_with_its_place() -> None:
    system = SlowFastSystem(slow={u: -u}, fast={w: 1 / (u - sp.Rational(1, 2)) - w}, epsilon=epsilon)
    manifold = solve_manifold(branch_of(system), region={"u": (0, 1)}, epsilon=0.01)
    assert manifold.status is Status.NON_FINITE
    assert "u = 0.5" in manifold.message


@pytest.mark.exhaustive
def test_orbits_that_come_from_a_fold_leave_a_larger_reported_error() -> None:
    # On w = sqrt(u), u' = 1, what happened at the fold u = 0 is felt by exp(-4 u^(3/2)/(3 epsilon)).
    branch = solve_critical(UPWARDS).nearest({"u": 1, "w": 1})
    far = solve_manifold(branch, region={"u": (0.5, 1)}, epsilon=0.01)
    assert far.status.ok
    near = solve_manifold(branch, region={"u": (0.15, 0.25)}, epsilon=0.01)
    assert near.status is Status.HISTORY_ENDS
    assert "can be followed only to u = 0." in near.message
    assert 1e-9 < near.error_estimate < 1.0
    # Two histories that both were on the branch differ by less than that.
    runs = [
        solve_ivp(
            lambda q, c: (q - c**2) / 0.01, (begin, 0.15), [start], method="Radau", rtol=1e-11, atol=1e-13
        )
        for begin, start in ((0.04, 0.2), (0.05, 0.21))
    ]
    spread = abs(runs[0].y[0, -1] - runs[1].y[0, -1])
    assert abs(near.evaluate(0.15)[0] - runs[0].y[0, -1]) < near.error_estimate + spread


@pytest.mark.parametrize("value", [0.3, 1.0, 3.0, 10.0])
def test_past_the_manifolds_life_there_is_no_surface(value: float) -> None:
    branch = solve_critical(UPWARDS).nearest({"u": 1, "w": 1})
    manifold = solve_manifold(branch, region={"u": (0.5, 1.5)}, epsilon=value)
    assert not manifold.status.ok
    assert manifold.error_estimate == float("inf")
    assert np.isnan(manifold.evaluate([0.7, 1.0])).all()
    assert manifold.values.shape == (len(manifold.nodes), 1)
    assert "u = " in manifold.message


def test_a_kink_is_not_resolved_and_says_where() -> None:
    system = SlowFastSystem(slow={u: -1}, fast={w: sp.Max(u, 1) - w}, epsilon=epsilon)
    manifold = solve_manifold(branch_of(system), region={"u": (0.5, 1.5)}, epsilon=0.01)
    assert manifold.status is Status.NOT_CONVERGED
    assert manifold.error_estimate > 1e-6
    assert "not smooth there" in manifold.message
    assert f"(tolerance {manifold.tolerance:g}), largest residual near u = " in manifold.message


def test_a_third_time_scale_is_warned_about() -> None:
    system = SlowFastSystem(
        slow={u: -u}, fast={x: sp.sin(u) - x + y, y: -1000 * (y - u**2) + x}, epsilon=epsilon
    )
    manifold = solve_manifold(branch_of(system), region={"u": (0.1, 1)}, epsilon=0.01)
    assert manifold.status.ok
    assert "third time scale" in manifold.message
    points = inside(manifold, 20)
    other = expand(branch_of(system), order=6).evaluate(points, 0.01)
    np.testing.assert_allclose(manifold.evaluate(points), other, rtol=0, atol=1e-10)


def test_a_point_outside_is_refused() -> None:
    manifold = solve_manifold(branch_of(LINEAR), region={"y": (0, 1)}, epsilon=0.05)
    with pytest.raises(GspError, match=r"covers y in \[0, 1\]. Got y = 1.5"):
        manifold.evaluate([0.5, 1.5])
    with pytest.raises(GspError, match="Got y = nan"):
        manifold.evaluate(float("nan"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"region": {"x": (0, 1)}}, "no interval for y"),
        ({"tolerance": 1e-20}, "tolerance is a number from 1e-14"),
    ],
)
def test_a_wrong_call_raises(change, words) -> None:
    arguments = {"region": {"y": (0, 1)}, "epsilon": 0.05, **change}
    with pytest.raises(DeclarationError, match=words):
        solve_manifold(branch_of(LINEAR), **arguments)


def test_a_wrong_branch_raises() -> None:
    with pytest.raises(BranchError, match="has 3 points over the centre"):
        solve_manifold(branch_of(systems.van_der_pol()), region={"y": (-0.1, 0.2)}, epsilon=0.05)
    symbols = sp.symbols("q1:5")
    many = SlowFastSystem(slow={q: -q for q in symbols}, fast={y: symbols[0] - y}, epsilon=epsilon)
    with pytest.raises(DeclarationError, match="one to three slow variables"):
        solve_manifold(branch_of(many), region={q.name: (0, 1) for q in symbols}, epsilon=0.05)


# -- the interpolant -------------------------------------------------------------------------------


def test_chebyshev_interpolants_are_exact_for_polynomials_and_nested() -> None:
    box = np.array([[0.0, 2.0], [-1.0, 3.0]])
    grid = nodes(box, (5, 9))
    values = np.stack([grid[..., 0] ** 4 * grid[..., 1] ** 3, grid[..., 0] - grid[..., 1] ** 8], axis=-1)
    surface = interpolate(box, values)
    points = box[:, 0] + np.random.default_rng(0).random((50, 2)) * (box[:, 1] - box[:, 0])
    a, b = points.T
    np.testing.assert_allclose(surface(points), np.stack([a**4 * b**3, a - b**8], axis=1), rtol=0, atol=1e-10)
    slopes = [[4 * a**3 * b**3, 3 * a**4 * b**2], [np.ones(50), -8 * b**7]]
    np.testing.assert_allclose(surface.derivative(points).transpose(1, 2, 0), slopes, rtol=0, atol=1e-9)
    assert np.array_equal(nodes(box, (9, 9))[::2], grid)
    chopped = interpolate(box, values[..., :1]).chopped(1e-9)
    assert chopped.coefficients.shape == (5, 4, 1)


def test_slopes_on_a_grid_are_those_at_its_nodes() -> None:
    box = np.array([[0.0, 2.0], [-1.0, 3.0]])
    grid = nodes(box, (9, 17))
    surface = interpolate(box, np.stack([np.sin(grid[..., 0] * grid[..., 1]), grid[..., 1] ** 3], axis=-1))
    for sizes in ((9, 17), (17, 33)):
        points = nodes(box, sizes).reshape(-1, 2)
        at_points = surface.derivative(points).reshape(*sizes, 2, 2)
        np.testing.assert_allclose(surface.slopes(sizes), at_points, rtol=0, atol=1e-12)


@pytest.mark.exhaustive
def test_a_long_axis_takes_memory_in_proportion_to_its_points() -> None:
    box, n = np.array([[0.0, 1.0]]), 2**13 + 1
    x = nodes(box, (n,)).reshape(-1, 1)
    tracemalloc.start()
    try:
        surface = interpolate(box, 1 / (1 + 1e6 * (x - 0.5) ** 2))
        between = surface(x[:-1] + 0.3 * np.diff(x, axis=0))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # A matrix of n rows and columns would be 5.4e8 bytes.
    assert peak < 1e8
    expected = 1 / (1 + 1e6 * (x[:-1] + 0.3 * np.diff(x, axis=0) - 0.5) ** 2)
    np.testing.assert_allclose(between, expected, rtol=0, atol=1e-6)


# -- work that is bounded, and none that is lost -----------------------------------------------------------


def repressilator():
    scene = load(Path(__file__).parents[1] / "systems" / "repressilator.toml")
    return study(scene).branch


def test_the_points_allowed_bound_the_grid_and_the_ending_says_what_is_left() -> None:
    branch = branch_of(OSCILLATING)
    region = {"t": (0, 40)}
    whole = solve_manifold(branch, region=region, epsilon=0.05)
    assert whole.status.ok
    assert len(whole.nodes) > 33
    part = solve_manifold(branch, region=region, epsilon=0.05, max_points=33)
    assert part.status is Status.TOO_MANY_POINTS
    assert len(part.nodes) == 33
    assert "the 33 points allowed do not resolve the surface along t, the next grid has 65" in part.message
    # What there is holds what it says.
    places = inside(part)
    assert np.abs(part.evaluate(places) - oscillating_exact(places, 0.05)).max() <= part.error_estimate
    with pytest.raises(DeclarationError, match="at least 17, the first grid over 1 slow variables"):
        solve_manifold(branch, region=region, epsilon=0.05, max_points=16)


@pytest.mark.exhaustive
def test_no_segment_is_solved_where_the_points_allowed_do_not_resolve_the_critical_manifold(
    monkeypatch,
) -> None:
    def solved(*_):
        raise AssertionError("a segment was solved")

    monkeypatch.setattr(orbit_segments.SegmentSolver, "solve", solved)
    region = {"p1": (2, 50), "p2": (2, 50), "p3": (2, 50)}
    manifold = solve_manifold(repressilator(), region=region, epsilon=0.02, max_points=1100)
    assert manifold.status is Status.TOO_MANY_POINTS
    assert len(manifold.nodes) == 0
    assert (
        "the 1100 points allowed do not resolve even the critical manifold along p1, p2, p3" in manifold.message
    )
    assert "the next grid has 4913; no segment was solved. Shrink the region." in manifold.message
    # Without a bound it is the finest grid there is.
    waves = SlowFastSystem(slow={x: -x, y: -y}, fast={z: sp.cos(400 * x * y) - z}, epsilon=epsilon)
    manifold = solve_manifold(branch_of(waves), region={"x": (0, 1), "y": (0, 1)}, epsilon=0.02)
    assert manifold.status is Status.TOO_MANY_POINTS
    assert "the 16641 points allowed do not resolve even the critical manifold along x, y" in manifold.message


@pytest.mark.exhaustive
def test_a_guess_is_improved_where_elements_end_and_nowhere_else(monkeypatch) -> None:
    improved, ends = [], []
    climb = orbit_segments.climb

    def counted(tape, branch, x, *rest, **given):
        improved.append(len(x))
        return climb(tape, branch, x, *rest, **given)

    refine = orbit_segments.SegmentSolver._refine_guess

    def noted(self, problem, rows, value):
        improved.clear()
        ends.append(int((problem.counts[rows] + 1).sum()))
        refine(self, problem, rows, value)
        assert improved == ends[-1:]

    monkeypatch.setattr(orbit_segments, "climb", counted)
    monkeypatch.setattr(orbit_segments.SegmentSolver, "_refine_guess", noted)
    manifold = solve_manifold(branch_of(systems.michaelis_menten()), region={"s": (0.2, 2)}, epsilon=0.05)
    assert manifold.status.ok
    assert ends


@pytest.mark.exhaustive
def test_a_segment_that_fails_is_shortened_and_never_made_longer(monkeypatch) -> None:
    goals = []
    attempt = orbit_segments.SegmentSolver._attempt

    def noted(self, x, y, goal, **given):
        goals.append(float(goal[0]))
        return attempt(self, x, y, goal, **given)

    monkeypatch.setattr(orbit_segments.SegmentSolver, "_attempt", noted)
    branch = repressilator()
    solver = orbit_segments.SegmentSolver(branch, epsilon=0.02, unstable=0, tolerance=1e-10)
    point = np.array([[4.67058, 4.67058, 4.67058]])
    segments = solver.solve(point, branch.points(point))
    assert len(goals) > 2
    assert goals == sorted(goals, reverse=True)
    assert segments.status == [Status.SUCCESS]
    assert segments.error[0] < 0.01


def test_a_segment_does_not_begin_beyond_a_pole_of_the_branch() -> None:
    # M0 is (1/(1 + u), u^2), whose pole lies upstream of the places before the decay that is asked for.
    system = SlowFastSystem(slow={u: 1}, fast={x: 1 / (1 + u) - x, y: u**2 - y}, epsilon=epsilon)
    branch = branch_of(system)
    places = np.linspace(-0.8, 0.0, 17)[:, None]
    solver = orbit_segments.SegmentSolver(branch, epsilon=0.05, unstable=0, tolerance=1e-10)
    segments = solver.solve(places, branch.points(places))
    assert (segments.ends[:, 0] > -1).all()
    # Who begins elsewhere on the same side finds the same, up to what both say.
    coarse = orbit_segments.SegmentSolver(branch, epsilon=0.05, unstable=0, tolerance=1e-3)
    other = coarse.solve(places, branch.points(places))
    apart = np.linalg.norm(other.y - segments.y, axis=1)
    assert (apart <= 2 * (other.error + segments.error)).all()


@pytest.mark.exhaustive
def test_the_degree_of_a_surface_does_not_depend_on_the_units_of_the_fast_variable():
    found = []
    for unit in (1, 4096, 2**20):
        rate = unit * (16 / (x + 2) - y / unit) + epsilon * unit * sp.sin(3 * x)
        branch = branch_of(SlowFastSystem(slow={x: -x}, fast={y: rate}, epsilon=epsilon))
        manifold = solve_manifold(branch, region={"x": (0, 1)}, epsilon=0.01, tolerance=1e-9)
        assert manifold.status is Status.SUCCESS
        at = np.linspace(0, 1, 5)
        found.append((manifold.surface.coefficients.shape, manifold.evaluate(at) / unit))
    for shape, values in found[1:]:
        assert shape == found[0][0]
        assert values == pytest.approx(found[0][1], rel=1e-9)


def test_a_step_of_the_slow_flow_is_exact_to_the_fourth_order():
    # On y = x + x^2 the flow x' = x - y = -x^2 from 1 is 1/(1 + t).
    system = SlowFastSystem(slow={x: x - y}, fast={y: x + x**2 - y}, epsilon=epsilon)
    flow = slow_track._CriticalFlow(branch_of(system), 0.01)
    errors = []
    for h in (0.05, 0.025):
        end, height, good = flow.step(np.array([[1.0]]), np.array([[2.0]]), np.array([h]))
        assert good.all()
        assert height[0, 0] == pytest.approx(end[0, 0] + end[0, 0] ** 2, rel=1e-10)
        errors.append(abs(end[0, 0] - 1 / (1 + h)))
    assert errors[1] < 1e-9
    assert np.log2(errors[0] / errors[1]) == pytest.approx(5, abs=0.4)


@pytest.mark.exhaustive
def test_a_finished_surface_is_checked_all_over_its_region_and_serves_nowhere_else(monkeypatch):
    looked = []

    def defect(branch, surface, value, points):
        looked.append(points)
        return solved_manifold_defect(branch, surface, value, points)

    solved_manifold_defect = solved_manifold.defect_of
    monkeypatch.setattr(solved_manifold, "defect_of", defect)
    system = SlowFastSystem(slow={x: -x, z: -z}, fast={y: x * z - y}, epsilon=epsilon)
    found = solve_manifold(branch_of(system), region={"x": (-1, 1), "z": (100, 101)}, epsilon=0.01)
    (points,) = looked
    for column, (low, high) in zip(points.T, ((-1, 1), (100, 101))):
        assert low <= column.min() < low + 0.2 * (high - low)
        assert high - 0.2 * (high - low) < column.max() <= high
    # Rounding is let in, on the scale of the width.
    for point in ((1 + 1e-12, 100.5), (-1 - 1e-12, 100.5), (0, 101 + 5e-13), (0, 100 - 5e-13)):
        assert found.evaluate(point)[0] == pytest.approx(point[0] * point[1] / 1.0 / (1 - 2 * 0.01), rel=1e-9)
    for point in ((1 + 1e-11, 100.5), (-1 - 1e-11, 100.5), (0, 101 + 1e-11), (0, 100 - 1e-11)):
        with pytest.raises(GspError, match=r"the manifold covers [xz] in \["):
            found.evaluate(point)


def test_the_estimate_holds_what_the_ends_of_the_segments_leave() -> None:
    # Every orbit solves the invariance equation: the residual does not see which of them was taken.
    branch, box = branch_of(LINEAR), {"y": (0.0, 1.0)}
    work = solved_manifold._Work(
        branch, box, 0.1, 1e-6, solved_manifold._classified(branch, (*box.items(),)), None
    )
    grid = nodes(work.intervals, [9])
    surface = interpolate(work.intervals, grid / 0.9)
    work.selection = 1e-6
    assert 1e-6 < work._checked(surface, grid, grid / 0.9).error_estimate < 1.1e-6


def test_normal_rates_of_another_type_on_the_surface_are_told_with_their_place() -> None:
    # M0 is w = sqrt(u), attracting; the surface handed over is w = -sqrt(u), which repels.
    branch, box = solve_critical(UPWARDS).nearest({"u": 1, "w": 1}), {"u": (0.5, 1.0)}
    verdict = solved_manifold._classified(branch, tuple(box.items()))
    work = solved_manifold._Work(branch, box, 0.01, 1e-6, verdict, None)
    grid = nodes(work.intervals, [17])
    for sign, is_lost in ((1, False), (-1, True)):
        found = work._checked(interpolate(work.intervals, sign * np.sqrt(grid)), grid, sign * np.sqrt(grid))
        assert (found.status is Status.HYPERBOLICITY_LOST) is is_lost
        assert np.isnan(found.evaluate(0.7)).all() == is_lost
    assert "change their type on the slow manifold, at u = " in found.message


@pytest.mark.parametrize("size", [2.0**-10, 2.0**20])
def test_what_rests_at_zero_has_the_size_that_its_region_tells(size: float) -> None:
    def branch(unit: float):
        a = sp.Rational(unit)
        rest = -y * (1 + x**2) + epsilon * a * sp.sin(3 * x)
        system = SlowFastSystem(slow={x: -x + y / a}, fast={y: rest}, epsilon=epsilon)
        found = solve_critical(system).branches[0]
        return found.in_own_units(np.array([1.0, 0.0]), {"x": (0, 2), "y": (-2 * unit, 2 * unit)})

    known = zero_derivative(branch(1.0), [[1.3]], epsilon=0.02)
    found = zero_derivative(branch(size), [[1.3]], epsilon=0.02)
    solved = solve_manifold(branch(size), region={"x": (0, 2)}, epsilon=0.02, tolerance=1e-8)
    assert found.status.ok
    assert found.y / size == pytest.approx(known.y, rel=1e-10)
    assert solved.status.ok
    assert solved.error_estimate < 1e-8 * size
    assert solved.evaluate([[1.3]]) / size == pytest.approx(known.y, rel=1e-6)
