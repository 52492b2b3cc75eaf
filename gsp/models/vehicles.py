"""Vehicles with steered wheels whose tyres slip a little."""

from __future__ import annotations

from functools import cache

import sympy as sp

from gsp.mechanics import FrictionSystem, LagrangianSystem, with_friction
from gsp.models.plane import FORWARD, LECTURE, SIDEWAYS, epsilon, m, phi, phidot, x, xdot, y, ydot
from gsp.scenes.scene import Scene


@cache
def car_with_friction() -> FrictionSystem:
    """A car with two axles, driven by a force that swings in time, its steering by a spring.

    (x, y) is the middle of the rear axle, phi the heading, sigma the steering angle. The slips w1, w2 are the
    sideways velocities of the rear and of the front wheel.
    """
    sigma, sigmadot, t = sp.symbols("sigma sigmadot t")
    J, K, a, length, k, F, u = sp.symbols("J K a l k F u")
    kinetic = m * (xdot**2 + ydot**2 + 2 * a * phidot * SIDEWAYS) / 2 + J * phidot**2 / 2 + K * sigmadot**2 / 2
    system = LagrangianSystem(
        kinetic - k * sigma**2 / 2,
        [x, y, phi, sigma],
        [xdot, ydot, phidot, sigmadot],
        forces={x: F * sp.cos(t) * sp.cos(phi), y: F * sp.cos(t) * sp.sin(phi)},
        parameters={
            **{m: 1, J: sp.Rational(1, 2), a: sp.Rational(1, 2), length: 1},
            **{K: sp.Rational(1, 10), k: sp.Rational(2, 5), F: 1},
        },
        time=t,
        name="car",
    )
    front = SIDEWAYS * sp.cos(sigma) - FORWARD * sp.sin(sigma) + length * phidot * sp.cos(sigma)
    return with_friction(system, [SIDEWAYS, front], epsilon=epsilon, frame={u: FORWARD, sigmadot: sigmadot})


def car() -> Scene:
    """Parking: a car rocks to and fro and steers twice as fast, and so moves sideways.

    u' is driven by F cos(t) and the steering spring has k/K = 4, so that sigma = (b/2) sin(2 t). In the limit
    phi' = u tan(sigma)/l, and after a period 2 pi the car is back in x, phi, sigma and u exactly (all of them change
    sign, or nothing, under t -> t + pi), but has moved in y: along the bracket [drive, [drive, steer]], by
    pi A^2 b/(4 l) to leading order for u = A sin(t). With tyres that slip the manoeuvre closes up to
    O(epsilon). J is the inertia about the rear axle, the centre of mass lies a ahead of it.

    Source: the parking manoeuvre of J. Eldering, "Nonholonomic dynamics as limit of friction: an introduction
    by example" (2015), section 2; steering by sinusoids after R. M. Murray and S. S. Sastry, IEEE Transactions
    on Automatic Control 38 (1993) 700-716.
    """
    two_turns = 12.6
    return car_with_friction().scene(
        region={
            **{"sigma": (-0.6, 0.6), "sigmadot": (-1.2, 1.2), "u": (-1.5, 1.5), "t": (0, two_turns)},
            **{"w1": (-0.2, 0.2), "w2": (-0.2, 0.2)},
        },
        start={"u": 0, "sigma": 0, "sigmadot": 1, "w1": 0, "w2": 0, "t": 0, "x": 0, "y": 0, "phi": 0},
        span=(0, two_turns),
        epsilon=0.05,
        epsilons=(0.02, 0.01, 0.005, 0.0025),
        path=("x", "y"),
        source=f"{LECTURE}, section 2; R. M. Murray and S. S. Sastry (1993)",
        description=(
            "A car cannot move sideways, yet rocking to and fro while steering twice as fast parks it. With tyres "
            "that slip the manoeuvre closes up to O(epsilon) only."
        ),
    )
