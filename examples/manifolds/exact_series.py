"""
A series that can be summed
===========================

A linear system has the slow manifold x = y/(1 - epsilon). Its series is the geometric one, and each order gains
a factor epsilon.
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp

y, x, epsilon = sp.symbols("y x epsilon")
system = gsp.SlowFastSystem(slow={y: -y}, fast={x: y - x}, epsilon=epsilon)
series = gsp.expand(gsp.solve_critical(system).branches[0], order=10)
print("coefficients:", [h["x"] for h in series.coefficients])

orders = np.arange(11)
errors = [abs(series.evaluate(1.0, 0.1, order=n)[0] - 1 / 0.9) for n in orders]
for n, error in zip(orders, errors):
    print(f"order {n:2}: {error:.1e}")

# %%
# The error of order n is epsilon^(n+1)/(1 - epsilon), exactly.
assert np.allclose(errors, 0.1 ** (orders + 1) / 0.9, rtol=1e-3, atol=0)
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
axes.semilogy(orders, errors, "o-")
axes.set(xlabel="order", ylabel="error at epsilon = 0.1")
