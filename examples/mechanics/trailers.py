"""
Two trailers
============

A car tows two trailers, each hitched to the axle before it, with a spring at each hitch. All angles are measured from
one axis in space, as one would write them down; the equations are derived in the angles between neighbours, in which
they have 150 terms (37,000 where both trailers are measured from the car). Tyres that slip a little let the last axle
drift out of the bend by O(epsilon), and the reduced flows follow it with one power of epsilon more for each order.
"""

from itertools import pairwise

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp
from gsp.mechanics import LagrangianSystem, with_friction

x, y, xdot, ydot, m, J, d, k, epsilon = sp.symbols("x y xdot ydot m J d k epsilon")
angles, rates = sp.symbols("theta0:3"), sp.symbols("omega0:3")

# %%
# Axle i is the length d behind axle i - 1, and its wheels do not move sideways.
velocities = [(xdot, ydot)]
for angle, rate in zip(angles[1:], rates[1:]):
    ahead = velocities[-1]
    velocities.append((ahead[0] + d * sp.sin(angle) * rate, ahead[1] - d * sp.cos(angle) * rate))
L = sum(m * (v[0] ** 2 + v[1] ** 2) / 2 + J * rate**2 / 2 for v, rate in zip(velocities, rates))
L -= sum(k * (behind - ahead) ** 2 / 2 for ahead, behind in pairwise(angles))
slips = [v[1] * sp.cos(angle) - v[0] * sp.sin(angle) for v, angle in zip(velocities, angles)]
system = LagrangianSystem(
    sp.expand(L), [x, y, *angles], [xdot, ydot, *rates], parameters={m: 1, J: 0.2, d: 0.7, k: 0.4}
)
towing = with_friction(system, slips, epsilon=epsilon)
print("slow:", *towing.standard_form.x, " fast:", *towing.standard_form.y)

scene = towing.scene(
    region={s.name: (-4, 4) for s in towing.standard_form.states},
    start={"x": 0, "y": 0, "xdot": 1, "ydot": 0, "omega0": 1.2, "omega1": 0, "omega2": 0}
    | {angle.name: 0 for angle in angles},
    span=(0, 3),
    epsilon=0.02,
    name="trailers",
)
compared = gsp.compare(scene, orders=(0, 1))
print(compared)


# %%
# The path of the last axle as its tyres slip more and more.
def last_axle(run) -> list[np.ndarray]:
    """Its position (2, m): the car's, less the lengths of the trailers."""
    lengths = float(system.parameters[d])
    back = [sum(turn(run[angle]) for angle in angles[1:]) for turn in (np.cos, np.sin)]
    return [run[q] - lengths * part for q, part in zip((x, y), back)]


axes = Figure(figsize=(5.4, 3.6), layout="constrained").subplots()
start = {s.name: value for s, value in zip(towing.limit.full_field.states, [0, 0, 0, 1, 1.2, 0, 0])}
times = np.linspace(0, 3, 201)
rolling = gsp.integrate(towing.limit.full_field, start=start, span=(0, 3), at=times)
axes.plot(*last_axle(rolling), "--", label="no slip")
ends = [np.array(last_axle(rolling))[:, -1]]
for value in (0.02, 0.04):
    slipping = gsp.integrate(
        towing.full_field, start=start | {"w1": 0, "w2": 0, "w3": 0}, span=(0, 3), epsilon=value, at=times
    )
    axes.plot(*last_axle(slipping), label=f"epsilon = {value}")
    ends.append(np.array(last_axle(slipping))[:, -1])
off = [float(np.hypot(*(end - ends[0]))) for end in ends[1:]]
print(f"the last axle ends {off[0]:.3f} and {off[1]:.3f} away from where it rolls to")

# %%
# Twice the slip is twice as far away, and an order is a power of epsilon.
assert 1.6 < off[1] / off[0] < 2.4
assert all(abs(compared.slopes[order] - order - 1) < 0.25 for order in compared.slopes)
axes.set(xlabel="x", ylabel="y", aspect="equal")
axes.legend(frameon=False)
