"""Chart of the boxes over which normal hyperbolicity is proved."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Rectangle

from gsp.analysis.analysis import Analysis
from gsp.charts.sampling import LINE
from gsp.charts.spectrum import sampled_eigenvalues
from gsp.charts.style import INK, PALE, SERIES, VERMILION, chart, colour_bar, legend, name_axes
from gsp.errors import DeclarationError

Boxes = tuple[tuple[tuple[float, float], ...], ...]


def has_boxes(analysis: Analysis) -> bool:
    """Whether there is a proof, or part of one, over one or two slow variables, in more boxes than the region.

    The boxes of a refutation prove nothing: some of them may hold another sheet.
    """
    found = analysis.hyperbolicity.certificate
    if found is None or found.verdict.name == "REFUTED":
        return False
    return len(found.region) in (1, 2) and bool(found.boxes) and found.tried > 1


@chart()
def proof(analysis: Analysis, axes: Axes) -> None:
    """The boxes of the certificate with the distance from the axis that is proved over each.

    As heights for one slow variable, under the sampled distance; as colours for two. Boxes that are left are hatched.
    Raises `DeclarationError` without such boxes.
    """
    found = analysis.hyperbolicity.certificate
    if found is None or not has_boxes(analysis):
        raise DeclarationError(
            "boxes of a proof are drawn over one or two slow variables.",
            "Read `hyperbolicity.certificate`, which says what is proved.",
            got="none",
        )
    names = list(found.region)
    for side, limits in zip(found.region.values(), (axes.set_xlim, axes.set_ylim)):
        limits(*side)
    if len(names) == 1:
        _heights(analysis, axes, found.boxes, np.array(found.gaps), found.undecided)
    else:
        _colours(axes, found.boxes, np.array(found.gaps), found.undecided)
    name_axes(axes, *names)
    if len(names) == 1:
        axes.set_ylabel(r"$\min\,|\mathrm{Re}\,\lambda|$ in fast time")
    legend(axes)


def _heights(analysis: Analysis, axes: Axes, boxes: Boxes, gaps: np.ndarray, undecided: Boxes) -> None:
    x, eigenvalues = sampled_eigenvalues(analysis, LINE)
    values = np.abs(np.real(eigenvalues)).min(axis=1)
    axes.plot(x[:, 0], values, color=SERIES[0], label="sampled")
    top = 1.1 * float(max(np.nanmax(values), gaps.max()))
    axes.set_ylim(0.0, top)
    label = f"proved in {len(boxes)} boxes"
    for ((low, high),), gap in zip(boxes, gaps):
        axes.add_patch(Rectangle((low, 0.0), high - low, gap, fc=PALE, ec=INK, lw=0.8, label=label, zorder=0))
        label = "_"
    label = f"undecided: {len(undecided)}"
    for ((low, high),) in undecided:
        axes.add_patch(
            Rectangle((low, 0.0), high - low, top, fc="none", ec=VERMILION, hatch="////", lw=0.8, label=label)
        )
        label = "_"


def _colours(axes: Axes, boxes: Boxes, gaps: np.ndarray, undecided: Boxes) -> None:
    patches = [_rectangle(box) for box in boxes]
    picture = PatchCollection(patches, cmap="cividis", edgecolor=INK, linewidth=0.8)
    picture.set_array(gaps)
    axes.add_collection(picture)
    axes.scatter([], [], marker="s", color=INK, facecolors="none", label=f"proved: {len(boxes)}")
    colour_bar(axes, picture, r"proved $\min\,|\mathrm{Re}\,\lambda|$, in fast time")
    label = f"undecided: {len(undecided)}"
    for box in undecided:
        patch = _rectangle(box)
        patch.set(fc="none", ec=VERMILION, hatch="////", lw=0.8, label=label)
        axes.add_patch(patch)
        label = "_"


def _rectangle(box: tuple[tuple[float, float], ...]) -> Rectangle:
    (left, right), (low, high) = box
    return Rectangle((left, low), right - left, high - low)
