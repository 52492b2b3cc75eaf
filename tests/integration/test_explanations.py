"""What is said of a run that failed: poles with their order and place, lost backward runs, starts off the domain."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

from gsp.errors import Status
from gsp.integration.explanations import LOST, explain
from gsp.integration.methods import Method
from gsp.integration.reduction_end.endings import begins
from gsp.integration.restriction import real_or_nan
from gsp.integration.trajectory import integrate
from gsp.systems.system import SlowFastSystem, VectorField

x, y, v, eps = sp.symbols("x y v epsilon")
NO_PARAMETERS = np.array([np.nan])


def told(flow, times, states, *, status: Status = Status.NON_FINITE, last: float = 9.0, p=NO_PARAMETERS):
    record = SimpleNamespace(
        times=np.array(times, dtype=float),
        states=np.array(states, dtype=float),
        status=status,
        stats=SimpleNamespace(),
    )
    return explain(flow, p, record, last)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("rate", "power", "factor"),
    # x ~ C (2 - t)^(-k) for x' = k/C^(1/k) x^(1 + 1/k), here with C = 3.
    [
        (lambda x: x**2 / 3, 1.0, 3.0),
        (lambda x: x**3 / 18, 0.5, 3.0),
        (lambda x: 2 * x ** sp.Rational(3, 2) / sp.sqrt(3), 2.0, 3.0),
    ],
)
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_pole_is_named_with_its_order_and_place(rate, power: float, factor: float, direction: float) -> None:
    # Backward in time the pole lies at -2.
    flow = VectorField({y: sp.Integer(0), x: direction * rate(x)}, epsilon=None)
    left = np.geomspace(2.0, 1e-8 if power >= 1.0 else 1e-10, 40)
    times = direction * (2.0 - left)
    states = np.stack([np.ones(40), factor * left**-power], axis=1)
    explanation = told(flow, times, states, last=9.0 * direction)
    assert explanation.note.startswith(
        f"x grows without bound, like (T - t)^-{power:.3g} with T = {direction * 2:.7g}"
    )
    assert explanation.remedy == Status.NON_FINITE.remedy


def test_growth_that_is_no_power_of_the_distance_or_not_enough_is_no_pole() -> None:
    flow = VectorField({x: x}, epsilon=None)
    times = np.linspace(0.0, 20.0, 40)
    assert told(flow, times, np.exp(times)[:, None]).note == ""
    quadratic = VectorField({x: x**2}, epsilon=None)
    left = np.geomspace(1.0, 1e-3, 30)
    assert told(quadratic, 1 - left, (1 / left)[:, None]).note == ""
    left = np.geomspace(1.0, 1e-5, 4)
    assert told(quadratic, 1 - left, (1 / left)[:, None]).note == ""


def test_a_start_off_the_domain_is_told_from_a_first_step_that_fails() -> None:
    flow = VectorField({x: sp.log(x)}, epsilon=None)
    assert told(flow, [0.0], [[-1.0]]).note == "the field is not finite at the start"
    assert told(flow, [0.0], [[1.0]]).note == ""
    assert told(flow, [0.0], [[1.0]]).remedy == Status.NON_FINITE.remedy
    assert told(flow, [0.0], [[-1.0]], status=Status.SUCCESS).note == ""


def test_a_backward_run_that_has_lost_every_digit_says_how_fast_it_did() -> None:
    flow = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: x - y}, epsilon=eps)

    def note(span: float, epsilon: float = 0.01) -> str:
        return told(flow, [0.0, -1e-3], [[0.0, 1.0], [0.0, 2.0]], last=-span, p=np.array([epsilon])).note

    # The rate is 1/epsilon = 100.
    assert note(0.01 * LOST * 1.001).startswith(
        "backward in time the fast directions grow at the rate 100, by 1e16 over"
    )
    assert note(0.01 * LOST * 0.999) == ""
    assert "1e434" in note(10.0)
    # Forward they decay, and in a field without a fast part nothing is lost.
    assert told(flow, [0.0, 1.0], [[0.0, 1.0], [0.0, 2.0]], last=10.0, p=np.array([0.01])).note == ""


def test_a_run_begins_where_its_series_holds_and_where_none_is_watched_anywhere() -> None:
    rows = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 1e-300], [1.0, 1.0, -1.0]])
    for watches, expected in ((False, [True] * 3), (True, [False, True, False])):
        validity = SimpleNamespace(watches_series=watches)
        assert begins(validity, rows).tolist() == expected  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("unreal", [sp.oo, -sp.oo, sp.zoo, sp.nan, sp.I, sp.sqrt(-2) * x, sp.oo * x])
def test_observables_that_are_infinite_or_imaginary_throughout_are_no_numbers(unreal: sp.Expr) -> None:
    found = real_or_nan({x: x + 1, y: unreal})
    assert found[x] == x + 1
    assert found[y] is sp.nan


def test_growth_that_is_no_power_is_not_told_as_one() -> None:
    x, y = sp.symbols("x y")
    field = VectorField({x: 1 + x**2, y: sp.exp(x) * (1 + x**2)}, epsilon=None)  # y = exp(tan t)
    run = integrate(field, start={"x": 0, "y": 1}, span=(0, 3))
    assert not run.status.ok
    assert "y grows" not in run.message


def test_a_stiff_method_that_runs_out_of_steps_is_not_told_to_be_one() -> None:
    # x slides on the jump of its rate from t = 4/5 on.
    field = VectorField({x: -sp.sign(x) - sp.Rational(1, 4)}, epsilon=None)
    run = integrate(field, start={"x": 1}, span=(0, 3), method=Method.RADAU13, max_steps=2000)
    assert run.status is Status.TOO_MANY_STEPS
    assert "stiff" not in run.message


@pytest.mark.parametrize(
    ("rates", "start", "surface"),
    [
        ({x: -sp.sign(x) - sp.Rational(1, 4)}, {"x": 1}, "x"),
        ({x: v, v: -x - sp.sign(v) / 2}, {"x": 2, "v": 0}, "v"),
        ({x: v, v: 10 - 20 * sp.Heaviside(v - 3, 0)}, {"x": 0, "v": 0}, "v - 3"),
        ({x: -sp.sign(x) * sp.sqrt(sp.Abs(x))}, {"x": 1}, "x"),
    ],
    ids=["a sink", "dry friction", "a governor", "no jump"],
)
def test_a_run_that_slides_along_a_jump_is_told_so(rates: dict, start: dict, surface: str) -> None:
    run = integrate(VectorField(states=rates, epsilon=None), start=start, span=(0, 20), max_steps=3000)
    assert run.status in (Status.TOO_MANY_STEPS, Status.STEP_TOO_SMALL)
    assert f"to and fro across {surface} = 0, where the field points there from both sides" in run.message
    assert "run_piecewise" in run.message


def test_a_run_that_crosses_jumps_until_its_steps_are_used_up_is_not_said_to_slide() -> None:
    field = VectorField(states={x: v, v: -sp.sign(x)}, epsilon=None)
    run = integrate(field, start={"x": 1, "v": 0}, span=(0, 1e4), max_steps=500)
    assert run.status is Status.TOO_MANY_STEPS
    assert "both sides" not in run.message


LIGHT, GAIN, LOSS = sp.symbols("I D B")


@pytest.mark.parametrize("method", ["radau13", "dop853"])
def test_a_state_that_grows_again_from_below_atol_is_told_though_the_run_reaches_its_end(method: str) -> None:
    # A laser with an absorber is dark between its pulses, down to 1e-32: at I = 1e-10 it is lost, and with it
    # when the next pulse comes. Nothing was said.
    laser = VectorField(
        states={
            LIGHT: (GAIN - LOSS - 1) * LIGHT,
            GAIN: (sp.Rational(17, 2) - GAIN * (1 + LIGHT)) / 50,
            LOSS: (sp.Rational(24, 5) - LOSS * (1 + 9 * LIGHT / 5)) / 10,
        },
        epsilon=None,
    )
    start = {"I": 1e-3, "D": 4, "B": 4}
    wrong = integrate(laser, start=start, span=(0, 600), rtol=1e-6, method=method)
    assert wrong.status is Status.SUCCESS
    assert wrong["I"].min() < -1.0
    assert "I is smaller than atol = 1e-10 at t = " in wrong.message
    assert "when it is large again is not known; give an atol below the least that I gets to" in wrong.message
    right = integrate(laser, start=start, span=(0, 600), rtol=1e-9, atol=1e-40, method=method)
    assert right.message == f"reached the end after {right.stats.steps} steps: {right.end_in_words}"
    # Of the logarithm of I at 1e-12, by LSODA.
    assert right["D"][-1] == pytest.approx(4.81906, rel=1e-5)


def test_a_state_that_may_pass_zero_or_stays_small_is_not_told() -> None:
    # Along y = -(t - 2)^2 sgn(t - 2)/4 the rate is 0 at y = 0 too, which is passed; x decays to 1e-41.
    field = VectorField(states={x: -1000 * x, y: -sp.sqrt(sp.Abs(y)), v: -y}, epsilon=None)
    run = integrate(field, start={"x": 1, "y": 1, "v": 1}, span=(0, 4), method="radau9", rtol=1e-6)
    assert run["x"].min() < 1e-30
    assert run["y"][-1] == pytest.approx(-1, rel=1e-4)
    assert run.message == f"reached the end after {run.stats.steps} steps: {run.end_in_words}"
