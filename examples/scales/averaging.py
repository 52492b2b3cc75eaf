"""
Fast phases are averaged
========================

What turns fast is neither attracted nor repelled: no slow manifold is there to reduce to, and what moves slowly is
averaged over the phase, exactly and to any order.
"""

import numpy as np
import sympy as sp

import gsp

u, v, q, p, theta, epsilon, alpha, c = sp.symbols("u v q p theta epsilon alpha c")

# %%
# A weakly nonlinear oscillator is a pair of states that turn about one another. Its amplitude comes to 2, and its
# frequency is 1 - epsilon^2/16 + 17 epsilon^4/3072 there.
oscillator = gsp.VectorField(
    {u: v / epsilon, v: -u / epsilon + (1 - u**2) * v}, epsilon=epsilon, name="van der Pol"
)
scene = gsp.Scene(
    oscillator, {"u": (-3, 3)}, {"u": 0.3, "v": 0}, (0, 8), 0.05, phase=gsp.FastPhase(pair=("u", "v"))
)
found = gsp.average(scene, order=3)
print(found)
axes = found.plot()

# %%
# The error of each order falls with its power of epsilon.
measured = gsp.compare_averaged(found)
print(measured)
assert all(abs(measured.slopes[n] - (n + 1)) < 0.2 for n in measured.slopes)

# %%
# A pendulum whose pivot vibrates stands upright, q = 0, where alpha^2 > 2: the averaged force is
# sin q - alpha^2 sin(2 q)/4. Rates of order 1/epsilon with mean zero are vibrations, and are taken off first.
pendulum = gsp.VectorField(
    {q: p, p: (1 + alpha * sp.cos(theta) / epsilon) * sp.sin(q) - c * p, theta: 1 / epsilon},
    epsilon=epsilon,
    parameters={alpha: 2, c: 0.2},
    name="vibrated pendulum",
)
upright = gsp.average(pendulum, phase=theta, order=1)
print(upright)
for strength in (1.2, 1.7):
    run = gsp.integrate(
        pendulum.with_parameters(alpha=strength),
        start={"q": 0.05, "p": 0, "theta": 0},
        span=(0, 12),
        epsilon=0.01,
    )
    print(f"alpha = {strength}: q goes as far as {np.abs(run['q']).max():.2f}")
    assert (np.abs(run["q"]).max() < 0.3) == (strength**2 > 2)

# %%
# A phase that turns slowly is a ramp that returns: over one turn the parameter goes to its other end and back.
x, shift, s = sp.symbols("x l phase")
field = gsp.VectorField({x: (x + shift) ** 2 - 1}, epsilon=None, parameters={shift: 0})
turn = gsp.Ramp({shift: 2 * (1 - sp.cos(s))}, sp.Integer(1), (0, 2 * sp.pi))
slow = gsp.critical_rate(field, ramp=turn, start={"x": -1}, edge={"x": 1})
print(slow)
for rate, tips in ((0.7, False), (3.0, True), (20.0, False)):
    beside = gsp.VectorField({x: (x + 2 * (1 - sp.cos(s))) ** 2 - 1, s: rate}, epsilon=None)
    crossed = gsp.Event(x - 1e3, terminal=True)
    run = gsp.integrate(beside, start={"x": -1, "phase": 0}, span=(0, 2 * np.pi / rate), events=[crossed])
    assert (run["x"][-1] > 1) == tips
