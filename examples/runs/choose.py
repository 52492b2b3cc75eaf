"""
What a scene needs
==================

`choose` predicts error and cost of every model. `simulate` runs a relaxation oscillation by two of them in turn.
"""

from dataclasses import replace

import numpy as np

import gsp

# The sleigh at three tolerances: the predicted error of each order does not move, what serves does.
sleigh = gsp.models.load("chaplygin_sleigh")
for tolerance in (1e-2, 1e-3, 1e-5):
    choice = gsp.choose(sleigh, tolerance=tolerance, solve=False)
    print(f"tolerance {tolerance:g}: {choice.model.label}, {choice.reason}")
    errors = ", ".join(f"{c.label} {c.predicted:.1e}" for c in choice.candidates if c.order is not None)
    print(f"  predicted: {errors}")
    print(f"  on a piece: predicted {choice.predicted_on_piece:.1e}, measured {choice.measured:.1e}")

# A reduced flow ends at a fold; the full system jumps, and the reduced flow takes over where it lands.
oscillator = replace(
    gsp.models.load("van_der_pol"),
    region={"y": (-2, 2), "x": (-3, 3)},
    span=(0, 4),
    epsilon=1e-3,
    tolerance=1e-5,
)
run = gsp.simulate(oscillator)
print(run)
times = np.linspace(run.layer, 4, 400)
full = gsp.integrate(
    oscillator.system, start=oscillator.start, span=(0, 4), epsilon=1e-3, rtol=1e-12, atol=1e-14, at=times
)
error = np.abs(run.sample(times)["y"] - full["y"]).max() / np.abs(full["y"]).max()
print(f"largest relative error of y against a full run: {error:.1e}")

# %%
# Blue pieces were run by the reduced flow, the jumps by the full system. The error is what was asked for, 1e-5.
assert error < 2e-5
axes = run.plot()
