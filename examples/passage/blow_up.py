"""
Blow-up of a cusp
=================

The weights of a nilpotent point say with which powers of epsilon orbits pass. Here they are computed and measured.
"""

import matplotlib.pyplot as plt
import numpy as np
import sympy as sp

import gsp

x, y, epsilon = sp.symbols("x y epsilon")
system = gsp.SlowFastSystem(slow={x: 1 + y**2}, fast={y: x - y**3 + x * y}, epsilon=epsilon, name="third order")
found = gsp.blow_up(system, near={"x": 0, "y": 0})
print(found)

# %%
# The run passes x = 0 at a y that goes as the power that the weights give.
epsilons = np.geomspace(1e-3, 1e-7, 9)
section = gsp.Event(x, terminal=True)
passed = [
    abs(
        gsp.integrate(system, start={"x": -1, "y": -1}, span=(0, 5), epsilon=e, rtol=1e-10, events=[section])[
            "y"
        ][-1]
    )
    for e in epsilons
]
slope = np.polyfit(np.log(epsilons[-3:]), np.log(passed[-3:]), 1)[0]
power = found.scaling.exponents["y"]
print(f"y ~ epsilon^{slope:.3f} measured, epsilon^({power}) from the weights")
assert abs(slope - float(power)) < 0.02

axes = plt.figure().subplots()
axes.loglog(epsilons, passed, "o", label="runs")
axes.loglog(epsilons, passed[-1] * (epsilons / epsilons[-1]) ** float(power), label=f"epsilon^({power})")
axes.set(xlabel="epsilon", ylabel="|y| at x = 0")
axes.legend()
