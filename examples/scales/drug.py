"""
A drug that binds its target
============================

A drug C, its target R and their complex RC. The target is made, and drug, target and complex are removed. Binding is
said to be nothing in particular, and is found to be a partial equilibrium: totals of drug and of target are slow.
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp

C, R, RC = sp.symbols("C R RC")
kel, kon, koff, ksyn, kdeg, kint = sp.symbols("kel kon koff ksyn kdeg kint")
bound = kon * C * R - koff * RC
drug = gsp.VectorField(
    {C: -kel * C - bound, R: ksyn - kdeg * R - bound, RC: bound - kint * RC},
    parameters={kel: 0.1, kon: 100, koff: 10, ksyn: 0.1, kdeg: 0.1, kint: 0.2},
)
scene = gsp.Scene(drug, region={}, start={"C": 5, "R": 1, "RC": 0}, span=(0, 30), tolerance=0.05)
found = gsp.find_reductions(scene)
print(found)

# %%
# What is taken has two slow variables, of which neither is a state of the model.
best = found.recommended
assert best is not None
assert "RC <-> C + R" in best.name
study = gsp.study(best.scene)
print({x.name: study.splitting.coordinates[x] for x in study.system.x})
assert len(study.system.x) == 2

# %%
# The drug that is left: of the full model, and by the reduced one where its totals are.
at = np.linspace(0, 30, 300)
full = gsp.integrate(drug, start=scene.start, span=scene.span, at=at)
run = gsp.integrate(
    study.reduced(best.order),
    start=study.base_point(best.order),
    span=scene.span,
    epsilon=best.scene.epsilon,
    at=at,
)
slow = study.system.x[0]
exact = sp.lambdify((C, R, RC), study.splitting.coordinates[slow])(full["C"], full["R"], full["RC"])
error = np.abs(run[slow.name] - exact).max() / np.abs(exact).max()
print(f"largest relative error of {slow}: {error:.4f}")
assert error < 0.05

axes = Figure(figsize=(6, 3.5)).add_subplot()
axes.plot(at, exact, label="full, three variables")
axes.plot(at, run[slow.name], "--", label="reduced, two variables")
axes.set_xlabel("t")
axes.set_ylabel(f"{slow} = {study.splitting.coordinates[slow]}")
axes.legend()
