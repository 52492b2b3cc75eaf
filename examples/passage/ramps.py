"""
Ramps that tip
==============

Plants that grow faster escape their herbivores when growth rises too fast, and come back when it returns in time
(O'Keeffe and Wieczorek, SIAM J. Appl. Dyn. Syst. 19 (2020) 2371-2402).
"""

import sympy as sp

import gsp

P, H, rho = sp.symbols("P H rho")
grazed = P**2 / (P**2 + 100) * sp.exp(-P / 40)
mortality = (rho - sp.Rational(1, 2)) / 30 + sp.Rational(1, 8)
field = gsp.VectorField(
    {P: rho * P - P**2 / 50 - H * grazed, H: (sp.Rational(2, 5) * grazed * sp.exp(-P / 40) - mortality) * H},
    epsilon=None,
    parameters={rho: 0.5},
    name="plants and herbivores",
)
home, saddle = {"P": 10.69, "H": 7.494}, {"P": 17.75, "H": 5.285}
ramp = gsp.Ramp.there_and_back({rho: (0.5, 0.66)})

# %%
# At the critical rates the orbit that leaves the rest point ends in the saddle. Between the two the plants escape.
found = gsp.critical_rate(field, ramp=ramp, start=home, edge=saddle)
print(found)
axes = found.plot()

# %%
# The window closes at a smaller amplitude. At the fold, 1.23 times this ramp, slow ramps begin to tip as well.
diagram = gsp.rate_diagram(field, ramp=ramp, start=home, edge=saddle, amplitudes=(0.4, 1.8), points=12)
axes = diagram.plot()

# %%
# Figure 5 of Ritchie et al., Earth Syst. Dynam. 14 (2023) 669-683, has the rate 0.0599484250318941 a day for a change
# of 0.568675118242666 of that to the fold, in the table behind it.
peak = sp.Rational("0.5") + sp.Rational("0.1966") * sp.Rational("0.568675118242666")
again = gsp.critical_rate(field, ramp=gsp.Ramp.there_and_back({rho: (0.5, peak)}), start=home, edge=saddle)
print(again)
assert min(abs(rate / 0.0599484250318941 - 1) for rate in again.rates) < 1e-8
