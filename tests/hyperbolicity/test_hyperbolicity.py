"""Normal hyperbolicity: the verdict follows the eigenvalues, losses are located, and disguise changes nothing."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gsp.critical.critical_manifold import solve_critical
from gsp.critical.sampling import Sampler
from gsp.errors import BranchError
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity, Kind, classify
from gsp.hyperbolicity.losses.locator import Locator
from gsp.systems.system import SlowFastSystem
from tests import example_systems as systems

x, y, z, u, v, a, eps = sp.symbols("x y z u v a epsilon")
UNIT = {"x": (-1, 1)}


def judge(g, region=UNIT, f=-x, *, through=None, epsilon=None, **parameters) -> Hyperbolicity:
    fast = g if isinstance(g, dict) else {y: g}
    values = {sp.Symbol(n): value for n, value in parameters.items()}
    manifold = solve_critical(SlowFastSystem(slow={x: f}, fast=fast, epsilon=eps, parameters=values))
    branch = manifold.nearest(through) if through else manifold.branches[0]
    return classify(branch, region=region, epsilon=epsilon)


def condition(verdict: Hyperbolicity, name: str):
    (found,) = [c for c in verdict.conditions if c.name == name]
    return found


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("g", "kind", "gap"),
    [
        (x - 2 * y, Kind.ATTRACTING, 2),
        (2 * y - x, Kind.REPELLING, 2),
        ({y: y + x**2, z: -3 * z + x * y}, Kind.SADDLE, 1),
        ({y: -y + 5 * z, z: -5 * y - z + x}, Kind.ATTRACTING, 1),
        (-y * (x**2 + sp.Rational(1, 4)), Kind.ATTRACTING, 0.25),
        (sp.exp(y) - x - 2, Kind.REPELLING, 1),
        (x - y**3 - y, Kind.ATTRACTING, 1),
    ],
)
def test_kind_and_gap_are_those_of_the_eigenvalues(g, kind, gap) -> None:
    verdict = judge(g)
    assert verdict.kind is kind
    assert verdict.gap == pytest.approx(gap, rel=1e-6)
    assert verdict.holds
    assert verdict.losses == ()


@pytest.mark.exhaustive
def test_eigenvalues_are_those_of_the_closed_form_and_keep_the_batch() -> None:
    verdict = judge({y: -y + x * z, z: -x * y - 2 * z})
    grid = np.linspace(-1, 1, 11)
    found = verdict.eigenvalues(grid)
    assert found.shape == (11, 2)
    root = np.sqrt(0.25 - grid**2 + 0j)
    expected = np.sort_complex(np.stack([-1.5 + root, -1.5 - root], axis=1))
    assert np.abs(np.sort_complex(found) - expected).max() < 1e-7
    assert verdict.eigenvalues(0.5).shape == (2,)
    assert verdict.eigenvalues({"x": 0.9}).imag.max() == pytest.approx(np.sqrt(0.81 - 0.25))


@pytest.mark.exhaustive
def test_a_sheet_is_not_blamed_for_the_folds_of_another() -> None:
    # Folds at y = +-1 of the lower pair of sheets; the sheet near y = 5 has none over the region.
    g = (x + y - y**3 / 3) * (y - 5) - sp.Rational(1, 100)
    upper = judge(g, {"x": (-1, 1)}, through={"x": 0, "y": 5})
    assert upper.losses == ()
    assert upper.kind is not Kind.LOST
    assert judge(g, {"x": (-1, 1)}, through={"x": 0, "y": 1.73}).kind is Kind.LOST


def test_only_the_sheet_that_runs_into_a_fold_owns_it() -> None:
    (branch,) = solve_critical(systems.van_der_pol()).branches
    fold = np.array([-2 / 3, 1.0])
    for start, owned in ((1.7, True), (0.1, True), (-1.7, False)):
        sheet = branch.through({"y": 0, "x": start})
        locator = Locator(Sampler(sheet), {"y": (-1, 1)}, 1.0, usual=1.0, samples=np.array([[0.0, start]]))
        sample = np.array([0.0, sheet.points(0.0)[0]])
        assert locator._on_sheet(fold, sample) is owned


@pytest.mark.exhaustive
def test_one_sheet_between_the_folds_holds() -> None:
    region = {"y": (-0.5, 0.5)}
    (branch,) = solve_critical(systems.van_der_pol()).branches
    for start, kind in ((1.7, Kind.ATTRACTING), (0.1, Kind.REPELLING), (-1.7, Kind.ATTRACTING)):
        assert classify(branch.through({"y": 0, "x": start}), region=region).kind is kind
    assert classify(branch, region={**region, "x": (1.1, 3)}).kind is Kind.ATTRACTING


def test_sheets_of_different_type_ask_which_one_is_meant() -> None:
    (branch,) = solve_critical(systems.van_der_pol()).branches
    with pytest.raises(BranchError, match=r"sheets of different type.*attracting, repelling.*branch.through"):
        classify(branch, region={"y": (-0.5, 0.5)})


def test_an_explicit_fold_is_located() -> None:
    for which in (0, 1):
        branches = solve_critical(SlowFastSystem(slow={x: 1}, fast={y: x + y**2}, epsilon=eps)).branches
        verdict = classify(branches[which], region=UNIT)
        assert verdict.kind is Kind.LOST
        assert not condition(verdict, "graph").holds
        assert verdict.losses
        assert abs(verdict.losses[0].point["x"]) < 1e-8


def test_a_transcritical_crossing_is_located() -> None:
    verdict = judge(y**2 - (x - sp.Rational(1, 7)) ** 2)
    assert verdict.kind is Kind.LOST
    (loss,) = verdict.losses
    assert loss.point["x"] == pytest.approx(1 / 7, abs=1e-8)
    assert not condition(verdict, "one type").holds


def test_a_gap_of_nothing_at_all_is_no_hyperbolic_equilibrium() -> None:
    x, y, z, epsilon = sp.symbols("x y z epsilon")
    centre = SlowFastSystem(slow={x: -x}, fast={y: z, z: x - y}, epsilon=epsilon)
    verdict = classify(solve_critical(centre).branches[0], region={"x": (0, 1)})
    assert (verdict.kind, verdict.gap, verdict.holds) == (Kind.LOST, 0.0, False)
    assert [c.name for c in verdict.conditions if not c.holds] == ["hyperbolic equilibria"]


def test_a_graph_may_leave_the_bounds_on_fast_variables_and_is_not_said_to_be_missing_there() -> None:
    """They choose a sheet: over half of the region y = x is outside them, and the branch is a graph all the same."""
    verdict = judge(x - y, {"x": (0, 2), "y": (-2, 1)})
    assert verdict.holds
    assert str(condition(verdict, "graph")).endswith(
        "(share of points of the region over which it has no real point, 0 needed)"
    )


@pytest.mark.parametrize(
    "g", [x * y - 1, -y + 1 / (x**2 - sp.Rational(1, 9)), (x - sp.Rational(1, 3)) ** 2 * y - 1]
)
def test_a_pole_of_the_branch_is_found_between_the_samples(g) -> None:
    verdict = judge(g, {"x": (-1, 1.1)})
    assert verdict.kind is Kind.LOST
    assert not condition(verdict, "graph").holds
    poles = {round(loss.point["x"], 7) for loss in verdict.losses if loss.crossing == "pole of the branch"}
    assert poles <= {0.0, round(1 / 3, 7), round(-1 / 3, 7)}
    assert poles


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("height", "place"),
    [
        (sp.tan(2 * x - 5), 2.5 - 3 * np.pi / 4),
        (sp.tan(sp.exp(x)), np.log(np.pi / 2)),
        (sp.sqrt(1 + 1 / (x - sp.Rational(1, 7)) ** 2), 1 / 7),
        (sp.sinh(3 + 1 / (x - sp.Rational(1, 7)) ** 2) ** sp.Rational(1, 9), 1 / 7),
    ],
)
def test_a_pole_within_a_function_is_a_pole_of_the_branch(height, place: float) -> None:
    verdict = judge(height - y, {"x": (-1, 0.9)})
    assert verdict.kind is Kind.LOST
    assert {round(loss.point["x"], 7) for loss in verdict.losses if loss.is_pole} == {round(place, 7)}


@pytest.mark.exhaustive
@pytest.mark.parametrize("height", [sp.atan(1 / (x - sp.Rational(1, 7)) ** 2), sp.tan(x)])
def test_a_function_that_stays_bounded_at_a_pole_within_it_has_none(height) -> None:
    assert judge(height - y, {"x": (-1, 0.9)}).losses == ()


def test_a_removable_zero_of_a_denominator_is_no_pole() -> None:
    system = SlowFastSystem(slow={x: -x}, fast={y: x - y / (1 + y**2)}, epsilon=eps)
    branch = solve_critical(system).nearest({"x": 0.1, "y": 0.1})
    verdict = classify(branch, region={"x": (-0.4, 0.4)})
    assert verdict.kind is Kind.ATTRACTING
    assert verdict.losses == ()


@pytest.mark.exhaustive
def test_a_branch_that_goes_on_where_its_formula_is_no_number_has_no_pole_there() -> None:
    # The rates of a gate, which are 0/0 at x = -40, a point of the grid, and smooth.
    opening = (x + 40) / 10 / (1 - sp.exp(-(x + 40) / 10))
    gate = opening * (1 - y) - 4 * sp.exp(-(x + 65) / 18) * y
    for region in ((-80, 0), (-40, 0), (-80, -40)):
        verdict = judge(gate, {"x": region})
        assert verdict.kind is Kind.ATTRACTING, region
        assert verdict.losses == ()
        assert condition(verdict, "graph").holds
    # Beside it poles are found, simple and double, and the end of a root is no removable point.
    for height in (1 / (x + 40), 1 / (x + 40) ** 2, 1 / sp.Abs(x + 40) ** sp.Rational(1, 2)):
        verdict = judge(height + opening - y, {"x": (-80, 0)})
        assert verdict.kind is Kind.LOST
        assert {round(loss.point["x"], 6) for loss in verdict.losses if loss.is_pole} == {-40.0}
    rooted = judge(sp.sqrt(x + 40) * opening - y, {"x": (-80, 0)})
    assert rooted.kind is Kind.LOST
    assert not condition(rooted, "graph").holds


def test_a_loss_too_thin_for_the_samples_is_found() -> None:
    third = sp.Rational(1, 3)
    verdict = judge(-y * ((x - third) ** 2 - sp.Rational(1, 10**6)))
    assert verdict.kind is Kind.LOST
    places = sorted(loss.point["x"] for loss in verdict.losses)
    assert places == pytest.approx([1 / 3 - 1e-3, 1 / 3 + 1e-3], abs=1e-8)
    shift = (x - third) ** 2 - sp.Rational(1, 10**6)
    pair = judge({y: -shift * y - 2 * z, z: 2 * y - shift * z})
    assert pair.kind is Kind.LOST
    assert all(loss.crossing == "imaginary pair" for loss in pair.losses)
    assert abs(pair.losses[0].point["x"] - 1 / 3) == pytest.approx(1e-3, abs=1e-8)


def test_a_branch_that_is_degenerate_everywhere_is_said_to_be() -> None:
    verdict = judge((y - x) ** 2)
    assert verdict.kind is Kind.LOST
    (loss,) = verdict.losses
    assert "whole branch" in loss.crossing


@pytest.mark.exhaustive
@given(st.lists(st.integers(-3, 3), min_size=4, max_size=4), st.sampled_from([(-1, -2), (1, 3), (-2, 1)]))
@settings(max_examples=4)
def test_a_linear_change_of_the_fast_variables_changes_nothing(entries, rates) -> None:
    matrix = sp.Matrix(2, 2, entries)
    assume(matrix.det() != 0)
    fast = sp.Matrix([y, z])
    layer = sp.Matrix([rates[0] * (y - x**2), rates[1] * (z - x * y)])
    back = dict(zip((y, z), matrix.inv() * fast))
    g = (matrix * layer).xreplace(back)
    plain = judge({y: layer[0], z: layer[1]})
    disguised = judge({y: sp.expand(g[0]), z: sp.expand(g[1])})
    assert disguised.kind is plain.kind
    assert disguised.gap == pytest.approx(plain.gap, rel=1e-9)


@pytest.mark.exhaustive
def test_the_rates_give_the_r_of_normal_hyperbolicity() -> None:
    verdict = judge(x - 2 * y, f=-4 * x, epsilon=0.1)
    assert (verdict.rates.normal, verdict.rates.tangential) == (2, 4)
    assert verdict.rates.r(0.1) == pytest.approx(5)
    found = condition(verdict, "normal rate dominates")
    assert found.holds
    assert found.value == pytest.approx(5)
    assert not condition(judge(x - 2 * y, f=-4 * x, epsilon=1), "normal rate dominates").holds
    assert judge(x - 2 * y, f=sp.Integer(1)).rates.r(0.1) == float("inf")
    # No rate dominates where there is none.
    assert judge(x * (x - 2 * y), f=sp.Integer(1)).rates.r(0.1) == 0.0


def test_the_tangential_rate_is_that_of_the_reduced_flow() -> None:
    # On y = 3 x the slow flow is x' = -x + 3 x = 2 x, although f_x alone is -1.
    assert judge(3 * x - y, f=-x + y).rates.tangential == pytest.approx(2)


def test_every_condition_is_decided_by_a_number() -> None:
    verdict = judge(x - 2 * y, epsilon=0.01)
    names = [c.name for c in verdict.conditions]
    assert len(names) == len(set(names)) == 7
    for found in verdict.conditions:
        assert isinstance(found.value, float)
        assert found.requirement
        assert found.holds
        assert found.name in str(verdict)
    assert "sampled" in verdict.evidence
    assert len(judge(x - 2 * y).conditions) == 6


def test_a_field_that_is_not_smooth_is_named() -> None:
    verdict = judge(sp.Abs(x) - y)
    assert verdict.kind is Kind.ATTRACTING
    found = condition(verdict, "smooth field")
    assert (found.value, found.holds) == (1, False)
    assert not verdict.holds


@pytest.mark.exhaustive
def test_three_slow_variables_are_sampled_with_their_corners() -> None:
    system = SlowFastSystem(slow={x: -x, u: -u, v: u}, fast={y: x + u * v - y - y**3}, epsilon=eps)
    region = {"x": (-1, 1), "u": (-1, 1), "v": (-1, 1)}
    verdict = classify(solve_critical(system).branches[0], region=region)
    assert verdict.kind is Kind.ATTRACTING
    # 1 + 3 y^2 is least, 1, at y = 0, and largest in a corner, where y^3 + y = 2.
    assert verdict.gap == pytest.approx(1, abs=1e-6)
    assert condition(verdict, "smooth Jacobian").value > 1
    corner = SlowFastSystem(slow={x: -x, u: -u, v: u}, fast={y: -y * (3 - x - u - v)}, epsilon=eps)
    assert classify(solve_critical(corner).branches[0], region=region).kind is Kind.LOST


def test_a_region_without_a_real_point_is_refused() -> None:
    with pytest.raises(BranchError, match=r"no real point in the region x in \[1, 2\]"):
        judge(y**2 + x, {"x": (1, 2)})
    with pytest.raises(BranchError, match="no real point in the region"):
        judge(x - y, {"x": (0, 1), "y": (5, 6)})
    # Over the start the branch has one point, outside the bounds on y: that sheet is refused, not the branch.
    wave = SlowFastSystem(slow={x: y}, fast={y: x - y * (1 - y) * (y - 0.2)}, epsilon=eps)
    region = {"x": (-0.05, 0.01), "y": (-0.05, 0.06)}
    sheet = solve_critical(wave).nearest({"x": -0.01, "y": 0}, region=region)
    with pytest.raises(BranchError, match=r"the sheet .* through x = -0.01, y = .*, to which the run"):
        classify(sheet, region=region)


@pytest.mark.exhaustive
def test_many_sheets_of_a_sine_are_told_apart() -> None:
    (branch,) = solve_critical(SlowFastSystem(slow={x: 1}, fast={y: sp.sin(y) - x}, epsilon=eps)).branches
    verdict = classify(branch, region={"x": (-1.5, 1.5), "y": (-10, 10)})
    folds = sorted(loss.point["y"] for loss in verdict.losses)
    assert folds == pytest.approx(np.pi * (np.arange(-3, 3) + 0.5), abs=1e-8)
    held = classify(branch.through({"x": 0, "y": 3.1}), region={"x": (-0.9, 0.9)})
    assert held.kind is Kind.ATTRACTING
    assert held.gap == pytest.approx(np.sqrt(1 - 0.81), rel=1e-6)


def test_a_verdict_prints_its_kind_gap_and_losses() -> None:
    verdict = classify(solve_critical(systems.van_der_pol()).branches[0], region={"y": (-1, 1)})
    places = sorted((loss.point["y"], loss.point["x"]) for loss in verdict.losses)
    assert np.array(places) == pytest.approx(np.array([(-2 / 3, 1), (2 / 3, -1)]), abs=1e-8)
    assert repr(verdict).startswith("Hyperbolicity(lost, gap=0, sampled at")
    assert "zero eigenvalue at y = -0.666667, x = 1" in str(verdict)
    assert "FAILS  hyperbolic equilibria" in str(verdict)


@pytest.mark.exhaustive
@pytest.mark.parametrize("power", [1, 2, 3])
@pytest.mark.parametrize(
    "g",
    [
        {u: x * (u / 4) ** a / (1 + (u / 4) ** a) - u},
        {u: x - u - (u / 4) ** a},
        {u: (x / 4) ** a / (1 + (x / 4) ** a) - u},
        {u: x - u, v: x / (1 + (u / 4) ** a) - v},
    ],
    ids=["gene", "power", "of the slow one", "repressed"],
)
def test_a_power_is_smooth_at_zero_whether_its_exponent_is_a_parameter_or_written_out(g, power: int) -> None:
    region = {"x": (0, 2), "u": (0, 2), "v": (0, 3)}
    verdict = judge(g, {name: region[name] for name in ("x", *map(str, g))}, a=power)
    assert verdict.holds
    assert verdict.kind is Kind.ATTRACTING
    assert not verdict.losses
    assert condition(verdict, "graph").value == 0.0
