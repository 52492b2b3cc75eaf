"""
A neuron begins to fire
=======================

FitzHugh and Nagumo's neuron under a growing current: its rest loses stability at a Hopf point, and cycles
explode behind it.

Source: R. FitzHugh, Biophysical Journal 1 (1961) 445-466.
"""

import math

import sympy as sp

import gsp

v, w, current, epsilon = sp.symbols("v w I epsilon")
neuron = gsp.SlowFastSystem(
    slow={w: v + sp.Rational(7, 10) - sp.Rational(4, 5) * w},
    fast={v: v - v**3 / 3 - w + current},
    epsilon=epsilon,
    parameters={current: 0},
)
(hopf,) = gsp.hopf_points(
    neuron, start={"v": -1.2, "w": -0.6}, parameter=current, bounds=(0, 0.6), epsilon=0.05
)
print(hopf)
family = gsp.continue_orbits(hopf, bounds=(0.2, 0.6), max_points=60)
print(family)

# %%
# The trace of the Jacobian, (1 - v^2)/epsilon - 4/5, is zero at the Hopf point.
at = -math.sqrt(1 - 0.8 * 0.05)
assert abs(hopf.value - (at**3 / 3 - at + (at + 0.7) / 0.8)) < 1e-9
axes = family.plot()
