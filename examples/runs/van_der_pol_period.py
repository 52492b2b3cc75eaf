"""
Van der Pol's period to fifteen digits
======================================

A closed orbit is solved for as a boundary value problem, which gives its Floquet multipliers too.
"""

import sympy as sp

import gsp

x, y, epsilon = sp.symbols("x y epsilon")
oscillator = gsp.SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon)
orbit = gsp.periodic_orbit(oscillator, start={"x": 2, "y": 0}, epsilon=1.0)
print(orbit)
print("multipliers", orbit.multipliers)
print("by shooting", gsp.shoot(orbit).period)

# %%
# At mu = 1 the published period is 6.66328685932313.
assert abs(orbit.period - 6.66328685932313) < 1e-11
axes = orbit.plot()
