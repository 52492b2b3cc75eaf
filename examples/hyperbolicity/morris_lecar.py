"""
The knees of a muscle fibre
===========================

Morris and Lecar model the muscle fibre of a barnacle. The knees of its critical manifold are the extrema of w over
the voltage.

Source: C. Morris and H. Lecar, Biophysical Journal 35 (1981) 193-213.
"""

import numpy as np
import sympy as sp
from scipy.optimize import brentq

import gsp

w, V, epsilon = sp.symbols("w V epsilon")
rest = 90 - 2 * (V + 60) - sp.Rational(22, 5) * (1 + sp.tanh((V + sp.Rational(6, 5)) / 18)) / 2 * (V - 120)
fibre = gsp.SlowFastSystem(
    slow={w: ((1 + sp.tanh((V - 2) / 30)) / 2 - w) * sp.cosh((V - 2) / 60)},
    fast={V: (rest - 8 * w * (V + 84)) / 20},
    epsilon=epsilon,
    name="Morris-Lecar",
)
curve = gsp.continue_critical(fibre, start={"w": 0.27, "V": -50}, bounds={"V": (-60, 60), "w": (-0.1, 0.8)})
print(curve)

# %%
# A second route: w = rest(V)/(8 (V + 84)) on the curve, and its derivative vanishes at the knees.
slope = sp.lambdify(V, sp.diff(rest / (8 * (V + 84)), V), "numpy")
knees = [brentq(slope, -45, -20), brentq(slope, -5, 30)]
found = sorted(fold.point["V"] for fold in curve.of_kind(gsp.SpecialKind.FOLD))
assert np.allclose(found, knees, rtol=0, atol=1e-7)
axes = curve.plot()
