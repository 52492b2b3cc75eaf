"""
Canard values, exactly
======================

The canard value of van der Pol's oscillator is an exact series. Koper's model has a folded node.
"""

import sympy as sp
from matplotlib.figure import Figure

import gsp

x, y, a, epsilon = sp.symbols("x y a epsilon")
oscillator = gsp.SlowFastSystem(
    slow={y: a - x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon, parameters={a: 0.9}, name="van der Pol"
)
canard = gsp.canard_value(oscillator, parameter=a, order=10)
print("canard point", canard.point)
for k, coefficient in enumerate(canard.coefficients):
    print(f"a_{k} = {coefficient}")
print("a(0.01) =", canard.value(0.01, digits=25))

koper = gsp.models.load("koper").system
for point in gsp.folded_singularities(koper, region={"x": (0.5, 1.5), "y": (-2, 2), "z": (-2, 2)}):
    print(f"{point.kind} at {point.point}: mu = {float(point.mu):.12f}, s_max = {point.s_max}")

# %%
# The first coefficients are those that Zvonkin and Shubin gave. They grow ever faster: the series
# is asymptotic.
assert list(canard.coefficients[:4]) == [1, sp.Rational(-1, 8), sp.Rational(-3, 32), sp.Rational(-173, 1024)]
axes = Figure(figsize=(6.4, 3.6), layout="constrained").subplots()
for small in (0.01, 0.05, 0.1):
    axes.semilogy(
        [abs(float(c)) * small**k for k, c in enumerate(canard.coefficients)], "o-", label=f"epsilon = {small}"
    )
axes.set(xlabel="k", ylabel="size of the term")
axes.legend(frameon=False)
