"""
Which parameters may be small?
==============================

Prey B, searching predators S and handling predators H, with six rates (Kruff, Lax, Liebscher and Walcher 2019). No
rate is said to be small. All choices that leave a slow manifold of two dimensions are found, and the
Rosenzweig-MacArthur system is one of them.
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp

B, S, H = sp.symbols("B S H")
alpha, beta, gamma, delta, eta, rho = sp.symbols("alpha beta gamma delta eta rho")
field = gsp.VectorField(
    {
        B: rho * B * (1 - B) - alpha * B * H,
        S: -eta * S + gamma * B * H,
        H: beta * S - delta * H + eta * S - gamma * B * H,
    },
    epsilon=None,
    parameters={alpha: 2, beta: 0.05, gamma: 2, delta: 2, eta: 0.05, rho: 0.1},
)
found = gsp.small_parameters(field, dimensions=[2])
values = {each.vanishing for each in found}
print(len(found), "reductions at", len(values), "special values")
assert len(values) == 15

# %%
# Slow birth and death, fast handling: H = 0 attracts.
(system,) = [each for each in found if each.vanishing == ("beta", "eta", "rho")]
print(system)
for state, rate in system.reduced.items():
    print(f"{state}' = {rate}")
below = delta + gamma * B
wanted = rho * B * (1 - B) - alpha * (eta + beta) * B * S / below
assert sp.cancel(system.reduced[B] - wanted) == 0

# %%
# At the given rates, epsilon is 1. How far the reduced run is from the full one is seen at once.
span, at = (0.0, 120.0), np.linspace(0.0, 120.0, 400)
full = gsp.integrate(field, start={"B": 0.6, "S": 0.3, "H": 0.0}, span=span, at=at)
reduced = gsp.integrate(
    gsp.VectorField(dict(system.reduced), epsilon=None, parameters=field.parameters),
    start={"B": 0.6, "S": 0.3},
    span=span,
    at=at,
)
error = np.abs(full["B"] - reduced["B"]).max()
print(f"largest difference of B: {error:.3f}")
assert error < 0.1

axes = Figure(figsize=(6, 3.5)).add_subplot()
axes.plot(full["B"], full["S"], label="full, three variables")
axes.plot(reduced["B"], reduced["S"], "--", label="reduced, two variables")
axes.set_xlabel("prey B")
axes.set_ylabel("searching predators S")
axes.legend()
