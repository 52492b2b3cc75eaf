"""
The smallest nonholonomic system
================================

A free particle obeys the constraint z' = y x'. This is the limit of friction against the slip z' - y x', and the
particle moves on a catenary.

Source: R. M. Rosenberg, Analytical Dynamics of Discrete Systems (1977).
"""

import gsp

scene = gsp.models.load("nonholonomic_particle")
particle = gsp.models.friction_system("nonholonomic_particle")
print(particle.limit)
comparison = gsp.compare(scene, orders=(0, 1, 2))
print(comparison)

# %%
# In the limit x' sqrt(1 + y^2) is constant. The power of epsilon of each order is as it must be.
limit = gsp.integrate(
    particle.limit.full_field,
    start={"x": -1.45, "y": -2, "z": 2.24, "xdot": 0.45, "ydot": 1},
    span=(0, 4),
    rtol=1e-11,
)
invariant = limit["xdot"] * (1 + limit["y"] ** 2) ** 0.5
assert abs(invariant - invariant[0]).max() < 1e-8
assert abs(comparison.slopes[1] - 2) < 0.15
axes = comparison.plot()
