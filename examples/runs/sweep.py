"""
A sweep that is stopped and goes on
===================================

A sweep over two parameters of the sleigh that is stopped and goes on: where is a reduced model of order 1
enough?
"""

import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import gsp

AXES = {"a": (0.1, 0.2, 0.4, 0.8), "epsilon": np.geomspace(0.003, 0.1, 6)}


def stop_halfway(share: float) -> None:
    if share > 0.5:
        raise KeyboardInterrupt


with tempfile.TemporaryDirectory() as scratch:
    call = {
        "model": "chaplygin_sleigh", "over": AXES, "options": {"orders": [0, 1]}, "into": Path(scratch, "runs"),
        "workers": 1, "points_per_chunk": 3,
    }  # fmt: skip
    try:
        gsp.sweep("compare", **call, progress=stop_halfway)
    except KeyboardInterrupt:
        print(f"stopped: {gsp.Sweep(call['into'])!r}")
    sweep = gsp.sweep("compare", **call)
    print(sweep)
    error = sweep.to_xarray().error.load()
    print("\nlargest relative error of the reduced flow of order 1, and its power of epsilon")
    for a in AXES["a"]:
        row = error.sel(a=a, order=1).values
        slope = np.polyfit(np.log(AXES["epsilon"]), np.log(row), 1)[0]
        print(f"  a = {a:.1f}  " + "  ".join(f"{value:.1e}" for value in row) + f"  slope {slope:.2f}")

# %%
# The error of order 1 falls like epsilon squared.
assert abs(slope - 2) < 0.1
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
for a in AXES["a"]:
    axes.loglog(AXES["epsilon"], error.sel(a=a, order=1).values, "o-", label=f"a = {a}")
axes.set(xlabel="epsilon", ylabel="relative error")
axes.legend(frameon=False)
