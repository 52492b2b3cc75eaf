"""Mechanical systems without constraint, friction or small parameter: where Lagrange's equations start."""

from __future__ import annotations

import sympy as sp

from gsp.mechanics import LagrangianSystem


def falling_particle() -> LagrangianSystem:
    """A particle in the Earth's gravity, L = m |v|^2/2 - m g z: it falls on a parabola.

    z is measured upwards, so z'' = -g and z = z0 + z0' t - g t^2/2, while x and y keep their velocities.

    Source: J. Eldering, "Nonholonomic dynamics as limit of friction: an introduction by example" (2015),
    Example 1.1, where V = -m g x3 should read V = m g x3 for the equations that follow it.
    """
    x, y, z, xdot, ydot, zdot, m, g = sp.symbols("x y z xdot ydot zdot m g")
    return LagrangianSystem(
        m * (xdot**2 + ydot**2 + zdot**2) / 2 - m * g * z,
        [x, y, z],
        [xdot, ydot, zdot],
        parameters={m: sp.Integer(1), g: sp.Rational(981, 100)},
        name="falling_particle",
    )


def rotating_frame() -> LagrangianSystem:
    """A free particle seen from a frame that turns at the rate Omega; L depends on time only before cancelling.

    The Lagrangian is the free one with the place R(t) (x, y) put in. Its equations are w' = -2 Omega w +
    Omega^2 (x, y) with Omega the generator of rotation: Coriolis and centrifugal force. In the frame at rest
    the particle moves on a straight line, R(t) (x, y) = place + velocity t.

    Source: J. Eldering, "Nonholonomic dynamics as limit of friction: an introduction by example" (2015),
    Exercise 1.2.
    """
    x, y, xdot, ydot, m, turn, t = sp.symbols("x y xdot ydot m Omega t")
    cos, sin = sp.cos(turn * t), sp.sin(turn * t)
    rotation = sp.Matrix([[cos, -sin], [sin, cos]])
    velocity = rotation.diff(t) * sp.Matrix([x, y]) + rotation * sp.Matrix([xdot, ydot])
    return LagrangianSystem(
        m * velocity.dot(velocity) / 2,
        [x, y],
        [xdot, ydot],
        parameters={m: sp.Integer(1), turn: sp.Rational(7, 10)},
        time=t,
        name="rotating_frame",
    )
