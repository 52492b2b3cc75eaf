"""The classical methods against one another: the orders that theorems promise, measured."""

import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from click.testing import CliRunner

from gsp import integrate, load, models
from gsp.algebra.ring import LocalisedRing
from gsp.cli import cli
from gsp.comparison import classical_methods
from gsp.comparison import method_table as table_module
from gsp.comparison.classical_methods import FraserRoussel, csp, ildm, quasi_steady_state
from gsp.comparison.comparison import slope
from gsp.comparison.method_table import MethodTable, method_table
from gsp.comparison.references import reference_at
from gsp.critical.branch import Branch
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import DeclarationError
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of
from gsp.slow.expansion import Expansion
from gsp.slow.series import LONGEST, expand
from gsp.slow.slow_points import zero_derivative
from gsp.slow.solved_manifold import solve_manifold
from gsp.systems.system import SlowFastSystem
from tests import example_systems as systems
from tests.example_systems import epsilon, x, y

LADDER = (0.01, 0.005, 0.0025)
# Branch, points (m, n_slow): explicit and implicit, several slow and fast variables, a saddle.
SHEETS = {
    "michaelis_menten": (
        solve_critical(systems.michaelis_menten()).branches[0],
        np.linspace(0.3, 2, 9)[:, None],
    ),
    "van_der_pol": (
        solve_critical(systems.van_der_pol()).branches[0].through({"y": 2 / 3, "x": 2}),
        np.linspace(0.2, 1, 9)[:, None],
    ),
    "koper": (
        solve_critical(systems.koper()).branches[0].through({"y": 0, "z": 0.5, "x": 2.4}),
        np.array([[-0.2, 0], [-0.1, 0.6], [0, 0.2], [0.1, 0.4], [0.2, 0.9]]),
    ),
    "coupled": (
        solve_critical(systems.coupled()).branches[0].through({"x": 1, "y": 0.5, "z": 0.3}),
        np.linspace(0.2, 1, 9)[:, None],
    ),
    "saddle": (solve_critical(systems.saddle()).branches[0], np.linspace(0.2, 1, 9)[:, None]),
}


def measured(branch, points, method) -> float:
    errors = []
    for e in LADDER:
        exact = zero_derivative(branch, points, epsilon=e, tolerance=1e-15)
        errors.append(float(np.abs(method(e).y - exact.y).max()))
    return slope(LADDER, errors, [3e-15] * len(LADDER))


@pytest.mark.parametrize(("branch", "points"), SHEETS.values(), ids=SHEETS)
def test_the_theorems_hold_on_every_kind_of_branch(branch, points) -> None:
    def order(function, **fixed):
        return measured(branch, points, lambda e: function(branch, points, epsilon=e, **fixed))

    def iterated(e: float, k: int):
        return FraserRoussel.over(branch, points, epsilon=e, iterates=k).points(points, k)

    assert measured(branch, points, lambda e: quasi_steady_state(branch, points)) == pytest.approx(1, abs=0.1)
    # Kaper and Kaper 2002: the error of ILDM is O(epsilon^2) times the curvature of M0, here not zero.
    assert order(ildm) == pytest.approx(2, abs=0.1)
    for q in (0, 1, 2):
        # Zagaris, Kaper and Kaper 2004, theorem 3.1.
        assert order(csp, refinements=q) == pytest.approx(q + 1, abs=0.1)
    for k in (0, 1, 2):
        # Kaper and Kaper 2002.
        assert measured(branch, points, lambda e, k=k: iterated(e, k)) == pytest.approx(k + 1, abs=0.1)


def test_three_refinements_of_csp_have_order_four() -> None:
    branch, points = SHEETS["michaelis_menten"]
    order = measured(branch, points, lambda e: csp(branch, points, epsilon=e, refinements=3))
    assert order == pytest.approx(4, abs=0.1)


