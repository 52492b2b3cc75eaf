"""
Where a burst begins
====================

Hindmarsh and Rose's neuron bursts. It is silent on the left sheet of its critical manifold, until that ends at
a fold.

Source: J. L. Hindmarsh and R. M. Rose, Proceedings of the Royal Society of London B 221 (1984) 87-102.
"""

import sympy as sp

import gsp

x, y, z, current, epsilon = sp.symbols("x y z I epsilon")
neuron = gsp.SlowFastSystem(
    slow={z: 4 * (x + sp.Rational(8, 5)) - z},
    fast={x: y - x**3 + 3 * x**2 - z + current, y: 1 - 5 * x**2 - y},
    epsilon=epsilon,
    parameters={current: sp.Rational(13, 4)},
)
start = {"z": 3.8, "x": -1.876, "y": -16.6}
curve = gsp.continue_critical(neuron, start=start, bounds={"z": (-2, 6), "x": (-2.2, 1), "y": (-25, 2)})
print(curve)

# %%
# The left fold is at x = -4/3, z = 1 + I - 32/27.
left = min(curve.of_kind(gsp.SpecialKind.FOLD), key=lambda fold: fold.point["x"])
assert abs(left.point["x"] + 4 / 3) < 1e-8
assert abs(left.point["z"] - (1 + 3.25 - 32 / 27)) < 1e-8
axes = curve.plot()
