"""Systems that are shifted by c: what is found of them is shifted by c, to the rounding of c."""

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import BranchError

x, y, t, epsilon = sp.symbols("x y t epsilon")
# g(x, t, y), and whether the sheet is shifted with t.
SHEETS = [
    (x + t**4 - y, 0),
    (x * sp.exp(-4 * t**2 - t * x / 9) - y, 0),
    (x / (1 + t**2) - y, 0),
    (x + t**2 * x + t - y * (1 + t**2), 0),
    (x + t - y**3 - y, 1),
    (x + 2 + t**2 - y**2, 1),
    (x + (t - y) ** 3 + (t - y), 1),
]


def far(g: sp.Expr, shifted: int, c: int) -> tuple[gsp.SeriesManifold, np.ndarray]:
    """The series of the system at t = c + 1, and the terms of order 0 to 3 there at epsilon = 0.01."""
    moved = g.xreplace({t: t - c, y: y - shifted * c})
    system = gsp.SlowFastSystem(slow={x: -x, t: sp.Integer(1)}, fast={y: moved}, epsilon=epsilon)
    branch = gsp.solve_critical(system).branches[0]
    if not branch.is_explicit:
        branch = branch.through({"x": 1, "t": c + 1, "y": shifted * c + 1})
    series = gsp.expand(branch, order=3)
    terms = series.terms([1.0, c + 1.0], 0.01).ravel()
    return series, terms - np.array([shifted * c, 0, 0, 0])


@pytest.mark.parametrize("c", [80, 10**6])
@pytest.mark.parametrize(("g", "shifted"), SHEETS)
def test_a_series_far_from_the_origin_is_the_one_at_it(g: sp.Expr, shifted: int, c: int) -> None:
    """Its terms change by less than 100 there when t does by 1, so that the rounding of t is that many times eps c."""
    at_origin, there = far(g, shifted, 0)[1], far(g, shifted, c)[1]
    assert there == pytest.approx(at_origin, rel=1e-13, abs=100 * c * np.finfo(float).eps)
    assert np.abs(there - at_origin)[1:] == pytest.approx(0, abs=c * np.finfo(float).eps)


def test_a_formula_far_from_the_origin_is_written_about_its_centre() -> None:
    branch = far(SHEETS[0][0], 0, 1000)[0].branch
    assert branch.graph == {y: x + (t - 1000) ** 4}


def test_a_rate_that_is_linear_in_a_shifted_state_is_written_about_no_other_place() -> None:
    """About 300, as the fast rate is, it would be 300 k more and less."""
    k, place = sp.symbols("k place")
    rate = y / 10 - k * (x - place)
    system = gsp.SlowFastSystem(
        slow={x: rate, t: sp.Integer(1)},
        fast={y: (x - 300) ** 3 / 50 + (t - 2020) ** 2 - y - (y - 40) ** 3 / 5000},
        epsilon=epsilon,
        parameters={k: 0.05, place: 293},
    )
    (branch,) = gsp.solve_critical(system).branches
    series = gsp.expand(branch, order=1)
    assert x in series.chart.centres
    assert series.reduced_field[0][0] == rate


@pytest.mark.parametrize("c", [0, 10**4, 10**6])
def test_the_sheets_over_a_point_far_from_the_origin_are_all_found(c: int) -> None:
    u = y - c
    system = gsp.SlowFastSystem(slow={x: u}, fast={y: x - c - u**5 / 3 + u**2}, epsilon=epsilon)
    found = gsp.solve_critical(system).branches[0].roots([c - 0.1])
    every = np.roots([-1 / 3, 0, 0, 1, 0, -0.1])
    real = np.sort(every.real[every.imag == 0])
    assert found.ravel() - c == pytest.approx(real, abs=1e-12 + 10 * c * np.finfo(float).eps)


@pytest.mark.parametrize("c", [0, 10**6])
def test_a_delayed_exit_far_from_the_origin_is_the_one_at_it(c: int) -> None:
    """The orbit is known to the rounding of c alone, and one step of the length of c would hold the whole passage."""
    u, v = y - c, x - c
    system = gsp.SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: (v + v**2 / 2) * u}, epsilon=epsilon)
    branch = gsp.solve_critical(system).branches[0]
    passed = gsp.entry_exit(branch, start={"x": c - 0.5})
    # Behind 0 the integral of v + v^2/2 takes the value again that it has at -1/2.
    exit_at = max(root.real for root in np.roots([1 / 6, 1 / 2, 0, -(0.125 - 0.125 / 6)]))
    assert passed.point["x"] - c == pytest.approx(exit_at, abs=1e-9 + 1e3 * c * np.finfo(float).eps)


