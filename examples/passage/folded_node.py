"""
Canards of a folded node
========================

The self-coupled FitzHugh-Nagumo system has a folded node. The script finds its canards and follows one in epsilon.
"""

import sympy as sp

import gsp

v, h, s, epsilon = sp.symbols("v h s epsilon")
# v' = h - (v^3 - v + 1)/2 - s v/2 in fast time; h and s are slow.
neuron = gsp.SlowFastSystem(
    slow={h: -2 * h - sp.Rational(13, 5) * v, s: -sp.Rational(113, 200) * s},
    fast={v: h - (v**3 - v + 1) / 2 - s * v / 2},
    epsilon=epsilon,
    name="self-coupled FitzHugh-Nagumo",
)
(node,) = gsp.folded_singularities(neuron, region={"v": (-1, 0)})
print(node)

# Lines on M0 as in AUTO's demo fnc, where the matching is by hand: h = -6, v = 0, and the section s = 0.2797.
canards = gsp.folded_canards(
    node, epsilon=0.015, section={"s": 0.2797}, attracting={"h": -6}, repelling={"v": 0}
)
print(canards)

print("\nfast time before and after the section, beside what was matched by hand")
by_hand = {3: (56.3127, 144.1008), 5: (85.7971, 178.5985), 7: (110.0469, 218.6280)}
for k, (before, after) in by_hand.items():
    found = canards[f"xi_{k}"]
    print(
        f"  xi_{k}  {found.time_before / 0.015:9.4f} {found.time_after / 0.015:9.4f}   {before:9.4f} {after:9.4f}"
    )

print("\nfollowed in epsilon, round a fold where two of them meet")
for k in (3,):
    print(" ", gsp.follow_canard(canards[f"xi_{k}"], epsilon=(1e-3, 0.08), max_points=120))

# %%
# The canards cross the section between the two slow manifolds. Two times of the third agree with the demo of AUTO.
third = canards["xi_3"]
assert abs(third.time_before / 0.015 - 56.3127) < 0.05
assert abs(third.time_after / 0.015 - 144.1008) < 0.05
axes = canards.plot()
