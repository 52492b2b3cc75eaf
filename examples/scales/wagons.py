"""
Wagons on stiff couplings
=========================

Three wagons, joined by stiff springs and dampers, roll over a gentle track. No position and no velocity is fast by
itself, and no parameter is small. What is fast are combinations of them: how the wagons move against one another. What
stays is how they move together.
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp

x, v = sp.symbols("x1:4"), sp.symbols("v1:4")
masses = (1, 2, 1)
pull = [900 * (x[k + 1] - x[k]) + 50 * (v[k + 1] - v[k]) for k in range(2)]
track = [sp.sin(0.3 * x[0]), 0, 0]
forces = [track[0] - v[0] / 5 + pull[0], -v[1] / 5 - pull[0] + pull[1], -v[2] / 5 - pull[1]]
wagons = gsp.VectorField(dict(zip(x, v)) | {v[k]: forces[k] / sp.Integer(masses[k]) for k in range(3)})
start = {"x1": 0.5, "v1": 0, "x2": 0.55, "v2": 0, "x3": 0.6, "v3": 0}
scene = gsp.Scene(wagons, region={}, start=start, span=(0, 20), tolerance=1e-3)
found = gsp.find_reductions(scene)
print(found)

# %%
# Six states become two: the centre of mass and its velocity. The directions that are left out are the simplest that the
# gap between the rates allows, and so the weights in the sums are the masses.
best = found.recommended
assert best is not None
assert best.name.startswith("quasi-steady state along")
study = gsp.study(best.scene)
together = [study.splitting.coordinates[s] for s in study.system.x]
print(*together, sep="\n")
assert {sp.expand(total / total.coeff(sp.Symbol(f"{letter}1"))) for total, letter in zip(together, "xv")} == {
    sum(m * s for m, s in zip(masses, states)) for states in (x, v)
}

# %%
# The couplings pull the wagons together within a tenth of a unit of time. From then on they roll as one.
at = np.append(np.linspace(0, 0.6, 300), np.linspace(0.7, 20, 300))
full = gsp.integrate(wagons, start=start, span=scene.span, at=at)
base = study.base_point(best.order)
run = gsp.integrate(study.reduced(best.order), start=base, span=scene.span, epsilon=best.scene.epsilon, at=at)
states = [sp.Symbol(name) for name in start]
exact = sp.lambdify(states, together[0])(*(full[name] for name in start))
centre = run[study.system.x[0].name]
error = np.abs(centre - exact).max() / np.abs(exact).max()
print(f"largest relative error of {together[0]}: {error:.1e}")
assert error < 1e-3

axes = Figure(figsize=(6, 3.5)).add_subplot()
for wagon in ("x1", "x2", "x3"):
    axes.plot(at[:300], full[wagon][:300], label=f"{wagon}, full")
axes.plot(at[:300], centre[:300] / sum(masses), "k--", label="centre of mass, reduced")
axes.set_xlabel("t")
axes.legend()
