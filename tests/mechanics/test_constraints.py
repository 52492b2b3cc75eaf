"""Lagrange-d'Alembert equations: section 3 of Eldering (2015), closed forms, and Frobenius."""

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gsp.errors import DeclarationError
from gsp.integration.trajectory import Method, integrate
from gsp.mechanics import ConstrainedSystem, LagrangianSystem, constrain

x, y, z, phi, theta = sp.symbols("x y z phi theta")
xdot, ydot, zdot, phidot, thetadot = sp.symbols("xdot ydot zdot phidot thetadot")
v, omega, w = sp.symbols("v omega w")
m, a, g = sp.symbols("m a g")
inertia = sp.Symbol("I")
sin, cos = sp.sin, sp.cos
TIGHT = {"rtol": 1e-13, "atol": 1e-14, "method": Method.DOP853}
SLIP = -xdot * sin(phi) + ydot * cos(phi)


def sleigh() -> LagrangianSystem:
    """(10)."""
    L = m * (xdot**2 + ydot**2) / 2 + (inertia + m * a**2) * phidot**2 / 2
    L += m * a * phidot * (-xdot * sin(phi) + ydot * cos(phi))
    return LagrangianSystem(
        L, [x, y, phi], [xdot, ydot, phidot], parameters={m: 1, inertia: 1, a: 0.2}, name="sleigh"
    )


def constrained_sleigh() -> ConstrainedSystem:
    return constrain(sleigh(), [SLIP], frame={v: xdot * cos(phi) + ydot * sin(phi), omega: phidot})


def free(coordinates: str, **forces) -> LagrangianSystem:
    """Unit masses on a line each, velocities named after their coordinates."""
    q = sp.symbols(coordinates)
    rates = [sp.Symbol(s.name + "dot") for s in q]
    return LagrangianSystem(sp.Add(*[u**2 / 2 for u in rates]), q, rates, **forces)


# -- the sleigh, section 3 -------------------------------------------------------------------------


def test_the_lagrange_equations_of_the_sleigh_are_11() -> None:
    ax, ay, aphi = sp.symbols("ax ay aphi")
    ours = sleigh().equations([ax, ay, aphi])
    printed = {
        x: m * ax + m * a * (-aphi * sin(phi) - phidot**2 * cos(phi)),
        y: m * ay + m * a * (aphi * cos(phi) - phidot**2 * sin(phi)),
        # d/dt of the bracket in (11), written out.
        phi: (inertia + m * a**2) * aphi
        + m * a * (-ax * sin(phi) + ay * cos(phi) - phidot * (xdot * cos(phi) + ydot * sin(phi)))
        + m * a * phidot * (xdot * cos(phi) + ydot * sin(phi)),
    }
    assert [sp.expand(ours[q] - printed[q]) for q in (x, y, phi)] == [0, 0, 0]


def test_the_reduced_equations_of_the_sleigh_are_12() -> None:
    system = constrained_sleigh()
    rates = system.reduced.equations
    assert list(rates) == [v, omega]
    assert sp.cancel(rates[v] - a * omega**2) == 0
    assert sp.cancel(rates[omega] + m * a * v * omega / (inertia + m * a**2)) == 0
    assert dict(system.reconstruction) == {x: v * cos(phi), y: v * sin(phi), phi: omega}


def test_the_multiplier_of_the_sleigh_is_13() -> None:
    system = constrained_sleigh()
    turning = system.reduced.equations[omega]
    assert sp.cancel(system.reduced_multipliers[0] - m * (v * omega + a * turning)) == 0
    (raw,) = system.multipliers
    back = dict(system.quasi_velocities)
    assert sp.expand(raw - system.reduced_multipliers[0].subs(back)) == 0
    forces = system.constraint_forces
    assert [sp.simplify(forces[q] - raw * e) for q, e in ((x, -sin(phi)), (y, cos(phi)), (phi, 0))] == [0, 0, 0]


def test_energy_is_conserved_and_constraint_forces_do_no_work() -> None:
    system = constrained_sleigh()
    assert system.energy_rate() == 0
    assert system.virtual_work() == (0, 0)
    assert sp.expand(system.energy() - m * v**2 / 2 - (inertia + m * a**2) * omega**2 / 2) == 0


def test_raw_and_reduced_equations_have_one_solution() -> None:
    system = constrained_sleigh()
    begin = {"x": 0.3, "y": -0.1, "phi": 0.4}
    raw_start = {**begin, "xdot": 0.9 * np.cos(0.4), "ydot": 0.9 * np.sin(0.4), "phidot": 1.1}
    raw = integrate(system.field, start=raw_start, span=(0, 4), at=[1, 2, 4], **TIGHT)
    reduced = integrate(
        system.full_field, start={"v": 0.9, "omega": 1.1, **begin}, span=(0, 4), at=[1, 2, 4], **TIGHT
    )
    for name in ("x", "y", "phi"):
        np.testing.assert_allclose(raw[name], reduced[name], rtol=0, atol=1e-11)
    assert np.abs(system.constraint_residual(raw)).max() < 1e-12
    off = integrate(system.field, start={**raw_start, "xdot": 2.0}, span=(0, 1), at=[1], **TIGHT)
    # Off the distribution the slip stays what it was: the multiplier keeps it constant.
    slip = -2.0 * np.sin(0.4) + 0.9 * np.sin(0.4) * np.cos(0.4)
    assert system.constraint_residual(off)[0, -1] == pytest.approx(slip, abs=1e-11)


