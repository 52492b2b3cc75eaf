"""Rotations by quaternions, and holonomic constraints that a system brings along."""

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import DeclarationError
from gsp.integration.trajectory import Method, integrate
from gsp.mechanics import LagrangianSystem, constrain, rotation, with_friction

TIGHT = {"rtol": 1e-12, "atol": 1e-13, "method": Method.DOP853}
x, y, xdot, ydot, m, g, epsilon = sp.symbols("x y xdot ydot m g epsilon")
OMEGA = sp.symbols("omega_x omega_y omega_z")
INERTIA = sp.symbols("I1 I2 I3")
turn = rotation("q")


def hat(vector) -> sp.Matrix:
    a, b, c = vector
    return sp.Matrix([[0, -c, b], [c, 0, -a], [-b, a, 0]])


def body(potential: sp.Expr = sp.S.Zero, values=None) -> LagrangianSystem:
    """A rigid body about a fixed point."""
    kinetic = sum(J * w**2 for J, w in zip(INERTIA, turn.body)) / 2
    return LagrangianSystem(
        kinetic - potential, turn.coordinates, turn.velocities,
        parameters=values or dict(zip(INERTIA, (1, 2, 3))), holonomic=[turn.holonomic],
    )  # fmt: skip


def chaplygin_ball():
    """A ball with its centre of mass in the middle and three moments of inertia, on a plane."""
    kinetic = m * (xdot**2 + ydot**2) / 2 + sum(J * w**2 for J, w in zip(INERTIA, turn.body)) / 2
    system = LagrangianSystem(
        kinetic, [x, y, *turn.coordinates], [xdot, ydot, *turn.velocities],
        parameters={m: 1, **dict(zip(INERTIA, (sp.Rational(3, 10), sp.Rational(2, 5), sp.Rational(1, 2))))},
        holonomic=[turn.holonomic],
    )  # fmt: skip
    slips = [xdot - turn.space[1], ydot + turn.space[0]]
    return with_friction(system, slips, epsilon=epsilon, frame=dict(zip(OMEGA, turn.body)))


def matrices(run) -> np.ndarray:
    """The rotations (m, 3, 3) along a run."""
    entries = sp.lambdify(turn.coordinates, list(turn.matrix))
    values = np.array(
        [np.broadcast_to(e, run["q0"].shape) for e in entries(*(run[q] for q in turn.coordinates))]
    )
    return values.T.reshape(-1, 3, 3)


@pytest.mark.exhaustive
def test_the_matrix_turns_at_the_angular_velocity_in_space_and_in_the_body() -> None:
    on_sphere = sp.sqrt(1 - sum(q**2 for q in turn.coordinates[1:]))
    q1, q2, q3 = sp.symbols("a b c", real=True)
    t = sp.Symbol("t")
    path = [sp.Rational(1, 3) + t * q1, sp.Rational(1, 5) + t * q2, -sp.Rational(1, 7) + t * q3]
    values = dict(zip(turn.coordinates[1:], path))
    values[turn.coordinates[0]] = on_sphere.subs(values)
    rates = {u: sp.diff(values[q], t) for q, u in zip(turn.coordinates, turn.velocities)}
    R = turn.matrix.subs(values)
    rate = sp.diff(R, t)

    def at_start(e):
        return sp.simplify(e.subs(t, 0))

    assert at_start(R * R.T - sp.eye(3)).is_zero_matrix
    assert at_start(R.det()) == 1
    space = [w.subs(rates).subs(values) for w in turn.space]
    inside = [w.subs(rates).subs(values) for w in turn.body]
    assert at_start(rate * R.T - hat(space)).is_zero_matrix
    assert at_start(R.T * rate - hat(inside)).is_zero_matrix


