"""Planar systems with relaxation cycles, and singular orbits of them, for tests of their proofs."""

from __future__ import annotations

import sympy as sp

import gsp

x, y, epsilon = sp.symbols("x y epsilon")
R = sp.Rational


def system(slow: sp.Expr, fast: sp.Expr) -> gsp.SlowFastSystem:
    return gsp.SlowFastSystem(slow={y: slow}, fast={x: fast}, epsilon=epsilon)


def van_der_pol(a: sp.Expr = sp.S.Zero) -> gsp.SlowFastSystem:
    return system(a - x, y - x**3 / 3 + x)


def fitzhugh_nagumo(current: sp.Expr = sp.S.Half) -> gsp.SlowFastSystem:
    return system(x + R(7, 10) - R(4, 5) * y, x - x**3 / 3 - y + current)


def morris_lecar() -> gsp.SlowFastSystem:
    """Rinzel and Ermentrout's constants between the Hopf and the saddle-node set, an applied current of 45."""
    opened, held = ((1 + sp.tanh(u)) / 2 for u in ((x + R(6, 5)) / 18, (x - 12) / R(87, 5)))
    current = 45 - 2 * (x + 60) - 8 * y * (x + 84) - 4 * opened * (x - 120)
    return system((held - y) * sp.cosh((x - 12) / R(174, 5)), current / 20)


def lengyel_epstein() -> gsp.SlowFastSystem:
    return system(x - x * y / (1 + x**2), 20 - x - 4 * x * y / (1 + x**2))


def two_cycles() -> gsp.SlowFastSystem:
    """y - F(x) with six folds, at which |F| is larger from pair to pair: a cycle that attracts within another one."""
    rise = sp.expand((x**2 - R(1, 4)) * (x**2 - R(9, 4)) * (x**2 - R(25, 4)))
    return system(-x, y - sp.integrate(rise, x))


def orbit_of(found: gsp.SlowFastSystem, start_x: float, start_y: float) -> gsp.SingularOrbit:
    start = {"x": start_x, "y": start_y}
    return gsp.singular_orbit(gsp.solve_critical(found).nearest(start), start)
