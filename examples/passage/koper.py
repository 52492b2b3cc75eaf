"""
Mixed modes of an electrode
===========================

Koper's model of an electrochemical cell swings large and small in turns.

Source: M. T. M. Koper, Physica D 80 (1995) 72-94; M. Desroches and others, SIAM Review 54 (2012) 211-288.
"""

import sympy as sp

import gsp

x, y, z, epsilon = sp.symbols("x y z epsilon")
cell = gsp.SlowFastSystem(
    slow={y: x - 2 * y + z, z: y - z}, fast={x: -10 * y - x**3 + 3 * x + 7}, epsilon=epsilon, name="Koper"
)
mode = gsp.mixed_mode(cell, "x", start={"x": -1.5, "y": 0.5, "z": 0.5}, span=(0, 60), epsilon=0.05)
print(mode)

# %%
# One large swing and two small ones. The folded node behind them has the eigenvalue ratio 0.0685.
(node,) = gsp.folded_singularities(cell, region={"x": (0.5, 1.5), "y": (-2, 2), "z": (-2, 2)})
assert mode.signature == "1^2"
assert abs(float(node.mu) - 0.068501760766) < 1e-10
axes = mode.plot()
