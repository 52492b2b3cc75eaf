"""
Friction that depends on rate and state
=======================================

Rock slides on rock as if friction had a memory: mu = mu_0 + a ln V + b ln theta, with theta' = 1 - V theta. When does a
block that is pulled by a spring creep steadily, and when does it stick and slip?

No switch is in it, as the friction has no jump at rest: z = ln V is a fast variable because the block is light. So the
friction is reduced as any other slow-fast system is. The equations are those of Bossolini, Brons and Kristiansen
(Nonlinearity 30 (2017) 2805): x is the state, y the stretch of the spring, xi its stiffness, alpha = (b - a)/a.
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp

x, y, z, alpha, xi, epsilon = sp.symbols("x y z alpha xi epsilon")
block = gsp.SlowFastSystem(
    slow={x: -sp.exp(z) * (x + (1 + alpha) * z), y: sp.exp(z) - 1},
    fast={z: -sp.exp(-z) * (y + (x + z) / xi)},
    epsilon=epsilon,
    parameters={alpha: 0.8, xi: 0.9},
)
(branch,) = gsp.solve_critical(block).branches
print(branch)

# %%
# The critical manifold attracts everywhere, so the block's inertia may be left out; in fast time it is forgotten at the
# rate exp(-z)/xi, slowly where the slip is fast.

verdict = gsp.classify(branch, region={"x": (-1, 1), "y": (-1, 1)})
rate = sp.diff(block.fast[z], z).subs(z, -x - xi * y)
print(verdict.kind, sp.simplify(rate))
assert str(verdict.kind) == "attracting"
assert sp.simplify(rate + sp.exp(x + xi * y) / xi) == 0

# %%
# On it steady creep, x = y = 0, has the trace alpha - xi and the determinant xi: it is stable if and only if the spring
# is stiffer than xi = alpha. A softer one leads to stick-slip, by a Hopf bifurcation of the reduced flow.

flow = gsp.expand(branch, order=1).reduced_field[0]
jacobian = sp.Matrix(list(flow)).jacobian([x, y]).subs({x: 0, y: 0})
print(sp.factor(jacobian.trace()), sp.factor(jacobian.det()))
assert sp.expand(jacobian.trace() - (alpha - xi)) == 0
assert sp.expand(jacobian.det() - xi) == 0

# %%
# Runs of the full system on both sides of it: the slip is near its steady rate, ln V = 0, or swings ever farther.

axes = Figure(figsize=(6, 3.5)).add_subplot()
at = np.linspace(0, 60, 1200)
largest = {}
for stiffness in (0.9, 0.75):
    start, scene = {"x": 0.05, "y": 0.0, "z": -0.05}, block.with_parameters(xi=stiffness)
    run = gsp.integrate(scene, start=start, span=(0, 60), epsilon=1e-3, at=at)
    sizes = np.abs(run["z"])
    largest[stiffness] = sizes[at > 50].max() / sizes[at < 10].max()
    axes.plot(at, run["z"], label=f"stiffness {stiffness}")
print(", ".join(f"at stiffness {key} the swings grow by {value:.2f}" for key, value in largest.items()))
assert largest[0.9] < 1.0 < largest[0.75]
axes.set_xlabel("t")
axes.set_ylabel("ln V")
axes.legend()