# {slow: f}, {fast: g} and a point next to the sheet, each state to be shifted by its own distance.
z = sp.Symbol("z")
HALF = sp.Rational(1, 2)
FIELDS = [
    ({x: -x + (x + HALF) * y}, {y: x - (x + 1) * y}, {x: 1, y: HALF}),
    ({x: -z, z: x - z}, {y: x * z + 1 + (x + z) ** 3 - (2 + sp.cos(x)) * y}, {x: HALF, z: HALF, y: 1}),
    ({x: z / 8 - 9 * y / 8, z: sp.Integer(1)}, {y: x + y**2 + y**3 / 10}, {x: -HALF, z: -HALF, y: -HALF}),
    (
        {x: 1 - x - x * sp.exp(y / (1 + y / 20)) / 10},
        {y: x * sp.exp(y / (1 + y / 20)) / 4 - 2 * y},
        {x: HALF, y: 0},
    ),
    (
        {x: sp.Integer(1)},
        {y: x * y - z - y * (y**2 + z**2), z: y + x * z - z * (y**2 + z**2)},
        {x: -HALF, y: 0, z: 0},
    ),
]
Shifted = tuple[gsp.SlowFastSystem, dict[sp.Symbol, sp.Expr], np.ndarray]


def shifted(field: tuple, c: int) -> Shifted:
    """The system, the point, and by how much each of its states is shifted: 2 c, -3 c and 5 c."""
    slow, fast, point = field
    there = dict(zip([*slow, *fast], (2 * c, -3 * c, 5 * c)))
    back = {s: s - far for s, far in there.items()}
    moved = [{s: rate.xreplace(back) for s, rate in rates.items()} for rates in (slow, fast)]
    system = gsp.SlowFastSystem(slow=moved[0], fast=moved[1], epsilon=epsilon)
    return system, {s: v + there[s] for s, v in point.items()}, np.array(list(there.values()), dtype=float)


@pytest.mark.parametrize("c", [300, 10**6])
@pytest.mark.parametrize("field", FIELDS)
def test_states_that_are_shifted_by_different_distances_keep_the_digits_of_the_series(
    field: tuple, c: int
) -> None:
    """Coefficients of order 2 were rounding altogether, up to 1e60."""
    found = []
    for by in (0, c):
        system, point, there = shifted(field, by)
        branch = gsp.solve_critical(system).nearest({s.name: float(v) for s, v in point.items()})
        slow = {s.name: float(point[s]) for s in system.x}
        terms = gsp.expand(branch, order=3).terms(slow, 0.01)
        found.append(terms - np.outer([1, 0, 0, 0], there[len(system.x) :]))
    assert found[1] == pytest.approx(found[0], rel=1e-9, abs=1e3 * c * np.finfo(float).eps)


@pytest.mark.parametrize("c", [300, 10**6])
def test_points_of_a_shifted_slow_manifold_are_those_at_the_origin(c: int) -> None:
    """With states at 2e6, -3e6 and 5e6 the surface was flat, and the points of order 0."""
    found = []
    for by in (0, c):
        system, point, there = shifted(FIELDS[1], by)
        branch = gsp.solve_critical(system).branches[0]
        slow = {s.name: float(point[s]) for s in system.x}
        around = {name: (v - 0.1, v + 0.1) for name, v in slow.items()}
        solved = gsp.solve_manifold(branch, region=around, epsilon=0.02, tolerance=1e-8)
        pointwise = gsp.zero_derivative(branch, slow, epsilon=0.02)
        assert abs(pointwise.y - solved.evaluate(slow)) <= pointwise.error + solved.error_estimate
        found.append(pointwise.y - there[-1:])
    assert found[1] == pytest.approx(found[0], abs=1e-11 + 1e2 * c * np.finfo(float).eps)


