"""
Which motion extremises the action?
===================================

Lagrange's equations (2) say that the action (3) does not change to first order when a motion is varied. The motion
without slip does not do that: varied across the constraint its action changes, by minus the work of the constraint
force. Along the constraint it does not change, and that is d'Alembert's principle.

Source: J. Eldering, "Nonholonomic dynamics as limit of friction: an introduction by example" (2015), (3), (8), (9).
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp
from gsp.mechanics import constrain

sleigh = gsp.models.lagrangian_system("sleigh_from_lagrangian")
x, y, phi = sleigh.coordinates
xdot, ydot, phidot = sleigh.velocities
limit = constrain(sleigh, [-xdot * sp.sin(phi) + ydot * sp.cos(phi)])

# The variations eta vanish at both ends of [0, 2]; the first is across the blade, the others along it and in phi.
span = (0, 2)
nodes, weights = np.polynomial.legendre.leggauss(40)
times, weights = 1 + nodes, weights
bump, slope = np.sin(np.pi * times / 2) ** 2, np.pi / 2 * np.sin(np.pi * times)
start = {"x": 0, "y": 0, "phi": 0, "xdot": 1, "ydot": 0, "phidot": 1.5}
run = gsp.integrate(limit.field, start=start, span=span, at=times, rtol=1e-11, atol=1e-12)
heading, turning = run["phi"], run["phidot"]
directions = {
    "across the blade": (-np.sin(heading), np.cos(heading), 0 * times),
    "along the blade": (np.cos(heading), np.sin(heading), 0 * times),
    "turned": (0 * times, 0 * times, 1 + 0 * times),
}
turned = {
    "across the blade": (-np.cos(heading) * turning, -np.sin(heading) * turning, 0 * times),
    "along the blade": (-np.sin(heading) * turning, np.cos(heading) * turning, 0 * times),
    "turned": (0 * times, 0 * times, 0 * times),
}
parameters = {p: float(value) for p, value in sleigh.parameters.items()}
lagrangian = sp.lambdify([*sleigh.coordinates, *sleigh.velocities], sleigh.lagrangian.subs(parameters))
multiplier = sp.lambdify([phi, xdot, ydot, phidot], limit.multipliers[0].subs(parameters))


def action(name: str, size: float) -> float:
    """S (3) of the motion varied by `size` eta, by Gauss's rule."""
    eta = [bump * d for d in directions[name]]
    rate = [slope * d + bump * e for d, e in zip(directions[name], turned[name])]
    q = [run[s] + size * e for s, e in zip(sleigh.coordinates, eta)]
    v = [run[s] + size * e for s, e in zip(sleigh.velocities, rate)]
    return float(weights @ lagrangian(*q, *v))


force = multiplier(heading, run["xdot"], run["ydot"], turning)
print("variation          dS/ds      minus the work of the constraint force")
steps = np.linspace(-0.5, 0.5, 41)
axes = Figure(figsize=(5.4, 4), layout="constrained").subplots()
for name, (a, b, _) in directions.items():
    change = (action(name, 1e-4) - action(name, -1e-4)) / 2e-4
    work = float(weights @ (force * bump * (-np.sin(heading) * a + np.cos(heading) * b)))
    print(f"{name:16} {change:9.5f}  {-work:9.5f}")
    assert abs(change + work) < 1e-6
    axes.plot(steps, [action(name, s) - action(name, 0) for s in steps], label=name)

# %%
# Two of the three curves are flat where the motion is not varied.
axes.axvline(0, color="0.8", linewidth=1, zorder=0)
axes.set(xlabel="size of the variation", ylabel="change of the action")
axes.legend(frameon=False)
