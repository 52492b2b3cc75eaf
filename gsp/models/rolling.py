"""Discs and balls that roll: no slip at the point of contact as the limit of strong friction."""

from __future__ import annotations

from functools import cache

import sympy as sp

from gsp.mechanics import FrictionSystem, LagrangianSystem, rotation, with_friction
from gsp.models.plane import FORWARD, LECTURE, SIDEWAYS, epsilon, m, phi, phidot, x, xdot, y, ydot
from gsp.scenes.scene import Scene

theta, psi = sp.symbols("theta psi")
thetadot, psidot = sp.symbols("thetadot psidot")
R, g = sp.symbols("R g")


@cache
def rolling_disc_with_friction() -> FrictionSystem:
    """An upright disc: slips w1 along and w2 across its heading phi, theta its rotation about its axle."""
    J, K = sp.symbols("J K")
    system = LagrangianSystem(
        m * (xdot**2 + ydot**2) / 2 + J * phidot**2 / 2 + K * thetadot**2 / 2,
        [x, y, phi, theta],
        [xdot, ydot, phidot, thetadot],
        parameters={m: 1, J: sp.Rational(1, 4), K: sp.Rational(1, 2), R: 1},
        name="rolling_disc",
    )
    return with_friction(
        system,
        [FORWARD - R * thetadot, SIDEWAYS],
        epsilon=epsilon,
        frame={phidot: phidot, thetadot: thetadot},
    )


def rolling_disc() -> Scene:
    """A vertical disc that rolls on the plane, and slips a little across and along its heading.

    Without slip it keeps its rates, and its point of contact moves on a circle of radius R theta'/phi'. With
    friction the centripetal force takes a sideways slip w2 = -epsilon m R theta' phi', which costs energy: the
    rate of rolling falls like exp(-epsilon m^2 R^2 phi'^2 t/(K + m R^2)) to first order, and the circle becomes a
    spiral. By its mirror symmetries the rates have odd powers of epsilon only: order 1 is as good as order 2.

    Source: J. Eldering, "Nonholonomic dynamics as limit of friction: an introduction by example" (2015),
    Example 2.2 (there with R = 1).
    """
    return rolling_disc_with_friction().scene(
        region={"phidot": (-2, 2), "thetadot": (-3, 3), "w1": (-1, 1), "w2": (-1, 1)},
        start={"phidot": 1, "thetadot": 2, "w1": 0, "w2": 0, "x": 0, "y": -2, "phi": 0},
        span=(0, 12),
        epsilon=0.02,
        epsilons=(0.02, 0.01, 0.005, 0.0025),
        path=("x", "y"),
        source=f"{LECTURE}, Example 2.2",
        description=(
            "A vertical disc rolls on a circle for ever. With friction in place of the constraint it slips "
            "outwards, loses energy, and spirals."
        ),
    )


def _ball(turn: sp.Symbol | None, name: str) -> FrictionSystem:
    """A homogeneous ball on a plane at rest, or on a table that turns at the rate `turn`."""
    turned = rotation("q")
    J, *names = sp.symbols("J omega_x omega_y omega_z")
    spin = turned.space
    kinetic = m * (xdot**2 + ydot**2) / 2 + J * sum(w**2 for w in spin) / 2
    parameters = {m: sp.Integer(1), J: sp.Rational(2, 5), R: sp.Integer(1)}
    slips = [xdot - R * spin[1], ydot + R * spin[0]]
    if turn is not None:
        parameters[turn] = sp.Integer(3)
        slips = [slips[0] + turn * y, slips[1] - turn * x]
    system = LagrangianSystem(
        kinetic, [x, y, *turned.coordinates], [xdot, ydot, *turned.velocities],
        parameters=parameters, holonomic=[turned.holonomic], name=name,
    )  # fmt: skip
    return with_friction(
        system, dict(zip(sp.symbols("s1 s2"), slips)), epsilon=epsilon, frame=dict(zip(names, spin))
    )


@cache
def rolling_ball_with_friction() -> FrictionSystem:
    """A ball on a plane over quaternions, with its angular velocity in space for its frame."""
    return _ball(None, "rolling_ball")


def rolling_ball() -> Scene:
    """A ball thrown onto a plane with slip: it rolls off in a straight line, and the reduction is exact.

    Its slip s decays like exp(-(1/m + R^2/J) t/epsilon) and nothing else happens: s = 0 is the slow manifold for
    every epsilon, all corrections vanish, and the velocity that remains is v0 - s0/(1 + m R^2/J), 5/7 v0 for a
    homogeneous ball that does not turn at first.

    Source: J. Eldering, "Nonholonomic dynamics as limit of friction: an introduction by example" (2015),
    Example 2.1; J.-A. Euler (1758) for the ball that slides before it rolls.
    """
    return rolling_ball_with_friction().scene(
        region={
            **{"omega_x": (-4, 4), "omega_y": (-4, 4), "omega_z": (-2, 2), "s1": (-4, 4), "s2": (-4, 4)},
        },
        # Thrown with the velocity (1, 0) and so much spin that (0.2, -0.9) remains.
        start={
            **{"omega_x": 3.15, "omega_y": -1.8, "omega_z": 0.5, "s1": 2.8, "s2": 3.15},
            **{"x": 0, "y": 0, "q0": 1},
        },
        span=(0, 1.5),
        epsilon=0.3,
        epsilons=(0.08, 0.04, 0.02, 0.01),
        path=("x", "y"),
        source=f"{LECTURE}, Example 2.1",
        description=(
            "A ball that is thrown with a spin of its own slips on a curve, then rolls straight. The limit of "
            "friction is exact here: the slow manifold is free of slip at every epsilon."
        ),
    )


