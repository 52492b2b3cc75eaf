"""Draw the pictures of the documents again: `python docs/images/make.py`."""

from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

import gsp
from gsp import charts
from gsp.charts.style import STYLE


def main() -> None:
    """Write the pictures beside this file."""
    folder = Path(__file__).parent
    sleigh(folder)
    charts.save(
        charts.work_precision(gsp.work_precision(gsp.models.load("chaplygin_sleigh"))), folder / "work.png"
    )


def sleigh(folder: Path) -> None:
    """Paths of the sleigh, and the errors of its reduced flows."""
    analysis = gsp.analyse(gsp.models.load("chaplygin_sleigh"))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
        charts.convergence(analysis, left)
        charts.error_against_epsilon(analysis.comparison, right)
        figure.savefig(folder / "sleigh.png", dpi=140)


if __name__ == "__main__":
    main()
