"""
Glycolysis and its fold
=======================

In Sel'kov's model of glycolysis the product is fast. On the critical manifold the slow rate is b - x.

Source: S. H. Strogatz, Nonlinear Dynamics and Chaos, section 7.3.
"""

import sympy as sp

import gsp

y, x, a, b, epsilon = sp.symbols("y x a b epsilon")
system = gsp.SlowFastSystem(
    slow={y: b - a * y - x**2 * y},
    fast={x: -x + a * y + x**2 * y},
    epsilon=epsilon,
    parameters={a: sp.Rational(1, 25), b: sp.Rational(1, 10)},
)
curve = gsp.continue_critical(system, start={"y": 1, "x": 0.05}, bounds={"y": (0, 2.7), "x": (0, 1)})
print(curve)

# %%
# The fold is at x = sqrt(a), y = 1/(2 sqrt(a)).
(fold,) = curve.of_kind(gsp.SpecialKind.FOLD)
assert abs(fold.point["x"] - 0.2) < 1e-9
assert abs(fold.point["y"] - 2.5) < 1e-9
axes = curve.plot()
