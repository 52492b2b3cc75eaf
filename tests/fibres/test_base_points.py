"""Base points of fast fibres: exact coefficients, two routes that agree, the slope table, and what is refused."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

from gsp import load, models
from gsp.comparison.comparison import compare, slope
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import BranchError, DeclarationError, GspError, HyperbolicityError, Status
from gsp.fibres import inner_expansion
from gsp.fibres.base_points import BasePoint, project
from gsp.fibres.inner_expansion import Problem, _sampled, expand_inner
from gsp.integration.restriction import restrict
from gsp.integration.trajectory import integrate
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of
from gsp.slow.series import expand
from gsp.slow.solved_manifold import solve_manifold
from gsp.systems.system import SlowFastSystem
from tests import example_systems as systems
from tests.example_systems import epsilon, x, y, z
from tests.literature import FOLDER

v, p, w, m, inertia, a, phi = sp.symbols("v p w m I a phi")
SLEIGH = solve_critical(systems.sleigh()).branches[0]
ENZYME = solve_critical(systems.michaelis_menten()).branches[0]
OSCILLATOR = solve_critical(systems.van_der_pol()).branches[0]
TURNING = {phi: (p - m * a * w) / (inertia + m * a**2)}
# v = -1, w = 1/2, omega = 3/2: p = (I + m a^2) omega + m a w = 1.66.
SLIDING = {"v": -1, "p": 1.66, "w": 0.5}


def digits(value: Fraction) -> sp.Expr:
    return sp.Rational(value.numerator, value.denominator).evalf(32)


def test_the_sleigh_s_coefficients_are_right_to_thirty_digits() -> None:
    base = expand_inner(SLEIGH, SLIDING, order=1, reconstruction=TURNING).base
    J = Fraction(104, 100)
    # Computed independently in 32 digits.
    expected = {
        base["v"][1]: "0.68612738962221210741920801092399",
        base["p"][0] / J: "1.5961538461538461538461538461538",
        base["p"][1] / J: "-0.017779927173418297678652708238507",
        base["phi"][1]: "-0.092455621301775147928994082840237",
    }
    for value, text in expected.items():
        assert abs(digits(value) - sp.Float(text, 32)) < sp.Float("2e-31", 32)
    assert base["v"][0] == -1
    assert base["phi"][0] == 0


def test_michaelis_menten_s_first_correction_is_the_integral_of_its_layer() -> None:
    # c = (1 - exp(-2 tau))/2 over s = 1, so b_1 = int (s + kappa - lambda)(c - 1/2) dtau = -(3/2)(1/2)/2.
    base = expand_inner(ENZYME, {"s": 1, "c": 0}, order=2).base["s"]
    assert base[:2] == (1, Fraction(-3, 8))
    assert expand_inner(ENZYME, {"s": 1, "c": sp.Rational(1, 2)}, order=1).base["s"][1] == 0


@pytest.mark.parametrize(
    ("branch", "start"), [(SLEIGH, SLIDING), (ENZYME, {"s": 1, "c": 0}), (ENZYME, {"s": 0.5, "c": 0.9})]
)
def test_exact_and_sampled_coefficients_agree(branch, start) -> None:
    one = expand_inner(branch, start, order=4)
    two = _sampled(Problem.declare(branch, start, {}), 4, 4)
    assert one.is_exact
    assert not two.is_exact
    tau = np.linspace(0, 30, 77)
    for name in one.base:
        assert np.allclose(two.base[name], [float(c) for c in one.base[name]], rtol=1e-13, atol=1e-14)
    for name, values in one.layer(tau, 1.0, order=4).items():
        assert np.allclose(two.layer(tau, 1.0, order=4)[name], values, rtol=0, atol=1e-11)


CASES = {
    "sleigh, exact": (SLEIGH, SLIDING, (0.02, 0.01, 0.005)),
    "Michaelis-Menten, exact": (ENZYME, {"s": 1, "c": 0}, (0.1, 0.05, 0.025)),
    "van der Pol, cubic layer": (
        OSCILLATOR.through({"y": 2 / 3, "x": 2}),
        {"y": 2 / 3, "x": 3},
        (0.02, 0.01, 0.005),
    ),
    "van der Pol, repelling": (
        OSCILLATOR.through({"y": 0, "x": 0.1}),
        {"y": 0, "x": 0.5},
        (0.01, 0.005, 0.0025),
    ),
    "two fast, cubic": (
        solve_critical(systems.coupled()).branches[0].through({"x": 1, "y": 0.5, "z": 0.3}),
        {"x": 1, "y": 2, "z": 1},
        (0.02, 0.01, 0.005),
    ),
    "transcendental": (
        solve_critical(systems.transcendental()).branches[0],
        {"x": 0.5, "y": 2},
        (0.02, 0.01, 0.005),
    ),
    "two slow, implicit": (
        solve_critical(systems.koper()).branches[0].through({"y": 0, "z": 0.5, "x": 2.4}),
        {"y": 0, "z": 0.5, "x": 3},
        (0.01, 0.005, 0.0025),
    ),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize(("branch", "start", "ladder"), CASES.values(), ids=CASES)
def test_series_and_backward_shadowing_agree_through_every_order(branch, start, ladder) -> None:
    shadows = [project(branch, start, epsilon=e, numeric=True) for e in ladder]
    floor = [max(s.error, 1e-15) for s in shadows]
    assert max(floor) < 1e-12
    for order in (0, 1, 2, 3):
        points = [project(branch, start, epsilon=e, order=order) for e in ladder]
        errors = [max(abs(q[name] - s[name]) for name in s) for q, s in zip(points, shadows)]
        assert slope(ladder, errors, floor) == pytest.approx(order + 1, abs=0.15)
        # The estimate is the larger of the next two terms.
        assert all(0.5 < q.error / e < 3 for q, e in zip(points, errors))


def test_without_an_order_the_best_one_is_taken() -> None:
    point = project(SLEIGH, SLIDING, epsilon=0.6)
    assert point.order is not None
    assert point.order < 4
    assert project(SLEIGH, SLIDING, epsilon=0.001).order == 4


def test_the_full_solution_approaches_the_slow_one_from_the_base_point_exponentially() -> None:
    e, gap = 0.05, 1.04
    start = {"v": -1, "p": 1.66, "w": 0.5}
    series = expand(SLEIGH, order=10)
    base = project(series, start, epsilon=e, numeric=True)
    t = [8 * e / gap, 12 * e / gap, 16 * e / gap]
    full = integrate(SLEIGH.system, start=start, span=(0, 1), epsilon=e, rtol=1e-13, atol=1e-15, at=t)
    slow = integrate(restrict(series), start=base, span=(0, 1), epsilon=e, rtol=1e-13, atol=1e-15, at=t)
    distance = np.abs(full["v"] - slow["v"])
    assert np.log(distance[0] / distance[1]) == pytest.approx(4, abs=0.5)
    assert np.log(distance[1] / distance[2]) == pytest.approx(4, abs=0.5)


def test_a_solved_manifold_gives_the_same_base_point() -> None:
    e = 0.02
    manifold = solve_manifold(ENZYME, region={"s": (0.2, 1.2)}, epsilon=e, tolerance=1e-12)
    start = {"s": 1, "c": 0}
    one, two = (
        project(manifold, start, epsilon=e, numeric=True),
        project(ENZYME, start, epsilon=e, numeric=True),
    )
    assert one["s"] == pytest.approx(two["s"], abs=1e-12)
    assert project(manifold, start, epsilon=e, order=2)["s"] == pytest.approx(two["s"], abs=1e-7)
    with pytest.raises(DeclarationError, match=r"solved at epsilon = 0.02"):
        project(manifold, start, epsilon=0.01)


def test_a_base_point_is_a_mapping_and_a_start() -> None:
    point = project(ENZYME, {"s": 1, "c": 0}, epsilon=0.01, order=2)
    assert isinstance(point, BasePoint)
    assert dict(point) == {"s": point["s"]}
    assert point.at_order(1)["s"] == pytest.approx(1 - 0.01 * 3 / 8)
    assert "exact series through order 2" in str(point)
    with pytest.raises(DeclarationError, match="order wanted"):
        point.at_order(3)
    with pytest.raises(DeclarationError, match="backward shadowing"):
        project(ENZYME, {"s": 1, "c": 0}, epsilon=0.01, numeric=True).at_order(0)


def test_an_implicit_branch_without_a_seed_takes_the_sheet_that_the_layer_leads_to() -> None:
    right = project(OSCILLATOR, {"y": 0, "x": 3}, epsilon=0.01, order=2)
    assert right["y"] == pytest.approx(
        project(OSCILLATOR.through({"y": 0, "x": 1.7}), {"y": 0, "x": 3}, epsilon=0.01, order=2)["y"], abs=1e-13
    )
    left = project(OSCILLATOR, {"y": 0, "x": -3}, epsilon=0.01, order=2)
    assert left["y"] != pytest.approx(right["y"], abs=1e-4)


def test_a_start_on_the_critical_manifold_still_has_a_layer() -> None:
    # w0 = 0: the base point differs from the start from order 2 on.
    base = expand_inner(SLEIGH, {"v": -1, "p": 1.66, "w": 0}, order=2).base
    assert base["v"][1] == 0
    assert base["v"][2] != 0
    sheet = OSCILLATOR.through({"y": 2 / 3, "x": 2})
    assert expand_inner(sheet, {"y": 2 / 3, "x": 2}, order=2).base["y"][1] == pytest.approx(0, abs=1e-14)


# -- the theorem ---------------------------------------------------------------------------------------


def moved(name: str) -> Scene:
    if name == "chaplygin_sleigh":
        # w0 = 1/2: omega jumps by m a w0/(I + m a^2) in the layer.
        return replace(models.load(name), start={"v": -1, "omega": 1.5, "w": 0.5}, span=(0, 6))
    return models.load(name)


@pytest.mark.exhaustive
@pytest.mark.parametrize("correction", [0, 1, 2, 3])
@pytest.mark.parametrize("name", ["chaplygin_sleigh", "michaelis_menten"])
def test_the_slope_is_the_smaller_of_order_and_correction_plus_one(name: str, correction: int) -> None:
    comparison = compare(moved(name), orders=(0, 1, 2, 3), correction=correction)
    for order in range(4):
        expected = min(order, correction) + 1
        assert comparison.expected[order] == expected
        assert comparison.slopes[order] == pytest.approx(expected, abs=0.1)


def test_keeping_omega_and_dropping_w_never_converges() -> None:
    scene = moved("chaplygin_sleigh")
    study = study_of(scene)
    flow = restrict(expand(study.branch, order=2))
    kept = {"v": -1, "p": 1.04 * 1.5}
    errors = []
    for e in scene.epsilons:
        full = integrate(
            study.system,
            start=dict(study.start),
            span=(0, 6),
            epsilon=e,
            rtol=1e-10,
            atol=1e-12,
            at=[6.0],
        )
        slow = integrate(flow, start=kept, span=(0, 6), epsilon=e, rtol=1e-10, atol=1e-12, at=[6.0])
        errors.append(abs(float((full["p"] - slow["p"])[0])))
    assert slope(scene.epsilons, errors, [1e-12] * 4) == pytest.approx(0, abs=0.1)
    assert min(errors) > 0.01


def test_a_correction_keeps_its_word_about_claims_and_the_card() -> None:
    comparison = compare(moved("chaplygin_sleigh"), orders=(0, 1), correction=1)
    assert comparison.correction == 1
    assert "at its base point through epsilon^1" in str(comparison)
    assert comparison.claim_slopes["(18) with its sign corrected"] == pytest.approx(2, abs=0.1)
    assert comparison.claim_slopes["(18) as printed"] == pytest.approx(1, abs=0.1)


def test_wrong_corrections_are_named() -> None:
    with pytest.raises(DeclarationError, match="more than half of the span"):
        compare(replace(moved("michaelis_menten"), span=(0, 0.5)), correction=1)


# -- refusals ------------------------------------------------------------------------------------------


def test_a_start_in_the_wrong_basin_is_refused_with_where_it_goes() -> None:
    sheet = OSCILLATOR.through({"y": 0, "x": 1.7})
    for numeric in (False, True):
        with pytest.raises(BranchError, match=r"leads to x = -1\.73205.* not to x = 1\.73205"):
            project(sheet, {"y": 0, "x": -0.5}, epsilon=0.01, numeric=numeric)
    system = SlowFastSystem(slow={x: -x}, fast={y: y**2 - x**2}, epsilon=epsilon)
    lower = next(b for b in solve_critical(system).branches if str(b) == "y = -x")
    with pytest.raises(BranchError, match="outside the basin"):
        project(lower, {"x": 1, "y": 1.5}, epsilon=0.01)


def test_a_run_that_passes_the_fold_and_comes_back_is_no_shadow() -> None:
    # The relaxation oscillation returns to the sheet after a while; that is another fibre.
    sheet = OSCILLATOR.through({"y": 2 / 3, "x": 2})
    with pytest.raises(BranchError, match=r"leaves the slow manifold .* before its layer is over"):
        project(sheet, {"y": -0.6, "x": 2}, epsilon=0.1, numeric=True)


@pytest.mark.exhaustive
def test_an_epsilon_beyond_the_manifold_s_life_is_named() -> None:
    with pytest.raises(HyperbolicityError, match="not separated from its neighbours"):
        project(SLEIGH, SLIDING, epsilon=1, numeric=True)


def test_a_saddle_type_branch_has_base_points_on_its_stable_side_only() -> None:
    system = SlowFastSystem(slow={x: -x + z}, fast={y: y, z: x - z}, epsilon=epsilon)
    branch = solve_critical(system).branches[0]
    assert project(branch, {"x": 1, "y": 0, "z": 3}, epsilon=0.01, order=1)["x"] == pytest.approx(1.02)
    with pytest.raises(HyperbolicityError, match=r"saddle type.*not on its stable side"):
        project(branch, {"x": 1, "y": 0.1, "z": 3}, epsilon=0.01)
    with pytest.raises(HyperbolicityError, match="stable and unstable fibres differ"):
        project(branch, {"x": 1, "y": 0, "z": 3}, epsilon=0.01, numeric=True)


def test_what_turns_fast_is_averaged_and_not_projected() -> None:
    system = SlowFastSystem(slow={x: -x + z}, fast={y: z, z: -y}, epsilon=epsilon)
    branch = solve_critical(system).branches[0]
    with pytest.raises(HyperbolicityError, match=r"no fibre to project along; what turns fast is averaged"):
        expand_inner(branch, {"x": 1, "y": 1, "z": 0}, order=1)


def test_a_layer_through_a_pole_is_refused() -> None:
    system = SlowFastSystem(slow={x: -1 / y}, fast={y: x - y}, epsilon=epsilon)
    branch = solve_critical(system).branches[0]
    # b_1 = int [1/h_0 - 1/Y_0] dtau with Y_0 = 1 + exp(-tau): ln 2.
    assert expand_inner(branch, {"x": 1, "y": 2}, order=1).base["x"][1] == pytest.approx(np.log(2), abs=1e-14)
    with pytest.raises(DeclarationError, match=r"near fast time 0\.6.*passes a pole"):
        project(branch, {"x": 1, "y": -1}, epsilon=0.01)


@pytest.mark.exhaustive
def test_two_time_scales_in_the_fast_block_are_named() -> None:
    system = SlowFastSystem(slow={x: -x + z}, fast={y: x - y - y**3, z: 10**6 * (y - z)}, epsilon=epsilon)
    branch = solve_critical(system).branches[0]
    with pytest.raises(HyperbolicityError, match="two time scales of their own"):
        project(branch, {"x": 1, "y": 0, "z": 0}, epsilon=0.01)


def test_a_stiff_layer_is_resolved() -> None:
    system = SlowFastSystem(slow={x: -x + z}, fast={y: x - y - y**3, z: 500 * (y - z)}, epsilon=epsilon)
    branch = solve_critical(system).branches[0].through({"x": 1, "y": 0.7, "z": 0.7})
    start = {"x": 1, "y": 0, "z": 2}
    one, two = (
        project(branch, start, epsilon=0.005, order=3),
        project(branch, start, epsilon=0.005, numeric=True),
    )
    assert one["x"] == pytest.approx(two["x"], abs=2 * one.error)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"start": {"s": 1}}, "gives no value for c"),
        ({"start": {"s": 1, "c": 0, "q": 1}}, 'names "q"'),
        ({"order": 1, "numeric": True}, "has no order"),
        ({"start": {"s": -1, "c": 0}}, "singular over the start"),
    ],
)
def test_bad_calls_are_named(arguments, message) -> None:
    call = {"start": {"s": 1, "c": 0}, "epsilon": 0.1} | arguments
    with pytest.raises(GspError, match=message):
        project(ENZYME, call.pop("start"), **call)


@pytest.mark.exhaustive
def test_positions_driven_through_sines_have_base_points_too() -> None:
    study = study_of(moved("chaplygin_sleigh"))
    reconstruction = study.scene.reconstruction
    start = dict(study.start) | {"phi": 2}
    ladder = (0.02, 0.01, 0.005)
    shadows = [
        project(study.branch, start, epsilon=e, numeric=True, reconstruction=reconstruction) for e in ladder
    ]
    points = [project(study.branch, start, epsilon=e, order=2, reconstruction=reconstruction) for e in ladder]
    assert set(points[0]) == {"v", "p", "phi", "x", "y"}
    for name in ("phi", "x", "y"):
        errors = [abs(q[name] - s[name]) for q, s in zip(points, shadows)]
        assert slope(ladder, errors, [1e-14] * 3) == pytest.approx(3, abs=0.15)


def test_a_layer_that_two_points_show_to_be_nonlinear_is_not_simplified(monkeypatch) -> None:
    x, y, eps = sp.symbols("x y epsilon")
    system = SlowFastSystem(slow={x: -y}, fast={y: x - y - sp.tanh(y) ** 3}, epsilon=eps)
    branch = solve_critical(system).nearest({"x": 1, "y": 0.7})
    asked = []
    monkeypatch.setattr(inner_expansion, "lowest_terms", lambda e: asked.append(e) or e)
    found = expand_inner(branch, {"x": 1, "y": 2}, order=1)
    assert not found.is_exact
    assert not asked


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("switching", "side"),
    [
        (sp.Min(1, y / 10), y / 10),
        (sp.Max(y / 4, -1), y / 4),
        (-sp.Min(y / 2, 1, x + 3), -y / 2),
        (sp.Max(0, y - 3) + sp.Min(y, 7) / 3, y / 3),
        (sp.Abs(y + 2) / 3, (y + 2) / 3),
        (sp.Heaviside(5 - y), sp.Integer(1)),
    ],
)
def test_a_layer_on_one_side_of_a_switch_is_that_of_the_side(switching: sp.Expr, side: sp.Expr) -> None:
    found, smooth = (
        project(
            expand(
                solve_critical(SlowFastSystem({x: y / 4 - x}, {y: x - 2 * y + term}, epsilon)).branches[0],
                order=2,
            ),
            {"x": 1, "y": Fraction(1, 5)},
            epsilon=0.01,
        )
        for term in (switching, side)
    )
    assert dict(found) == pytest.approx(dict(smooth), rel=1e-9)
    np.testing.assert_allclose(
        found.coefficients["x"], np.array(smooth.coefficients["x"], dtype=float), rtol=1e-9
    )


@pytest.mark.exhaustive
@pytest.mark.parametrize(("order", "status"), [(0, Status.SUCCESS), (1, Status.HYPERBOLICITY_LOST)])
def test_a_base_point_beyond_the_end_of_the_sheet_is_told_so(order, status) -> None:
    # From no messengers the layer carries the proteins to p = -18, and the sheet of the dimers ends at -3.75.
    study = study_of(load(FOLDER / "gene_dimers_from_nothing.toml"))
    base = project(study.branch, study.start, epsilon=study.scene.epsilon, order=order)
    assert base.status is status
    assert status.name in str(base)


def test_a_layer_across_a_jump_of_a_fast_variable_is_not_taken_for_linear() -> None:
    # Its fast Jacobian is -1 on both sides of y = 1/2.
    def branch(offset: sp.Expr):
        system = SlowFastSystem(slow={x: -x + y / 4}, fast={y: x - y + offset / 9}, epsilon=epsilon)
        return solve_critical(system).nearest({x: 1.5, y: 1.6})

    jump, smooth = (
        expand(branch(offset), order=2) for offset in (sp.sign(y - sp.Rational(1, 2)), sp.Integer(1))
    )
    start = {"x": 1.5, "y": 1.0}
    assert project(jump, start, epsilon=1e-3)["x"] == pytest.approx(
        project(smooth, start, epsilon=1e-3)["x"], rel=1e-9
    )
    with pytest.raises(BranchError, match="not smooth"):
        project(jump, {"x": 1.5, "y": 0.0}, epsilon=1e-3)


@pytest.mark.parametrize("unit", [1, 10**6, sp.Rational(1, 10**6)])
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("step", [sp.sign(y / 2 - x / 4) / 2, sp.Heaviside(2 * y - x, 0)])
def test_a_layer_goes_through_a_jump_of_a_slow_rate(step: sp.Expr, sign: int, unit: sp.Rational) -> None:
    """It was said that nothing can be reduced there. y = 6/5 (1 - exp(-tau)) passes 3/5 after ln 2."""
    fast = {y: sign * (y / unit - x) * unit}
    system = SlowFastSystem(slow={x: -1 - step.subs(y, y / unit)}, fast=fast, epsilon=epsilon)
    branch, start = solve_critical(system).branches[0], {"x": 1.2, "y": 0.0}
    assert dict(project(branch, start, epsilon=0.01, order=0)) == {"x": 1.2}
    inner = expand_inner(branch, start, order=3)
    # Before it x is faster by 1 than after it.
    assert [float(c) for c in inner.base["x"]] == pytest.approx([1.2, -sign * np.log(2.0)], rel=1e-12)
    with pytest.raises(DeclarationError, match=r"crosses a jump .* at fast time 0\.6931, past .* order 1"):
        project(branch, start, epsilon=0.01, order=1)


def test_powers_of_long_decimals_end_no_layer() -> None:
    """Whether the layer is linear is asked in decimals: as exact numbers (p/q)^(r/s) are taken apart into primes."""
    base = 1 + (x * y) ** 6 / 7 + x**5 * y**3
    fast = base ** (-y / (1 + y) - sp.Rational(17, 10)) - y
    system = SlowFastSystem(slow={x: -x}, fast={y: fast}, epsilon=epsilon)
    branch = solve_critical(system).branches[0].through({"x": 1.371728123, "y": 0.5})
    found = expand_inner(branch, {"x": 1.371728123456, "y": 0.000612345678}, order=1)
    assert not found.is_exact
