"""From a Lagrangian to its nonholonomic limit, and back through friction.

- `LagrangianSystem` holds L(q, qdot, t) and forces, and gives Lagrange's equations.
- `rotation` gives the coordinates of a body that turns in space.
- `constrain` puts constraints on velocities, as Lagrange and d'Alembert do: multipliers and the reduced equations.
- `with_friction` puts strong friction in place of the constraints, and splits what results into slow and fast.
- With dry friction, `no_slip` of its result answers whether the constraints hold, and where they cease to.

Equation numbers are those of J. Eldering, "Nonholonomic dynamics as limit of friction" (2015).
"""

from __future__ import annotations

from gsp.mechanics.constraints import ConstrainedSystem, constrain
from gsp.mechanics.dry_friction import DryFrictionSystem
from gsp.mechanics.friction import FrictionSystem, with_friction
from gsp.mechanics.lagrangian import LagrangianSystem
from gsp.mechanics.rotation import Rotation, rotation
from gsp.sliding.no_slip import NoSlip

__all__ = [
    "ConstrainedSystem",
    "DryFrictionSystem",
    "FrictionSystem",
    "LagrangianSystem",
    "NoSlip",
    "Rotation",
    "constrain",
    "rotation",
    "with_friction",
]
