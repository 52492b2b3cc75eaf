"""Scenes without a small parameter, and how one is given to them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.cli.telling import NOTE
from gsp.errors import DeclarationError, GspError, SplittingError
from gsp.scenes.small_parameter import explain_small, take_fast, take_small, without_small
from gsp.systems.system import SlowFastSystem
from tests.contracts import public

VERBS = public("VERBS")

MOTOR = """
parameters = { L = 0.01, R = 1, k = 0.5 }
states = { i = "(1 - R*i - k*w)/L", w = "k*i - 0.1*w" }
start = { i = 0, w = 0 }
scene = { span = [0, 5] }
"""


@pytest.fixture
def motor(tmp_path: Path) -> gsp.Scene:
    path = tmp_path / "motor.toml"
    path.write_text(MOTOR)
    return gsp.load(path)


def test_a_model_without_a_small_parameter_is_a_model(motor: gsp.Scene, tmp_path: Path) -> None:
    assert (motor.epsilon, motor.epsilons, dict(motor.region)) == (None, (), {})
    run = gsp.integrate(motor)
    # i' = 0 = w' at the end of all motion: w = k/(k^2 + 0.1 R).
    still = gsp.integrate(motor, span=(0, 200))
    assert still["w"][-1] == pytest.approx(0.5 / (0.25 + 0.1), rel=1e-6)
    assert run.epsilon is None
    gsp.save(motor, tmp_path / "again.toml")
    assert gsp.load(tmp_path / "again.toml").system.equations == motor.system.equations


@pytest.mark.parametrize(
    "verb", [name for name in VERBS if "Study" in VERBS[name].takes and "demo" not in name]
)
def test_what_needs_a_small_parameter_says_how_to_name_one(motor: gsp.Scene, verb: str) -> None:
    with pytest.raises(SplittingError, match=f"motor has no small parameter, and {verb} needs one") as caught:
        getattr(gsp, verb)(motor, **VERBS[verb].right())
    assert "take_small(scene, parameter=NAME)" in caught.value.remedy


def test_the_parameter_in_a_denominator_makes_its_variable_fast(motor: gsp.Scene) -> None:
    taken = take_small(motor, parameter="L")
    assert (str(taken.system.epsilon), taken.epsilon, taken.span) == ("L", 0.01, motor.span)
    study = gsp.study(taken)
    assert [s.name for s in study.system.y] == ["i"]
    # R i = 1 - k w, and w' = k (1 - k w)/R - w/10 to leading order.
    w, R, k = sp.symbols("w R k")
    assert sp.simplify(study.series(0).reduced_field[0][0] - (k * (1 - k * w) / R - w / 10)) == 0


def test_bounds_of_slow_states_are_those_of_the_run(motor: gsp.Scene) -> None:
    run = gsp.integrate(motor)
    region = take_small(motor, parameter="L").region
    assert list(region) == ["w"]
    # Wider by what a run within the tolerance may be off.
    most = run["w"].max()
    margin = motor.tolerance * most
    assert region["w"] == pytest.approx((-margin, most + margin), rel=1e-4)


def test_bounds_found_by_a_run_hold_what_it_turns_at_within_a_step() -> None:
    # x rises to its largest value, exp(-1)/k, and falls, in few steps; y follows it.
    x, u, y, k, tau = sp.symbols("x u y k tau")
    field = gsp.VectorField(
        {u: -k * u, x: u - k * x, y: (x - y) / tau}, parameters={k: 1, tau: sp.Rational(1, 1000)}, epsilon=None
    )
    scene = gsp.Scene(field, region={}, start={"u": 1, "x": 0, "y": 0}, span=(0, 40), tolerance=1e-6)
    low, high = take_fast(scene, variables=["y"]).region["x"]
    assert low <= 0.0
    assert np.exp(-1.0) * (1.0 + 0.5e-6) <= high <= np.exp(-1.0) * (1.0 + 2e-6)


def test_bounds_found_by_a_run_have_no_more_digits_than_it_tells(motor: gsp.Scene) -> None:
    rough = replace(motor, tolerance=0.01)
    most = gsp.integrate(motor)["w"].max()
    low, high = take_small(rough, parameter="L").region["w"]
    assert (low, high) == pytest.approx((-0.01 * most, 1.01 * most), rel=1e-4)
    # A hundredth of what the run tells to 1e-6.
    assert all(round(end, 8) == end for end in (low, high))


def test_bounds_of_an_amount_leave_out_what_no_run_reaches() -> None:
    """S is eaten and flows in: it stays positive. v is pulled through zero."""
    S, v, y, k, eps = sp.symbols("S v y k epsilon")
    field = gsp.VectorField({S: 1 - k * S, v: -S * v + 1 - S, y: (S - y) / eps}, parameters={k: 20, eps: 0.01})
    region = take_small(
        gsp.Scene(field, {}, {"S": 1, "v": 0, "y": 1}, (0, 5), tolerance=0.1), parameter="epsilon"
    ).region
    # Within the tolerance of 0.1 it could have been at 0.05 - 0.1.
    assert region["S"] == pytest.approx((0.0, 1.1), rel=1e-4)
    assert region["v"][0] < 0.0


def test_states_that_are_fast_only_against_each_other_are_bounded() -> None:
    """A radiator in warm contact with the air: Tr - Ta is fast, Cr Tr + Ca Ta is slow and is made of both."""
    Tr, Ta, Tw, R = sp.symbols("Tr Ta Tw R")
    field = gsp.VectorField(
        {Tr: (1 - (Tr - Ta) / R) / 2, Ta: (Tr - Ta) / R - (Ta - Tw), Tw: (Ta - 2 * Tw) / 50},
        parameters={R: sp.Rational(1, 100)},
    )
    taken = take_small(gsp.Scene(field, {}, {"Tr": 1, "Ta": 0, "Tw": 0}, (0, 20)), parameter="R")
    assert set(taken.region) == {"Tr", "Ta", "Tw"}
    study = gsp.study(taken)
    assert len(study.system.y) == 1
    assert study.branch is not None


def test_a_factor_of_the_rates_makes_the_time_the_slow_one() -> None:
    x, y, delta = sp.symbols("x y delta")
    field = gsp.VectorField({x: delta * (y - x), y: x - 2 * y}, parameters={delta: sp.Rational(1, 50)})
    taken = take_small(gsp.Scene(field, {}, {"x": 1, "y": 0}, (0, 100)), parameter="delta")
    assert taken.span == pytest.approx((0.0, 2.0))
    fast = gsp.integrate(field, start={"x": 1, "y": 0}, span=(0, 100))
    slow = gsp.integrate(taken)
    np.testing.assert_allclose(slow.y[:, -1], fast.y[:, -1], rtol=1e-6)
    assert gsp.study(taken).system.y == (y,)


def test_named_fast_variables_are_fast_and_the_model_is_that_at_one(motor: gsp.Scene) -> None:
    taken = take_fast(motor, variables=["i"])
    assert isinstance(taken.system, SlowFastSystem)
    assert taken.system.y == (sp.Symbol("i"),)
    assert taken.epsilon == 1.0
    np.testing.assert_allclose(gsp.integrate(taken).at(5.0), gsp.integrate(motor).at(5.0)[[1, 0]], rtol=1e-6)


def test_another_parameter_may_be_the_small_one_instead() -> None:
    scene = gsp.models.load("michaelis_menten")
    plain = without_small(scene)
    assert plain.epsilon is None
    np.testing.assert_allclose(gsp.integrate(plain).y[:, -1], gsp.integrate(scene).y[:, -1], rtol=1e-6)
    assert "epsilon" in map(str, take_small(scene, parameter="kappa").system.parameters)


def test_the_usual_name_may_belong_to_a_parameter() -> None:
    x, y, epsilon = sp.symbols("x y epsilon")
    field = gsp.VectorField({x: -epsilon * x, y: x - y}, parameters={epsilon: 7})
    taken = take_fast(gsp.Scene(field, {}, {"x": 1, "y": 0}, (0, 1)), variables=["y"])
    assert str(taken.system.epsilon) == "epsilon_1"


@pytest.mark.parametrize(
    ("take", "words"),
    [
        (
            lambda scene: take_small(scene, parameter="q"),
            "parameter is 'q', and no parameter has this name. They are L, R, k",
        ),
        (lambda scene: take_small(scene, parameter="i"), "parameter is 'i'"),
        (
            lambda scene: take_fast(scene, variables=["L"]),
            "variables names 'L', which is no state. The states are i, w",
        ),
        (
            lambda scene: take_fast(scene, variables=["i", "w"]),
            "not all and not none. Got i, w",
        ),
        (lambda scene: take_fast(scene, variables=[]), "Got none"),
    ],
)
def test_what_cannot_be_small_or_fast_is_refused(motor: gsp.Scene, take, words: str) -> None:
    with pytest.raises(GspError, match=words):
        take(motor)


@pytest.mark.parametrize(("value", "rate"), [(-1, "stands"), (0, "stands")])
def test_a_small_parameter_is_positive(value: int, rate: str) -> None:
    x, a = sp.symbols("x a")
    field = gsp.VectorField({x: -a * x}, parameters={a: value})
    with pytest.raises(DeclarationError, match=f"a = {value} cannot be the small parameter"):
        take_small(gsp.Scene(field, {}, {"x": 1}, (0, 1)), parameter="a")


def test_a_parameter_in_no_rate_separates_nothing(motor: gsp.Scene) -> None:
    x, a = sp.symbols("x a")
    field = gsp.VectorField({x: -x}, parameters={a: 1}, observables={sp.Symbol("u"): a * x})
    with pytest.raises(DeclarationError, match="a stands in no rate"):
        take_small(gsp.Scene(field, {}, {"x": 1}, (0, 1)), parameter="a")


def test_a_factor_of_every_rate_sets_the_pace_and_separates_nothing() -> None:
    x, y, r = sp.symbols("x y r")
    for rates in ({x: r * x * (1 - x)}, {x: -r * x * y, y: r * (x - y) / 3}):
        field = gsp.VectorField(rates, parameters={r: sp.Rational(1, 9)})
        scene = gsp.Scene(field, {}, {state.name: 0.5 for state in rates}, (0, 1))
        with pytest.raises(GspError, match="r is a factor of every rate and stands nowhere else"):
            take_small(scene, parameter="r")


def test_what_was_taken_and_what_is_left_is_told() -> None:
    x, y, z, a, b, c = sp.symbols("x y z a b c")
    field = gsp.VectorField(
        {x: (y - x) / a, y: (z - y) / b, z: c * x - a * z}, parameters={a: 0.01, b: 0.02, c: 0.5}
    )
    before = gsp.Scene(field, {}, {"x": 1, "y": 0, "z": 0}, (0, 1))
    assert explain_small(take_small(before, parameter="a"), before) == [
        "small parameter: a = 0.01, which divides the rates of x",
        "a stands in the rates of z too, and is as small there",
        "left as it is: b = 1/50, which divides the rate of y",
    ]
    slowed = explain_small(take_small(before, parameter="c"), before)
    assert slowed[1].startswith("no rate has a pole in c, so the time of the model is the fast one")
    fast = explain_small(take_fast(before, variables=["x"]), before)
    assert fast[0] == "fast variables: x; their rates are divided by epsilon, which is 1 for the model itself"


def test_parameters_inside_functions_are_no_poles_and_hinder_nothing() -> None:
    """A rate with sqrt(x^2 + c^2) or exp(-b x) has another parameter that is small, or variables that are fast."""
    x, y, a, b, c = sp.symbols("x y a b c")
    field = gsp.VectorField(
        {x: -x + sp.exp(-b * y), y: (sp.sqrt(x**2 + c**2) - y) / a}, parameters={a: 0.01, b: 2, c: 1}
    )
    before = gsp.Scene(field, {}, {"x": 1, "y": 0}, (0, 1))
    assert explain_small(take_small(before, parameter="a"), before) == [
        "small parameter: a = 0.01, which divides the rates of y"
    ]
    assert explain_small(take_fast(before, variables=["y"]), before)[1:] == [
        "left as it is: a = 1/100, which divides the rate of y"
    ]
    with pytest.raises(DeclarationError, match=r"b stands in exp\(-b\*y\)"):
        take_small(before, parameter="b")


def test_what_turns_turns_by_the_parameter_that_the_scene_names() -> None:
    from tests.averaging.public import oscillator

    scene = oscillator()
    assert scene.phase is not None
    assert take_small(scene, parameter=str(scene.system.epsilon)).phase == scene.phase
    assert without_small(scene).phase is None


def test_a_parameter_that_is_not_small_is_told_as_such(motor: gsp.Scene) -> None:
    said = explain_small(take_small(motor, parameter="R"), motor)
    assert said[:2] == ["small parameter: R = 1", "R = 1 is not small, and series in it are of no use"]
    assert "rates are divided by R" in said[2]
    assert said[3] == "fast in that time: i, w"
    # The command line cuts notes.
    x, y, uptake = sp.symbols("x y uptake")
    field = gsp.VectorField({x: uptake - x - y, y: x - y}, parameters={uptake: 10})
    before = gsp.Scene(field, {}, {"x": 1, "y": 1}, (0, 60))
    assert max(map(len, explain_small(take_small(before, parameter="uptake"), before))) <= NOTE
