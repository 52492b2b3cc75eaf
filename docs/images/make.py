"""Draw the pictures of the documents again: `python docs/images/make.py`."""

from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

import gsp
from gsp import charts
from gsp.charts.style import STYLE


def main() -> None:
    """Write sleigh.png beside this file."""
    analysis = gsp.analyse(gsp.models.load("chaplygin_sleigh"))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
        charts.convergence(analysis, left)
        charts.error_against_epsilon(analysis.comparison, right)
        figure.savefig(Path(__file__).parent / "sleigh.png", dpi=140)


if __name__ == "__main__":
    main()
