"""
The period of a relaxation oscillation
======================================

Van der Pol's period follows from its singular orbit and is set against that of the full system. Koper's mixed modes are
counted.
"""

import math

import sympy as sp

import gsp

x, y, z, epsilon = sp.symbols("x y z epsilon")
oscillator = gsp.SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon, name="van der Pol")
start = {"x": 2, "y": 0.6}
orbit = gsp.singular_orbit(gsp.solve_critical(oscillator).nearest(start), start)
print(orbit)
for mu in (10, 100):
    small = mu**-2
    full = gsp.periodic_orbit(oscillator, start=start, epsilon=small)
    left = (full.period - orbit.period(small)) / small
    expected = mu * orbit.period(small)
    print(f"mu = {mu}: period {mu * full.period:.10f}, expected {expected:.6f}, left {left:.3f} epsilon")

for k, small in ((-6, 0.1), (sp.Rational(-13, 2), 0.1), (-7, 0.05)):
    koper = gsp.SlowFastSystem(
        slow={y: x - 2 * y + z, z: y - z}, fast={x: -10 * y - x**3 + 3 * x - k}, epsilon=epsilon
    )
    mode = gsp.mixed_mode(koper, "x", start={"x": -1.5, "y": 0.5, "z": 0.5}, span=(0, 120), epsilon=small)
    print(f"Koper, k = {float(k):g}, epsilon = {small:g}: {mode}")

# %%
# The singular orbit takes the slow time 3 - 2 ln 2 for a lap.
assert abs(orbit.coefficients[0] - (3 - 2 * math.log(2))) < 1e-9
axes = orbit.plot()
