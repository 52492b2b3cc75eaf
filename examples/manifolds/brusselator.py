"""
A sum that is slow
==================

In the Brusselator with fast interconversion both species change fast. Their sum does not: `split` finds it, and
the critical set x y = B.

Source: I. Prigogine and R. Lefever, Journal of Chemical Physics 48 (1968) 1695-1700.
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp

x, y, A, B, epsilon = sp.symbols("x y A B epsilon")
field = gsp.VectorField(
    states={x: A - x + (x**2 * y - B * x) / epsilon, y: (B * x - x**2 * y) / epsilon},
    epsilon=epsilon,
    parameters={A: 1, B: 2},
)
splitting = gsp.split(field)
print(splitting.explain())
run = gsp.integrate(field, start={"x": 4, "y": 2}, span=(0, 0.5), epsilon=0.02)

# %%
# The slow variable is x + y, and the run settles on x y = 2 up to a distance of the order of epsilon.
((slow, raw),) = [(name, raw) for name, raw in splitting.coordinates.items() if name not in (x, y)]
assert sp.simplify(raw - (x + y)) == 0
assert abs(run["x"][-1] * run["y"][-1] - 2) < 0.1
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
on = np.linspace(1.2, 5.5, 200)
axes.plot(on, 2 / on, "--", color="grey", label="x y = B")
axes.plot(run["x"], run["y"], label="run")
axes.set(xlabel="x", ylabel="y")
axes.legend(frameon=False)