def test_where_the_critical_manifold_is_flat_ildm_gains_an_order() -> None:
    # The sleigh's M0 is w = 0: its curvature vanishes, and with it the error at epsilon^2.
    branch = solve_critical(systems.sleigh()).branches[0]
    points = np.array([[-1, 1], [0.5, 1.5], [1, -0.5], [-0.3, 0.8]])
    order = measured(branch, points, lambda e: ildm(branch, points, epsilon=e))
    assert order == pytest.approx(3, abs=0.1)


def test_on_a_linear_system_ildm_is_exact() -> None:
    system = SlowFastSystem(slow={x: -x + y / 2}, fast={y: x - 2 * y}, epsilon=epsilon)
    branch = solve_critical(system).branches[0]
    e = 0.1
    # The slow eigenvector of [[-1, 1/2], [1/e, -2/e]].
    slow = np.roots([1, 1 + 2 / e, 2 / e - 0.5 / e]).max()
    assert ildm(branch, np.array([[1.0]]), epsilon=e).y[0, 0] == pytest.approx(2 * (slow + 1), abs=1e-13)


def segel_slemrod(kappa: float, sigma: float) -> SlowFastSystem:
    k, s = sp.symbols("kappa sigma")
    return SlowFastSystem(
        slow={y: (-(k + 1) * y + (k - s + y) * x) / s},
        fast={x: y - x * (k + y) / (k + 1)},
        epsilon=epsilon,
        parameters={k: kappa, s: sigma},
    )


def test_one_csp_refinement_is_its_closed_form() -> None:
    # With B = (g_x/g_y, 1) the condition g + epsilon (g_x/g_y) f = 0 is quadratic in the fast variable.
    system = segel_slemrod(10, 100)
    f, g = system.f[0], system.g[0]
    condition = sp.expand((g * g.diff(x) + epsilon * g.diff(y) * f).xreplace(dict(system.parameters)))
    branch = solve_critical(system).branches[0]
    found = csp(branch, np.array([[0.7]]), epsilon=0.05, refinements=1).y[0, 0]
    roots = sp.Poly(condition.subs({y: sp.Rational(7, 10), epsilon: sp.Rational(1, 20)}), x).nroots(n=20)
    assert min(abs(complex(root) - found) for root in roots) < 1e-13


@pytest.mark.exhaustive
def test_the_published_errors_on_michaelis_menten_are_reproduced_and_beaten() -> None:
    # Patsatzis, Fabiani, Russo and Siettos (arXiv 2309.07946), kappa = 10, sigma = 100, y in (0, 1): quasi-steady
    # state 8e-2, CSP once 5e-3, series through epsilon^2 1e-3, their network 5e-4. Their largest errors belong to
    # epsilon near 0.08, to judge by the first three.
    branch = solve_critical(segel_slemrod(10, 100)).branches[0]
    points = np.logspace(-6, 0, 60)[:, None]
    e = 0.08
    exact = zero_derivative(branch, points, epsilon=e)
    assert exact.error.max() < 1e-11

    def error(values) -> float:
        return float(np.abs(values - exact.y).max())

    assert error(quasi_steady_state(branch, points).y) == pytest.approx(8.3e-2, rel=0.1)
    assert error(csp(branch, points, epsilon=e, refinements=1).y) == pytest.approx(5e-3, rel=0.15)
    series = expand(branch, order=3)
    assert error(series.evaluate(points, e, order=2)) == pytest.approx(1.2e-3, rel=0.25)
    for value in (0.1, e, 0.01):
        solved = solve_manifold(branch, region={"y": (0, 1)}, epsilon=value)
        pointwise = zero_derivative(branch, points, epsilon=value)
        assert np.abs(solved.evaluate(points) - pointwise.y).max() < 1e-10


# -- the table -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def enzyme() -> MethodTable:
    scene = models.load("michaelis_menten")
    return method_table(scene, points=np.linspace(0.3, 1.8, 9), epsilons=(0.02, 0.01, 0.005))


@pytest.mark.exhaustive
def test_every_fitted_order_of_the_table_is_the_expected_one(enzyme: MethodTable) -> None:
    for row in enzyme.rows:
        if row.expected is not None:
            assert row.fitted == pytest.approx(row.expected, abs=0.1), row.label
        assert row.microseconds > 0
    solved = enzyme["solved"]
    assert solved.expected is None
    assert np.isnan(solved.fitted)
    assert max(solved.errors) < 1e-10