def test_a_rotation_about_an_axis_is_rodrigues() -> None:
    values = rotation("r").about((1, 2, 2), 0.7)
    axis = np.array([1, 2, 2]) / 3
    K = np.array(hat(axis), dtype=float)
    expected = np.eye(3) + np.sin(0.7) * K + (1 - np.cos(0.7)) * K @ K
    found = np.array(rotation("r").matrix.subs(values), dtype=float)
    np.testing.assert_allclose(found, expected, atol=1e-15)
    for axis, angle in (((0, 0, 0), 1), ((1, 0), 1), ((1, 0, 0), np.inf), ((np.nan, 0, 1), 1)):
        with pytest.raises(DeclarationError, match="axis of three numbers"):
            turn.about(axis, angle)
    with pytest.raises(DeclarationError, match="a rotation has a name"):
        rotation("2 q")


@pytest.mark.exhaustive
def test_eulers_equations_follow_from_the_lagrangian_over_quaternions() -> None:
    free = constrain(body(), [], frame=dict(zip(OMEGA, turn.body)))
    a, b, c = OMEGA
    I1, I2, I3 = INERTIA
    expected = [(I2 - I3) * b * c / I1, (I3 - I1) * c * a / I2, (I1 - I2) * a * b / I3]
    assert [sp.cancel(r - e) for r, e in zip(free.reduced.rates, expected)] == [0, 0, 0]
    # A body that nothing acts on keeps its angular momentum in space.
    start = {**turn.about((0, 0, 1), 0.0), "omega_x": 0.01, "omega_y": 2.0, "omega_z": 0.02}
    run = integrate(free.full_field, start=start, span=(0, 20), at=np.linspace(0, 20, 81), **TIGHT)
    inside = np.stack([J * run[w] for J, w in zip((1, 2, 3), OMEGA)], axis=1)
    in_space = np.einsum("tij,tj->ti", matrices(run), inside)
    np.testing.assert_allclose(in_space, np.broadcast_to(in_space[0], in_space.shape), atol=1e-9)
    # It tumbles about the middle axis, which comes to point the other way.
    assert matrices(run)[:, 1, 1].min() < -0.9


@pytest.mark.exhaustive
def test_a_top_goes_through_the_pole_of_eulers_angles() -> None:
    """Upright is where they are singular: a top that stands there and turns slowly falls, and comes back."""
    equal = {INERTIA[0]: 1, INERTIA[1]: 1, INERTIA[2]: 1, g: 1}
    top = constrain(body(g * turn.matrix[2, 2], equal), [], frame=dict(zip(OMEGA, turn.body)))
    start = {**turn.about((1, 0, 0), 0.0), "omega_x": 0.2, "omega_y": 0.0, "omega_z": 0.5}
    run = integrate(top.full_field, start=start, span=(0, 30), at=np.linspace(0, 30, 601), **TIGHT)
    R = matrices(run)
    lean = R[:, 2, 2]
    energy = sum(run[w] ** 2 for w in OMEGA) / 2 + lean
    np.testing.assert_allclose(energy, energy[0], atol=1e-9)
    inside = np.stack([run[w] for w in OMEGA], axis=1)
    np.testing.assert_allclose(np.einsum("tij,tj->ti", R, inside)[:, 2], 0.5, atol=1e-9)
    np.testing.assert_allclose(run["omega_z"], 0.5, atol=1e-9)
    # u'^2 = 2 (1 - u^2) (E - g u) - (p_phi - p_psi u)^2, with E = 0.2^2/2 + 1 and both momenta 1/2.
    slope = R[:, 2, 0] * run["omega_y"] - R[:, 2, 1] * run["omega_x"]
    expected = 2 * (1 - lean**2) * (1.02 - lean) - 0.25 * (1 - lean) ** 2
    np.testing.assert_allclose(slope**2, expected, atol=1e-8)
    assert lean.min() < -0.5
    assert lean[300:].max() > 0.99