# -- closed forms ----------------------------------------------------------------------------------


def rolling_disc() -> ConstrainedSystem:
    """Example 2.2."""
    R, J, K = sp.symbols("R J K")
    L = m * (xdot**2 + ydot**2) / 2 + J * phidot**2 / 2 + K * thetadot**2 / 2
    system = LagrangianSystem(
        L, [x, y, phi, theta], [xdot, ydot, phidot, thetadot], parameters={m: 1, J: 0.25, K: 0.5, R: 0.7}
    )
    return constrain(system, [xdot - R * cos(phi) * thetadot, ydot - R * sin(phi) * thetadot])


def test_a_holonomic_constraint_gives_lagranges_equations_on_the_circle() -> None:
    L = m * (xdot**2 + ydot**2) / 2 - m * g * y
    system = LagrangianSystem(L, [x, y], [xdot, ydot], parameters={m: 1, g: 9.81})
    pendulum = constrain(system, [x * xdot + y * ydot])
    assert pendulum.is_holonomic
    assert pendulum.growth_vector == (1,)
    run = integrate(
        pendulum.field, start={"x": 0.6, "y": -0.8, "xdot": 0, "ydot": 0}, span=(0, 2), at=[1, 2], **TIGHT
    )
    np.testing.assert_allclose(np.hypot(run["x"], run["y"]), 1, atol=1e-11)
    angle = LagrangianSystem(m * phidot**2 / 2 - m * g * sin(phi), [phi], [phidot], parameters={m: 1, g: 9.81})
    begin = {"phi": np.arctan2(-0.8, 0.6), "phidot": 0}
    other = integrate(angle.euler_lagrange(), start=begin, span=(0, 2), at=[1, 2], **TIGHT)
    np.testing.assert_allclose(np.cos(other["phi"]), run["x"], atol=1e-9)


# -- integrability ---------------------------------------------------------------------------------


def test_growth_vectors_are_those_of_the_literature() -> None:
    assert constrain(free("x y z"), [zdot - y * xdot]).growth_vector == (2, 3)
    assert constrained_sleigh().growth_vector == (2, 3)
    assert rolling_disc().growth_vector == (2, 3, 4)
    assert constrain(free("x y z"), [zdot - xdot]).growth_vector == (2,)


def test_each_constraint_says_whether_it_is_integrable() -> None:
    system = free("x y z s")
    s, sdot = sp.symbols("s sdot")
    mixed = constrain(system, [zdot - y * xdot, sdot * s + x * xdot + y * ydot])
    assert mixed.integrable == (False, True)
    assert not mixed.is_holonomic
    assert mixed.growth_vector == (2, 3)
    together = constrain(system, [zdot - y * xdot - x * ydot, sdot - zdot])
    assert together.is_holonomic


def test_a_multiple_of_an_exact_form_is_integrable() -> None:
    # exp(x) (dz - y dx - x dy): not closed, yet Frobenius finds z = x y + const.
    form = sp.exp(x) * (zdot - y * xdot - x * ydot)
    assert constrain(free("x y z"), [form]).is_holonomic


def test_an_affine_constraint_is_judged_on_space_time() -> None:
    system = free("x y z")
    assert constrain(system, [zdot - 2]).is_holonomic
    # z' = x: the condition on the velocities is linear in position, and no condition on positions at all.
    moving = constrain(system, [zdot - x])
    assert not moving.is_holonomic
    # Off the distribution too z' - x stays what it was.
    assert moving.field.equations[zdot] == xdot


# -- frames ----------------------------------------------------------------------------------------


def test_without_a_frame_free_velocities_keep_their_names() -> None:
    built = constrain(sleigh(), [SLIP])
    u1 = sp.Symbol("u1")
    assert built.reduced.states == (u1, phidot)
    assert built.quasi_velocities[u1] == xdot * cos(phi) + ydot * sin(phi)
    named_ = constrained_sleigh().reduced.equations
    same = {sp.Symbol("u1"): v, phidot: omega}
    assert [e.subs(same) for e in built.reduced.rates] == list(named_.values())


@pytest.mark.parametrize("curved", [False, True])
def test_a_frame_is_found_where_a_form_is_not_real_everywhere(curved: bool) -> None:
    """As sqrt(1/4 - x^2) is, at some of the generic points."""
    height = sp.Rational(1, 4) - x**2
    L = (xdot**2 + ydot**2 + phidot**2 + (x * xdot) ** 2 / height * int(curved)) / 2
    system = LagrangianSystem(L, [x, y, phi], [xdot, ydot, phidot])
    found = constrain(system, [ydot * sp.cos(phi) - xdot * sp.sin(phi) * sp.sqrt(height)])
    slope = found.velocities[ydot] / found.velocities[xdot]
    assert float(slope.subs({x: 0.3, phi: 0.4})) == pytest.approx(0.4 * np.tan(0.4), rel=1e-12)


