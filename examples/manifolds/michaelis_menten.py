"""
Michaelis and Menten's quasi-steady state
=========================================

Is the quasi-steady state of Michaelis and Menten allowed, and what does the next order gain?
"""

import numpy as np
import sympy as sp

import gsp

s, c, kappa, lam, epsilon = sp.symbols("s c kappa lambda epsilon")
system = gsp.SlowFastSystem(
    slow={s: -s + (s + kappa - lam) * c},
    fast={c: s - (s + kappa) * c},
    epsilon=epsilon,
    parameters={kappa: 1, lam: 0.5},
    name="Michaelis-Menten",
)
branch = gsp.solve_critical(system).branches[0]
print("quasi-steady state:", branch)
print(gsp.classify(branch, region={"s": (0, 5)}, epsilon=0.1))

series = gsp.expand(branch, order=8)
print("first correction: ", series.coefficients[1]["c"])

# How far to go at epsilon = 0.1: the terms fall, and the residual of the invariance equation with them.
points = np.array([0.1, 0.5, 1.0, 5.0])
print("best order at s =", dict(zip(points.tolist(), series.optimal_order(points, 0.1).tolist())))
for order in range(0, 9, 2):
    residual = np.abs(series.residual(points, 0.1, order=order)).max()
    print(f"order {order}: residual {residual:.1e}")

# A run that starts without complex crosses an initial layer before it lands on the manifold.
run = gsp.integrate(system, start={"s": 1, "c": 0}, span=(0, 5), epsilon=0.1)
on = series.evaluate(run["s"], 0.1)[:, 0]
for t in (0.0, 0.2, 0.5, 1.0, 5.0):
    i = int(np.searchsorted(run.t, t))
    print(f"t = {run.t[i]:5.3f}: distance to the manifold {abs(run['c'][i] - on[i]):.1e}")

print(gsp.compare(gsp.models.load("michaelis_menten")))

# %%
# The first correction is the known one, kappa lambda s/(kappa + s)^4.
assert sp.simplify(series.coefficients[1]["c"] - kappa * lam * s / (kappa + s) ** 4) == 0
axes = run.plot()
