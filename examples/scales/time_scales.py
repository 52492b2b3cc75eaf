"""
Time scales along a run
=======================

An enzyme, its substrate, their complex and the product, and little enzyme. No parameter is
said to be small. Two sums are conserved, and of the two modes that are left one is exhausted soon.
"""

import numpy as np
import sympy as sp

import gsp

e, s, c, p = sp.symbols("e s c p")
bind, leave, make = 50 * e * s, 10 * c, c
field = gsp.VectorField({e: -bind + leave + make, s: -bind + leave, c: bind - leave - make, p: make})
scales = gsp.time_scales(field, start={"e": 0.05, "s": 1, "c": 0, "p": 0}, span=(0, 40))
print(scales)
assert {str(law) for law in scales.conserved} == {"c + e", "c + p + s"}

# %%
# The rates are the eigenvalues of the two equations that are left: their sum is the trace.
states = dict(zip("escp", scales.states.T))
trace = -50 * states["s"] - 11 - 50 * states["e"]
assert np.abs(scales.rates[:, :2].real.sum(axis=1) / trace - 1).max() < 1e-8

# %%
# Which terms drive the fast mode at the end: binding, against what the complex loses.
for term, share in zip(scales.reactions.rates, scales.participation[-1, 0]):
    print(f"{term}: {share:+.2f}")

# %%
# Exhausted time scales in blue, and the gap to the next.
axes = scales.plot()