@cache
def ball_on_turntable_with_friction() -> FrictionSystem:
    """A ball on a table that turns at the rate Omega: constraints with an offset, and friction that drives."""
    return _ball(sp.Symbol("Omega"), "ball_on_turntable")


def ball_on_turntable() -> Scene:
    """A homogeneous ball on a turntable: circles in space at 2/7 of the table's rate; slip makes them spirals.

    Without slip the ball's centre moves on a circle at the rate Omega J/(J + m R^2), whatever its start. The
    constraints are affine, and the table does work on the ball: with friction in place of the constraint the
    circle grows.

    Source: S. Earnshaw, "Dynamics" (1844); J. A. Burns, "Ball rolling on a turntable: analog for charged particle
    dynamics", American Journal of Physics 49 (1981) 56-58.
    """
    return ball_on_turntable_with_friction().scene(
        region={
            **{"x": (-2, 2), "y": (-2, 2), "omega_x": (-4, 4), "omega_y": (-4, 4), "omega_z": (-1, 1)},
            **{"s1": (-1, 1), "s2": (-1, 1)},
        },
        start={
            **{"x": 1, "y": 0, "omega_x": 2, "omega_y": 0, "omega_z": 0.5, "s1": 0, "s2": 0},
            **{"q0": 1},
        },
        span=(0, 8),
        epsilon=0.05,
        epsilons=(0.04, 0.02, 0.01, 0.005),
        path=("x", "y"),
        source="S. Earnshaw, Dynamics (1844); J. A. Burns, American Journal of Physics 49 (1981) 56-58",
        description=(
            "A ball on a turntable moves on a circle at 2/7 of the table's rate. With friction in place of the "
            "constraint the circle becomes a spiral."
        ),
    )


@cache
def falling_disc_with_friction() -> FrictionSystem:
    """A disc that rolls, turns and leans: (x, y) its point of contact, phi its heading, theta its lean."""
    A, C = sp.symbols("A C")
    q, rates = (x, y, phi, theta, psi), (xdot, ydot, phidot, thetadot, psidot)
    centre = sp.Matrix(
        [x + R * sp.sin(theta) * sp.sin(phi), y - R * sp.sin(theta) * sp.cos(phi), R * sp.cos(theta)]
    )
    velocity = centre.jacobian(q) * sp.Matrix(rates)
    turning = (
        A * (thetadot**2 + phidot**2 * sp.cos(theta) ** 2) + C * (psidot + phidot * sp.sin(theta)) ** 2
    ) / 2
    system = LagrangianSystem(
        m * velocity.dot(velocity) / 2 + turning - m * g * centre[2],
        q,
        rates,
        parameters={m: 1, A: sp.Rational(1, 4), C: sp.Rational(1, 2), R: 1, g: sp.Rational(981, 100)},
        name="falling_disc",
    )
    return with_friction(
        system,
        [FORWARD - R * psidot, SIDEWAYS],
        epsilon=epsilon,
        frame={phidot: phidot, thetadot: thetadot, psidot: psidot},
    )


def falling_disc() -> Scene:
    """A coin that rolls, leans and turns into its lean, with slip at its point of contact.

    theta is the lean from the vertical, psi the rotation about the axle. In the limit upright rolling is stable when
    psi'^2 > A m g R/(C (C + m R^2)), that is v^2 > g R/3 for a homogeneous disc; faster than that, the coin weaves
    along its path. Slow are the lean, the turning and two momenta, one with a coefficient that depends on the lean.

    Source: P. Appell, "Traité de mécanique rationnelle" II (1896); A. M. Bloch, "Nonholonomic Mechanics and
    Control", Springer (2003), section 1.4.
    """
    return falling_disc_with_friction().scene(
        region={
            **{"theta": (-0.8, 0.8), "phidot": (-4, 4), "thetadot": (-4, 4), "psidot": (1, 6)},
            **{"w1": (-1, 1), "w2": (-1, 1)},
        },
        start={
            **{"theta": 0.3, "phidot": 0.5, "thetadot": 0, "psidot": 3.5, "w1": 0, "w2": 0},
            **{"x": 0, "y": 0, "phi": 0, "psi": 0},
        },
        span=(0, 4),
        epsilon=0.01,
        epsilons=(0.008, 0.004, 0.002, 0.001),
        tolerance=1e-4,
        path=("x", "y"),
        source="P. Appell, Traité de mécanique rationnelle II (1896); A. M. Bloch (2003), section 1.4",
        description=(
            "A coin rolls, leans, and turns into its lean: it weaves along its path. With friction in place "
            "of the constraint it slips outwards in each bend and loses energy."
        ),
    )
