"""
Results as tables
=================

What was measured goes to pandas and xarray with its names. Here these are the runs of an ensemble, and errors of
reduced flows.
"""

import numpy as np
from matplotlib.figure import Figure

import gsp

scene = gsp.models.load("michaelis_menten")
starts = np.linspace(0.2, 1.0, 25)
times = np.linspace(0.5, 5.0, 10)


def runs(flow: object, epsilon: float):
    ensemble = gsp.integrate_many(flow, {"s": starts, "c": 0.0}, span=(0, 5), epsilon=epsilon, at=times)
    return ensemble.to_xarray()


# %%
# The full system against itself at half of epsilon: two data sets on one grid of members and times.
wide, narrow = runs(scene.system, 0.04), runs(scene.system, 0.02)
print(wide)
change = abs(wide.s - narrow.s).max("t")
assert change.dims == ("member",)
assert change.sizes["member"] == 25

# %%
# Errors of the reduced flows as a data frame.
frame = gsp.compare(scene, orders=(0, 1, 2), epsilons=(0.04, 0.02, 0.01)).to_pandas()
print(frame[["error", "slope", "expected"]])
errors = frame["error"].unstack("order")
ratios = errors.loc[0.02] / errors.loc[0.01]
assert abs(np.log2(ratios[2]) - 3) < 0.1

axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
axes.loglog(errors.index, errors.to_numpy(), "o-")
axes.set(xlabel="epsilon", ylabel="largest relative error")
axes.legend([f"order {order}" for order in errors.columns], frameon=False)
