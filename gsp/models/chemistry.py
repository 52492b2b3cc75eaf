"""Reactions: enzymes, unimolecular decay, an electrode, and a test problem."""

from __future__ import annotations

import sympy as sp

from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem


def michaelis_menten() -> Scene:
    """s' = -s + (s + kappa - lambda) c, epsilon c' = s - (s + kappa) c: substrate s, complex c, scaled.

    epsilon is the ratio of enzyme to substrate at the start, kappa the Michaelis constant and lambda the part
    of it that belongs to the product, both over the substrate at the start. The reaction starts without
    complex.

    Source: L. A. Segel and M. Slemrod, "The quasi-steady-state assumption: a case study in perturbation", SIAM
    Review 31 (1989) 446-477.
    """
    s, c, kappa, lam, epsilon = sp.symbols("s c kappa lambda epsilon")
    return Scene(
        SlowFastSystem(
            slow={s: -s + (s + kappa - lam) * c},
            fast={c: s - (s + kappa) * c},
            epsilon=epsilon,
            parameters={kappa: sp.Integer(1), lam: sp.Rational(1, 2)},
            name="michaelis_menten",
        ),
        region={"s": (0.05, 2), "c": (0, 1)},
        start={"s": 1, "c": 0},
        span=(0, 5),
        epsilon=0.05,
        source='L. A. Segel and M. Slemrod, "The quasi-steady-state assumption", SIAM Review 31 (1989) 446-477',
        description="An enzyme binds its substrate fast and releases the product slowly.",
    )


def davis_skodje() -> Scene:
    """y1' = -y1, epsilon y2' = -y2 + ((1 - epsilon) y1 + y1^2)/(1 + y1)^2; epsilon is 1/gamma of the source.

    The slow manifold is y2 = y1/(1 + y1), exactly, for every epsilon: the series ends after its first term.

    Source: M. J. Davis and R. T. Skodje, "Geometric investigation of low-dimensional manifolds in systems
    approaching equilibrium", Journal of Chemical Physics 111 (1999) 859-874.
    """
    y1, y2, epsilon = sp.symbols("y1 y2 epsilon")
    return Scene(
        SlowFastSystem(
            slow={y1: -y1},
            fast={y2: -y2 + ((1 - epsilon) * y1 + y1**2) / (1 + y1) ** 2},
            epsilon=epsilon,
            name="davis_skodje",
        ),
        region={"y1": (0, 3.5), "y2": (0, 2)},
        start={"y1": 3, "y2": 1.5},
        span=(0, 5),
        epsilon=0.1,
        source="M. J. Davis and R. T. Skodje, Journal of Chemical Physics 111 (1999) 859-874",
        description="A test problem for reduction methods: its slow manifold does not move with epsilon.",
    )


def lindemann() -> Scene:
    """x' = -x^2 + beta x y, epsilon y' = x^2 - (1 + beta x) y: reactant x, activated molecule y, scaled.

    A + A <-> A + B, B -> P. epsilon compares the lifetime of the activated molecule B, whose concentration it
    scales, with the time between activating collisions; beta is the rate of deactivation over that of decay.

    Source: F. A. Lindemann and others, "Discussion on the radiation theory of chemical action", Transactions
    of the Faraday Society 17 (1922) 598-606; phase plane in M. S. Calder and D. Siegel, "Properties of the
    Lindemann mechanism in phase space", Electronic Journal of Qualitative Theory of Differential Equations
    2011, no. 8.
    """
    x, y, beta, epsilon = sp.symbols("x y beta epsilon")
    return Scene(
        SlowFastSystem(
            slow={x: -(x**2) + beta * x * y},
            fast={y: x**2 - (1 + beta * x) * y},
            epsilon=epsilon,
            parameters={beta: sp.Integer(1)},
            name="lindemann",
        ),
        region={"x": (0.05, 1.5), "y": (0, 1)},
        start={"x": 1, "y": 0},
        span=(0, 5),
        epsilon=0.05,
        source=(
            "F. A. Lindemann, Transactions of the Faraday Society 17 (1922) 598-606; M. S. Calder and "
            "D. Siegel, Electronic Journal of Qualitative Theory of Differential Equations 2011, no. 8"
        ),
        description="Molecules are activated by collision, then decay; the activated ones are few.",
    )


def koper() -> Scene:
    """epsilon x' = k y - x^3 + 3 x - lambda, y' = x - 2 y + z, z' = e2 (y - z): one fast, two slow variables.

    The critical manifold is a folded sheet given implicitly by a cubic in x, attracting for |x| > 1. With k =
    -10, lambda = -7, e2 = 1 the fold x = 1 carries a folded node. The scene stays on the right sheet, x > 1.

    Source: M. T. M. Koper, "Bifurcations of mixed-mode oscillations in a three-variable autonomous Van der
    Pol-Duffing model with a cross-shaped phase diagram", Physica D 80 (1995) 72-94; M. Desroches and others,
    "Mixed-mode oscillations with multiple time scales", SIAM Review 54 (2012) 211-288.
    """
    x, y, z, k, e2, lam, epsilon = sp.symbols("x y z k e2 lambda epsilon")
    return Scene(
        SlowFastSystem(
            slow={y: x - 2 * y + z, z: e2 * (y - z)},
            fast={x: k * y - x**3 + 3 * x - lam},
            epsilon=epsilon,
            parameters={k: sp.Integer(-10), e2: sp.Integer(1), lam: sp.Integer(-7)},
            name="koper",
        ),
        region={"y": (-0.2, 0.85), "z": (0, 1), "x": (1.2, 2.7)},
        start={"y": 0, "z": 0.5, "x": 2.4},
        span=(0, 0.3),
        epsilon=0.01,
        source="M. T. M. Koper, Physica D 80 (1995) 72-94; M. Desroches et al., SIAM Review 54 (2012) 211-288",
        description="An electrochemical oscillator, on one attracting sheet of its folded critical manifold.",
    )
