"""
The initial layer, uniformly
============================

A composite expansion holds in the initial layer and after it. Michaelis and Menten's enzyme starts without
complex.
"""

import numpy as np
import sympy as sp

import gsp

s, c, epsilon = sp.symbols("s c epsilon")
enzyme = gsp.SlowFastSystem(
    slow={s: -s + (s + sp.Rational(1, 2)) * c}, fast={c: s - (s + 1) * c}, epsilon=epsilon
)
branch = gsp.solve_critical(enzyme).branches[0]
times = np.linspace(0, 3, 400)
errors = {}
for value in (0.1, 0.05, 0.025):
    solution = gsp.composite(branch, {"s": 1, "c": 0}, span=(0, 3), epsilon=value, order=1)
    full = gsp.integrate(enzyme, start={"s": 1, "c": 0}, span=(0, 3), epsilon=value, rtol=1e-10, at=times)
    errors[value] = np.abs(solution.sample(times)["c"] - full["c"]).max()
    print(f"epsilon = {value}: largest error of c, layer included, {errors[value]:.2e}")

# %%
# The expansion is of order 1: each halving of epsilon divides the error by about four.
assert 3.4 < errors[0.05] / errors[0.025] < 4.6
axes = gsp.charts.composite(solution, name="c", full=full)