@pytest.mark.exhaustive
def test_the_reference_has_a_second_route(enzyme: MethodTable) -> None:
    assert set(enzyme.references) == {"orbit segments"}
    assert max(enzyme.floor) < 1e-12
    assert max(enzyme.disagreement) < 1e-12


def test_a_table_reads_well_and_can_be_written(enzyme: MethodTable) -> None:
    text = str(enzyme)
    assert "ILDM" in text
    assert "reference: orbit segments" in text
    assert len({len(line) for line in text.splitlines()[2:-3]}) == 1
    row = json.loads(json.dumps(enzyme.as_rows()))[1]
    assert (row["method"], row["epsilon"], row["error"]) == ("QSS", 0.01, enzyme["QSS"].errors[1])
    with pytest.raises(KeyError, match="CSP 2"):
        enzyme["CSP 9"]


@pytest.mark.exhaustive
def test_iterates_that_are_exact_but_for_interpolation_have_no_order() -> None:
    # y = x/(1 + x) at every epsilon: what is left fell by epsilon^k, and was told as the order.
    table = method_table(models.load("davis_skodje"), refinements=(), orders=())
    for k in (1, 2, 3):
        assert max(table[f"Fraser-Roussel {k}"].errors) < 1e-6
        assert np.isnan(table[f"Fraser-Roussel {k}"].fitted)


def test_the_series_is_exact_where_the_others_are_not() -> None:
    table = method_table(
        models.load("davis_skodje"),
        points=np.linspace(0.5, 3, 7),
        epsilons=(0.05, 0.025),
        orders=(0, 1),
        iterates=(1,),
    )
    assert max(table["series 0"].errors) < 1e-14
    assert np.isnan(table["series 0"].fitted)
    assert table["ILDM"].fitted == pytest.approx(2, abs=0.1)
    assert table["CSP 1"].fitted == pytest.approx(2, abs=0.1)


@pytest.mark.exhaustive
def test_a_field_that_is_split_and_two_slow_variables_are_tabulated() -> None:
    table = method_table(
        models.load("chaplygin_sleigh"), epsilons=(0.01, 0.005), orders=(0, 1), refinements=(1,), iterates=(1,)
    )
    assert table["series 1"].fitted == pytest.approx(2, abs=0.1)
    assert table["ILDM"].fitted == pytest.approx(3, abs=0.1)


@pytest.mark.exhaustive
def test_a_series_too_long_to_run_is_omitted_with_its_length_and_no_other_is_expanded_twice(
    monkeypatch,
) -> None:
    scene = load(Path(__file__).parents[1] / "systems" / "olsen.toml")
    study = study_of(scene, verb="method_table")
    orders, written = [], []
    extend = Expansion._next
    monkeypatch.setattr(Expansion, "_next", lambda self: orders.append(self._known) or extend(self))
    horner = LocalisedRing.horner
    monkeypatch.setattr(
        LocalisedRing, "horner", lambda self, e: written.append(len(e.numerator)) or horner(self, e)
    )
    points = [[2.9, 0.5], [3.0, 0.51]]
    table = method_table(study, points=points, epsilons=(0.01, 0.005))
    assert "series 1" in [row.label for row in table.rows]
    assert table.omitted["series 3"] == f"its coefficients have up to 1166 steps, more than {LONGEST}"
    assert set(table.omitted) == {"series 3"}
    # Polynomials through order 2, which are too long, then programs through order 3.
    assert orders == [0, 1, 0, 1, 2]
    assert written == []


def toggle_switch() -> Scene:
    return load(Path(__file__).parents[1] / "systems" / "toggle_switch.toml")


