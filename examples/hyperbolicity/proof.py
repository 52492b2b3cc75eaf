"""
A proof, and its checker
========================

Prove that a branch is normally hyperbolic, write the proof, and check it by other code.
"""

import tempfile
from pathlib import Path

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp
from gsp.proofs.verification import verify

y, x, eps = sp.symbols("y x epsilon")
system = gsp.SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=eps)
branch = gsp.solve_critical(system).branches[0].through({"y": 1.0, "x": 2.1})

# To within 1e-6 of the fold at y = -2/3, and across it.
near = gsp.certify(branch, region={"y": (-2 / 3 + 1e-6, 2.0)})
across = gsp.certify(branch, region={"y": (-1.0, 2.0)})
print(near)
print(across)

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder, "proof.json")
    near.save(file)
    print(verify(file))

# %%
# The proved gap is below the true one at the end of the region, and near it.
# The gap goes to zero at the fold as a square root.
at = np.linspace(-2 / 3 + 1e-6, 2, 400)
gaps = np.array([float(branch.points({"y": value})[0]) ** 2 - 1 for value in at])
assert 0 < near.gap <= gaps[0] < 1.2 * near.gap
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
axes.plot(at, gaps)
axes.axhline(near.gap, ls="--", color="grey")
axes.set(xlabel="y", ylabel="gap in fast time")
