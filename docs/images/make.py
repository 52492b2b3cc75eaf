"""Draw the pictures of the documents again: `python docs/images/make.py`."""

from pathlib import Path

import matplotlib
import sympy as sp
from matplotlib.figure import Figure

import gsp
from gsp import charts
from gsp.charts.style import STYLE

HERE = Path(__file__).parent


def main() -> None:
    """Write every picture beside this file."""
    sleigh()
    canard_explosion()


def canard_explosion() -> None:
    """canard_explosion.png: van der Pol's family of cycles from the Hopf point to relaxation."""
    x, y, a, epsilon = sp.symbols("x y a epsilon")
    system = gsp.SlowFastSystem(
        slow={y: a - x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon, parameters={a: 1.1}
    )
    (hopf,) = gsp.hopf_points(system, start={"x": 1.1, "y": -0.6}, parameter=a, bounds=(0.9, 1.2), epsilon=0.01)
    family = gsp.continue_orbits(hopf, bounds=(0.985, 1.2), max_step=0.1, tolerance=1e-11)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2)
        charts.canard_explosion(family, left, canard=gsp.canard_value(system, parameter=a))
        charts.canard_cycles(family, right)
        figure.savefig(HERE / "canard_explosion.png", dpi=140)


def sleigh() -> None:
    """sleigh.png: paths for three frictions and in the limit, and errors against epsilon."""
    analysis = gsp.analyse(gsp.models.load("chaplygin_sleigh"))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
        charts.convergence(analysis, left)
        charts.error_against_epsilon(analysis.comparison, right)
        figure.savefig(HERE / "sleigh.png", dpi=140)


if __name__ == "__main__":
    main()
