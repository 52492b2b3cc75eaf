"""
Prey, predators and a fold
==========================

The prey grows faster than its predator. The sheet of the prey has a fold, beyond which the prey collapses.

Source: S. Rinaldi and S. Muratori, Ecological Modelling 61 (1992) 287-308.
"""

import sympy as sp

import gsp

v, u, h, m, epsilon = sp.symbols("v u h m epsilon")
system = gsp.SlowFastSystem(
    slow={v: v * (u / (u + h) - m)},
    fast={u: u * (1 - u) - u * v / (u + h)},
    epsilon=epsilon,
    parameters={h: sp.Rational(1, 4), m: sp.Rational(1, 2)},
)
curve = gsp.continue_critical(system, start={"u": 0.8, "v": 0.21}, bounds={"u": (0.01, 1), "v": (0, 0.5)})
print(curve)

# %%
# The fold is at u = (1 - h)/2, v = (1 + h)^2/4.
(fold,) = curve.of_kind(gsp.SpecialKind.FOLD)
assert abs(fold.point["u"] - 3 / 8) < 1e-9
assert abs(fold.point["v"] - 25 / 64) < 1e-9
axes = curve.plot()
