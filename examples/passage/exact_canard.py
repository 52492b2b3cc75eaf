"""
A canard that is known exactly
==============================

The parabola y = x^2 - epsilon/2 is invariant in the system epsilon x' = x^2 - y, y' = x - a when a = 0: its canard
value is zero to every order.
"""

import sympy as sp

import gsp

x, y, a, epsilon = sp.symbols("x y a epsilon")
system = gsp.SlowFastSystem(slow={y: x - a}, fast={x: x**2 - y}, epsilon=epsilon, parameters={a: 0})
canard = gsp.canard_value(system, parameter=a, order=8)
print("coefficients:", canard.coefficients)
run = gsp.integrate(system, start={"x": -1, "y": 0.95}, span=(0, 3.4), epsilon=0.1, rtol=1e-11, atol=1e-13)
print(run.message)

# %%
# The run stays on the parabola y = x^2 - epsilon/2 on its attracting side and on its repelling one.
assert list(canard.coefficients) == [0] * 9
assert abs(run["y"] - (run["x"] ** 2 - 0.05)).max() < 1e-4
axes = run.plot()
