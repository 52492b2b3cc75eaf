"""The critical manifold: every branch satisfies its equations, sheets are followed, ends and absences are named."""

from __future__ import annotations

import dataclasses
import itertools
import re

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gsp.critical.branch import Branch
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import BranchError, DeclarationError
from gsp.hyperbolicity.hyperbolicity import classify
from gsp.systems.system import SlowFastSystem
from tests import example_systems as systems

x, y, z, w, u, a, b, eps = sp.symbols("x y z w u a b epsilon")


def one(g: sp.Expr, **parameters) -> SlowFastSystem:
    values = {sp.Symbol(n): value for n, value in parameters.items()}
    return SlowFastSystem(slow={x: -x}, fast={y: g}, epsilon=eps, parameters=values)


def residual(branch: Branch, x_values: np.ndarray, y_values: np.ndarray) -> float:
    system = branch.system
    point = [e.subs(dict(system.parameters)).subs(system.epsilon, 0) for e in system.g]
    g = sp.lambdify([*system.x, *system.y], point)
    return float(np.abs(np.array(g(*x_values.T, *y_values.T), dtype=float)).max())


EXPLICIT = {
    "linear": (one(a * x - 2 * y, a=3), 1, (-1, 1)),
    "both roots of a quadratic": (one(y**2 - x - 2), 2, (-1, 1)),
    "exponential": (one(sp.exp(y) - x - 2), 1, (-1, 1)),
    "logarithm": (one(x - sp.log(y)), 1, (-1, 1)),
    "hyperbolic tangent": (one(-sp.tanh(y - x) - x / 2), 1, (-1, 1)),
    "transcritical": (one(y**2 - x**2), 2, (-1, 1)),
    "three factors": (one((y - x) * (y + 1) * (x * y - 1)), 3, (0.5, 2)),
    "rational": (one(x - (x + a) * y, a=1), 1, (0, 4)),
    "rational in y": (one(x - y / (1 + y)), 1, (-1, 0.9)),
    "a parameter is zero": (one(a * y**2 + b * y + x, a=0, b=3), 1, (-1, 1)),
    "a leading coefficient that vanishes": (one(x * y**2 - y + x), 2, (0.01, 0.4)),
    "epsilon in g": (one(x - y + eps * y**3), 1, (-1, 1)),
}


@pytest.mark.parametrize("case", EXPLICIT)
def test_explicit_branches_satisfy_their_equations(case: str) -> None:
    system, count, (low, high) = EXPLICIT[case]
    manifold = solve_critical(system)
    assert len(manifold.branches) == count
    grid = np.linspace(low, high, 41)[:, None]
    for branch in manifold.branches:
        assert branch.is_explicit
        y_values = branch.points(grid)
        scale = 1 + np.abs(y_values).max() ** 2
        assert residual(branch, grid, y_values) < 1e-12 * scale


def test_a_root_stays_accurate_where_the_leading_coefficient_vanishes() -> None:
    branch = solve_critical(one(x * y**2 - y + x)).nearest({"x": 0.1, "y": 0.1})
    # y = x + x^3 + 2 x^5 + ...: the textbook formula would lose every digit here, and is 0/0 at x = 0.
    points = branch.points(np.array([0.0, 1e-9, -1e-5]))
    assert points.ravel() == pytest.approx([0.0, 1e-9, -1e-5 - 1e-15], rel=1e-14, abs=0)