@pytest.mark.exhaustive
def test_what_stays_short_of_its_tolerance_says_so_and_no_surface_is_made_twice(monkeypatch) -> None:
    # The region is wide: neither 289 points nor the 20,000 of the iterates resolve what the power 5/2 makes of it.
    monkeypatch.setattr(table_module, "MOST_POINTS", 289)
    made: list[tuple[float, float]] = []
    over = FraserRoussel.over

    def counted(branch, x, *, epsilon, iterates, dropped=10.0) -> FraserRoussel:
        made.append((epsilon, dropped))
        return over(branch, x, epsilon=epsilon, iterates=iterates, dropped=dropped)

    monkeypatch.setattr(FraserRoussel, "over", counted)
    table = method_table(toggle_switch(), epsilons=(0.01, 0.005), refinements=(), orders=(0, 1))
    assert len(made) == len(set(made)) == 4
    assert "289 segments, estimated error" in table.endings["solved", 0.005]
    assert "the 289 points allowed do not resolve the surface along u, v, the next grid has 1089" in str(table)
    assert table["Fraser-Roussel 3"].evaluations < 10


def test_a_grid_that_may_not_be_finer_leaves_the_iterates_unresolved(monkeypatch) -> None:
    # M0 is 1/(1 + 25 x^2), for which 9 points are far too few; at a tenth of the region they are not.
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: 1 / (1 + 25 * x**2) - y}, epsilon=epsilon)
    branch = solve_critical(system).branches[0]
    wide, narrow = np.linspace(-1, 1, 5)[:, None], np.linspace(-0.002, 0.002, 5)[:, None]
    assert FraserRoussel.over(branch, wide, epsilon=0.01, iterates=2).resolved
    monkeypatch.setattr(classical_methods, "MOST_NODES", classical_methods.FIRST)
    assert not FraserRoussel.over(branch, wide, epsilon=0.01, iterates=2).resolved
    assert FraserRoussel.over(branch, narrow, epsilon=0.01, iterates=2).resolved


def test_the_critical_manifold_is_followed_once_for_all_epsilons(monkeypatch) -> None:
    branch, x = SHEETS["van_der_pol"]
    assert not branch.is_explicit
    followed: list[int] = []
    points = Branch.points

    def counted(self, x, **given):
        followed.append(len(x))
        return points(self, x, **given)

    monkeypatch.setattr(Branch, "points", counted)
    # A box that no other test has.
    x = x + 1e-3
    assert FraserRoussel.over(branch, x, epsilon=1e-3, iterates=1).resolved
    on_grids = sum(followed)
    assert FraserRoussel.over(branch, x, epsilon=2e-3, iterates=1).resolved
    assert sum(followed) == on_grids > 0


def test_where_a_matrix_is_singular_on_the_way_there_is_no_value_and_elsewhere_there_is() -> None:
    # With one refinement the matrix of Newton's first step is 1 - (epsilon x)^-1 up to a factor.
    u, w = sp.symbols("u w")
    system = SlowFastSystem(slow={u: -u * w}, fast={w: u - w}, epsilon=epsilon)
    branch = solve_critical(system).branches[0]
    places = np.array([[1.0], [2.0]])
    both = csp(branch, places, epsilon=0.5, refinements=1).y
    alone = csp(branch, places[:1], epsilon=0.5, refinements=1).y
    assert np.isnan(both[1]).all()
    assert both[0] == alone[0]
    assert np.isfinite(alone).all()


@pytest.mark.exhaustive
def test_a_table_with_singular_matrices_in_it_is_made() -> None:
    table = method_table(load(Path(__file__).parents[1] / "systems" / "morris_lecar.toml"), orders=(0, 1))
    assert np.isnan(table["CSP 2"].errors[0])
    assert np.isfinite(table["CSP 2"].errors[-1])


