"""Where M0 jumps under a reduced run: slow coordinates go on, and a run in fast ones ends on the side it comes from."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import HyperbolicityError, Status
from gsp.integration.trajectory import Trajectory

x, y, clock, eps = sp.symbols("x y clock epsilon")
CUBIC = x - y - y**3
ON = sp.Heaviside(clock - 1)
START = {"x": 0.5, "clock": 0.0}


def flow_of(g: sp.Expr, unit: int | sp.Rational = 1, order: int = 0):
    """The flow of x' = -x on g = 0, with x in other units."""
    system = gsp.SlowFastSystem(slow={x: -x, clock: sp.Integer(1)}, fast={y: g.subs(x, x / unit)}, epsilon=eps)
    branch = gsp.solve_critical(system).branches[0]
    return gsp.restrict(gsp.expand(branch, order=order))


def run(g: sp.Expr, start=START, span=(0.0, 2.0), order: int = 0, **more) -> Trajectory:
    flow = flow_of(g, order=order)
    return gsp.integrate(flow, start=start, span=span, epsilon=1e-3, rtol=1e-9, atol=1e-11, **more)


@pytest.mark.parametrize("order", [0, 1])
@pytest.mark.parametrize(
    "g",
    [
        CUBIC + ON,
        CUBIC + sp.sign(1 - clock) / 5,
        CUBIC + sp.Piecewise((2, clock > 1), (0, True)),
        sp.sin(x) - y - y**3 + ON,
    ],
    ids=["step", "sign", "pieces", "x kept"],
)
def test_a_slow_variable_does_not_jump_where_an_input_is_switched_on(g: sp.Expr, order: int) -> None:
    """x = x0 exp(-t) whatever y does."""
    found = run(g, order=order)
    assert found.status is Status.JUMP_REACHED
    assert "jumps where" in found.message
    assert found.t[-1] == pytest.approx(1.0, abs=1e-9)
    assert found["x"] == pytest.approx(0.5 * np.exp(-found.t), rel=1e-6)
    # A time of output on the jump itself is on neither side.
    gridded = run(g, order=order, at=[0.5, 1.0, 1.5])
    assert gridded.t.tolist() == [0.5]
    assert gridded["x"] == pytest.approx(0.5 * np.exp([-0.5]), rel=1e-6)


def test_a_jump_in_the_state_is_met_where_it_is() -> None:
    """M0 breaks off at y = 1/5, where x = 1/5 + 1/5^5 + 1/10."""
    edge = 0.2 + 0.2**5 + 0.1
    found = run(x - y - y**5 - sp.sign(y - sp.Rational(1, 5)) / 10, {"x": 0.9, "clock": 0.0, "y": 0.6})
    assert found.status is Status.JUMP_REACHED
    assert found.t[-1] == pytest.approx(np.log(0.9 / edge), rel=1e-7)
    assert found["x"][-1] == pytest.approx(edge, rel=1e-7)


def test_backward_it_is_met_from_behind() -> None:
    found = run(CUBIC + ON, {"x": 0.5, "clock": 2.0}, span=(2.0, 0.0))
    assert found.status is Status.JUMP_REACHED
    assert found.t[-1] == pytest.approx(1.0, abs=1e-9)
    assert found["x"] == pytest.approx(0.5 * np.exp(2.0 - found.t), rel=1e-6)


@pytest.mark.parametrize(
    "g",
    [
        CUBIC + sp.Abs(clock - 1),
        CUBIC + sp.Max(0, clock - 1),
        CUBIC + sp.Piecewise((clock - 1, clock >= 1), (0, True)),
        CUBIC + (clock - 1) * ON,
        x - y + ON,
    ],
    ids=["kink", "ramp", "pieces that meet", "product", "slow coordinates"],
)
def test_a_kink_ends_nothing_and_slow_coordinates_go_on(g: sp.Expr) -> None:
    found = run(g)
    assert found.status is Status.SUCCESS
    assert found["x"][-1] == pytest.approx(0.5 * np.exp(-2.0), rel=1e-6)