IMPLICIT = {
    "cubic": (one(x - y**3 - y), None),
    "quintic": (one(x - y**5 - y), None),
    "transcendental": (one(sp.cos(y) + x - y), {"y": (-4, 4)}),
    "non-integer power": (one(2 + x - y**a, a=2.5), {"y": (0.1, 4)}),
    "two fast variables": (
        SlowFastSystem(slow={x: -x}, fast={y: x - y - z**3, z: y - z - z**3}, epsilon=eps),
        {"y": (-3, 3), "z": (-3, 3)},
    ),
    "two fast variables, transcendental": (
        SlowFastSystem(slow={x: -x}, fast={y: x - y**3 - y - z, z: y - z - sp.sin(z)}, epsilon=eps),
        {"y": (-3, 3), "z": (-3, 3)},
    ),
    "two slow variables": (
        SlowFastSystem(slow={x: -x, u: x}, fast={y: x * u + u - y**3 - y}, epsilon=eps),
        None,
    ),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", IMPLICIT)
def test_implicit_branches_satisfy_their_equations(case: str) -> None:
    system, bounds = IMPLICIT[case]
    (branch,) = solve_critical(system).branches
    assert not branch.is_explicit
    assert branch.graph is None
    axes = [np.linspace(-1, 1, 9)] * len(system.x)
    grid = np.array(list(itertools.product(*axes)))
    by_roots = np.array([branch.roots(row[None, :], bounds=bounds)[0] for row in grid])
    assert residual(branch, grid, by_roots) < 1e-12
    start = dict(zip([s.name for s in system.states], [*grid[0], *by_roots[0]]))
    by_sheet = branch.through(start).points(grid)
    by_newton = branch.points(grid, near=by_roots)
    assert np.abs(by_sheet - by_roots).max() < 1e-11
    assert np.abs(by_newton - by_roots).max() < 1e-11


def test_all_roots_are_found_and_bounds_select_among_them() -> None:
    (branch,) = solve_critical(one(x + y - y**3)).branches
    assert branch.roots({"x": 0}).ravel() == pytest.approx([-1, 0, 1], abs=1e-13)
    assert branch.roots({"x": 0}, bounds={"y": (-0.5, 2)}).ravel() == pytest.approx([0, 1], abs=1e-13)
    assert branch.roots({"x": 5}).shape == (1, 1)
    (pendulum,) = solve_critical(one(sp.sin(y) - x)).branches
    found = pendulum.roots({"x": 0.5}, bounds={"y": (-7, 7)}).ravel()
    sixths = np.array([-11, -7, 1, 5, 13])
    assert found == pytest.approx(sixths * np.pi / 6, abs=1e-12)


def test_roots_without_bounds_are_refused_when_they_cannot_be_complete() -> None:
    (branch,) = solve_critical(one(sp.sin(y) - x)).branches
    with pytest.raises(BranchError, match="without bounds on y"):
        branch.roots({"x": 0.5})


def test_a_branch_with_several_points_asks_which() -> None:
    (branch,) = solve_critical(one(x + y - y**3)).branches
    with pytest.raises(BranchError, match=r"has 3 points \(y = -1, 0, 1\) over x = 0.*branch.through"):
        branch.points({"x": 0})
    assert branch.points({"x": 5})[0] == pytest.approx(1.904160859134921, abs=1e-14)


def test_a_point_has_shape_n_fast_and_a_batch_m_by_n_fast() -> None:
    for system in (one(x - y), one(x - y**3 - y)):
        (branch,) = solve_critical(system).branches
        assert branch.points(0.5).shape == (1,)
        assert branch.points({"x": 0.5}).shape == (1,)
        assert branch.points([0.1, 0.2, 0.3]).shape == (3, 1)
        assert branch.points({"x": np.linspace(0, 1, 7)}).shape == (7, 1)
        with pytest.raises(DeclarationError, match="shape"):
            branch.points(np.zeros((3, 2)))


def test_a_thousand_points_equal_the_points_one_by_one() -> None:
    (branch,) = solve_critical(one(x - y**3 - y)).branches
    sheet = branch.through({"x": 0, "y": 0})
    grid = np.linspace(-3, 3, 1000)
    batch = sheet.points(grid)
    assert residual(branch, grid[:, None], batch) < 1e-12
    assert batch[::100, 0] == pytest.approx([sheet.points(value)[0] for value in grid[::100]], abs=1e-13)


@pytest.mark.exhaustive
def test_a_sheet_ends_at_its_fold_and_the_error_says_where() -> None:
    (branch,) = solve_critical(one(x + y - y**3 / 3)).branches
    upper = branch.through({"x": 0, "y": 1.7})
    assert upper.seed is not None
    assert upper.seed[1][0] == pytest.approx(np.sqrt(3), abs=1e-15)
    assert upper.points(np.linspace(-0.66, 3, 50)).min() > 1.0
    with pytest.raises(
        BranchError, match=r"sheet through x = 0 ends at x = -0.66666\d*, y = 1(\.0\d*)? \(a fold\?\)"
    ):
        upper.points(np.array([0.0, -0.9]))
    middle = branch.through({"x": 0, "y": 0.1})
    with pytest.raises(BranchError, match=r"ends at x = 0.66666\d*, y = -(1|0.99)"):
        middle.points(1.0)


@given(st.floats(-0.6, 0.6), st.integers(0, 2), st.floats(-0.6, 0.6))
@settings(max_examples=40)
def test_following_a_sheet_never_changes_sheets(start: float, which: int, target: float) -> None:
    (branch,) = solve_critical(one(x + y - y**3 / 3)).branches
    seed = branch.roots(start)[which]
    sheet = branch.through({"x": start, "y": seed[0]})
    assert sheet.points(target)[0] == pytest.approx(branch.roots(target)[which, 0], abs=1e-10)


def test_the_nearest_branch_and_sheet_are_chosen() -> None:
    manifold = solve_critical(one((y - x) * (y**3 - y - x)))
    assert manifold.nearest({"x": 0.5, "y": 0.52}).is_explicit
    sheet = manifold.nearest({"x": 0.1, "y": -0.9})
    assert sheet.seed is not None
    assert -1 < sheet.points(0.1)[0] < -0.9
    with pytest.raises(DeclarationError, match="no value for y"):
        manifold.nearest({"x": 0.5})
    with pytest.raises(DeclarationError, match='names "q", which is no state'):
        manifold.nearest({"x": 0.5, "y": 1, "q": 2})


def test_newtons_method_that_finds_nothing_says_so() -> None:
    (branch,) = solve_critical(one(sp.cos(y) - 2 - x + y / 10**6)).branches
    with pytest.raises(BranchError, match="Newton's method found no point near"):
        branch.points(0.0, near=[0.3])


def test_a_singular_jacobian_at_a_point_is_no_crash() -> None:
    (branch,) = solve_critical(one(x + y - y**3)).branches
    points = branch.points({"x": 0}, near=[1 / np.sqrt(3) + 1e-9])
    assert residual(branch, np.zeros((1, 1)), points[None, :]) < 1e-12


def test_two_fast_variables_are_eliminated_down_to_formulas() -> None:
    system = SlowFastSystem(slow={x: 1}, fast={y: z - y, z: w - z + x, w: -w - y * z}, epsilon=eps)
    manifold = solve_critical(system)
    assert len(manifold.branches) == 2
    grid = np.linspace(0.1, 1, 9)[:, None]
    for branch in manifold.branches:
        assert residual(branch, grid, branch.points(grid)) < 1e-13


def test_vertical_pieces_are_kept_apart() -> None:
    manifold = solve_critical(one(x * (y - x)))
    assert [str(branch) for branch in manifold.branches] == ["y = x"]
    assert manifold.unsolved == (x,)
    with pytest.raises(BranchError, match="is no graph of y over the slow variables x"):
        solve_critical(one(x))


@pytest.mark.exhaustive
def test_a_factor_common_to_two_equations_is_no_graph() -> None:
    common = SlowFastSystem(slow={x: 1}, fast={y: (y - x) * (z - 1), z: (y - x) * (z + 1)}, epsilon=eps)
    with pytest.raises(BranchError, match="is no graph of y, z"):
        solve_critical(common)
    mixed = SlowFastSystem(slow={x: 1}, fast={y: (y - x) * (z - 1), z: (y - x) * (z + y)}, epsilon=eps)
    manifold = solve_critical(mixed)
    assert [str(branch) for branch in manifold.branches] == ["y = -1, z = 1"]
    assert manifold.unsolved in ((x - y,), (y - x,))


NOWHERE_REAL = [
    y**2 + 1,
    y**2 + x**2 + 1,
    y**4 + 1,
    y**4 + x**2 + 1,
    (y + x) ** 2 + 1,
    y**2 + x * y + x**2 + 1,
    y**2 + x**2,
    sp.exp(y) + 1,
    sp.exp(y) + x**2 + 1,
    a * y**2 + 1,
    sp.Integer(1),
]


@pytest.mark.parametrize("g", NOWHERE_REAL, ids=str)
def test_equations_without_real_solutions_are_refused(g: sp.Expr) -> None:
    with pytest.raises(BranchError, match="no real zeros"):
        solve_critical(one(g, a=2) if g.has(a) else one(g))


def test_complex_pieces_are_listed_beside_real_ones() -> None:
    manifold = solve_critical(one((y - x) * (y**2 + 1)))
    assert [str(branch) for branch in manifold.branches] == ["y = x"]
    assert manifold.complex == (y**2 + 1,)


def test_a_branch_that_is_complex_over_a_point_says_where() -> None:
    branch = solve_critical(one(y**2 - x)).branches[0]
    with pytest.raises(BranchError, match=r"complex or singular over x = -1 \(1 of 3 points\)"):
        branch.points([1, -1, 2])


def test_a_fast_rate_that_vanishes_at_epsilon_zero_is_refused() -> None:
    with pytest.raises(BranchError, match="fast rate of y vanishes identically at epsilon = 0"):
        solve_critical(one(eps * (x - y)))


@given(st.permutations([0, 1, 2]))
@settings(max_examples=6)
def test_permuting_the_fast_variables_permutes_the_points(order) -> None:
    rates = [(y, z - 2 * y + x), (z, w - z), (w, x - w - y)]
    system = SlowFastSystem(slow={x: -x}, fast=dict(rates[i] for i in order), epsilon=eps)
    (branch,) = solve_critical(system).branches
    direct = solve_critical(SlowFastSystem(slow={x: -x}, fast=dict(rates), epsilon=eps)).branches[0]
    assert branch.points(0.7) == pytest.approx(direct.points(0.7)[list(order)], abs=1e-15)


@pytest.mark.parametrize("make", [systems.sleigh, systems.michaelis_menten, systems.van_der_pol, systems.koper])
def test_the_known_systems_have_one_branch(make) -> None:
    (branch,) = solve_critical(make()).branches
    assert branch.is_explicit == (make in (systems.sleigh, systems.michaelis_menten))


def test_branches_are_equal_when_their_declarations_are() -> None:
    one_, two = (solve_critical(one(x - y**3 - y)).branches[0] for _ in range(2))
    assert one_ == two
    assert hash(one_) == hash(two)
    assert one_ != one_.through({"x": 0, "y": 0})


def test_a_branch_prints_as_its_formula_or_its_equation() -> None:
    assert str(solve_critical(one(x - y)).branches[0]) == "y = x"
    assert str(solve_critical(one(x - y**3 - y)).branches[0]) == "x - y**3 - y = 0"
    assert repr(solve_critical(one(y**2 - x**2))) == "CriticalManifold(y = x, y = -x)"


def test_a_chain_of_cubics_is_not_multiplied_out() -> None:
    # Eliminating every variable would give a polynomial of degree 3^6.
    chain = sp.symbols("s1:7")
    fast = {s: -2 * s - s**3 + chain[(i + 1) % 6] / 2 + x for i, s in enumerate(chain)}
    (branch,) = solve_critical(SlowFastSystem(slow={x: -x}, fast=fast, epsilon=eps)).branches
    points = branch.through({"x": 0.0, **{s.name: 0.0 for s in chain}}).points([0.5, -0.7])
    # All components are equal: 3 s/2 + s^3 = x.
    assert np.abs(1.5 * points + points**3 - np.array([[0.5], [-0.7]])).max() < 1e-12


def test_a_start_on_a_fold_has_no_nearest_sheet() -> None:
    critical = solve_critical(systems.van_der_pol())
    with pytest.raises(BranchError, match="lies on a fold"):
        critical.nearest({"x": 1, "y": -2 / 3})
    assert critical.nearest({"x": 1, "y": 1e300}).points(1e300)[0] == pytest.approx(3e300 ** (1 / 3))


@pytest.mark.parametrize("powers", [(0, 0), (-18, 18), (12, -12)])
def test_a_start_over_a_fold_has_no_sheet_to_go_on_with_in_any_units(powers) -> None:
    """x + 1 + y = exp(y) has a double root over x = 0, and two sheets beside it."""
    X, Y = x * sp.Rational(10) ** powers[0], y * sp.Rational(10) ** powers[1]
    critical = solve_critical(SlowFastSystem(slow={x: Y - 1}, fast={y: X + 1 + Y - sp.exp(Y)}, epsilon=eps))
    unit, fast_unit = 10.0 ** -powers[0], 10.0 ** -powers[1]
    region = {"x": (-unit, unit), "y": (-fast_unit, fast_unit)}
    with pytest.raises(BranchError, match="ends right over the start"):
        critical.nearest({"x": 0.0, "y": 0.7 * fast_unit}, region=region)
    assert critical.nearest({"x": 1e-3 * unit, "y": 0.7 * fast_unit}, region=region).seed is not None


def test_a_start_beside_a_branch_with_a_complex_formula_is_refused_in_words() -> None:
    critical = solve_critical(one(y**2 + y + x * sp.tanh(x) - 1))
    with pytest.raises(BranchError, match="no branch of the critical manifold is real"):
        critical.nearest({"x": 3, "y": 0})


def test_a_narrow_gaussian_is_an_atom_and_is_not_written_as_powers() -> None:
    dip = sp.exp(-(((x - sp.Rational(3, 10)) / sp.Rational(1, 100)) ** 2))
    (branch,) = solve_critical(one(-y * (1 - sp.Rational(11, 10) * dip))).branches
    assert dict(branch.graph or {}) == {y: 0}


def test_what_is_too_long_to_factor_stays_an_equation() -> None:
    s, c, k = sp.symbols("s c k")
    dear = SlowFastSystem(
        slow={s: -s}, fast={c: (s + c + k + a) ** 99 - 1, k: s - k**3 - k}, epsilon=eps, parameters={a: 1}
    )
    (branch,) = solve_critical(dear).branches
    assert not branch.is_explicit
    point = branch.through({"s": 0.0, "c": 0.0, "k": 0.0}).points(0.0)
    assert point == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_substitution_that_gives_no_formula_and_no_factor_is_undone() -> None:
    fast = {y: -y - z * sp.tanh(x) - sp.sin(y) / 3 - x, z: -(z**3) - 2 * z + sp.sin(x)}
    (branch,) = solve_critical(SlowFastSystem(slow={x: -x}, fast=fast, epsilon=eps)).branches
    assert sum(sp.count_ops(e) for e in branch.equations) <= sum(sp.count_ops(e) for e in fast.values()) + 6


def test_a_start_on_a_piece_that_is_no_graph_is_not_given_a_far_branch() -> None:
    # In (x, y, z - y^2) only y is fast; the far branch is an accident of the factor y + z - 20.
    shared = (x - y) * (y + z - 20)
    hidden = SlowFastSystem(
        slow={x: -x}, fast={y: shared, z: 2 * y * (x - y) * (y - 15) + eps * (x - z)}, epsilon=eps
    )
    critical = solve_critical(hidden)
    assert critical.unsolved
    with pytest.raises(BranchError, match=r"nearest to the piece .* which is no graph of y, z over .* x"):
        critical.nearest({"x": 0.5, "y": 0.45, "z": 0.2})
    assert critical.nearest({"x": 0.5, "y": 15.0, "z": 5.0}).is_explicit


def test_where_a_coefficient_has_a_pole_the_branch_has_no_point() -> None:
    x, y, epsilon = sp.symbols("x y epsilon")
    system = SlowFastSystem(slow={x: 1}, fast={y: x ** (1 - 2 * sp.pi) - y - y**3}, epsilon=epsilon)
    branch = solve_critical(system).branches[0]
    assert branch.roots({"x": 0}).shape == (0, 1)
    assert branch.roots({"x": 1}).shape == (1, 1)
    with pytest.raises(BranchError, match="no real point over x = 0"):
        branch.through({"x": 0, "y": 0})


def boltzmann(half: float, width: float) -> sp.Expr:
    return 1 / (1 + sp.exp((half - y) / sp.Rational(width)))


def steep_activation() -> SlowFastSystem:
    """A current with two steps and a gate z that follows y: three sheets over x, near y = -0.9 - x, 0 and 0.9 - x."""
    rate = -y - x + 2 * boltzmann(0, "0.02") - 1
    return SlowFastSystem(slow={x: 1}, fast={y: rate - z / 10, z: boltzmann(0, "0.02") - z}, epsilon=eps)


@pytest.mark.parametrize("start", np.linspace(-2.0, 2.0, 17))
def test_the_nearest_sheet_is_the_nearest_and_not_the_one_that_newtons_method_comes_to(start: float) -> None:
    manifold = solve_critical(steep_activation())
    everything = manifold.branches[0].roots(0.1, bounds={"y": (-3, 3), "z": (-1, 2)})
    assert len(everything) == 3
    for gate in (0.0, 0.5, 1.0):
        distances = np.linalg.norm(everything - [start, gate], axis=1)
        found = manifold.nearest({"x": 0.1, "y": start, "z": gate}).points(0.1)
        assert np.linalg.norm(found - [start, gate]) == pytest.approx(distances.min(), rel=1e-9)


def test_bounds_on_fast_variables_choose_the_sheet_and_the_branch() -> None:
    manifold = solve_critical(steep_activation())
    start = {"x": 0.1, "y": 0.05, "z": 0.5}
    assert abs(manifold.nearest(start).points(0.1)[0]) < 0.1
    assert manifold.nearest(start, region={"x": [0, 0.2], "y": [0.5, 2]}).points(0.1)[0] > 0.5
    assert manifold.nearest(start, region={"y": [-2, -0.5]}).points(0.1)[0] < -0.5
    # No sheet lies in these bounds, and the nearest is taken, of which later stages say so.
    assert abs(manifold.nearest(start, region={"y": [3, 4]}).points(0.1)[0]) < 0.1
    halves = solve_critical(SlowFastSystem(slow={x: 1}, fast={y: y * (x - y)}, epsilon=eps))
    assert halves.nearest({"x": 1, "y": 0.5}, region={"y": [0.3, 3]}).points(1.0)[0] == 1.0
    assert halves.nearest({"x": 1, "y": 0.5}, region={"y": [-1, 0.9]}).points(1.0)[0] == 0.0
    with pytest.raises(DeclarationError, match="q"):
        halves.nearest({"x": 1, "y": 0.5}, region={"q": [0, 1]})


@pytest.mark.exhaustive
def test_a_long_equation_is_shown_by_its_beginning_and_its_length() -> None:
    long = sp.expand((x**3 + y * z + z**2 + 1) ** 8) - 1
    (branch,) = solve_critical(
        SlowFastSystem(slow={x: 1, z: 1}, fast={y: long + y**9 + y}, epsilon=eps)
    ).branches
    assert re.fullmatch(r"y \+ x\*\*24 \+ .{150,240} \.\.\. \(166 terms\) = 0", str(branch))
    assert len(repr(branch)) < 300
    root = sp.sqrt(sum(sp.sin(k * x) ** 2 for k in range(1, 60)))
    assert re.search(r"sqrt.* \.\.\. \(\d+ operations\)$", str(Branch(branch.system, (y - root,), {y: root})))


def test_a_point_where_the_slope_is_infinite_is_no_fold() -> None:
    x, y, epsilon = sp.symbols("x y epsilon")
    system = SlowFastSystem(slow={x: -x}, fast={y: x - sp.sqrt(y) - y - y**5}, epsilon=epsilon)
    # The sheet ends there like a square, with an infinite slope, and does not turn back.
    with pytest.raises(BranchError, match="no branch of the critical manifold is real near the start"):
        solve_critical(system).nearest({"x": 0, "y": 0})


X, Y = sp.symbols("X Y")
LINE_AND_POINT = {X: (X - Y) * (X - 3), Y: (X - Y) * (Y - 4)}


def _rotated(fast: dict, cosine: sp.Rational, sine: sp.Rational) -> dict:
    """The same field in coordinates turned by an angle; both are rational."""
    there = {X: cosine * X - sine * Y, Y: sine * X + cosine * Y}
    u, v = (fast[s].subs(there, simultaneous=True) for s in (X, Y))
    return {X: sp.expand(cosine * u + sine * v), Y: sp.expand(cosine * v - sine * u)}


@pytest.mark.parametrize(
    ("fast", "piece"),
    [
        (LINE_AND_POINT, X - Y),
        (_rotated(LINE_AND_POINT, sp.Rational(3, 5), sp.Rational(4, 5)), X + 7 * Y),
        (_rotated(LINE_AND_POINT, sp.Rational(5, 13), sp.Rational(12, 13)), 7 * X + 17 * Y),
        ({X: (Y - X) * (1 + X / 3) + eps * x, Y: (X - Y) * (1 - Y / 4) - eps * Y}, X - Y),
        ({X: (X**2 + Y**2 - 1) * (X - x), Y: (X**2 + Y**2 - 1) * (Y - 2)}, X**2 + Y**2 - 1),
        ({X: (X - sp.exp(Y)) * (X - x), Y: (X - sp.exp(Y)) * (Y - x)}, X - sp.exp(Y)),
        ({X: (x - 1) * (X - 3), Y: (x - 1) * (Y - 4)}, x - 1),
        ({**LINE_AND_POINT, z: z - X}, (X - Y, z - X)),
        # At x = 0 the branch meets a line over this one point.
        ({X: X * Y, Y: X * z + Y, z: z - X * x}, (x, Y, z)),
    ],
)
def test_a_piece_of_the_wrong_dimension_is_kept_beside_the_branches(fast, piece) -> None:
    manifold = solve_critical(SlowFastSystem(slow={x: -x}, fast=fast, epsilon=eps))
    assert len(manifold.branches) == 1
    (found,) = manifold.unsolved
    expected = sp.Tuple(*piece) if isinstance(piece, tuple) else sp.Tuple(piece)
    equations = found if isinstance(found, sp.Tuple) else sp.Tuple(found)
    assert len(equations) == len(expected)
    for one_of, other in zip(equations, expected):
        assert sp.expand(one_of - other) == 0 or sp.expand(one_of + other) == 0
        assert str(one_of) in manifold.no_graph
        assert str(one_of) in repr(manifold)


def test_a_common_factor_without_real_zeros_is_complex_and_no_piece() -> None:
    circle = X**2 + Y**2 + 1
    manifold = solve_critical(
        SlowFastSystem(slow={x: -x}, fast={X: circle * (X - x), Y: circle * (Y - x)}, epsilon=eps)
    )
    assert manifold.unsolved == ()
    assert manifold.complex == (circle,)


@pytest.mark.exhaustive
def test_a_region_without_a_branch_names_the_piece_that_may_be_there() -> None:
    manifold = solve_critical(SlowFastSystem(slow={x: -x}, fast=LINE_AND_POINT, epsilon=eps))
    with pytest.raises(BranchError, match=r"there is X - Y = 0 too"):
        classify(manifold.branches[0], region={"x": (0.1, 2), "X": (-1, 1), "Y": (-1, 1)})
    with pytest.raises(BranchError, match=r"nearest to the piece X - Y = 0"):
        manifold.nearest({"x": 1, "X": 0.3, "Y": 0.2})


@pytest.mark.exhaustive
def test_how_far_a_piece_of_several_equations_is_counts_all_of_them() -> None:
    fast = {**LINE_AND_POINT, z: z - X}
    manifold = solve_critical(SlowFastSystem(slow={x: -x}, fast=fast, epsilon=eps))
    # 0.14 from X = Y, 0.76 from the branch and 0.83 from the line.
    assert manifold.nearest({"x": 1, "X": 3.4, "Y": 3.6, "z": 2.5}) == manifold.branches[0]
    with pytest.raises(BranchError, match=r"nearest to the piece X - Y = 0 and -X \+ z = 0"):
        manifold.nearest({"x": 1, "X": 1.0, "Y": 1.1, "z": 1.0})


def test_a_start_far_off_two_switches_has_the_sheet_on_which_both_hold() -> None:
    phi = {s: s / sp.sqrt(1 + s**2) for s in (y, z)}
    system = SlowFastSystem(
        slow={x: sp.Integer(1)}, fast={y: x / 2 - phi[y], z: x / 4 - phi[z] + phi[y] / 8}, epsilon=eps
    )
    sheet = solve_critical(system).nearest({"x": 1.0, "y": -100.0, "z": -50.0}, region={"x": (0, 1)})
    held = np.array([1 / 2, 5 / 16])
    assert sheet.points({"x": 1.0}) == pytest.approx(held / np.sqrt(1 - held**2), rel=1e-10)


@pytest.mark.parametrize(("total", "is_explicit"), [(sp.Rational(1, 10**6), False), (sp.Integer(30), True)])
@pytest.mark.parametrize("unit", [1, sp.Rational(1, 10**9)])
def test_a_formula_that_loses_digits_is_not_gone_by(total: sp.Expr, is_explicit: bool, unit: sp.Expr) -> None:
    """A complex in total concentrations: beside a trace of enzyme the root is the difference of large numbers."""
    s, c = x * unit, y * unit
    rate = (c**2 - (total + 50 + s) * c + total * s) / unit
    critical = solve_critical(SlowFastSystem(slow={x: -c}, fast={y: rate}, epsilon=eps))
    size = float(1 / unit)
    # Over x = 0 the root is 0, and what doubles make of it is no loss beside the others.
    sheet = critical.nearest({"x": 1000.0 * size, "y": 0.0}, region={"x": (0, 2000.0 * size)})
    assert sheet.is_explicit == is_explicit
    for place in (sp.Integer(2), sp.Integer(1000)):
        half = (total + 50 + place) / 2
        expected = sp.N(half - sp.sqrt(half**2 - total * place), 30) / unit
        (found,) = sheet.points(np.array([[float(place) * size]]))[0]
        assert found == pytest.approx(float(expected), rel=1e-9 if is_explicit else 1e-13)


def test_equations_in_units_hold_at_the_same_points_with_slopes_by_the_same_states() -> None:
    plain = solve_critical(one(x - y - y**5)).branches[0]
    scaled = dataclasses.replace(plain, units=(1024.0, 0.03125))
    on, off = np.array([[2.0, 1.0], [34.0, 2.0]]), np.array([[3.0, 1.0], [4.0, 1.0]])
    for branch in (plain, scaled):
        assert branch.residual(on).ravel() == pytest.approx([0.0, 0.0])
        first, second = branch.residual(off).ravel()
        assert second == pytest.approx(2.0 * first)
        # One more in x.
        assert branch.full_jacobian(off)[0, 0, 0] == pytest.approx(first)
