"""
A cycle for every epsilon
=========================

Van der Pol's relaxation cycle is proved for every epsilon in an interval at once. Orbits cross two polygons into the
annulus between them, whatever epsilon is: across an edge the field is linear in epsilon, so that two values decide. No
equilibrium is in the annulus, so a cycle is. Where the integral of the divergence over a turn is proved negative too,
it is the only one there, and attracts.
"""

import sympy as sp

import gsp

x, y, epsilon = sp.symbols("x y epsilon")
system = gsp.SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon)
start = {"x": 2, "y": 0.6}
orbit = gsp.singular_orbit(gsp.solve_critical(system).nearest(start), start)
cycle = gsp.certify(orbit)
print(cycle)
axes = cycle.plot()

# %%
# For smaller epsilon the annulus is narrower, and closes in on the singular orbit: bounds of the period for every
# epsilon up to a value differ by a multiple of its power 2/3, as the periods themselves do.

for small in (1e-2, 1e-3, 1e-4):
    least, most = gsp.certify(orbit, epsilon=small).existence.turn.period
    print(
        f"epsilon up to {small:g}: from {least:.4f} to {most:.4f}; the law at {small:g}: {orbit.period(small):.4f}"
    )
    assert least < orbit.period(small) < most

# %%
# A system that settles, or one in a canard's window, is undecided: what is not proved is not claimed.

a = sp.Rational(6, 5)
excitable = gsp.SlowFastSystem(slow={y: a - x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon)
print(gsp.certify(gsp.singular_orbit(gsp.solve_critical(excitable).nearest(start), start)))
