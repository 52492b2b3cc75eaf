"""
Classical reductions, side by side
==================================

Davis and Skodje's test problem has the slow manifold y2 = y1/(1 + y1) at every epsilon. Quasi-steady state,
ILDM, CSP, iterations and the series try to find it.
"""

import gsp

scene = gsp.models.load("davis_skodje")
table = gsp.method_table(scene)
print(table)

# %%
# The solved manifold is the exact one to its tolerance.
branch = gsp.solve_critical(scene.system).branches[0]
solved = gsp.solve_manifold(branch, region={"y1": (0.1, 3)}, epsilon=0.1, tolerance=1e-11)
assert abs(solved.evaluate(1.0)[0] - 0.5) < 1e-9
axes = table.plot()
