"""
A ball and a disc that slip
===========================

A ball is thrown with slip, and a disc rolls on a circle. For both, no slip is the limit of strong friction.
"""

import math

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp

# The ball: its slip decays at the rate (1/m + R^2/J)/epsilon, and what is left is a straight line.
ball = gsp.models.friction_system("rolling_ball")
print(ball.splitting.explain())
series = gsp.expand(gsp.solve_critical(ball.standard_form).branches[0], order=3)
print("corrections of the ball:", [tuple(h) for h in series.coefficients])
start = {"omega_x": 0, "omega_y": 0, "omega_z": 0, "s1": 7, "s2": 0, "x": 0, "y": 0}
start |= {"q0": 1, "q1": 0, "q2": 0, "q3": 0}
run = gsp.integrate(ball.full_field, start=start, span=(0, 2), epsilon=0.1)
speed = run["omega_y"][-1] + run["s1"][-1]
print(f"thrown at 7 without spin it rolls off at {speed:.6f}: five sevenths are left\n")

# The disc: without slip a circle of radius R theta'/phi', with slip a spiral inwards.
disc = gsp.models.friction_system("rolling_disc")
print(disc.limit)
print("power of the friction:", disc.dissipation())
series = gsp.expand(gsp.solve_critical(disc.standard_form).branches[0], order=1)
slip, p = series.coefficients[1]["w2"], sp.Symbol("p")
print(f"sideways slip to first order: w2 = epsilon ({slip}), p = {disc.splitting.coordinates[p]}\n")
start = {"phidot": 1, "thetadot": 2, "w1": 0, "w2": 0, "x": 0, "y": -2, "phi": 0, "theta": 0}
print("epsilon   thetadot after a turn   exp(-2 pi epsilon (m R phidot)^2/(K + m R^2))")
turn = np.linspace(0, 2 * math.pi, 201)
for epsilon in (0.04, 0.02, 0.01):
    run = gsp.integrate(disc.full_field, start=start, span=(0, 2 * math.pi), epsilon=epsilon, at=turn)
    left = float(run["thetadot"][-1]) / 2
    print(f"{epsilon:7.2f}   {left:21.5f}   {math.exp(-2 * math.pi * epsilon / 1.5):.5f}")

# %%
# Five sevenths of the speed are left, as everyone who bowls knows. The path of the disc with slip winds inwards.
assert abs(speed - 5) < 1e-4
axes = Figure(figsize=(5, 4.4), layout="constrained").subplots()
axes.plot(run["x"], run["y"])
axes.set(xlabel="x", ylabel="y", aspect="equal")
