"""Relaxation oscillators."""

from __future__ import annotations

import sympy as sp

from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem


def van_der_pol() -> Scene:
    """epsilon x' = y - x^3/3 + x, y' = a - x, on the right attracting sheet x > 1.

    The sheet ends in a fold at (x, y) = (1, -2/3), where trajectories jump to the left one; with a = 0 the
    limit cycle is symmetric. On the sheet (1 - x^2) x' = x - a to leading order, so from x = 2 the fold is
    reached at t = 3/2 - ln 2 = 0.807; the span ends before that.

    Source: B. van der Pol, "On relaxation-oscillations", Philosophical Magazine 2 (1926) 978-992, in the
    Lienard plane of M. Krupa and P. Szmolyan, "Relaxation oscillation and canard explosion", Journal of
    Differential Equations 174 (2001) 312-368.
    """
    x, y, a, epsilon = sp.symbols("x y a epsilon")
    return Scene(
        SlowFastSystem(
            slow={y: a - x},
            fast={x: y - x**3 / 3 + x},
            epsilon=epsilon,
            parameters={a: sp.Integer(0)},
            name="van_der_pol",
        ),
        region={"y": (-0.6, 1.2), "x": (1.1, 2.2)},
        start={"y": 2 / 3, "x": 2},
        span=(0, 0.6),
        epsilon=0.01,
        source=(
            "B. van der Pol, Philosophical Magazine 2 (1926) 978-992; M. Krupa and P. Szmolyan, "
            "Journal of Differential Equations 174 (2001) 312-368"
        ),
        description="The slow phase of a relaxation oscillation, on the right sheet of the cubic.",
    )
