"""
Four ways to lose normal hyperbolicity
======================================

Four systems lose normal hyperbolicity, each in its own way. `classify` names the loss and says what follows.
"""

import numpy as np
import sympy as sp

import gsp

x, u, y, z, epsilon = sp.symbols("x u y z epsilon")
systems = {
    "a relaxation oscillator": ({x: sp.Rational(1, 2) - y}, {y: x - y**3 / 3 + y}, {"x": (-1, 1)}),
    "two branches that cross": ({x: sp.Integer(1)}, {y: y * (x - y) + 2 * epsilon}, {"x": (-1, 1)}),
    "an unfolded cusp": (
        {x: sp.Integer(1), u: sp.Rational(1, 2)},
        {y: x + u * y - y**3},
        {"x": (-1, 1), "u": (-1, 1)},
    ),
    "damping that is quadratic": ({x: -x}, {y: x - y, z: -z * sp.Abs(z)}, {"x": (-1, 1)}),
}
for name, (slow, fast, region) in systems.items():
    system = gsp.SlowFastSystem(slow=slow, fast=fast, epsilon=epsilon)
    branch = gsp.solve_critical(system).branches[0]
    verdict = gsp.classify(branch, region=region)
    print(name)
    for loss in verdict.losses:
        print(" ", loss.headline)
        print("   ", loss.consequence)
        print("    reduction", "may go on:" if loss.may_reduce else "ends here:", loss.remedy)
    if verdict.sub_region is not None:
        print("  it holds", verdict.sub_region)

# %%
# The cusp, drawn: over the point (x, u) = (0, 0) three sheets become one.
cusp = gsp.SlowFastSystem(slow={x: 1, u: sp.Rational(1, 2)}, fast={y: x + u * y - y**3}, epsilon=epsilon)
sheet = gsp.critical_sheet(
    cusp, start={"x": 0.5, "u": -1, "y": 0.4}, bounds={"x": (-1, 1), "u": (-1, 1), "y": (-2, 2)}
)
fold = sheet.folds[0]
# On the fold curve 27 x^2 = 4 u^3.
assert np.abs(27 * fold["x"] ** 2 - 4 * fold["u"] ** 3).max() < 1e-8
axes = sheet.plot()
