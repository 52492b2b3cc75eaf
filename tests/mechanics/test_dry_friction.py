"""Dry friction in contacts: where no-slip holds, where it fails, creep, and runs of the unreduced equations."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from gsp.comparison.comparison import compare
from gsp.critical.loss_kind import LossKind
from gsp.errors import DeclarationError
from gsp.integration.trajectory import integrate
from gsp.mechanics import DryFrictionSystem, FrictionSystem, LagrangianSystem, with_friction
from gsp.sliding.law import W

x, y, phi, xdot, ydot, phidot = sp.symbols("x y phi xdot ydot phidot")
m, a, inertia, mu, N, v, omega, w, epsilon = sp.symbols("m a I mu N v omega w epsilon")
SLIP = -xdot * sp.sin(phi) + ydot * sp.cos(phi)
FORWARD = xdot * sp.cos(phi) + ydot * sp.sin(phi)
FRAME = {v: FORWARD, omega: phidot}
ARM, MASS, INERTIA = 0.2, 1.0, 1.0
TOTAL = INERTIA + MASS * ARM**2


def sleigh(law="coulomb", force=0.9) -> DryFrictionSystem:
    """Chaplygin's sleigh on a blade that bears mu N."""
    energy = m * (xdot**2 + ydot**2) / 2 + (inertia + m * a**2) * phidot**2 / 2 + m * a * phidot * SLIP
    system = LagrangianSystem(
        energy,
        [x, y, phi],
        [xdot, ydot, phidot],
        parameters={m: MASS, inertia: INERTIA, a: ARM, mu: 0.1, N: 10 * force},
    )
    return with_friction(system, [SLIP], epsilon=epsilon, law=law, mu=mu, normal=N, frame=FRAME)


def block(law="coulomb", mu=0.5, slope="1/5", **others) -> DryFrictionSystem:
    """A round block on an incline of the angle `slope`, slipping in the plane and free to turn."""
    angle = sp.Rational(slope)
    energy = m * (xdot**2 + ydot**2 + phidot**2) / 2 - m * sp.Rational("9.81") * sp.sin(angle) * x
    system = LagrangianSystem(energy, [x, y, phi], [xdot, ydot, phidot], parameters={m: 2})
    normal = m * sp.Rational("9.81") * sp.cos(angle)
    return with_friction(system, [(xdot, ydot)], epsilon=epsilon, law=law, mu=mu, normal=normal, **others)


def test_the_sleigh_sticks_if_and_only_if_its_blade_bears_the_turn() -> None:
    """|v omega| < F_c (I + m a^2)/(m I)."""
    (load,) = sleigh().loads
    asked = (v * omega * m * inertia / (mu * N * (inertia + m * a**2))) ** 2
    assert sp.simplify(load - asked) == 0


@pytest.mark.exhaustive
def test_no_slip_fails_at_the_time_and_place_of_the_constrained_run() -> None:
    """The sleigh runs backwards, unstably: |v omega| grows to what the blade bears."""
    bears = 0.9 * TOTAL / (MASS * INERTIA)

    def rates(_, z):
        return [ARM * z[1] ** 2, -MASS * ARM * z[0] * z[1] / TOTAL, z[1]]

    def cone(_, z):
        return abs(z[0] * z[1]) - bears

    cone.terminal = True
    run = solve_ivp(rates, (0, 20), [-1.5, 0.3, 0.1], "DOP853", rtol=1e-12, atol=1e-14, events=cone)
    (time,), (place,) = run.t_events[0], run.y_events[0]
    found = sleigh().no_slip(start={"x": 0, "y": 0, "phi": 0.1, "v": -1.5, "omega": 0.3}, span=(0, 20))
    assert not found.holds
    assert found.loss is LossKind.CONE_END
    assert found.time == pytest.approx(time, abs=1e-9)
    assert found.place is not None
    assert [found.place[name] for name in ("v", "omega", "phi")] == pytest.approx(place, abs=1e-9)
    assert "No-slip fails at t = " in str(found)
    assert "end of the friction cone" in str(found)
    assert found.shares[0, -1] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.exhaustive
