"""From a Lagrangian to its nonholonomic limit, and back through friction.

- `LagrangianSystem` holds L(q, qdot, t) and forces, and gives Lagrange's equations.
- `constrain` puts constraints on velocities, as Lagrange and d'Alembert do: multipliers and the reduced equations.
- `with_friction` puts strong friction in place of the constraints, and splits what results into slow and fast.

Equation numbers are those of J. Eldering, "Nonholonomic dynamics as limit of friction" (2015).
"""

from __future__ import annotations

from gsp.mechanics.constraints import ConstrainedSystem, constrain
from gsp.mechanics.friction import FrictionSystem, with_friction
from gsp.mechanics.lagrangian import LagrangianSystem

__all__ = ["ConstrainedSystem", "FrictionSystem", "LagrangianSystem", "constrain", "with_friction"]
