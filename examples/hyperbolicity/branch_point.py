"""
Two curves that cross
=====================

The critical manifold of y (x - y^2) is a line and a parabola. Stability changes hands where they cross.
"""

import sympy as sp

import gsp

x, y, epsilon = sp.symbols("x y epsilon")
system = gsp.SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: y * (x - y**2)}, epsilon=epsilon)
line = gsp.continue_critical(system, start={"x": -1, "y": 0}, bounds={"x": (-1, 1), "y": (-1.5, 1.5)})
print(line)
parabola = gsp.switch_branch(line, line.special[0])
print(parabola)

# %%
# The crossing is a pitchfork at the origin, and the other branch is y^2 = x.
assert line.special[0].kind is gsp.SpecialKind.PITCHFORK
assert abs(parabola["y"] ** 2 - parabola["x"]).max() < 1e-9
axes = line.plot()
parabola.plot(axes)