def test_the_full_system_sticks_until_then_and_slips_after() -> None:
    given = sleigh()
    start = {"x": 0, "y": 0, "phi": 0.1, "v": -1.5, "omega": 0.3}
    time = given.no_slip(start=start, span=(0, 20)).time
    assert time is not None
    small = 1e-6
    full = integrate(given.field, start={"v": -1.5, "omega": 0.3, "w": 0}, span=(0, time + 1), epsilon=small)
    slips = np.abs(full.sample(np.array([0.5 * time, time - 0.05, time + 0.2]))["w"])
    assert slips[0] < 10 * small
    assert slips[1] < 100 * small
    assert slips[2] > 1e-3


@pytest.mark.exhaustive
def test_a_law_that_overshoots_holds_on_longer() -> None:
    stribeck = W / sp.sqrt(1 + W**2) + W / (1 + W**2)
    start = {"x": 0, "y": 0, "phi": 0.1, "v": -1.5, "omega": 0.3}
    plain, over = (sleigh(law).no_slip(start=start, span=(0, 8)) for law in ("coulomb", stribeck))
    assert plain.time is not None
    assert over.time is None or over.time > plain.time
    weak = sleigh(stribeck, force=0.7).no_slip(start=start, span=(0, 8))
    assert weak.loss is LossKind.SLIP_ONSET


def test_a_block_creeps_down_an_incline_by_the_law() -> None:
    """tan(1/5) of 0.5 is asked for: w = epsilon phi^-1(0.4054...), down the slope."""
    given = block()
    share = np.tan(0.2) / 0.5
    found = given.no_slip(start={"x": 0, "y": 0, "phi": 0, "phidot": 0}, span=(0, 2))
    assert found.holds
    assert found.shares == pytest.approx(share)
    creep = 1e-3 * share / np.sqrt(1 - share**2)
    assert found.creep(1e-3) == pytest.approx(creep)
    assert found.distance(1e-3) == pytest.approx(2 * creep)
    begin = dict.fromkeys((state.name for state in given.full_field.states), 0.0)
    run = integrate(given.full_field, start=begin, span=(0, 2), epsilon=1e-3, rtol=1e-10)
    assert run["w1"][-1] == pytest.approx(-creep, rel=1e-6)
    light = float(given.creep[0].xreplace({**given.system.values, epsilon: sp.Rational(1, 1000)}))
    assert light == pytest.approx(-1e-3 * share)


@pytest.mark.exhaustive
def test_an_elliptic_cone_bears_more_along_one_axis() -> None:
    """Gravity pulls along x, where mu is 0.1 or 0.5."""
    easy, hard = (block(mu=[pair]) for pair in ((0.1, 0.5), (0.5, 0.1)))
    start = {"x": 0, "y": 0, "phi": 0, "phidot": 0}
    assert easy.no_slip(start=start, span=(0, 1)).loss is LossKind.CONE_END
    assert hard.no_slip(start=start, span=(0, 1)).holds


def test_friction_in_a_plane_is_against_the_slip_where_the_cone_is_round() -> None:
    given = block()
    w1, w2 = given.frame.across
    place = {w1: sp.Rational(3), w2: sp.Rational(4), epsilon: sp.Rational(1, 10**12), **given.system.values}
    forces = [sp.N(force.xreplace(place)) for force in given.forces]
    bears = 0.5 * 2 * 9.81 * np.cos(0.2)
    assert [float(f) for f in forces] == pytest.approx([-0.6 * bears, -0.8 * bears])


@pytest.mark.exhaustive
def test_the_reduced_flows_of_a_sticking_sleigh_have_their_slopes() -> None:
    scene = sleigh(force=3.0).scene(
        region={"v": (-2, 2), "omega": (-2, 2), "w": (-1, 1)},
        start={"v": 1.0, "omega": 0.8, "w": 0, "phi": 0, "x": 0, "y": 0},
        span=(0, 3),
        epsilon=0.01,
    )
    found = compare(scene, orders=(0, 1, 2))
    for order in range(3):
        assert found.slopes[order] == pytest.approx(order + 1, abs=0.2)


