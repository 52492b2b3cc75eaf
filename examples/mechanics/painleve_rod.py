"""
Painlevé's rod
==============

A rod slides on a rough plane upon its end. Where friction is strong the normal force that keeps the end on the plane
does not exist: can the plane still be taken for rigid?

Along the plane friction is mu times the normal force N, and it turns the rod, so that the height of the end has the
acceleration b + p N with

    p = 1/m + (l^2/I) cos(theta) (cos(theta) - mu sin(theta)).

A rigid plane asks for b + p N = 0. Make it soft instead: N = d + c e for the depth epsilon^2 d of the end in the
plane, at the rate epsilon e. Then d and e are fast, and the rigid plane is the critical manifold.
"""

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp
from gsp.mechanics import LagrangianSystem, with_friction

theta, omega, d, e, mu, c, epsilon = sp.symbols("theta omega d e mu c epsilon")
lever = sp.cos(theta) - mu * sp.sin(theta)
p = 1 + 3 * sp.cos(theta) * lever  # m = l = g = 1, I = 1/3
force = d + c * e
rod = gsp.SlowFastSystem(
    slow={theta: omega, omega: -3 * lever * force},
    fast={d: e, e: 1 - omega**2 * sp.sin(theta) - p * force},
    epsilon=epsilon,
    parameters={mu: 2, c: 1},
)
(branch,) = gsp.solve_critical(rod).branches
print(branch)

# %%
# Where p > 0 the end sinks in until it is held, and the rigid plane is right. Where p < 0 friction turns the rod so
# that it is pressed in the more, the more it is pressed: the critical manifold is a saddle, with a plane that pulls.
# Between the two N is infinite. So the reduction is refused over the whole range, and it is said where and why.

whole = gsp.classify(branch, region={"theta": (0.3, 1.5), "omega": (-0.2, 0.2)})
print(whole)
assert not whole.holds
assert {loss.kind for loss in whole.losses} == {gsp.LossKind.BRANCH_POLE}
flat = gsp.classify(branch, region={"theta": (0.1, 0.4), "omega": (-0.2, 0.2)})
steep = gsp.classify(branch, region={"theta": (0.7, 1.1), "omega": (-0.2, 0.2)})
print(flat.kind, steep.kind)
assert (str(flat.kind), str(steep.kind)) == ("attracting", "saddle")

# %%
# The least p is 5/2 - 3/2 sqrt(1 + mu^2): there is no paradox below mu = 4/3.

angles = np.linspace(0, np.pi / 2, 2001)
for strength in (1.3, 4 / 3, 1.4):
    least = float(sp.lambdify(theta, p.subs(mu, strength), "numpy")(angles).min())
    print(f"mu = {strength:.4f}: p is {least:+.4f} at least")
    assert abs(least - (2.5 - 1.5 * np.sqrt(1 + strength**2))) < 1e-5

# %%
# A contact with a normal force that is to keep the end on the plane is therefore no contact of `with_friction`: it
# takes one of positions and parameters, and says so.

x, y, xdot, ydot, thetadot = sp.symbols("x y xdot ydot thetadot")
lagrangian = (xdot**2 + ydot**2) / 2 + thetadot**2 / 6 - y
body = LagrangianSystem(lagrangian, [x, y, theta], [xdot, ydot, thetadot])
slip = xdot + sp.sin(theta) * thetadot
try:
    with_friction(
        body,
        [slip],
        epsilon=epsilon,
        law="coulomb",
        mu=2,
        normal=(1 - thetadot**2 * sp.sin(theta)) / p.subs(mu, 2),
    )
    raise AssertionError
except gsp.GspError as error:
    print(error)

axes = Figure(figsize=(6, 3.5)).add_subplot()
for strength in (1.0, 4 / 3, 2.0):
    axes.plot(angles, sp.lambdify(theta, p.subs(mu, strength), "numpy")(angles), label=f"µ = {strength:.3g}")
axes.axhline(0, color="0.5", lw=0.8)
axes.set_xlabel("angle of the rod to the plane")
axes.set_ylabel("p")
axes.legend()