@pytest.mark.exhaustive
def test_the_raw_equations_and_the_frame_agree_and_keep_the_constraint() -> None:
    system = body()
    free = constrain(system, [], frame=dict(zip(OMEGA, turn.body)))
    begin = turn.about((1, 1, 0), 0.4)
    spin = {"omega_x": 0.4, "omega_y": -0.3, "omega_z": 0.9}
    values = {sp.Symbol(name): value for name, value in (begin | spin).items()}
    rates = {v.name: float(free.velocities[v].subs(values)) for v in turn.velocities}
    times = np.linspace(0, 3, 7)
    raw = integrate(system.euler_lagrange(), start=begin | rates, span=(0, 3), at=times, **TIGHT)
    framed = integrate(free.full_field, start=begin | spin, span=(0, 3), at=times, **TIGHT)
    for q in turn.coordinates:
        np.testing.assert_allclose(raw[q], framed[q], atol=1e-9)
    np.testing.assert_allclose(sum(raw[q] ** 2 for q in turn.coordinates), 1, atol=1e-9)
    assert system.energy_rate() == 0
    assert free.energy_rate() == 0
    assert free.is_holonomic
    assert free.growth_vector == (3,)


@pytest.mark.exhaustive
def test_a_chaplygin_ball_keeps_its_angular_momentum_about_the_contact_and_its_energy() -> None:
    limit = chaplygin_ball().limit
    assert limit.energy_rate() == 0
    assert not limit.is_holonomic
    start = {**turn.about((1, 0, 2), 0.8), "x": 0, "y": 0, "omega_x": 1.0, "omega_y": -0.6, "omega_z": 1.4}
    run = integrate(limit.full_field, start=start, span=(0, 10), at=np.linspace(0, 10, 41), **TIGHT)
    R = matrices(run)
    inside = np.stack([run[w] for w in OMEGA], axis=1)
    spin = np.einsum("tij,tj->ti", R, inside)
    # R I omega + m e3 x (omega x e3) in space, for the radius 1 and the mass 1 (Chaplygin 1903).
    about_contact = np.einsum("tij,tj->ti", R, inside * np.array([0.3, 0.4, 0.5])) + spin * np.array([1, 1, 0])
    np.testing.assert_allclose(about_contact, np.broadcast_to(about_contact[0], about_contact.shape), atol=1e-9)
    # It is no homogeneous ball: its spin changes.
    assert np.ptp(spin[:, 0]) > 0.1


@pytest.mark.exhaustive
def test_friction_tends_to_the_chaplygin_ball_that_rolls() -> None:
    ball = chaplygin_ball()
    assert sp.expand(ball.energy_rate() - ball.dissipation()) == 0
    start = {**turn.about((1, 0, 2), 0.8), "x": 0, "y": 0, "omega_x": 1.0, "omega_y": -0.6, "omega_z": 1.4}
    limit = integrate(ball.limit.full_field, start=start, span=(0, 2), **TIGHT)
    errors = []
    for value in (2e-3, 1e-3):
        begin = {**start, "w1": 0, "w2": 0}
        run = integrate(ball.full_field, start=begin, span=(0, 2), epsilon=value, **TIGHT)
        errors.append(np.array([run[s][-1] - limit[s][-1] for s in ("x", "y", "omega_x", "omega_z")]))
    np.testing.assert_allclose(errors[0] / errors[1], 2, atol=0.1)
    assert np.abs(errors[0]).max() > 1e-4


