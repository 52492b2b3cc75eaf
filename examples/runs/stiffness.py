"""
What stiffness costs
====================

The same run at ever smaller epsilon: an explicit method needs ever more steps, an implicit one does not. Steps
are counted, not timed.
"""

import numpy as np
from matplotlib.figure import Figure

import gsp

scene = gsp.models.load("chaplygin_sleigh")
epsilons = np.geomspace(1e-1, 1e-4, 7)
steps = {
    method: [
        gsp.integrate(
            scene.system, start=scene.start, span=(0, 3), epsilon=float(e), rtol=1e-6, atol=1e-9, method=method
        ).stats.steps
        for e in epsilons
    ]
    for method in (gsp.Method.DOP853, gsp.Method.RADAU9, gsp.Method.RADAU13)
}
for method, counts in steps.items():
    print(f"{method.name:8}", *(f"{count:7}" for count in counts))

# %%
# The explicit method takes steps in proportion to 1/epsilon.
explicit = steps[gsp.Method.DOP853]
slope = np.log(explicit[-1] / explicit[-3]) / np.log(epsilons[-3] / epsilons[-1])
assert abs(slope - 1) < 0.1
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
for method, counts in steps.items():
    axes.loglog(epsilons, counts, "o-", label=method.name)
axes.set(xlabel="epsilon", ylabel="steps")
axes.legend(frameon=False)
