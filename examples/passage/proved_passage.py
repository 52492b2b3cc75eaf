"""
A passage for every epsilon
===========================

Orbits that come to a fold, to a point where branches cross, or along a branch that loses its stability, are followed
past it for every epsilon in an interval at once, with what is proved of where they come out. How far proofs about
cycles reach is set against where runs lose the cycle.
"""

import numpy as np
import sympy as sp

import gsp

x, y, epsilon = sp.symbols("x y epsilon")
oscillator = gsp.SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon)
fold = gsp.fold_passage(oscillator, {"x": 1, "y": -2 / 3})
passed = gsp.certify(fold, start={"y": 0.6}, epsilon=1e-2)
print(passed)
axes = passed.plot()

# %%
# Every orbit that enters leaves through the exit section. Its width falls like the delay: with epsilon^(2/3).

for small in (1e-2, 1e-3, 1e-4):
    (low, high), _ = gsp.certify(fold, start={"y": 0.6}, epsilon=small).strip.exit
    print(f"epsilon up to {small:g}: y from {low:.5f} to {high:.5f}; expected {fold.exit(small)['y']:.5f}")
    assert low < fold.exit(small)["y"] < high

# %%
# Past a pitchfork orbits change to one of the branches; along an invariant branch they stay, and leave late.

pitchfork = gsp.SlowFastSystem(slow={y: 1}, fast={x: y * x - x**3 + epsilon}, epsilon=epsilon)
print(gsp.certify(gsp.entry_exit(gsp.solve_critical(pitchfork).nearest({"x": 0, "y": -1}), start={"y": -1})))
delayed = gsp.SlowFastSystem(slow={y: 1}, fast={x: x * (y - x)}, epsilon=epsilon)
late = gsp.entry_exit(gsp.solve_critical(delayed).nearest({"x": 0, "y": -1}), start={"y": -1})
stays = gsp.certify(late, epsilon=0.01)
print(stays)
assert stays.delay.stays_to < late.point["y"] < stays.delay.leaves_by

# %%
# A cycle is proved up to an epsilon, and runs lose it at another: the equilibrium within gains stability there. In
# between nothing is said.

neuron = gsp.SlowFastSystem(
    slow={y: x + sp.Rational(7, 10) - 4 * y / 5},
    fast={x: x - x**3 / 3 - y + sp.Rational(1, 2)},
    epsilon=epsilon,
)
chemical = gsp.SlowFastSystem(
    slow={y: x - x * y / (1 + x**2)}, fast={x: 20 - x - 4 * x * y / (1 + x**2)}, epsilon=epsilon
)


def swings(system: gsp.SlowFastSystem, start: dict[str, float], small: float) -> float:
    """How far the fast variable goes at the end of a run."""
    run = gsp.integrate(system, start=start, span=(0.0, 400.0), epsilon=small)
    return float(np.ptp(run["x"][run.t > 350.0]))


for name, system, start in (
    ("FitzHugh and Nagumo", neuron, {"x": -1.8, "y": 0.5}),
    ("Lengyel and Epstein", chemical, {"x": 0.45, "y": 13.5}),
):
    cycle = gsp.certify(gsp.singular_orbit(gsp.solve_critical(system).nearest(start), start))
    kept, lost = cycle.epsilon_0, 100.0
    whole = swings(system, start, kept)
    while lost > 1.05 * kept:
        middle = (kept * lost) ** 0.5
        kept, lost = (middle, lost) if swings(system, start, middle) > 0.05 * whole else (kept, middle)
    print(f"{name}: unique to {cycle.epsilon_1:.3g}, exists to {cycle.epsilon_0:.3g}, lost near {lost:.2g}")
    assert cycle.epsilon_1 <= cycle.epsilon_0 < lost
