"""Reduced against full: order N gives slope N + 1, exact reductions give rounding, rivals are judged."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from gsp import load, models
from gsp.comparison.compared_runs import ComparedRuns, on_manifold
from gsp.comparison.comparison import compare, slope, with_rounding
from gsp.errors import DeclarationError, Status
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of
from gsp.slow.series import expand
from gsp.systems.system import SlowFastSystem
from tests.cases import thinned
from tests.literature import FOLDER

x, y, eps = sp.symbols("x y epsilon")


@pytest.mark.parametrize(
    "name", thinned(["chaplygin_sleigh", "michaelis_menten", "lindemann", "van_der_pol", "koper"], 3)
)
def test_the_slope_of_order_n_is_n_plus_one(name: str) -> None:
    comparison = compare(models.load(name), orders=(0, 1, 2, 3))
    for order in range(4):
        assert comparison.expected[order] == order + 1
        assert comparison.slopes[order] == pytest.approx(order + 1, abs=0.1)


@pytest.mark.parametrize("name", ["davis_skodje", "linear"])
def test_an_exact_reduction_is_exact_to_rounding_at_every_order(name: str) -> None:
    comparison = compare(models.load(name), orders=(0, 2))
    for order in (0, 2):
        assert comparison.is_exact(order)
        assert max(comparison.errors[order]) < 1e-12
        assert np.isnan(comparison.slopes[order])


def test_the_printed_sign_of_equation_18_is_wrong_and_the_derived_one_right() -> None:
    comparison = compare(models.load("chaplygin_sleigh"), orders=(0, 1))
    assert comparison.claim_slopes["(18) as printed"] == pytest.approx(1, abs=0.1)
    assert comparison.claim_slopes["(18) with its sign corrected"] == pytest.approx(2, abs=0.1)
    # With the printed sign order 1 is worse than order 0.
    assert all(c > e for c, e in zip(comparison.claims["(18) as printed"], comparison.errors[0]))


def test_the_start_lies_on_the_slow_manifold() -> None:
    study = study_of(models.load("michaelis_menten"))
    series = expand(study.branch, order=6)
    start = on_manifold(series, study.start, 0.1)
    # The slow manifold at s = 1, epsilon = 0.1, computed independently in 40 digits.
    assert start["c"] == pytest.approx(0.5030315116239185527, abs=2e-9)


def test_epsilons_may_be_given_and_are_sorted() -> None:
    comparison = compare(models.load("michaelis_menten"), orders=(1,), epsilons=(0.01, 0.02, 0.005))
    assert comparison.epsilons == (0.02, 0.01, 0.005)
    assert comparison.slopes[1] == pytest.approx(2, abs=0.1)


def test_a_run_that_stops_early_gives_nan_and_its_status() -> None:
    # On M0, y = 1/x, the reduced flow x' = -1/x reaches x = 0 at t = 1/2: the branch ends there.
    system = SlowFastSystem(slow={x: -y}, fast={y: 1 - x * y}, epsilon=eps)
    scene = Scene(system, {"x": (0.1, 2)}, {"x": 1, "y": 1}, (0, 0.6), 0.01, (0.02, 0.01), 1e-6)
    comparison = compare(scene, orders=(0,))
    assert all(np.isnan(error) for error in comparison.errors[0])
    assert all(status is not Status.SUCCESS for status in comparison.statuses[0])


def test_a_slope_ignores_errors_at_the_floor() -> None:
    epsilons = (0.1, 0.05, 0.025, 0.0125)
    errors = [e**2 for e in epsilons[:3]] + [1e-13]
    assert slope(epsilons, errors, [1e-14] * 4) == pytest.approx(2)
    assert np.isnan(slope(epsilons, [1e-15] * 4, [1e-15] * 4))


def test_what_a_correction_alone_moves_has_the_orders_of_the_theorem() -> None:
    """z is of the size of epsilon: beside itself at each epsilon its error had one power less."""
    x, y, z, epsilon = sp.symbols("x y z epsilon")
    system = SlowFastSystem(slow={x: -x, z: y - x}, fast={y: x - y}, epsilon=epsilon)
    scene = Scene(system, {"x": (0.01, 2), "z": (-1, 1)}, {"x": 1, "y": 1, "z": 0}, (0, 2), 0.01)
    found = compare(scene, orders=(0, 1))
    assert found.slopes == pytest.approx(found.expected, abs=0.1)


@pytest.mark.parametrize(
    ("f", "g", "powers"),
    [
        (-y / 10, x + sp.sign(x - sp.Rational(7, 10)) / 10 - y, {0: 1, 2: 1}),
        (-y / 10, x + sp.Abs(x - sp.Rational(7, 10)) / 2 - y, {0: 1, 2: 2}),
        (-y / 10 - sp.Heaviside(x - sp.Rational(7, 10)) / 5, x - y, {0: 1, 2: 2}),
    ],
    ids=["the fast rate jumps", "it has a kink", "the slow rate jumps"],
)
def test_no_power_is_expected_of_corrections_past_a_switch(f: sp.Expr, g: sp.Expr, powers: dict) -> None:
    """Past a jump of g the fast variables are off by O(1) for a time epsilon; past a kink or a jump of f by epsilon."""
    system = SlowFastSystem(slow={x: f}, fast={y: g}, epsilon=eps)
    scene = Scene(system, {"x": (0.1, 2)}, {"x": 1, "y": 1}, (0, 6), 0.01)
    found = compare(scene, orders=(0, 2))
    assert found.expected == {0: 1, 2: None}
    assert found.slopes == pytest.approx(powers, abs=0.1)
    assert "the run crosses x - 7/10 = 0" in str(found)
    assert found.as_json()["attributes"]["crossed"] == "x - 7/10"
    short = compare(replace(scene, span=(0, 1)), orders=(0, 2))
    assert short.expected == {0: 1, 2: 3}
    assert short.crossed == ()


def test_what_passes_early_in_a_long_span_is_measured() -> None:
    """x' = -20 y, epsilon y' = x - y: at order 0 x is off by 400 epsilon t exp(-20 t), most at t = 1/20."""
    system = SlowFastSystem(slow={x: -20 * y}, fast={y: x - y}, epsilon=eps)
    scene = Scene(system, {"x": (0, 1)}, {"x": 1, "y": 1}, (0, 200), 0.001, (0.002, 0.001))
    found = compare(scene, orders=(0, 1))
    assert found.errors[0][1] == pytest.approx(20 * 0.001 / np.e, rel=0.1)
    assert found.slopes == pytest.approx(found.expected, abs=0.1)


def test_progress_reaches_one() -> None:
    seen: list[float] = []
    compare(models.load("linear"), orders=(0,), progress=seen.append)
    assert seen[-1] == 1.0
    assert seen == sorted(seen)


def test_progress_is_seen_while_flows_are_made(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[float] = []
    begun: list[int] = []
    at = ComparedRuns.at
    monkeypatch.setattr(ComparedRuns, "at", lambda *given: begun.append(len(seen)) or at(*given))
    compare(models.load("linear"), orders=(0, 1, 2), epsilons=(0.02, 0.01), progress=seen.append)
    # Three flows, then each of them at two epsilons.
    assert begun[:2] == [3, 6]
    assert seen[:9] == pytest.approx(np.arange(1, 10) / 9)


def test_other_parameters_give_another_comparison() -> None:
    scene = models.load("michaelis_menten")
    other = replace(scene, system=scene.system.with_parameters(kappa=2))
    one, two = (compare(s, orders=(0,)).errors[0] for s in (scene, other))
    assert one != two


def test_a_repelling_branch_is_compared_backward_in_time() -> None:
    system = SlowFastSystem(slow={x: -x + y}, fast={y: y - x + x * y / 4}, epsilon=eps)
    scene = Scene(system, {"x": (0.1, 2)}, {"x": 1, "y": 1}, (0, 1), 0.01, (0.02, 0.01, 0.005), 1e-6)
    comparison = compare(scene, orders=(0, 1, 2))
    for order in range(3):
        assert comparison.slopes[order] == pytest.approx(order + 1, abs=0.1)


@pytest.mark.exhaustive
def test_what_is_no_number_in_the_table_has_its_reason_below_it() -> None:
    """Through a pitchfork no run gets, and a reduced flow that is exact has no slope."""
    system = SlowFastSystem(slow={x: 1}, fast={y: y * (x - y**2) + eps / 10}, epsilon=eps)
    scene = Scene(
        system,
        region={"x": (-1, 1)},
        start={"x": -1, "y": 0.2},
        span=(0, 2),
        epsilon=0.02,
        epsilons=(0.02, 0.01),
        tolerance=1e-6,
    )
    text = str(compare(scene, orders=(0, 1)))
    assert "nan of order 0 at each: a run ended early, HYPERBOLICITY_LOST: normal" in text
    assert "nan of order 1 at each: a run ended early, SERIES_ENDS: the terms" in text
    assert "no slope of order 0, 1: fewer than two errors stand clear" in text
    exact = SlowFastSystem(slow={x: -x}, fast={y: x - y}, epsilon=eps)
    text = str(compare(replace(scene, system=exact, region={"x": (-2, 1)}), orders=(0,)))
    assert "no slope of order 0: the errors are within the reference's own" in text
    assert "nan of order" not in text


@pytest.mark.parametrize("correction", [None, 1])
def test_errors_do_not_depend_on_when_the_clock_began(correction) -> None:
    system = SlowFastSystem(slow={x: -x + y**2 / 5}, fast={y: x - y + x * y / 3}, epsilon=eps)
    start = {"x": 1, "y": 1.3 if correction is None else 0.2}
    asked = Scene(system, {"x": (-5, 5)}, start, (0, 2), 0.01, (0.02, 0.01), 1e-6)
    here, later = (
        compare(replace(asked, span=(t, t + 2)), orders=(0, 1), correction=correction) for t in (0, 7)
    )
    for order in (0, 1):
        assert later.errors[order] == pytest.approx(here.errors[order], rel=1e-3)
        assert later.slopes[order] == pytest.approx(order + 1, abs=0.3)


def test_a_layer_longer_than_half_of_the_span_is_refused_whenever_the_clock_began() -> None:
    asked = models.load("michaelis_menten")
    for begin in (0, 7):
        with pytest.raises(DeclarationError, match="more than half of the span"):
            compare(replace(asked, span=(begin, begin + 0.5)), correction=1, epsilons=(0.1, 0.05))


def test_errors_that_fall_no_more_with_epsilon_are_rounding() -> None:
    # Of a stirred reactor with exp(-15000/T), T about 900: these are its rounding; two full runs agree better.
    ladder, floor = (0.002, 0.001, 0.0005, 0.00025), [4e-15] * 4
    flat, falling = [2.33e-14, 2.96e-14, 2.93e-14, 2.65e-14], [3.05e-10, 1.91e-11, 1.19e-12, 7.53e-14]
    assert with_rounding(ladder, flat, floor, power=4) == [2.96e-14] * 4
    assert np.isnan(slope(ladder, flat, with_rounding(ladder, flat, floor, power=4)))
    assert with_rounding(ladder, falling, floor, power=4) == floor
    ending = [4.15e-13, 5.42e-14, 2.93e-14, 2.65e-14]
    assert with_rounding(ladder, ending, floor, power=4) == [4e-15, *[5.42e-14] * 3]
    # An error that is large is none of rounding, however it falls.
    assert with_rounding(ladder, [1e-3] * 4, floor, power=4) == floor
    assert with_rounding(ladder, [float("nan")] * 4, floor, power=4) == floor


def test_the_card_says_where_both_runs_begin() -> None:
    scene = models.load("michaelis_menten")
    assert "both runs begin on the slow manifold" in str(compare(scene, orders=(0,)))
    corrected = str(compare(scene, orders=(0,), correction=1))
    assert "the full run begins off the slow manifold, the reduced one at its base point" in corrected


@pytest.mark.exhaustive
def test_functions_of_two_fast_variables_are_compared_through_order_four_by_programs() -> None:
    # The polynomials of order 3 are beyond the budget of terms; those of order 2 have ten thousand.
    z = sp.Symbol("z")
    fast = {y: x - 3 * y + sp.tanh(y - z + x), z: sp.tanh(y * z) + x - 2 * z + sp.exp(-z)}
    scene = Scene(
        SlowFastSystem(slow={x: 1 - x + y * z}, fast=fast, epsilon=eps),
        **{"region": {"x": (0, 2), "y": (-1, 2), "z": (-1, 2)}, "start": {"x": 0.5, "y": 0.3, "z": 0.3}},
        **{"span": (0, 2), "epsilon": 0.05},
    )
    study = study_of(scene)
    comparison = compare(study, orders=(2, 4))
    assert [comparison.slopes[order] for order in (2, 4)] == pytest.approx([3, 5], abs=0.1)
    assert comparison.ending == ""
    short = study.short_series(6)
    assert (short.order, short.is_program) == (3, True)
    assert "at order 4 it has coefficients of 1090 steps, more than 600" in study.why_shorter(6)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["icealbedo", "npz"])
def test_order_one_is_better_by_a_power_beside_a_kink_and_where_two_limits_meet(name: str) -> None:
    # Ice and albedo switch beside the run; Liebig's minimum is a kink of the fast rates.
    found = compare(load(FOLDER / f"{name}.toml"), orders=(0, 1))
    assert found.slopes[0] == pytest.approx(1.0, abs=0.1)
    assert found.slopes[1] == pytest.approx(2.0, abs=0.1)
    assert all(first < 0.2 * leading for leading, first in zip(found.errors[0], found.errors[1]))


def test_a_start_at_rest_is_compared_over_its_base_point() -> None:
    """Virions without a cell infected: over that start no reduction errs, over what the layer leaves each does."""
    T, ill, V = sp.symbols("T ill V")
    spread = T * V / 50
    system = SlowFastSystem(slow={T: 1 - T - spread, ill: spread - ill}, fast={V: 200 * ill - V}, epsilon=eps)
    region = {"T": (0, 2), "ill": (0, 2), "V": (0, 400)}
    scene = Scene(system, region, {"T": 1, "ill": 0, "V": 1}, (0, 3), 0.02)
    found = compare(scene, orders=(0, 1))
    assert "over the base point of the scene's start" in str(found)
    assert found.as_json()["attributes"]["begins"] == found.begins
    assert found.slopes[0] == pytest.approx(1, abs=0.1)
    assert found.slopes[1] == pytest.approx(2, abs=0.15)
    moving = replace(scene, start={"T": 1, "ill": 0.1, "V": 1})
    assert not compare(moving, orders=(0, 1)).begins
    # What is exact over both is exact.
    exact = compare(models.load("linear"), orders=(0, 1))
    assert all(exact.is_exact(order) for order in (0, 1))


def test_orders_without_a_number_are_told_as_ranges() -> None:
    x, y, eps = sp.symbols("x y epsilon")
    system = SlowFastSystem(slow={x: -x}, fast={y: x - y}, epsilon=eps)
    scene = Scene(system, start={"x": 1, "y": 1}, span=(0, 1), epsilon=0.1, region={"x": (0, 1)})
    lines = str(compare(scene, orders=range(12), epsilons=[0.2, 0.1])).splitlines()
    told = " ".join(line for line in lines if "no slope of order" in line)
    assert " to " in told
    assert len(told) < 300
