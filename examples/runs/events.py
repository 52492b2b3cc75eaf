"""
Periods by events
=================

Events give the return times of a relaxation oscillation and stop a run in its jump from a fold. Reduced flows end by
themselves.
"""

import numpy as np
import sympy as sp

import gsp

x, y, epsilon = sp.symbols("x y epsilon")
system = gsp.SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon, name="van der Pol")
start = {"x": 2, "y": 2 / 3}

# The period by returns to x = 0, against its leading orders 3 - 2 ln 2 + 3 Omega_0 epsilon^(2/3).
print("epsilon     period          leading orders")
for value in (1e-2, 1e-4, 1e-6):
    run = gsp.integrate(
        system, start=start, span=(0, 8), epsilon=value, rtol=1e-10, atol=1e-12,
        events=gsp.Event("x", direction=1),
    )  # fmt: skip
    returns = np.diff(run.events["x"].times)
    leading = 3 - 2 * np.log(2) + 3 * 2.338107410459767 * value ** (2 / 3)
    print(f"{value:<8g}  {returns[-1]:.10f}    {leading:.10f}")

# A terminal event stops in the middle of the first jump.
jump = gsp.integrate(
    system, start=start, span=(0, 8), epsilon=1e-4, events=gsp.Event("x", direction=-1, terminal=True)
)
print(f"\nthe jump: {jump.message}")

# The reduced flow ends at the fold, exactly at 3/2 - ln 2; above order 0 where its series stops falling.
branch = gsp.solve_critical(system).nearest(start)
series = gsp.expand(branch, order=3)
print(f"\nfold at {1.5 - np.log(2):.10f}")
for order in range(4):
    flow = gsp.restrict(series, order=order)
    run = gsp.integrate(flow, start=start, span=(0, 8), epsilon=1e-4, rtol=1e-10, atol=1e-12)
    print(f"order {order}: {run.status.name} at t = {run.t[-1]:.10f}, x0 = {run['x0'][-1]:.6f}")

# %%
# The slow time from the start to the fold is 3/2 - ln 2. The full run jumps a little later.
ended = gsp.integrate(
    gsp.restrict(series, order=0), start=start, span=(0, 8), epsilon=1e-4, rtol=1e-10, atol=1e-12
)
assert abs(ended.t[-1] - (1.5 - np.log(2))) < 1e-8
axes = jump.plot()
