"""
The compost bomb
================

Soil heats itself as it decays. Under air that warms slowly it loses carbon and stays cool; when the air warms faster
than 8.8 degrees in a century it burns, though it would come back to rest (S. Wieczorek, P. Ashwin, C. Luke, P. Cox,
Proc. R. Soc. A 467 (2011) 1243-1269).
"""

import sympy as sp
from matplotlib.figure import Figure

import gsp

T, C, air, epsilon = sp.symbols("T C T_a epsilon")
respired = C / 100 * sp.exp(T * sp.log(sp.Rational(5, 2)) / 10)
compost = gsp.SlowFastSystem(
    slow={C: sp.Rational(1055, 1000) - respired},
    fast={T: respired - sp.Rational(5049, 39000) * (T - air)},
    epsilon=epsilon,
    parameters={air: 0},
    name="compost",
)
start = {"T": 8, "C": 50}

# %%
# No rest point is lost, and there is no edge state: what tips is what passes a level, here 60 degrees.
warming = gsp.Ramp.linear_with_ends({air: (0, 20)})
bomb = gsp.critical_rate(compost, ramp=warming, start=start, edge={"T": 60}, epsilon=2.5 / 39)
print(bomb)
assert abs(bomb.rate - 0.0884833) < 1e-7

# A little below that rate, and a little above it, the ramp as a state.
axes = Figure(figsize=(5.4, 3.6), layout="constrained").subplots()
for factor in (0.99, 1.01):
    rate = factor * bomb.rate
    field = gsp.SlowFastSystem({**compost.slow, air: rate}, compost.fast, epsilon=epsilon)
    run = gsp.integrate(field, start={**start, "T_a": 0}, span=(0, 20 / rate), epsilon=2.5 / 39)
    axes.plot(run.t, run["T"], label=f"{factor} of the critical rate")
axes.set(xlabel="time", ylabel="temperature of the soil")
axes.legend(frameon=False)

# %%
# The threshold is a canard through a folded saddle, and a series in epsilon.
slow = gsp.slow_ramp(
    gsp.critical_rate(compost, ramp=warming, start=start, edge={"T": 60}, epsilon=0.01), order=2
)
print(slow)
assert abs(slow.coefficients[0] - 0.080774) < 1e-6
