"""
A reduced flow for another program
==================================

`export` writes the reduced flow as text in any of `gsp.exports.TARGETS`. Here SciPy
integrates what was written, without gsp.
"""

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import gsp

scene = gsp.models.load("michaelis_menten")
text = gsp.export(scene, order=2, to="python")
print(text)
alone: dict = {}
exec(text, alone)
times = np.linspace(0, 5, 101)
theirs = solve_ivp(alone["rates"], (0, 5), [1.0], t_eval=times, rtol=1e-10, atol=1e-12)

# %%
# The flow within the package gives the same.
flow = gsp.restrict(gsp.study(scene).series(2), order=2)
ours = gsp.integrate(flow, start={"s": 1.0}, span=(0, 5), epsilon=scene.epsilon, rtol=1e-11, at=times)
assert np.abs(theirs.y[0] - ours["s"]).max() < 1e-8

# %%
# On an implicit branch the states are coordinates of the critical manifold: here x0, from which y is read as x is.
oscillator = gsp.models.load("van_der_pol")
exec(gsp.export(oscillator, order=1, to="python"), folded := {})
fall = solve_ivp(folded["rates"], (0, 0.5), folded["start"], rtol=1e-10, atol=1e-12)
y, x = folded["slow_manifold"](fall.y[:, -1])
print(f"y = {y:.6f}, x = {x:.6f}")

# %%
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
axes.plot(times, theirs.y[0], label="substrate")
axes.plot(times, alone["slow_manifold"](theirs.y)[0], label="complex, from the slow manifold")
axes.set(xlabel="t")
axes.legend(frameon=False)