def test_two_contacts_are_told_apart() -> None:
    """A bar on two blades: the one with the weaker grip lets go."""
    energy = (xdot**2 + ydot**2 + phidot**2) / 2 - 3 * x - y
    system = LagrangianSystem(energy, [x, y, phi], [xdot, ydot, phidot])
    given = with_friction(
        system, [xdot, ydot], epsilon=epsilon, law="tanh", mu=[0.5, 0.2], normal=[10, 10 / (1 + phi**2)]
    )
    found = given.no_slip(start={"x": 0, "y": 0, "phi": 0, "phidot": 1}, span=(0, 5))
    assert found.contact == 1
    assert found.time == pytest.approx(1.0, abs=1e-9)
    assert isinstance(given, DryFrictionSystem)
    assert given != sleigh()


def test_viscous_friction_is_what_it_was() -> None:
    assert isinstance(with_friction(sleigh().system, [SLIP], epsilon=epsilon, frame=FRAME), FrictionSystem)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"law": "coulomb", "mu": 0.5}, "takes normal"),
        ({"law": "coulomb", "normal": 1}, "takes mu"),
        ({"mu": 0.5}, "mu belongs to dry friction"),
        ({"law": "coulomb", "mu": 0.5, "normal": 1, "damping": 2}, "damping belongs to viscous friction"),
        ({"law": "columb", "mu": 0.5, "normal": 1}, 'phi = "columb" is no law'),
        ({"law": "coulomb", "mu": -1, "normal": 1}, "mu is not positive"),
        ({"law": "coulomb", "mu": 1, "normal": phidot}, "normal depends on phidot"),
        ({"law": "coulomb", "mu": [1, 2], "normal": 1}, "mu has 2 entries for 1 contacts"),
        ({"law": "coulomb", "mu": [(1, 2)], "normal": 1}, "mu has 2 values for a contact with 1 direction"),
    ],
)
def test_what_is_no_dry_friction_is_refused(options, says) -> None:
    with pytest.raises(DeclarationError, match=says):
        with_friction(sleigh().system, [SLIP], epsilon=epsilon, **options)


def test_a_contact_in_the_plane_needs_a_law_that_is_smooth_at_rest() -> None:
    for law, says in (
        ("linear", r"\(Max\(-1, Min\(1, w\)\)\)/w is 0/0 at rest"),
        ("tanh", r"\(tanh\(w\)\)/w is 0/0 at rest"),
        (W / (1 + sp.Abs(W)), r"\(w/\(Abs\(w\) \+ 1\)\)/w has a kink at rest"),
    ):
        with pytest.raises(DeclarationError, match=says):
            _ = block(law=law).field


def test_a_start_that_slips_is_refused() -> None:
    with pytest.raises(DeclarationError, match=r"the start slips: w = 0\.5"):
        sleigh().no_slip(start={"x": 0, "y": 0, "phi": 0, "v": 1, "omega": 0, "w": 0.5}, span=(0, 1))
    with pytest.raises(DeclarationError, match="the start slips: w = 1"):
        sleigh().no_slip(start={"x": 0, "y": 0, "phi": 0, "xdot": 0, "ydot": 1, "phidot": 0}, span=(0, 1))


def test_contacts_may_hold_every_velocity() -> None:
    """A door at rest: its closer's spring against the hinge, 0.6 of 1.2; pushed over, it lets go past 1.2."""
    phi, phidot, t = sp.symbols("phi phidot t")
    spring = sp.Rational(5, 2) * phidot**2 - sp.Rational(3, 2) * (phi + sp.Rational(1, 2)) ** 2
    door = LagrangianSystem(spring, [phi], [phidot])
    hinge = with_friction(door, [phidot], epsilon=epsilon, law="coulomb", mu=1, normal=1.2)
    found = hinge.no_slip(start={"phi": -0.3, "phidot": 0}, span=(0, 5))
    assert found.holds
    assert "0.5 of what it bears" in str(found)
    pushed = LagrangianSystem(spring, [phi], [phidot], forces={phi: t}, time=t)
    held = with_friction(pushed, [phidot], epsilon=epsilon, law="coulomb", mu=1, normal=1.2)
    start = {"phi": -0.3, "phidot": 0, "t": 0}
    failing = held.no_slip(start=start, span=(0, 5))
    assert not failing.holds
    assert "t = 1.8" in str(failing)
    assert held.run(start=start, span=(0, 3)).pieces[0].run.t[-1] == pytest.approx(1.8, abs=1e-9)
