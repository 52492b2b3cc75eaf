"""
Robertson's kinetics
====================

Three reactions whose rates lie nine orders of magnitude apart: the classical test of stiff integrators. The
intermediate B is scaled by epsilon = 1e-4.

Source: H. H. Robertson (1966); reference value by E. Hairer and G. Wanner, Solving Ordinary Differential
Equations II.
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp

A, b, C, epsilon = sp.symbols("A b C epsilon")
loss = sp.Rational(1, 25) * A
kinetics = gsp.SlowFastSystem(
    slow={A: -loss + b * C, C: sp.Rational(3, 10) * b**2},
    fast={b: loss - b * C - sp.Rational(3, 10) * b**2},
    epsilon=epsilon,
)
times = np.geomspace(1e-3, 40, 60)
run = gsp.integrate(
    kinetics, start={"A": 1, "b": 0, "C": 0}, span=(0, 40), epsilon=1e-4, rtol=1e-10, atol=1e-14, at=times
)
print(run.stats)
print(f"A(40) = {run['A'][-1]:.12f}")

# %%
# The published value, and the sum of the three, which is conserved.
assert abs(run["A"][-1] - 0.7158270688) < 1e-8
assert abs(run["A"] + 1e-4 * run["b"] + run["C"] - 1).max() < 1e-9
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
for name in ("A", "b", "C"):
    axes.semilogx(times, run[name], label=name)
axes.set(xlabel="t")
axes.legend(frameon=False)
