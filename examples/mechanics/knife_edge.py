"""
A blade that never gets down
============================

A knife edge on a slope, released at rest, turns at a constant rate and moves on a cycloid across the slope.
With friction in place of the constraint it creeps downhill.

Source: A. M. Bloch, Nonholonomic Mechanics and Control, section 1.6.
"""

import math

import numpy as np
from matplotlib.figure import Figure

import gsp

blade = gsp.models.friction_system("knife_edge")
print(blade.limit)
start = {"phi": -math.pi / 2, "v": 0, "omega": 1, "x": 0, "y": 0}
times = np.linspace(0, 10, 201)
limit = gsp.integrate(blade.limit.full_field, start=start, span=(0, 10), at=times, rtol=1e-10, atol=1e-12)
slipping = gsp.integrate(blade.full_field, start=start | {"w": 0}, span=(0, 10), epsilon=0.02, at=times)

# %%
# The cycloid, with G = g sin(alpha): x = G (t - sin(2 t)/2)/2, y = -G sin(t)^2/2.
G = 9.81 * math.sin(0.2)
assert np.abs(limit["x"] - G * (times - np.sin(2 * times) / 2) / 2).max() < 1e-7
assert np.abs(limit["y"] + G * np.sin(times) ** 2 / 2).max() < 1e-7
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
axes.plot(limit["x"], limit["y"], "--", label="no slip")
axes.plot(slipping["x"], slipping["y"], label="epsilon = 0.02")
axes.set(xlabel="x, across the slope", ylabel="y, uphill")
axes.legend(frameon=False)
