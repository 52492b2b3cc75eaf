"""
Folds, followed
===============

The critical manifold is followed through its folds: as FitzHugh-Nagumo's curve, and as Koper's sheet. The folds of the
curve are then followed over the current.
"""

import sympy as sp

import gsp

v, w, current, a, b, epsilon = sp.symbols("v w I a b epsilon")
neuron = gsp.SlowFastSystem(
    slow={w: v + a - b * w},
    fast={v: v - v**3 / 3 - w + current},
    epsilon=epsilon,
    parameters={a: 0.7, b: 0.8, current: 0.5},
    name="FitzHugh-Nagumo",
)
# One curve of M0 through both folds: stability changes there, and the reduced flow ends.
curve = gsp.continue_critical(neuron, start={"v": -1.5, "w": 0.1}, bounds={"v": (-2.5, 2.5), "w": (-2, 2)})
print(curve)

# A fold followed over a parameter: (v, w, I) = (-1, I - 2/3, I).
fold = curve.of_kind(gsp.SpecialKind.FOLD)[0]
along = gsp.continue_folds(neuron, start=fold.point, parameter=current, bounds={"I": (0, 2), "w": (-3, 3)})
print(along)

# Two slow variables: M0 as a sheet, cut along its fold curves.
koper = gsp.models.load("koper").system
sheet = gsp.critical_sheet(
    koper, start={"x": 2.4, "y": 0, "z": 0.5}, bounds={"x": (-2.6, 2.6), "y": (-3, 2), "z": (0, 1)}
)
print(f"{len(sheet.triangles)} triangles, {len(sheet.folds)} fold curves: {sheet.message}")
for curve_of_folds in sheet.folds:
    print(f"  x from {curve_of_folds['x'].min():.6f} to {curve_of_folds['x'].max():.6f}")

# %%
# The folds of the neuron are at v = -1 and v = 1, whatever its parameters are.
assert sorted(round(found.point["v"], 9) for found in curve.of_kind(gsp.SpecialKind.FOLD)) == [-1, 1]
axes = curve.plot()