@pytest.mark.exhaustive
def test_the_reference_is_the_route_with_the_smaller_error_and_the_other_one_is_shown() -> None:
    # There the zero-derivative principle is past its optimal truncation at epsilon = 0.005.
    scene = load(Path(__file__).parents[1] / "systems" / "repressilator.toml")
    branch, system = study_of(scene).branch, scene.system
    points = np.array([[2.975, 2.975, 2.975]])
    reference = reference_at(branch, points, 0.005)
    pointwise = zero_derivative(branch, points, epsilon=0.005, tolerance=1e-15)
    assert reference.source == "orbit segments"
    assert reference.error < 0.01 * pointwise.error.max()
    assert reference.second_route == np.abs(pointwise.y - reference.y).max()
    # The flow as a witness: it carries the manifold into itself, and what is off it comes nearer by 1/e only.
    off = []
    for fast in (reference.y[0], pointwise.y[0]):
        start = dict(zip((s.name for s in system.states), (*points[0], *fast)))
        run = integrate(system, start=start, span=(0, 0.005), epsilon=0.005, rtol=1e-12, atol=1e-12)
        end = np.array([run[s.name][-1] for s in system.states])
        off.append(np.abs(reference_at(branch, end[None, :3], 0.005).y[0] - end[3:]).max())
    assert off[0] < reference.error + 1e-9
    assert off[1] > 100 * off[0]


def test_a_reference_is_never_surer_than_rounding() -> None:
    system = SlowFastSystem(slow={x: -x}, fast={y: 1000 * x - y}, epsilon=epsilon)
    points = np.linspace(1, 2, 3)[:, None]
    reference = reference_at(solve_critical(system).branches[0], points, 0.01)
    # y = 1000 x/(1 - epsilon).
    assert reference.y == pytest.approx(1000 * points / 0.99, rel=1e-14)
    assert reference.error >= 2000 * 2.0**-52
    assert reference.error < 1e-9


def test_points_on_both_sides_of_a_change_of_stability_have_no_orbit_segments() -> None:
    system = SlowFastSystem(slow={x: 1}, fast={y: x * (y - x)}, epsilon=epsilon)
    branch = next(b for b in solve_critical(system).branches if b.is_explicit)
    reference = reference_at(branch, np.array([[-1.0], [1.0]]), 0.001)
    assert reference.source == "zero-derivative principle"
    assert np.isnan(reference.second_route)
    alone = reference_at(branch, np.array([[1.0]]), 0.001)
    assert alone.y[0] == pytest.approx(reference.y[1], abs=2 * (reference.error + alone.error))


@pytest.mark.exhaustive
def test_readying_a_method_takes_no_longer_than_the_table_and_its_points_are_in_the_region() -> None:
    begun = time.perf_counter()
    scene = models.load("michaelis_menten")
    table = method_table(scene, epsilons=(0.02, 0.01), refinements=(), iterates=(1,))
    elapsed = time.perf_counter() - begun
    assert all(0.0 <= row.preparation < elapsed for row in table.rows if np.isfinite(row.preparation))
    low, high = scene.region["s"]
    assert low < table.points.min() < low + 0.1 * (high - low)
    assert high - 0.1 * (high - low) < table.points.max() < high


@pytest.mark.exhaustive
def test_more_than_three_slow_variables_take_pointwise_methods() -> None:
    slow = sp.symbols("x1:5")
    system = SlowFastSystem(
        slow={s: -s for s in slow}, fast={y: sp.Add(*slow) + slow[0] * slow[1] - y}, epsilon=epsilon
    )
    start = {"x1": 0.5, "x2": 0.5, "x3": 0.5, "x4": 0.5, "y": 2}
    scene = Scene(system, {s.name: (0, 1) for s in slow}, start, (0, 1), 0.01, (0.02, 0.01), 1e-6)
    table = method_table(scene)
    assert set(table.omitted) == {"Fraser-Roussel", "solved"}
    assert table["CSP 1"].fitted == pytest.approx(2, abs=0.1)
    assert "omitted" in str(table)


def test_bad_calls_are_named() -> None:
    scene = models.load("michaelis_menten")
    with pytest.raises(DeclarationError, match="two epsilons or more"):
        method_table(scene, epsilons=(0.1,))
    for points, said in (
        ([], "points are one point or more"),
        ([[1.0], [float("inf")]], "points must be finite"),
    ):
        with pytest.raises(DeclarationError, match=said):
            method_table(scene, points=points)
    with pytest.raises(DeclarationError, match="no interval for s"):
        method_table(replace(scene, region={"c": (0, 1)}))


