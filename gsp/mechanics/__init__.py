"""Mechanics: from a Lagrangian to its nonholonomic limit, and back through friction.

    LagrangianSystem   L(q, qdot, t) and forces: Lagrange's equations
    constrain          Lagrange-d'Alembert: constraints on velocities, multipliers, the reduced equations
    with_friction      strong friction in place of the constraints, split into slow and fast

Equation numbers are those of J. Eldering, "Nonholonomic dynamics as limit of friction" (2015).
"""

from __future__ import annotations

from gsp.mechanics.constraints import ConstrainedSystem, constrain
from gsp.mechanics.friction import FrictionSystem, with_friction
from gsp.mechanics.lagrangian import LagrangianSystem

__all__ = ["ConstrainedSystem", "FrictionSystem", "LagrangianSystem", "constrain", "with_friction"]
