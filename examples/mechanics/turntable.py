"""
A ball on a turntable
=====================

A homogeneous ball that rolls on a turning table moves on a circle, at two sevenths of the table's rate.
Friction in place of the constraint makes it a spiral.

Source: J. A. Burns, American Journal of Physics 49 (1981) 56-58.
"""

import numpy as np
from matplotlib.figure import Figure

import gsp

ball = gsp.models.friction_system("ball_on_turntable")
print(ball.limit.reduced)
# The table's rate is 3.
turn = 2 * np.pi / (2 / 7 * 3)
times = np.linspace(0, turn, 201)
start = {"x": 1, "y": 0, "omega_x": 2, "omega_y": 0, "omega_z": 0.5}
limit = gsp.integrate(ball.limit.reduced, start=start, span=(0, turn), at=times, rtol=1e-10, atol=1e-12)
full = gsp.integrate(ball.field, start=start | {"s1": 0, "s2": 0}, span=(0, turn), epsilon=0.05, at=times)

# %%
# After 7/2 turns of the table the ball is back.
assert np.hypot(limit["x"][-1] - limit["x"][0], limit["y"][-1] - limit["y"][0]) < 1e-6
# It was nowhere near in between.
assert np.hypot(limit["x"] - limit["x"][0], limit["y"] - limit["y"][0]).max() > 0.5
axes = Figure(figsize=(5, 4.4), layout="constrained").subplots()
axes.plot(limit["x"], limit["y"], "--", label="no slip")
axes.plot(full["x"], full["y"], label="epsilon = 0.05")
axes.set(xlabel="x", ylabel="y", aspect="equal")
axes.legend(frameon=False)
