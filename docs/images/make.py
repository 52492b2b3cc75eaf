"""Draw the pictures of the documents again: `python docs/images/make.py`."""

from pathlib import Path

import matplotlib
import sympy as sp
from matplotlib.figure import Figure

import gsp
from gsp import charts
from gsp.charts.style import STYLE


def main() -> None:
    """Write sleigh.png and folded_node.png beside this file."""
    analysis = gsp.analyse(gsp.models.load("chaplygin_sleigh"))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
        charts.convergence(analysis, left)
        charts.error_against_epsilon(analysis.comparison, right)
        figure.savefig(Path(__file__).parent / "sleigh.png", dpi=140)
        figure = Figure(figsize=(9.6, 4.4), layout="constrained")
        neuron = canards_of_the_neuron()
        charts.canard_section(neuron, figure.add_subplot(1, 2, 1))
        charts.canard_orbits(neuron, figure.add_subplot(1, 2, 2, projection="3d"))
        figure.savefig(Path(__file__).parent / "folded_node.png", dpi=140)


def canards_of_the_neuron() -> gsp.CanardOrbits:
    """The self-coupled FitzHugh-Nagumo system of AUTO's demo fnc at epsilon = 0.015."""
    v, h, s, epsilon = sp.symbols("v h s epsilon")
    system = gsp.SlowFastSystem(
        slow={h: -2 * h - sp.Rational(13, 5) * v, s: -sp.Rational(113, 200) * s},
        fast={v: h - (v**3 - v + 1) / 2 - s * v / 2},
        epsilon=epsilon,
    )
    (node,) = gsp.folded_singularities(system, region={"v": (-1, 0)})
    return gsp.folded_canards(
        node, epsilon=0.015, section={"s": 0.2797}, attracting={"h": -6}, repelling={"v": 0}
    )


if __name__ == "__main__":
    main()
