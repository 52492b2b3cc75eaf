"""
How small is small enough, proved
=================================

The script proves how small an epsilon is small enough for Michaelis and Menten's reaction, and what its reduction
costs.
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp

s, c, epsilon = sp.symbols("s c epsilon")
slow = {s: -s + (s + sp.Rational(1, 2)) * c}
system = gsp.SlowFastSystem(slow=slow, fast={c: s - (s + 1) * c}, epsilon=epsilon, name="Michaelis-Menten")
branch = gsp.solve_critical(system).branches[0]
for order in (0, 1):
    series = gsp.expand(branch, order=order)
    print(f"order {order}")
    print(gsp.certify(series, region={"s": (0.1, 5)}))
    bound = gsp.bound_reduction(series, start={"s": 5.0}, span=(0, 10), epsilon=0.1)
    print(bound)

# %%
# The measured difference is below the proved bound.
full = gsp.integrate(
    system, start={"s": 5.0, "c": float(series.evaluate(5.0, 0.1)[0])}, span=(0, 10), epsilon=0.1,
    rtol=1e-11, atol=1e-13, at=np.linspace(0, 10, 101),
)  # fmt: skip
flow = gsp.restrict(series, order=1)
reduced = gsp.integrate(flow, start={"s": 5.0}, span=(0, 10), epsilon=0.1, rtol=1e-11, atol=1e-13, at=full.t)
difference = np.abs(full["s"] - reduced["s"])
assert 0 < difference.max() < bound.bound < 3e-4
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
axes.plot(full.t[::5], 1e4 * difference[::5], "o", ms=4, label="measured")
axes.plot(bound.times, 1e4 * bound.slow, label="proved bound")
axes.set(xlabel="t", ylabel="|full - reduced|, 1e-4")
axes.legend(frameon=False)
