"""Linear test systems, whose slow manifolds are known in closed form."""

from __future__ import annotations

import sympy as sp

from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem


def linear() -> Scene:
    """y' = -y, epsilon x' = y - x: x relaxes to a decaying y.

    The slow manifold is x = y/(1 - epsilon), exactly, the eigenvector of the slow eigenvalue -1; its series in
    epsilon is geometric.

    Source: elementary; the scalar case of A. N. Tikhonov, "Systems of differential equations containing small
    parameters in the derivatives", Mat. Sbornik 31 (1952) 575-586.
    """
    x, y, epsilon = sp.symbols("x y epsilon")
    return Scene(
        SlowFastSystem(slow={y: -y}, fast={x: y - x}, epsilon=epsilon, name="linear"),
        region={"y": (0, 1.5), "x": (-0.5, 2)},
        start={"y": 1, "x": 0},
        span=(0, 3),
        epsilon=0.05,
        source="A. N. Tikhonov, Mat. Sbornik 31 (1952) 575-586, the linear case",
        description="The smallest system with two time scales; every stage has a closed form.",
    )