def test_a_holonomic_constraint_is_the_lagrangian_restricted_to_it() -> None:
    """Remark 2.4: the same pendulum by its constraint and by its angle, then two rods."""
    length, theta, thetadot = sp.symbols("l theta thetadot")
    L = m * (xdot**2 + ydot**2) / 2 - m * g * y
    values = {m: 2, length: 3, g: 5}
    held = LagrangianSystem(L, [x, y], [xdot, ydot], parameters=values, holonomic=[x**2 + y**2 - length**2])
    on_circle = {x: length * sp.sin(theta), y: -length * sp.cos(theta)}
    rates = {xdot: length * sp.cos(theta) * thetadot, ydot: length * sp.sin(theta) * thetadot}
    restricted = LagrangianSystem(L.subs({**on_circle, **rates}), [theta], [thetadot], parameters=values)
    bend = restricted.euler_lagrange().rates[1]
    field = held.euler_lagrange()
    expected = sp.diff(rates[xdot], theta) * thetadot + sp.diff(rates[xdot], thetadot) * bend
    assert sp.simplify(field.equations[xdot].subs({**on_circle, **rates}) - expected) == 0
    swing = constrain(held, [], frame={thetadot: (x * ydot - y * xdot) / length**2})
    assert sp.simplify(swing.reduced.equations[thetadot].subs(on_circle) - bend) == 0


def test_a_system_may_lack_kinetic_energy_across_its_constraints_but_not_along() -> None:
    kinetic = xdot**2 / 2
    with pytest.raises(DeclarationError, match="degenerate"):
        LagrangianSystem(kinetic, [x, y], [xdot, ydot])
    held = LagrangianSystem(kinetic, [x, y], [xdot, ydot], holonomic=[y - x**2])
    assert held.euler_lagrange().rates == (xdot, ydot, 0, 2 * xdot**2)
    with pytest.raises(DeclarationError, match="degenerate"):
        LagrangianSystem(kinetic, [x, y], [xdot, ydot], holonomic=[x - 1])
    with pytest.raises(DeclarationError, match="must not depend on one another"):
        LagrangianSystem(kinetic + ydot**2, [x, y], [xdot, ydot], holonomic=[x - y, 2 * x - 2 * y])


@pytest.mark.parametrize(
    ("holonomic", "words"),
    [
        (x - y, "sequence of expressions"),
        ([x * xdot], "not one on the coordinates alone"),
        ([m], "not one on the coordinates alone"),
        ([x - sp.Symbol("z")], "holonomic constraint 1 is x - z"),
    ],
)
def test_what_is_no_holonomic_constraint_is_refused(holonomic, words: str) -> None:
    with pytest.raises(DeclarationError, match=words):
        LagrangianSystem(m * (xdot**2 + ydot**2), [x, y], [xdot, ydot], parameters={m: 1}, holonomic=holonomic)


def test_a_start_off_the_holonomic_constraint_is_refused() -> None:
    ball = gsp.models.friction_system("rolling_ball")
    scene = {"region": {"omega_x": (-1, 1), "s1": (-1, 1), "s2": (-1, 1)}, "span": (0, 1), "epsilon": 0.1}
    spin = {"x": 0, "y": 0, "omega_x": 1, "omega_y": 0, "omega_z": 0, "s1": 0, "s2": 0}
    with pytest.raises(DeclarationError, match=r"violates the holonomic constraint .* it is -1 there"):
        ball.scene(start=spin, **scene)
    raw = {"x": 0, "y": 0, "q0": 1, "xdot": 0, "ydot": 0, **{f"q{i}dot": 0.5 for i in range(4)}}
    with pytest.raises(DeclarationError, match=r"violates the holonomic constraint .* it is 1 there"):
        ball.scene(start=raw, **scene)
    raw["q0dot"] = 0
    assert ball.scene(start=raw, **scene).start["omega_x"] == pytest.approx(1)


def test_constraints_that_say_what_a_holonomic_one_says_are_refused() -> None:
    held = LagrangianSystem(
        sum(r**2 for r in sp.symbols("adot bdot cdot")) / 2, sp.symbols("a b c"), sp.symbols("adot bdot cdot"),
        holonomic=[sp.Symbol("a") - sp.Symbol("b")],
    )  # fmt: skip
    with pytest.raises(DeclarationError, match="depend on the holonomic ones"):
        constrain(held, [sp.Symbol("adot") - sp.Symbol("bdot")])
    with pytest.raises(DeclarationError, match="leave no motion"):
        constrain(held, [sp.Symbol("adot"), sp.Symbol("cdot")])