@pytest.mark.exhaustive
def test_the_command_tells_the_reference_and_what_was_cut_short_as_the_table_does(monkeypatch) -> None:
    """All of what the text says stands in the JSON, and in the table's attributes."""
    scene = models.load("michaelis_menten")
    table = method_table(scene, epsilons=(0.02, 0.01), refinements=(0,), iterates=(1,), orders=(0,))
    endings = {("solved", 0.01): "stopped at 17 segments"}
    told = replace(table, endings=endings, omitted={"series 4": "it is too long"})
    monkeypatch.setattr(table_module, "method_table", lambda *arguments, **keywords: told)
    shown = json.loads(CliRunner().invoke(cli, ["methods", "michaelis_menten", "--json"]).stdout)
    assert shown == told.as_json()
    assert shown["coordinates"]["method"]["values"] == [row.label for row in told.rows]
    assert shown["coordinates"]["epsilon"]["values"] == list(told.epsilons)
    for name, given in (
        ("reference", told.references),
        ("floor", told.floor),
        ("disagreement", told.disagreement),
    ):
        assert shown["variables"][name]["values"] == list(given)
    attributes = shown["attributes"]
    assert attributes["endings"] == "solved at epsilon = 0.01: stopped at 17 segments"
    assert attributes["omitted"] == "series 4: it is too long"


def test_methods_have_their_orders_in_any_unit() -> None:
    # Numbers may be 1e-12: beside 1 every error would be rounding, and a box around one point huge.
    fitted = []
    for unit in (sp.Integer(1), sp.Rational(1, 10**12)):
        system = SlowFastSystem(slow={x: -x + y}, fast={y: x - (1 + x / unit) * y}, epsilon=epsilon)
        size = float(unit)
        scene = Scene(system, {"x": (0.1 * size, 3 * size)}, {"x": size, "y": 0}, (0, 1), 0.01, (0.02, 0.01))
        table = method_table(scene, points=[[0.5 * size]], iterates=(2,), refinements=(2,), orders=(2,))
        assert max(table.floor) < 1e-13 * size
        fitted.append([row.fitted for row in table.rows if row.expected])
    assert fitted[1] == pytest.approx(fitted[0], abs=0.02)


def kinked() -> Branch:
    """x' = -1, epsilon y' = |x| - y: y = x + epsilon, and from the kink on -x - epsilon + 2 epsilon exp(x/epsilon)."""
    return solve_critical(SlowFastSystem({x: -1}, {y: sp.Abs(x) - y}, epsilon=epsilon)).branches[0]


@pytest.mark.parametrize("e", [0.1, 0.05])
def test_beside_a_kink_the_reference_is_the_manifold_and_not_what_the_field_at_the_point_says(e: float) -> None:
    points = np.array([-0.5, -0.1, -0.03, 0.04, 0.3])
    exact = np.where(points > 0, points + e, -points - e + 2 * e * np.exp(np.minimum(points, 0) / e))
    found = reference_at(kinked(), points[:, None], e)
    assert np.abs(found.y[:, 0] - exact).max() <= found.error < 0.1 * found.second_route
    assert found.second_route == pytest.approx(2 * e * np.exp(-0.03 / e), rel=1e-3)


def test_across_a_kink_no_order_above_the_first_is_expected() -> None:
    scene = Scene(
        kinked().system, region={"x": (-1, 1)}, start={"x": 1, "y": 1}, span=(0, 2), epsilon=0.05,
        epsilons=(0.1, 0.05), tolerance=0.01,
    )  # fmt: skip
    options = {"refinements": (0, 1), "iterates": (), "orders": (0, 2)}
    across = method_table(scene, points=np.array([[-0.03], [0.5]]), **options)
    assert across.crossed == ("x",)
    assert {row.expected for row in across.rows} == {1, None}
    assert "no order above 1 is expected: points lie on both sides of x = 0" in str(across)
    # The order is measured all the same.
    assert across["series 2"].fitted < 1.5
    beside = method_table(scene, points=np.array([[0.2], [0.5]]), **options)
    assert not beside.crossed
    assert beside["series 2"].expected == 3
