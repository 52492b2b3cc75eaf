"""Bodies on blades that slide: constraints on velocities replaced by strong friction against sideways slip."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import sympy as sp

from gsp.mechanics import FrictionSystem, LagrangianSystem, with_friction
from gsp.models.plane import FORWARD, LECTURE, SIDEWAYS, epsilon, m, phi, phidot, x, xdot, y, ydot
from gsp.scenes.scene import Scene
from gsp.scenes.switched import in_fast_variables

z, zdot = sp.symbols("z zdot")
v, omega = sp.symbols("v omega")


@cache
def sleigh_from_lagrangian_with_friction() -> FrictionSystem:
    """The sleigh's Lagrangian (10) with friction against w = -x' sin(phi) + y' cos(phi); v, omega, w its frame."""
    inertia, a = sp.symbols("I a")
    lagrangian = m * (xdot**2 + ydot**2) / 2 + (inertia + m * a**2) * phidot**2 / 2 + m * a * phidot * SIDEWAYS
    system = LagrangianSystem(
        lagrangian,
        [x, y, phi],
        [xdot, ydot, phidot],
        parameters={m: sp.Integer(1), inertia: sp.Integer(1), a: sp.Rational(1, 5)},
        name="sleigh_from_lagrangian",
    )
    return with_friction(system, [SIDEWAYS], epsilon=epsilon, frame={v: FORWARD, omega: phidot})


def sleigh_from_lagrangian() -> Scene:
    """The Chaplygin sleigh derived from its Lagrangian alone: equations, slow momentum, path, no algebra by hand.

    L = m |x'|^2/2 + (I + m a^2) phi'^2/2 + m a phi' (-x' sin(phi) + y' cos(phi)), friction -w/epsilon against the
    slip w of the skate. In the limit v' = a omega^2, omega' = -m a v omega/(I + m a^2): ellipses
    v^2 + (I + m a^2) omega^2/m = const, run through from v < 0 to v > 0 as
    v = c tanh(m a c t/(I + m a^2)), started here from rest in v and a turn.

    Source: J. Eldering, "Nonholonomic dynamics as limit of friction: an introduction by example" (2015),
    equations (10) to (18). `chaplygin_sleigh` is the same field typed in.
    """
    return sleigh_from_lagrangian_with_friction().scene(
        region={"v": (-1, 2.5), "omega": (-0.5, 2.5), "w": (-1, 1)},
        start={"xdot": 0, "ydot": 0, "phidot": 2, "x": 0, "y": 0, "phi": 0},
        span=(0, 10),
        epsilon=0.05,
        epsilons=(0.02, 0.01, 0.005, 0.0025),
        path=("x", "y"),
        source=f"{LECTURE}, equations (10)-(18)",
        description=(
            "A sleigh that spins on the spot is derived from its Lagrangian. The skate turns the spin into "
            "motion ahead; with friction in place of the constraint it slips outwards and loses energy."
        ),
    )


def sled() -> Scene:
    """The sleigh of mass and moment 1 on a blade that bears mu N, N = 9: it sticks while |v omega| < mu N (1 + a^2).

    The constrained sleigh keeps v^2 + (1 + a^2) omega^2 = c^2, and asks for most where both terms are c^2/2. So the
    blade never lets go while c^2 < 2 mu N (1 + a^2)^(3/2), 1.909 here: pushed backwards at 1.2 it turns round and
    glides away; at 1.5 it lets go after 2.9785635. `share` is what is asked of what it bears.

    Source: J. Eldering, "Nonholonomic dynamics as limit of friction: an introduction by example" (2015), section 4,
    with dry friction, smoothed by tanh, in place of viscous friction.
    """
    a, mu, share = sp.symbols("a mu share")
    body = LagrangianSystem(
        (xdot**2 + ydot**2) / 2 + (1 + a**2) * phidot**2 / 2 + a * phidot * SIDEWAYS,
        [x, y, phi],
        [xdot, ydot, phidot],
        parameters={a: sp.Rational(1, 5), mu: sp.Rational(1, 10)},
        name="sled",
    )
    friction = with_friction(
        body, [SIDEWAYS], epsilon=epsilon, frame={v: FORWARD, omega: phidot}, law="tanh", mu=mu, normal=9
    )
    # In the variables in which the slip is fast, so that its bounds are those of v1 = w/epsilon.
    scene, _ = in_fast_variables(
        friction.scene(
            region={"v": (-1.25, -1.0), "omega": (0.25, 0.6)},
            start={"v": -1.2, "omega": 0.3, "w": 0, "x": 0, "y": 0, "phi": 0.1},
            span=(0, 3),
            epsilon=0.01,
            epsilons=(0.004, 0.002, 0.001, 0.0005),
            tolerance=1e-4,
            path=("x", "y"),
            source=f"{LECTURE}, section 4, with dry friction",
            description=(
                "A sled rests on one blade, which friction holds against sideways slip as long as it is asked for less "
                "than it bears. Pushed backwards it turns round; pushed too hard, its blade lets go in the turn."
            ),
            observables={share: sp.Abs(v * omega) / (9 * mu * (1 + a**2))},
        )
    )
    return replace(scene, region={**scene.region, "v1": (-0.5, 2)})


