"""
The canard explosion
====================

One family of cycles of van der Pol's oscillator leads from the Hopf point through the canard explosion to relaxation.
"""

import sympy as sp

import gsp

x, y, a, epsilon = sp.symbols("x y a epsilon")
oscillator = gsp.SlowFastSystem(
    slow={y: a - x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon, parameters={a: 1.1}, name="van der Pol"
)
canard = gsp.canard_value(oscillator, parameter=a)
(hopf,) = gsp.hopf_points(oscillator, start={"x": 1.1, "y": -0.6}, parameter=a, bounds=(0.9, 1.2), epsilon=0.01)
print(hopf)
family = gsp.continue_orbits(hopf, bounds=(0.95, 1.2))
print(family)
value = float(canard.value(0.01))
print(f"explosion - canard value = {family.explosions[0].value - value:.1e}")
print(f"{'a - canard value':>18} {'period':>9} {'amplitude':>10} {'multiplier':>11}")
for orbit in family.orbits[::6]:
    print(
        f"{orbit.parameters['a'] - value:18.3e} {orbit.period:9.5f} {orbit.amplitude['x']:10.5f} "
        f"{orbit.multipliers[1].real:11.2e}"
    )

relaxation = gsp.periodic_orbit(oscillator.with_parameters(a=0), start={"x": 2, "y": 0}, epsilon=0.01)
print(f"period at mu = 10: {10 * relaxation.period:.13f} by collocation")
print(f"                   {10 * gsp.shoot(relaxation).period:.13f} by shooting")

# %%
# The explosion sits at the maximal canard. The period at mu = 10 is that of the literature.
assert abs(family.explosions[0].value - value) < 1e-10
assert abs(10 * relaxation.period - 19.0783695669) < 1e-9
axes = family.plot()
