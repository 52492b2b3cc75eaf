"""
Past a fold, and a delayed exit
===============================

Exits behind a fold give the constant Omega_0. A delayed exit at a Hopf point asks for more digits than doubles have.
"""

import sympy as sp

import gsp

x, y, t, epsilon = sp.symbols("x y t epsilon")
oscillator = gsp.SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon, name="van der Pol")
passage = gsp.fold_passage(oscillator, {"x": 1, "y": -2 / 3})
print(passage)
for small in (1e-2, 1e-3, 1e-4):
    found = gsp.fold_exit(passage, epsilon=small)
    print(f"epsilon = {small:g}: y = {found.point['y']:.10f}, expected {found.expected['y']:.10f}")
print(gsp.fit_omega0(passage))

shishkova = gsp.SlowFastSystem(
    slow={t: 1}, fast={x: t * x - y + epsilon, y: x + t * y}, epsilon=epsilon, name="Shishkova"
)
delayed = gsp.entry_exit(gsp.solve_critical(shishkova).branches[0], start={"t": -2})
print(delayed)
for small in (0.05, 0.01):
    print(delayed.warning(small) or f"double precision serves at epsilon = {small:g}")
    print(gsp.measure_delay(delayed, epsilon=small, radius=1))

# %%
# The delay at the fold is Omega_0, the least zero of the Airy function Ai(-x).
assert abs(gsp.fit_omega0(passage).omega0 - 2.338107410459767) < 1e-3
axes = gsp.charts.fold_passage(
    passage, exits=[gsp.fold_exit(passage, epsilon=small) for small in (1e-2, 1e-3, 1e-4)]
)
