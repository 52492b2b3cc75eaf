"""
Way in, way out
===============

Along y = 0 the eigenvalue is y + y^2. An orbit that comes in at y = -1/2 leaves where the integral of the
eigenvalue is back at zero.
"""

import math

import sympy as sp

import gsp

x, y, epsilon = sp.symbols("x y epsilon")
system = gsp.SlowFastSystem(slow={y: sp.Integer(1)}, fast={x: (y + y**2) * x}, epsilon=epsilon)
delayed = gsp.entry_exit(gsp.solve_critical(system).branches[0], start={"y": -0.5})
print(delayed)

# %%
# The way out is at (sqrt(3) - 1)/2.
assert abs(delayed.point["y"] - (math.sqrt(3) - 1) / 2) < 1e-9
axes = gsp.charts.delayed_exit(gsp.measure_delay(delayed, epsilon=0.005, radius=0.1))