def test_three_velocities_under_one_turning_constraint_get_a_frame() -> None:
    system = free("x y z phi")
    built = constrain(system, [xdot * cos(phi) + ydot * sin(phi) + zdot * sin(phi)])
    A = built.matrix
    moved = sp.Matrix([built.velocities[r] for r in (xdot, ydot, zdot, sp.Symbol("phidot"))])
    assert sp.simplify((A * moved)[0]) == 0
    assert built.energy_rate() == 0
    assert len(built.frame.along) == 3


entry = st.integers(-3, 3)


@pytest.mark.exhaustive
@settings(max_examples=5)
@given(st.lists(entry, min_size=16, max_size=16), st.lists(entry, min_size=8, max_size=8), st.integers(1, 2))
def test_constant_constraints_obey_dalembert(numbers: list[int], forms: list[int], k: int) -> None:
    J = sp.Matrix(4, 4, numbers)
    M = J.T * J + sp.eye(4)
    A = sp.Matrix(k, 4, forms[: 4 * k])
    assume(A.rank() == k)
    q, rates = sp.symbols("q1:5"), sp.symbols("r1:5")
    R = sp.Matrix(list(rates))
    L = (R.T * M * R)[0] / 2 - q[0] ** 2 + q[1] * q[2]
    system = constrain(LagrangianSystem(L, q, rates), list(A * R))
    accelerations = sp.Matrix([system.field.equations[s] for s in rates])
    force = M * accelerations - sp.Matrix([sp.diff(L, s) for s in q])
    assert (A * accelerations).applyfunc(sp.expand) == sp.zeros(k, 1)
    assert sp.Matrix.hstack(A.T, force).rank() == k
    assert (force - A.T * sp.Matrix(system.multipliers)).applyfunc(sp.expand) == sp.zeros(4, 1)
    assert system.energy_rate() == 0
    assert system.is_holonomic


# -- refusals --------------------------------------------------------------------------------------

t = sp.Symbol("t")
timed = LagrangianSystem((xdot**2 + ydot**2) / 2 + x * sin(t), [x, y], [xdot, ydot], time=t)
REFUSED = {
    "nonlinear": ([xdot**2 + ydot**2 - 1], r"xdot\*\*2.*not linear"),
    "product": ([xdot * ydot], "not linear.*derivative by xdot is ydot"),
    "a position": ([x - y], "contains no velocity"),
    "redundant": ([SLIP, phidot, 2 * SLIP - phidot], r"constraint 3, .*\(2\)\*\(constraint 1\) \+ \(-1\)\*"),
    "redundant by an identity": ([SLIP * cos(phi), SLIP * sin(phi)], "constraint 2.*depends on the others"),
    "inconsistent": ([phidot, 2 * phidot - 1], r"inconsistent.*\(2\)\*\(constraint 1\) \+ -1"),
    "redundant and affine": ([phidot - 1, 2 * phidot - 2], "depends on the others"),
    "too many": ([xdot, ydot, phidot], "leave no motion"),
    "none": ([], "no constraint"),
    "unknown symbol": ([xdot - sp.Symbol("c") * ydot], "constraint 1 is .*c has no value"),
}


@pytest.mark.parametrize("case", list(REFUSED))
def test_what_is_no_set_of_velocity_constraints_is_refused_by_name(case: str) -> None:
    constraints, words = REFUSED[case]
    with pytest.raises(DeclarationError, match=words):
        constrain(sleigh(), constraints)


def test_constraints_that_depend_on_time_are_refused() -> None:
    with pytest.raises(DeclarationError, match="depends on time t"):
        constrain(timed, [xdot - t * ydot])


FRAMES = {
    "too few": ({v: xdot * cos(phi) + ydot * sin(phi)}, "need 2"),
    "dependent": (
        {v: xdot * cos(phi) + ydot * sin(phi), omega: xdot * cos(phi) + ydot * sin(phi) + SLIP},
        "depend",
    ),
    "offset": ({v: xdot + 1, omega: phidot}, "not linear in the velocities: it contains 1"),
    "name of a parameter": ({m: xdot, omega: phidot}, "name that is taken"),
    "name of another velocity": ({ydot: xdot, omega: phidot}, "name of a velocity"),
    "no mapping": ([v, omega], "frame maps symbols"),
}


@pytest.mark.parametrize("case", list(FRAMES))
def test_what_is_no_frame_is_refused_by_name(case: str) -> None:
    frame, words = FRAMES[case]
    with pytest.raises(DeclarationError, match=words):
        constrain(sleigh(), [SLIP], frame=frame)


def test_a_field_is_no_lagrangian_system() -> None:
    with pytest.raises(DeclarationError, match="takes a LagrangianSystem"):
        constrain(sleigh().euler_lagrange(), [SLIP])  # pyright: ignore[reportArgumentType]