def test_a_jump_without_height_is_passed_and_the_next_is_not() -> None:
    """(clock - 1) sign((clock - 1)(clock - 3/2)) has a kink at 1 and a jump at 3/2."""
    surface = (clock - 1) * (clock - sp.Rational(3, 2))
    found = run(CUBIC + (clock - 1) * sp.sign(surface))
    assert found.status is Status.JUMP_REACHED
    assert found.t[-1] == pytest.approx(1.5, abs=1e-9)


def test_a_start_on_a_jump_is_on_the_side_whose_value_the_field_has() -> None:
    start = {"x": 0.5, "clock": 1.0}
    behind = run(CUBIC + sp.Piecewise((1, clock >= 1), (0, True)), start, span=(1.0, 2.0))
    assert behind.status is Status.SUCCESS
    assert behind["x"][-1] == pytest.approx(0.5 * np.exp(-1.0), rel=1e-6)
    ahead = run(CUBIC + sp.Piecewise((1, clock > 1), (0, True)), start, span=(1.0, 2.0))
    assert ahead.status is Status.JUMP_REACHED
    assert ahead.t[-1] == 1.0
    with pytest.raises(HyperbolicityError, match=r"clock - 1 = 0, on neither side"):
        run(CUBIC + ON, start, span=(1.0, 2.0))


def test_members_of_an_ensemble_end_where_single_runs_do() -> None:
    flow = flow_of(CUBIC + ON)
    asked = {"span": (0.0, 2.0), "epsilon": 1e-3, "rtol": 1e-9, "atol": 1e-11, "at": [0.5, 1.5]}
    many = gsp.integrate_many(flow, {"x": [0.5, 0.7], "clock": [0.0, 1.2]}, **asked)
    assert [status.name for status in many.statuses] == ["JUMP_REACHED", "SUCCESS"]
    assert many["x"][0] == pytest.approx([0.5 * np.exp(-0.5), np.nan], rel=1e-6, nan_ok=True)


@pytest.mark.parametrize("unit", [10**9, sp.Rational(1, 10**9)], ids=str)
def test_the_end_does_not_depend_on_the_unit_of_the_slow_variable(unit) -> None:
    start = {"x": 0.5 * float(unit), "clock": 0.0}
    found = gsp.integrate(flow_of(CUBIC + ON, unit), start=start, span=(0.0, 2.0), epsilon=1e-3, rtol=1e-9)
    assert found.status is Status.JUMP_REACHED
    assert found["x"][-1] == pytest.approx(start["x"] * np.exp(-1.0), rel=1e-6)


def test_steps_end_on_a_pulse_of_a_clock_where_the_states_are_not_the_slow_variables() -> None:
    """x' = -x + a pulse of area 1/10 at t = 3/2, on x = y + y^3."""
    width = sp.Rational(1, 10**5)
    pulse = sp.exp(-(((clock - sp.Rational(3, 2)) / width) ** 2)) / (10 * width * sp.sqrt(sp.pi))
    system = gsp.SlowFastSystem(slow={x: -x + pulse, clock: sp.Integer(1)}, fast={y: CUBIC}, epsilon=eps)
    near = {"x": 0.5, "clock": 0.0, "y": 0.4}
    flow = gsp.restrict(gsp.expand(gsp.solve_critical(system).branches[0].through(near), order=0))
    end = 0.5 * np.exp(-3.0) + 0.1 * np.exp(-1.5)
    asked = {"span": (0.0, 3.0), "epsilon": 1e-3, "rtol": 1e-8}
    for start in (START, near):
        assert gsp.integrate(flow, start=start, **asked)["x"][-1] == pytest.approx(end, rel=1e-4)
    many = gsp.integrate_many(flow, {"x": [0.5], "clock": [0.0]}, **asked)
    assert many["x"][0, -1] == pytest.approx(end, rel=1e-4)