@pytest.mark.parametrize("c", [0, 10**6])
def test_a_fold_far_from_the_origin_is_passed_like_the_one_at_it(c: int) -> None:
    """Newton's method was to come nearer to it than the rounding of c, and there was no fold."""
    u, v = x - c, y - 2 * c
    system = gsp.SlowFastSystem(slow={x: -v}, fast={y: u - v**3 / 3 + v}, epsilon=epsilon)
    passage = gsp.fold_passage(
        system, {"x": c - 2 / 3, "y": 2 * c + 1}, region={"x": (c - 2, c + 2), "y": (2 * c - 3, 2 * c + 3)}
    )
    assert passage.a * passage.b == pytest.approx(1.0, rel=1e-6)
    assert passage.exit(0.001)["x"] - c == pytest.approx(-0.6885126840426017, abs=1e-8)


@pytest.mark.parametrize("c", [0, 10**6])
def test_a_branch_far_from_the_origin_has_equilibria_to_the_rounding_of_its_points(c: int) -> None:
    u, v = x - c, y - c
    system = gsp.SlowFastSystem(slow={x: -u}, fast={y: u + 3 * v - v**3 / 9 + 2}, epsilon=epsilon)
    branch = gsp.solve_critical(system).nearest({"x": c, "y": c + 5})
    verdict = gsp.classify(branch, region={"x": (c - 1, c + 1), "y": (c + 4, c + 8)})
    assert verdict.holds
    assert verdict.kind.value == "attracting"


@pytest.mark.parametrize("c", [10**4, 10**6])
def test_a_relaxation_cycle_far_from_the_origin_closes_with_the_period_at_it(c: int) -> None:
    """Drops were measured in the distance from the origin, and landed nowhere."""
    u, v = x - c, y - c
    system = gsp.SlowFastSystem(slow={x: -v}, fast={y: u - v**3 / 3 + v}, epsilon=epsilon)
    branch = gsp.solve_critical(system).branches[0]
    orbit = gsp.singular_orbit(branch, {"x": c + 0.6, "y": c + 2})
    expected = [3 - 2 * np.log(2), 7.01432224, 1 / 3]
    # T_1 and T_2 are differences over 1e-5, of runs that are told to 1e-11 of where the states are.
    assert orbit.coefficients == pytest.approx(expected, abs=1e-8 * c)


def test_places_are_told_to_the_digits_of_how_far_they_are_from_the_centre() -> None:
    """Both were 1e+06."""
    X, Y = x - 10**6, y - 10**6
    system = gsp.SlowFastSystem(slow={x: -X}, fast={y: X**2 + 2 * X * Y - Y - Y**2}, epsilon=epsilon)
    start = {"x": 1000000.25, "y": 1000000.125}
    branch = gsp.solve_critical(system).nearest(start)
    base = gsp.project(gsp.expand(branch, order=1), start, epsilon=0.01)
    assert "fibre through x = 1000000.25, y = 1000000.125 at" in str(base)
    # Three sheets lie over the middle of the region.
    sheets = gsp.SlowFastSystem(slow={x: -Y}, fast={y: X + Y - Y**3 / 3}, epsilon=epsilon)
    with pytest.raises(BranchError, match=r"x = 1000000\.125\."):
        gsp.solve_manifold(gsp.solve_critical(sheets).branches[0], region={"x": (1e6, 1000000.25)}, epsilon=0.3)


@pytest.mark.parametrize("c", [300, 10**6])
def test_formulas_beside_a_root_are_about_the_parameter_that_is_the_origin(c: int) -> None:
    """Of h_3 at 10^6 the expansion gave 1e32: the centre of its polynomials is T0 and a multiple of the root."""
    T, T0 = sp.symbols("T T0")
    u = T - T0
    system = gsp.SlowFastSystem(
        slow={T: y * u / 7 - u / 5},
        fast={y: 1 + u / 10 + y - y**2 + u * y**2 / 9},
        epsilon=epsilon,
        parameters={T0: c},
    )
    series = gsp.expand(gsp.solve_critical(system).branches[0], order=3)
    for (formula,) in series.coefficients:
        exact = formula.xreplace({T: c + sp.Rational(1, 4), T0: sp.Integer(c)})
        found = sp.lambdify((T, T0), formula, "math")(c + 0.25, float(c))
        assert found == pytest.approx(float(exact.evalf(30)), rel=100 * c * np.finfo(float).eps)
