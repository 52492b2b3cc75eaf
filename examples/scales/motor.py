"""
A motor without an epsilon
==========================

A motor has an inductance L, a resistance R and an inertia J, and nobody says which of them is small. What may be left
out is found, with its error at the motor's own values.
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp

i, w, V, R, L, k, b, J = sp.symbols("i w V R L k b J")
motor = gsp.VectorField(
    {i: (V - R * i - k * w) / L, w: (k * i - b * w) / J},
    parameters={V: 12, R: 1, L: 0.02, k: 0.1, b: 0.001, J: 0.01},
)
scene = gsp.Scene(motor, region={}, start={"i": 0, "w": 0}, span=(0, 5), tolerance=0.05)
found = gsp.find_reductions(scene)
print(found)

# %%
# The current is fast, and L is what divides its rate: it becomes the small parameter.
best = found.recommended
assert best is not None
assert str(best.scene.system.epsilon) == "L"
study = gsp.study(best.scene)
rate = study.series(1).reduced_field[0][w]
print(f"w' = {rate}")
assert sp.cancel(rate - (k * (V - k * w) / R - b * w) / J) == 0

# %%
# The speed of the reduced motor starts as fast as it can; that of the full one waits for its current.
at = np.linspace(0, 5, 400)
full = gsp.integrate(motor, start=scene.start, span=scene.span, at=at)
reduced = gsp.integrate(study.reduced(0), start={"w": 0}, span=scene.span, epsilon=best.scene.epsilon, at=at)
error = np.abs(full["w"] - reduced["w"]).max() / full["w"].max()
print(f"largest relative error of the speed, start and all: {error:.3f}")
assert error < 0.05

axes = Figure(figsize=(6, 3.5)).add_subplot()
axes.plot(at, full["w"], label="full")
axes.plot(at, reduced["w"], "--", label="without inductance")
axes.set_xlabel("t")
axes.set_ylabel("speed w")
axes.legend()
