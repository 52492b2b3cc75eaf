"""
A proof up to a fold
====================

The autocatalator's critical manifold attracts for b < 1 and has a fold at b = 1. Ball arithmetic proves the gap
on boxes ever nearer to it.

Source: I. Gucwa and P. Szmolyan, Discrete and Continuous Dynamical Systems S 2 (2009) 783-806.
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp

a, b, epsilon = sp.symbols("a b epsilon")
system = gsp.SlowFastSystem(
    slow={a: sp.Rational(9, 10) - a - a * b**2}, fast={b: a - b + a * b**2}, epsilon=epsilon
)
branch = gsp.solve_critical(system).nearest({"a": 0.1, "b": 0.1})
ends = 0.5 - np.array([0.1, 0.01, 1e-3, 1e-4])
proved = [gsp.certify(branch, region={"a": (0.05, float(end))}) for end in ends]
for end, certificate in zip(ends, proved):
    print(f"a up to {end:.4f}: {certificate.verdict.name}, gap at least {certificate.gap:.6f}")

# %%
# The eigenvalue on the branch is -sqrt(1 - 4 a^2).
exact = np.sqrt(1 - 4 * ends**2)
for certificate, gap in zip(proved, exact):
    assert 0.5 * gap < certificate.gap <= gap
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
axes.loglog(0.5 - ends, exact, label="exact")
axes.loglog(0.5 - ends, [certificate.gap for certificate in proved], "o", label="proved")
axes.set(xlabel="distance from the fold", ylabel="gap in fast time")
axes.legend(frameon=False)
