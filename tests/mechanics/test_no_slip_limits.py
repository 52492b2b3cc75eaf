"""No-slip beside closed forms: how far contacts creep, which starts are taken, and in which units."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import DeclarationError
from gsp.mechanics import LagrangianSystem, constrain, with_friction

x, y, xd, yd, m, r, t, R = sp.symbols("x y xdot ydot m r t R")
theta, phi, thetadot, phidot = sp.symbols("theta phi thetadot phidot")
epsilon = sp.Symbol("epsilon")


def contact(forces: dict, **given):
    """A mass on a plane that is held across x by a contact with mu N."""
    system = LagrangianSystem(
        m * (xd**2 + yd**2) / 2,
        [x, y],
        [xd, yd],
        parameters={m: 1},
        forces=forces,
        time=given.pop("time", None),
    )
    asked = {"law": "coulomb", "mu": sp.Rational(1, 2), "normal": 1, **given}
    return with_friction(system, asked.pop("rows", [yd]), epsilon=epsilon, **asked)


@pytest.mark.parametrize("mu", [0.7, 0.3])
def test_a_contact_creeps_a_finite_way_before_it_lets_go(mu: float) -> None:
    """The share is t/T with T = 10 mu, and the integral of epsilon s/sqrt(1 - s^2) over it epsilon T."""
    found = contact({y: x / 10}, mu=mu).no_slip(start={"x": 0, "y": 0, "xdot": 1}, span=(0, 20))
    assert found.time == pytest.approx(10 * mu, rel=1e-9)
    assert found.distance(1e-3) == pytest.approx([1e-2 * mu], rel=1e-6)


def test_a_contact_that_is_pushed_to_and_fro_creeps_the_whole_way() -> None:
    """Its share is 4/5 |cos t|, with a corner wherever the force turns: one part in ten thousand was lost there."""
    found = contact({y: 2 * sp.cos(x) / 5}, law="linear").no_slip(
        start={"x": 0, "y": 0, "xdot": 1}, span=(0, 10)
    )
    assert found.distance(1e-3) == pytest.approx([0.8e-3 * (6 - np.sin(10))], rel=1e-6)


@pytest.mark.exhaustive
@pytest.mark.parametrize("mu", [(0.8, 0.4), (0.4, 0.8), (0.5, 0.5)])
def test_in_a_cone_that_is_no_circle_the_slip_is_that_of_the_full_field(mu: tuple[float, float]) -> None:
    system = contact({y: sp.Rational(1, 5)}, rows=[(xd, yd)], mu=[mu])
    found = system.no_slip(start={"x": 0, "y": 0}, span=(0, 10))
    share = 0.2 / mu[1]
    slip = 1e-3 * share / np.sqrt(1 - share**2) * mu[0] / mu[1]
    assert found.creep(1e-3) == pytest.approx(np.full((1, found.t.size), slip), rel=1e-9)
    run = gsp.integrate(system.full_field, start={"x": 0, "y": 0, "w1": 0, "w2": 0}, span=(0, 10), epsilon=1e-3)
    # Within the layer at its start.
    assert found.distance(1e-3)[0] == pytest.approx(run["y"][-1], rel=1e-2)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("given", "start", "said"),
    [
        ({"normal": 1 - x}, 2, "bears nothing at the start: mu N is -0.5"),
        ({"mu": (1 - x) / 2}, 2, "bears nothing at the start: mu N is -0.5"),
        (
            {"law": r / sp.sqrt(1 + r**2) + r * (1 + r / sp.sqrt(1 + r**2)) / (1 + r**2)},
            0,
            "bears 1.67873 on one side and 1 on the other",
        ),
    ],
)
def test_what_a_share_would_not_tell_is_refused(given: dict, start: float, said: str) -> None:
    system = contact({y: sp.Rational(1, 10)}, **given)
    with pytest.raises(DeclarationError, match=said):
        system.no_slip(start={"x": start, "y": 0, "xdot": 1}, span=(0, 5))


def test_a_contact_lets_go_where_nothing_presses_it_any_more() -> None:
    found = contact({y: sp.Rational(1, 10)}, normal=1 - x).no_slip(
        start={"x": 0, "y": 0, "xdot": 1}, span=(0, 5)
    )
    # 1/10 is mu (1 - t).
    assert found.time == pytest.approx(0.8, rel=1e-9)


def test_a_drive_in_time_acts_across_the_constraint_alone() -> None:
    found = contact({y: sp.Rational(3, 5) * sp.sin(t)}, time=t).no_slip(
        start={"x": 0, "y": 0, "xdot": 1, "t": 0}, span=(0, 5)
    )
    assert found.time == pytest.approx(np.arcsin(5 / 6), rel=1e-9)


@pytest.mark.parametrize("start", [{"x": 1e9, "xdot": 1, "ydot": 0.5}, {"x": 0, "xdot": 1e-9, "ydot": 0.9e-9}])
def test_a_start_slips_beside_its_velocities_wherever_it_is(start: dict) -> None:
    with pytest.raises(DeclarationError, match="the start slips"):
        contact({}).no_slip(start={"y": 0, **start}, span=(0, 1))


def test_a_contact_that_is_asked_for_more_from_the_start_says_for_how_much() -> None:
    found = contact({y: 2}).no_slip(start={"x": 0, "y": 0, "xdot": 1}, span=(0, 1))
    assert found.time == 0.0
    assert "is asked for 4 times what it bears" in str(found)
    assert found.distance(1e-3) == pytest.approx([0.0])


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_a_mass_matrix_is_regular_in_any_units(size: float) -> None:
    disc = LagrangianSystem(
        m * xd**2 / 2 + m * R**2 / 4 * thetadot**2, [x, theta], [xd, thetadot], parameters={m: 4e-15, R: size}
    )
    assert disc.parameters[R] == sp.Rational(str(size))


@pytest.mark.parametrize("order", [1, -1])
def test_constraints_are_independent_in_any_units(order: int) -> None:
    system = LagrangianSystem(
        (xd**2 + yd**2 + thetadot**2 + phidot**2) / 2, [x, y, theta, phi], [xd, yd, thetadot, phidot],
        parameters={R: 1e-9},
    )  # fmt: skip
    assert constrain(system, [xd - yd, R * thetadot - 2 * R * phidot][::order]).reduced is not None
    assert constrain(system, [R**2 * (thetadot - 2 * phidot)]).reduced is not None
    with pytest.raises(DeclarationError, match=r"constraint 2.*depends on the others"):
        constrain(system, [xd - yd, R * xd - R * yd][::order])
