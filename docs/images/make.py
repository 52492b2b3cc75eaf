"""Draw the pictures of the documents again: `python docs/images/make.py`."""

from dataclasses import replace
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

import gsp
from gsp import charts
from gsp.charts.style import STYLE


def main() -> None:
    """Write sleigh.png and switches.png beside this file."""
    analysis = gsp.analyse(gsp.models.load("chaplygin_sleigh"))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
        charts.convergence(analysis, left)
        charts.error_against_epsilon(analysis.comparison, right)
        figure.savefig(Path(__file__).parent / "sleigh.png", dpi=140)
    oscillator = replace(
        gsp.models.load("van_der_pol"),
        region={"y": (-2, 2), "x": (-3, 3)},
        span=(0, 4),
        epsilon=0.01,
        tolerance=1e-3,
    )
    charts.save(charts.switches(gsp.simulate(oscillator)), Path(__file__).parent / "switches.png")


if __name__ == "__main__":
    main()