@cache
def knife_edge_with_friction() -> FrictionSystem:
    """A blade on a slope, y pointing uphill: L = m |x'|^2/2 + J phi'^2/2 - m g sin(alpha) y."""
    J, g, alpha = sp.symbols("J g alpha")
    system = LagrangianSystem(
        m * (xdot**2 + ydot**2) / 2 + J * phidot**2 / 2 - m * g * sp.sin(alpha) * y,
        [x, y, phi],
        [xdot, ydot, phidot],
        parameters={m: 1, J: sp.Rational(1, 2), g: sp.Rational(981, 100), alpha: sp.Rational(1, 5)},
        name="knife_edge",
    )
    return with_friction(system, [SIDEWAYS], epsilon=epsilon, frame={v: FORWARD, omega: phidot})


def knife_edge() -> Scene:
    """A knife edge on an inclined plane: it does not slide down, unless it slips.

    With G = g sin(alpha), the blade turns at a constant rate omega. Released at rest pointing downhill it moves on
    the cycloid x = G (omega t - sin(2 omega t)/2)/(2 omega^2), y = -G sin(omega t)^2/(2 omega^2): across the slope,
    between two heights. A start at speed v0 adds (v0/omega) (1 - cos(omega t), -sin(omega t)). Friction in place of
    the constraint lets it creep downhill at the mean rate 2 epsilon m G to first order, whatever omega.

    Source: Ju. I. Neimark and N. A. Fufaev, "Dynamics of Nonholonomic Systems", AMS (1972); A. M. Bloch,
    "Nonholonomic Mechanics and Control", Springer (2003), section 1.6.
    """
    return knife_edge_with_friction().scene(
        region={"phi": (-2, 9), "v": (-3.5, 3.5), "omega": (0.5, 1.5), "w": (-0.6, 0.6)},
        start={"phi": -1.5707963267948966, "v": 0.4, "omega": 1, "w": 0, "x": 0, "y": 0},
        span=(0, 10),
        epsilon=0.02,
        epsilons=(0.01, 0.005, 0.0025, 0.00125),
        path=("x", "y"),
        source="A. M. Bloch, Nonholonomic Mechanics and Control (2003), section 1.6; Neimark and Fufaev (1972)",
        description=(
            "A blade that turns at a constant rate on a slope runs across it between two heights and never gets "
            "down; y points uphill. With friction in place of the constraint it creeps downhill."
        ),
    )


@cache
def nonholonomic_particle_with_friction() -> FrictionSystem:
    """A free particle in space with friction against the slip z' - y x'."""
    system = LagrangianSystem(
        (xdot**2 + ydot**2 + zdot**2) / 2, [x, y, z], [xdot, ydot, zdot], name="nonholonomic_particle"
    )
    return with_friction(system, [zdot - y * xdot], epsilon=epsilon, frame={xdot: xdot, ydot: ydot})


def nonholonomic_particle() -> Scene:
    """The particle with z' = y x', the smallest nonholonomic system, as a limit of friction.

    Of mass 1 and otherwise free. In the limit y' = b is constant and x' sqrt(1 + y^2) = c is too, so that
    x = (c/b) asinh(y) and z = (c/b) sqrt(1 + y^2) up to constants: seen along y it moves on the catenary
    z = (c/b) cosh(b x/c). The slow momentum is p = x' + y z', whose coefficients depend on the place: the scene is
    about the standard form.

    Source: R. M. Rosenberg, "Analytical Dynamics of Discrete Systems", Plenum (1977); L. Bates and
    J. Śniatycki, "Nonholonomic reduction", Reports on Mathematical Physics 32 (1993) 99-115.
    """
    return nonholonomic_particle_with_friction().scene(
        region={"y": (-2.5, 2.5), "xdot": (0.3, 1.5), "ydot": (0.5, 1.5), "w": (-1, 1)},
        start={"x": -1.45, "y": -2, "z": 2.24, "xdot": 0.45, "ydot": 1, "zdot": -0.9},
        span=(0, 4),
        epsilon=0.05,
        epsilons=(0.04, 0.02, 0.01, 0.005),
        path=("x", "z"),
        source="R. M. Rosenberg, Analytical Dynamics (1977); L. Bates and J. Śniatycki (1993)",
        description=(
            "A particle that may move only with ż = y ẋ runs on a catenary; friction against the slip ż - y ẋ in "
            "place of the constraint lets it fall behind."
        ),
    )
