"""
The Chaplygin sleigh
====================

The Chaplygin sleigh slides on a skate with the friction w/epsilon. The script finds its slow momentum, derives equation
(18), and measures how good each order is.

After J. Eldering, "Nonholonomic dynamics as limit of friction: an introduction by example" (2015).
"""

import sympy as sp

import gsp

v, omega, w, m, inertia, a, epsilon = sp.symbols("v omega w m I a epsilon")
J = inertia + m * a**2
field = gsp.VectorField(
    states={
        v: omega * w + a * omega**2,
        omega: a * w / (inertia * epsilon),
        w: -v * omega - J * w / (inertia * m * epsilon),
    },
    epsilon=epsilon,
    parameters={m: 1, inertia: 1, a: 0.2},
    name="sleigh",
)
splitting = gsp.split(field)
print(splitting.explain())
system = splitting.system
assert system is not None

branch = gsp.solve_critical(system).branches[0]
print(gsp.classify(branch, region={"v": (-2, 2), "p": (-2, 2)}, epsilon=0.05))

series = gsp.expand(branch, order=3)
for k, h in enumerate(series.coefficients):
    print(f"h_{k} = {h['w']}")

# In (v, omega) the reduced field through O(epsilon) is equation (18), with a minus sign in v'.
scene = gsp.models.load("chaplygin_sleigh")
raw = gsp.analyse(scene, orders=(0,)).raw
assert raw is not None
for k in (0, 1):
    print(f"epsilon^{k}: {raw.reduced_field[k].as_dict()}")

comparison = gsp.compare(scene)
print(comparison)

# %%
# The error of order N falls like the power N + 1 of epsilon.
for order, slope in comparison.slopes.items():
    assert abs(slope - (order + 1)) < 0.1
axes = comparison.plot()
