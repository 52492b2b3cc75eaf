"""
A tyre creeps out of its bend
=============================

How far does a tyre creep in a bend, when friction acts against its sideways slip? The answer is in metres.

A quarter of a car rolls through a quarter circle on one tyre that turns at the rate v/radius. Small slip angles
give a sideways force -C_alpha w/v, so friction is viscous with the coefficient c = C_alpha/v in kg/s, and
epsilon = 1/c.
"""

import math

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp
from gsp.mechanics import FrictionSystem, LagrangianSystem, with_friction

# Typical of a passenger car: quarter mass, cornering stiffness of one tyre, rubber on dry asphalt.
MASS = 375.0  # kg
STIFFNESS = 5.0e4  # N/rad
GRIP = 0.9  # friction coefficient, no unit
RADIUS = 100.0  # m
GRAVITY = 9.81  # m/s^2


def tyre() -> FrictionSystem:
    """A mass on one wheel: forward velocity v, rate of turning omega, slip w to its left."""
    x, y, phi, xdot, ydot, phidot = sp.symbols("x y phi xdot ydot phidot")
    v, omega, m, inertia, epsilon = sp.symbols("v omega m I epsilon")
    system = LagrangianSystem(
        m * (xdot**2 + ydot**2) / 2 + inertia * phidot**2 / 2,
        [x, y, phi],
        [xdot, ydot, phidot],
        parameters={m: MASS, inertia: 50},
    )
    forward = xdot * sp.cos(phi) + ydot * sp.sin(phi)
    sideways = -xdot * sp.sin(phi) + ydot * sp.cos(phi)
    return with_friction(system, [sideways], epsilon=epsilon, frame={v: forward, omega: phidot})


def creep(system: FrictionSystem, speed: float) -> dict[str, float]:
    """Drift out of the bend in metres: by the reduced flow through O(epsilon), and by the full system."""
    epsilon, omega = speed / STIFFNESS, speed / RADIUS
    end = 0.5 * math.pi / omega
    start = {"v": speed, "omega": omega, "w": 0.0, "x": 0.0, "y": 0.0, "phi": 0.0}
    series = gsp.expand(gsp.solve_critical(system.standard_form).branches[0], order=1)
    drift = {}
    for order in (0, 1):
        flow = gsp.restrict(series, order=order, reconstruction=system.reconstruction)
        begin = {name: value for name, value in start.items() if name != "w"}
        drift[f"order {order}"] = gsp.integrate(flow, start=begin, span=(0, end), epsilon=epsilon)
    drift["full"] = gsp.integrate(system.full_field, start=start, span=(0, end), epsilon=epsilon)
    # Without slip the wheel ends at (radius, radius) and heads along y: out of the bend is along x.
    found = {name: float(run["x"][-1]) - RADIUS for name, run in drift.items()}
    slip = abs(float(series.coefficients[1]["w"].subs({"m": MASS, "v": speed, "omega": omega}))) * epsilon
    return {**found, "slip": slip, "lag": RADIUS - float(drift["full"]["y"][-1])}


system = tyre()
print(system)
print("\nslip on the slow manifold: w = -epsilon m v omega, a slip angle of m v^2/(radius C_alpha)\n")
print("speed  share of  m omega  slip   slip    drift out of the bend [m]   lag")
print("[m/s]  the grip  epsilon  [m/s]  [deg]   order 0  order 1    full    [m]")
for speed in (10.0, 15.0, 20.0):
    row = creep(system, speed)
    share = speed**2 / (RADIUS * GRAVITY * GRIP)
    ratio = MASS * speed / RADIUS * speed / STIFFNESS
    print(
        f"{speed:5.0f}  {share:8.0%}  {ratio:7.4f}  {row['slip']:5.3f}  {math.degrees(row['slip'] / speed):5.2f}"
        f"  {row['order 0']:9.3f}  {row['order 1']:7.3f}  {row['full']:7.3f}  {row['lag']:5.2f}"
    )
print(f"\nAt 20 m/s the tyre creeps {creep(system, 20.0)['full']:.2f} m out of a quarter circle of 157 m.")

# %%
# By hand the drift to first order is (2 - pi/2) R m omega epsilon: geometry times the slip.
speeds = np.linspace(5, 22, 8)
drifts = [creep(system, float(speed)) for speed in speeds]
by_hand = (2 - math.pi / 2) * RADIUS * (MASS / STIFFNESS) * speeds**2 / RADIUS
assert abs(drifts[0]["order 1"] / by_hand[0] - 1) < 0.02
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
axes.plot(speeds, by_hand, "--", color="grey", label="first order, by hand")
for label in ("order 1", "full"):
    axes.plot(speeds, [row[label] for row in drifts], "o-", label=label)
axes.set(xlabel="speed [m/s]", ylabel="drift out of the bend [m]")
axes.legend(frameon=False)
