"""Excitable cells."""

from __future__ import annotations

import sympy as sp

from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem


def fitzhugh_nagumo() -> Scene:
    """epsilon v' = v - v^3/3 - w + I, w' = v + a - b w: a neuron at rest current recovers after a spike.

    v is the membrane voltage, w the recovery variable, I the current. Often written in fast time, with epsilon
    in front of w'; here time is slow. The left sheet v < -1 attracts; with I = 0 it carries the rest state
    (-1.199, -0.624), which the trajectory approaches without meeting the fold at v = -1.

    Source: R. FitzHugh, "Impulses and physiological states in theoretical models of nerve membrane",
    Biophysical Journal 1 (1961) 445-466; J. Nagumo, S. Arimoto and S. Yoshizawa, Proceedings of the IRE 50
    (1962) 2061-2070.
    """
    v, w, a, b, current, epsilon = sp.symbols("v w a b I epsilon")
    return Scene(
        SlowFastSystem(
            slow={w: v + a - b * w},
            fast={v: v - v**3 / 3 - w + current},
            epsilon=epsilon,
            parameters={a: sp.Rational(7, 10), b: sp.Rational(4, 5), current: sp.Integer(0)},
            name="fitzhugh_nagumo",
        ),
        region={"w": (-0.64, 0.8), "v": (-2.2, -1.1)},
        start={"w": 2 / 3, "v": -2},
        span=(0, 1),
        epsilon=0.02,
        epsilons=(0.02, 0.01, 0.005, 0.0025),
        source=(
            "R. FitzHugh, Biophysical Journal 1 (1961) 445-466; J. Nagumo, S. Arimoto and S. Yoshizawa, "
            "Proceedings of the IRE 50 (1962) 2061-2070"
        ),
        description="A neuron without current returns to rest along the left sheet after its spike.",
    )
