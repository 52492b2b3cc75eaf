"""
Where double precision leaves early
===================================

In Shishkova's system a pair of complex eigenvalues is lost at t = 0. Orbits stay till the buffer point.
Rounding errors are enough to drive them off before.

Source: M. A. Shishkova, Soviet Mathematics Doklady 14 (1973) 483-487.
"""

import sympy as sp

import gsp

x, y, t, epsilon = sp.symbols("x y t epsilon")
system = gsp.SlowFastSystem(
    slow={t: sp.Integer(1)}, fast={x: t * x - y + epsilon, y: x + t * y}, epsilon=epsilon
)
delayed = gsp.entry_exit(gsp.solve_critical(system).branches[0], start={"t": -2})
print(delayed)
measured = gsp.measure_delay(delayed, epsilon=0.01, radius=1)
print(measured)

# %%
# The buffer point is t = 1, a slow time of 3 after the entry at t = -2.
assert abs(delayed.t - 3) < 1e-6
axes = gsp.charts.delayed_exit(measured)
