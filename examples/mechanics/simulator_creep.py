"""
A block creeps in a simulator
=============================

How fast does a block creep down an incline, in a simulator that is to hold it by friction?

MuJoCo makes contacts soft: one that sticks has the force -(b/R_t) w for the slip w, with b = 2/(d_max tau) and
R_t = R_n/impratio. So friction is viscous, with 4 b/R_n for four corners and epsilon = 1/impratio, and no-slip is its
limit. The first correction is the creep. Measured with MuJoCo 4.0.0, and again where it is installed.
"""

import importlib.util
import math

import numpy as np
import sympy as sp
from matplotlib.figure import Figure

import gsp
from gsp.mechanics import LagrangianSystem, with_friction

GRAVITY, CORNERS = 9.81, 4
# Slope in rad, mass in kg, impratio, tau in s, d_max; what was measured: R_n in 1/kg, and the speed in m/s.
RUNS = """
0.2 1 1 0.02 0.95 0.10968283 0.00050769408; 0.2 1 10 0.02 0.95 0.10968283 5.0769408e-05
0.2 1 100 0.02 0.95 0.10968283 5.0769408e-06; 0.2 1 1000 0.02 0.95 0.10968283 5.0769408e-07
0.1 1 10 0.02 0.95 0.10968035 2.5511581e-05; 0.4 1 10 0.02 0.95 0.10969086 9.9522083e-05
0.12 2 100 0.02 0.95 0.054840362 3.0591542e-06; 0.3 0.5 1 0.02 0.95 0.21937306 0.00075521933
0.05 5 1 0.02 0.95 0.021935939 0.00012771676; 0.38 20 1000 0.02 0.95 0.0054844987 9.4793892e-07
0.2 1 10 0.01 0.95 0.11101912 2.569397e-05; 0.2 1 10 0.04 0.95 0.094952889 8.7902582e-05
0.2 1 10 0.08 0.95 0.056936624 0.00010541809; 0.2 1 10 0.02 0.99 0.10818064 5.2182466e-05
0.2 1 10 0.02 0.98 0.10858672 5.1849267e-05; 0.3 3 50 0.03 0.97 0.034008833 2.1518013e-05
0.15 0.1 5 0.05 0.96 0.78650087 0.00013836011; 0.25 10 500 0.015 0.95 0.011064943 9.5670863e-07
0.35 1 2 0.03 0.99 0.099384333 0.00062056619; 0.45 4 20 0.01 0.98 0.027736212 2.8995933e-05
"""
ROWS = [tuple(map(float, run.split())) for run in RUNS.replace("\n", ";").split(";") if run.strip()]


def predicted(rows: list[tuple[float, ...]]) -> np.ndarray:
    """Speeds (k,) in m/s by the first order in epsilon, from the Lagrangian."""
    x, phi, xdot, phidot, m, g, slope, b, R, epsilon = sp.symbols("x phi xdot phidot m g slope b R epsilon")
    lagrangian = m * xdot**2 / 2 + phidot**2 / 2 + m * g * sp.sin(slope) * x
    values = {m: 1, g: GRAVITY, slope: 0.2, b: 100, R: 0.1}
    block = LagrangianSystem(lagrangian, [x, phi], [xdot, phidot], parameters=values)
    friction = with_friction(block, [xdot], epsilon=epsilon, damping=CORNERS * b / R)
    (branch,) = gsp.solve_critical(friction.standard_form).branches
    slip = epsilon * gsp.expand(branch, order=1).coefficients[1][0]
    places = (
        {m: mass, g: GRAVITY, slope: angle, b: 2 / (stiffest * tau), R: softness, epsilon: 1 / ratio}
        for angle, mass, ratio, tau, stiffest, softness, _ in rows
    )
    return np.array([float(slip.subs(place)) for place in places])


def simulated(angle: float, mass: float, ratio: float, tau: float, stiffest: float) -> tuple[float, float]:
    """R_n of a contact and the speed of the block, measured in the simulator over its fifth second."""
    import mujoco

    contact = f'friction="1" solref="{tau} 1" solimp="0.9 {stiffest} 0.001"'
    pull = f"{GRAVITY * math.sin(angle)} 0 {-GRAVITY * math.cos(angle)}"
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="{pull}" cone="elliptic" impratio="{ratio}" tolerance="1e-15" iterations="500"/>
        <worldbody><geom type="plane" size="9 9 1" {contact}/><body pos="0 0 .1"><freejoint/>
        <geom type="box" size=".1 .1 .1" mass="{mass}" {contact}/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=2000)
    begin, time = data.qpos[0], data.time
    mujoco.mj_step(model, data, nstep=500)
    normal = np.array([data.efc_R[data.contact[c].efc_address] for c in range(CORNERS)])
    return 1.0 / float(np.mean(1.0 / normal)), float((data.qpos[0] - begin) / (data.time - time))


if importlib.util.find_spec("mujoco"):
    ROWS = [(*row[:5], *simulated(*row[:5])) for row in ROWS]

# %%
# Twenty runs, each speed against that of the first order: no more than a thousandth apart.

measured, expected = np.array(ROWS)[:, 6], predicted(ROWS)
worst = float(np.abs(measured / expected - 1.0).max())
print(f"largest relative difference of {len(ROWS)} runs: {worst:.1e}")
assert len(ROWS) == 20
assert worst < 1e-3

# %%
# A thousand times the ratio is a thousandth of the creep; none of it goes away.

axes = Figure(figsize=(6, 4)).add_subplot()
axes.loglog(expected * 1e6, measured * 1e6, "o")
axes.loglog(np.sort(expected) * 1e6, np.sort(expected) * 1e6, "-", lw=1)
axes.set_xlabel("creep by the first order, µm/s")
axes.set_ylabel("creep in the simulator, µm/s")
