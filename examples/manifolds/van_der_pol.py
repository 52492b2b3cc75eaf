"""
An implicit branch
==================

The branch of van der Pol's oscillator is an implicit cubic. It has two folds, and a reduced run stays beside the full
one.
"""

import numpy as np
import sympy as sp

import gsp

x, y, a, epsilon = sp.symbols("x y a epsilon")
system = gsp.SlowFastSystem(
    slow={y: a - x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon, parameters={a: 0}, name="van der Pol"
)
branch = gsp.solve_critical(system).branches[0]
print("explicit" if branch.is_explicit else "implicit", branch)

# Over the whole cubic normal hyperbolicity is lost, and classify says where.
print(gsp.classify(branch, region={"y": (-2, 2), "x": (-3, 3)}))

# One sheet of it: the one through (x, y) = (2, 2/3).
right = branch.through({"x": 2, "y": 2 / 3})
print(gsp.classify(right, region={"y": (-0.6, 1)}))

# The coefficients are functions of the point x of M0 over y: y = x^3/3 - x has no useful inverse.
series = gsp.expand(right, order=3)
print("h_1 =", series.coefficients[1]["x"])

value, t = 0.01, np.linspace(0, 0.6, 7)
start = {"y": 2 / 3, "x": float(series.evaluate(2 / 3, value)[0])}
full = gsp.integrate(system, start=start, span=(0, 0.6), epsilon=value, at=t)
print("     t   full x     order 0 error   order 3 error")
runs = [
    gsp.integrate(gsp.restrict(series, order=n), start=start, span=(0, 0.6), epsilon=value, at=t)
    for n in (0, 3)
]
for i, time in enumerate(t):
    errors = "   ".join(f"{abs(run['x'][i] - full['x'][i]):13.2e}" for run in runs)
    print(f"{time:6.2f}  {full['x'][i]:8.5f}   {errors}")

# %%
# On the curve y = x^3/3 - x the first correction is h_1 = x/(x^2 - 1)^3 times the sign of the slow rate.
point = float(right.points({"y": 2 / 3})[0])
assert abs(point - 2) < 1e-12
axes = gsp.continue_critical(system, start={"x": 2, "y": 2 / 3}, bounds={"x": (-3, 3), "y": (-2, 2)}).plot()
