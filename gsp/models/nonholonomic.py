"""Mechanical systems with velocity constraints, as limits of friction."""

from __future__ import annotations

import sympy as sp

from gsp.models.plane import LECTURE
from gsp.scenes.scene import Scene
from gsp.systems.system import VectorField


def chaplygin_sleigh() -> Scene:
    """A body on a skate with viscous friction w/epsilon against sideways slip, in its raw variables.

    v and w are the velocities of the skate along and across its blade, omega the rate of turning: v' = omega w
    + a omega^2, omega' = a w/(I epsilon), w' = -v omega - rho w, rho = (I + m a^2)/(I m epsilon), with mass m,
    moment of inertia I about the centre of mass, which lies a ahead of the skate. The skate's angle phi and
    place (x, y) are driven by these velocities.

    Source: J. Eldering, "Nonholonomic dynamics as limit of friction: an introduction by example" (2015),
    sections 3 and 4, between equations (15) and (17). Its equation (18), as printed, has the wrong sign in v':
    substituting w = -v omega/rho gives v' = a omega^2 - epsilon I m v omega^2/(I + m a^2).
    """
    v, omega, w, m, inertia, a, epsilon = sp.symbols("v omega w m I a epsilon")
    phi, x, y = sp.symbols("phi x y")
    rho = (inertia + m * a**2) / (inertia * m * epsilon)
    field = VectorField(
        {v: omega * w + a * omega**2, omega: a * w / (inertia * epsilon), w: -v * omega - rho * w},
        epsilon=epsilon,
        parameters={m: sp.Integer(1), inertia: sp.Integer(1), a: sp.Rational(1, 5)},
        name="chaplygin_sleigh",
    )
    # Equation (18) with d(v omega)/dt written out to leading order, which is all that O(epsilon) asks for.
    J = inertia + m * a**2
    friction = epsilon * inertia * m * v * omega**2 / J
    turning = -m * a * v * omega / J + epsilon * inertia * m**2 * a / J**2 * (
        a * omega**3 - m * a * v**2 * omega / J
    )
    printed = {v: a * omega**2 + friction, omega: turning}
    corrected = {v: a * omega**2 - friction, omega: turning}
    return Scene(
        field,
        region={"v": (-2, 2), "omega": (-2, 2), "w": (-1, 1)},
        # From backwards, which is unstable, through a turn to forwards: the path of the source's Figure 5.
        start={"v": -1.5, "omega": 1, "w": 0, "phi": 2},
        span=(0, 12),
        epsilon=0.05,
        epsilons=(0.02, 0.01, 0.005, 0.0025),
        source=f"{LECTURE}, sections 3-4",
        description=(
            "A sleigh on one skate slides on the plane. Friction against sideways slip grows as 1/epsilon; "
            "in the limit the skate cannot slip at all and the sleigh obeys the Lagrange-d'Alembert equations. "
            "Equation (18) of the source, as printed, has the wrong sign in v̇."
        ),
        reconstruction={
            phi: omega,
            x: v * sp.cos(phi) - w * sp.sin(phi),
            y: v * sp.sin(phi) + w * sp.cos(phi),
        },
        path=("x", "y"),
        claims={"(18) as printed": printed, "(18) with its sign corrected": corrected},
    )
