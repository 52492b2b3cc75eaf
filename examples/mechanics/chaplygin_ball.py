"""
Chaplygin's ball
================

A ball whose centre of mass is its middle, and whose three moments of inertia differ, rolls on a plane. Its orientation
is a unit quaternion, so that no angle is singular on its way. Its path is no straight line, yet its angular momentum
about the point of contact stays the same in space. With friction in place of the constraint both hold up to O(epsilon).

Source: S. A. Chaplygin, "On a ball's rolling on a horizontal plane" (1903; Regular and Chaotic Dynamics 7 (2002) 131).
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp
from gsp.mechanics import LagrangianSystem, rotation, with_friction

x, y, xdot, ydot, m, epsilon = sp.symbols("x y xdot ydot m epsilon")
names, moments = sp.symbols("omega_1 omega_2 omega_3"), sp.symbols("I1 I2 I3")
turn = rotation("q")
kinetic = m * (xdot**2 + ydot**2) / 2 + sum(J * w**2 for J, w in zip(moments, turn.body)) / 2
system = LagrangianSystem(
    kinetic,
    [x, y, *turn.coordinates],
    [xdot, ydot, *turn.velocities],
    parameters={m: 1, **dict(zip(moments, (sp.Rational(1, 5), sp.Rational(2, 5), sp.Rational(1, 2))))},
    holonomic=[turn.holonomic],
)
# The radius is 1: the point of contact rests where xdot = omega_y and ydot = -omega_x in space.
slips = [xdot - turn.space[1], ydot + turn.space[0]]
ball = with_friction(system, slips, epsilon=epsilon, frame=dict(zip(names, turn.body)))

times = np.linspace(0, 12, 601)
start = {**turn.about((1, 0, 2), 0.8), "x": 0, "y": 0, "omega_1": 0.3, "omega_2": 2, "omega_3": -1.5}
entries = sp.lambdify(turn.coordinates, sp.flatten(turn.matrix))


def about_contact(run) -> np.ndarray:
    """R I omega + m e3 x (omega x e3) (m, 3), in space."""
    R = np.stack(
        [np.broadcast_to(e, times.shape) for e in entries(*(run[q] for q in turn.coordinates))], axis=1
    )
    R, omega = R.reshape(-1, 3, 3), np.stack([run[w] for w in names], axis=1)
    inertia = np.array([float(system.parameters[J]) for J in moments])
    return np.einsum("tij,tj->ti", R, inertia * omega) + np.einsum("tij,tj->ti", R, omega) * [1, 1, 0]


axes = Figure(figsize=(5.4, 4.2), layout="constrained").subplots()
rolling = gsp.integrate(ball.limit.full_field, start=start, span=(0, 12), at=times, rtol=1e-10, atol=1e-12)
print(f"angular momentum about the contact moves by {np.abs(np.ptp(about_contact(rolling), axis=0)).max():.1e}")
forward = np.array([rolling["x"][-1], rolling["y"][-1]])
forward /= np.hypot(*forward)


def draw(run, style: str, label: str) -> None:
    """The path along the way forward and, much enlarged, across it."""
    along, across = forward @ [run["x"], run["y"]], forward @ [run["y"], -run["x"]]
    axes.plot(along, across, style, label=label)


draw(rolling, "--", "no slip")
for value in (0.4, 0.2):
    run = gsp.integrate(
        ball.full_field, start={**start, "w1": 0, "w2": 0}, span=(0, 12), epsilon=value, at=times
    )
    print(f"epsilon = {value}: by {np.abs(np.ptp(about_contact(run), axis=0)).max():.3f}")
    draw(run, "-", f"epsilon = {value}")

# %%
# The ball weaves about its way; slip damps that, and slows the ball down.
assert np.abs(np.ptp(about_contact(rolling), axis=0)).max() < 1e-7
axes.set(xlabel="way forward", ylabel="way to the left")
axes.legend(frameon=False)
