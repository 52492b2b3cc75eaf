"""
Where a start lands
===================

A start off the slow manifold lands on the slow motion that begins at the base point of its fast fibre. In a
linear system the fibre is an eigenvector, and the base point is known.
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp

x, y, epsilon = sp.symbols("x y epsilon")
system = gsp.SlowFastSystem(slow={x: -y}, fast={y: x - y}, epsilon=epsilon)
series = gsp.expand(gsp.solve_critical(system).branches[0], order=4)
value, start = 0.1, {"x": 1.0, "y": 3.0}
base = gsp.project(series, start, epsilon=value, numeric=True)
print(dict(base), "by", base.route)

# The eigenvalues solve epsilon mu^2 + mu + 1 = 0; eigenvectors are (1, -mu).
fast, slow = sorted(np.roots([value, 1, 1]).real)
exact = (start["y"] + fast * start["x"]) / (fast - slow)
print(f"exact {exact:.15f}, difference {base['x'] - exact:.1e}")

# %%
# The full run and the slow motion from the base point meet.
assert abs(base["x"] - exact) < 1e-10
full = gsp.integrate(system, start=start, span=(0, 2), epsilon=value, at=np.linspace(0, 2, 201))
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
axes.plot(full["x"], full["y"], label="full run")
axes.plot(
    exact * np.exp(slow * full.t), -slow * exact * np.exp(slow * full.t), "--", label="from the base point"
)
axes.set(xlabel="x", ylabel="y")
axes.legend(frameon=False)
