"""
A laser that starts late
========================

Pumped through its threshold, a class-B laser stays dark for a while: the dark state repels already, and the
light has yet to grow.

Source: F. T. Arecchi and others, Optics Communications 51 (1984) 308-314.
"""

import math

import sympy as sp
from scipy.optimize import brentq

import gsp

D, n, epsilon = sp.symbols("D n epsilon")
laser = gsp.SlowFastSystem(slow={D: 1 - D * (1 + n)}, fast={n: n * (2 * D - 1)}, epsilon=epsilon, name="laser")
dark = gsp.solve_critical(laser).nearest({"D": 0, "n": 0})
delayed = gsp.entry_exit(dark, start={"D": 0})
print(delayed)
measured = gsp.measure_delay(delayed, epsilon=0.02, radius=0.1)
print(measured)

# %%
# On the dark state D = 1 - exp(-t). What decays till D = 1/2 grows back when T = 2 (1 - exp(-T)).
assert abs(delayed.t - brentq(lambda t: t - 2 * (1 - math.exp(-t)), 1, 2)) < 1e-8
axes = gsp.charts.delayed_exit(measured)
