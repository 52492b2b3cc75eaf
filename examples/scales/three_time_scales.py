"""
Three time scales
=================

A substrate z makes a messenger m, which an enzyme binds to a complex c. Binding is fastest, the messenger follows the
substrate, and the substrate lasts. The slow manifold within the slow manifold is a series in both small parameters.
"""

import sympy as sp

import gsp

z, m, c, epsilon, delta = sp.symbols("z m c epsilon delta")
field = gsp.VectorField(
    {z: m / 4 - z, m: (z - m * (1 + c)) / delta, c: (m - c * (1 + m)) / (epsilon * delta)},
    epsilon=epsilon,
    parameters={delta: 0.02},
)
scene = gsp.Scene(field, {"z": (0.1, 1), "m": (0.05, 1)}, {"z": 1, "m": 0.1, "c": 0}, (0, 2), 0.05)
nested = gsp.nest(scene, small=["epsilon", "delta"])
print(nested.explain())
print(nested.first.hyperbolicity)
print(nested.second.hyperbolicity)

# %%
# The errors of the flow on the inner manifold fall with both parameters together, and with each alone.
together = gsp.compare(nested)
print(together)
for name, study in nested.alone.items():
    alone = gsp.compare(study, orders=(0, 1))
    print(name, alone.slopes)
    assert abs(alone.slopes[1] - 2) < 0.2
assert abs(together.slopes[1] - 2) < 0.2

# %%
# From the start binding comes first, onto C1; then the messenger moves along C1 to C2; then all moves along C2. Dashed
# is the flow on C2.
axes = nested.plot()
