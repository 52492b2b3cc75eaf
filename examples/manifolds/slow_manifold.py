"""
Three routes to the slow manifold
=================================

The slow manifold is found by its series, at points by the zero-derivative principle, and by solving for it, on three
kinds of system.
"""

import warnings

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp

s, c, kappa, lam, epsilon = sp.symbols("s c kappa lambda epsilon")
enzyme = gsp.SlowFastSystem(
    slow={s: -s + (s + kappa - lam) * c},
    fast={c: s - (s + kappa) * c},
    epsilon=epsilon,
    parameters={kappa: 1, lam: 0.5},
)
branch = gsp.solve_critical(enzyme).branches[0]
points = np.array([0.1, 0.5, 1.0, 5.0])
solved = gsp.solve_manifold(branch, region={"s": (0.05, 6)}, epsilon=0.1, tolerance=1e-12)
print(solved.message)
pointwise = gsp.zero_derivative(branch, points, epsilon=0.1)
series = gsp.expand(branch, order=20)
print("     s   solved manifold     zero-derivative    order   series at its best order")
for i, (x, y) in enumerate(zip(points, solved.evaluate(points)[:, 0])):
    order = series.optimal_order(x, 0.1)
    best = series.evaluate(x, 0.1, order=order)[0]
    pointwise_error = abs(pointwise.y[i, 0] - y)
    print(f"{x:6.2f}  {y:.15f}  {pointwise_error:10.1e} away {pointwise.order[i]:6}   {abs(best - y):.1e} away")

# Saddle type: one fast direction attracts, the other repels; no integration in either direction finds it.
x, y = sp.symbols("x y")
saddle = gsp.SlowFastSystem(slow={s: -s}, fast={x: x + s**2, y: -y + x * s}, epsilon=epsilon)
found = gsp.solve_manifold(gsp.solve_critical(saddle).branches[0], region={"s": (0.2, 1)}, epsilon=0.05)
exact = np.array([-1 / 1.1, -1 / (1.1 * 0.85)])
print(
    f"saddle type at s = 1: {found.evaluate(1.0)}, {np.abs(found.evaluate(1.0) - exact).max():.1e} from exact"
)

# Ten thousand points of the sleigh's manifold in one call.
sleigh = gsp.split(gsp.models.load("chaplygin_sleigh").system).system
assert sleigh is not None
cloud = np.random.default_rng(0).uniform(-1, 1, (10_000, 2))
many = gsp.zero_derivative(gsp.solve_critical(sleigh).branches[0], cloud, epsilon=0.01, order=8)
print(f"{len(cloud)} points, largest estimated error {many.error.max():.1e}")

# %%
# The saddle's manifold is known in closed form. The series gets better, then worse.
assert np.abs(found.evaluate(1.0) - exact).max() < 1e-12
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
for x, y in zip(points, solved.evaluate(points)[:, 0]):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gsp.BeyondReachWarning)
        errors = [abs(series.evaluate(x, 0.1, order=n)[0] - y) for n in range(21)]
    axes.semilogy(errors, "o-", ms=3, label=f"s = {x:g}")
axes.set(xlabel="order", ylabel="error of the series at epsilon = 0.1")
axes.legend(frameon=False)
