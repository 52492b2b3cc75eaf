"""How every chart looks, and how one becomes a file. Figures are made without pyplot and its global state."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial, wraps
from inspect import signature
from itertools import cycle, product
from pathlib import Path
from textwrap import shorten
from typing import Any, Concatenate, ParamSpec, cast, get_type_hints

import matplotlib
import numpy as np
import sympy as sp
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.markers import MarkerStyle
from matplotlib.mathtext import MathTextParser
from matplotlib.path import Path as Outline
from matplotlib.ticker import MaxNLocator

from gsp.charts.options import check_options
from gsp.errors import DeclarationError, OutputError
from gsp.results.files import write_file
from gsp.results.tex import name_in_tex
from gsp.systems.arguments import check_among, check_noun, shown

# Okabe and Ito's palette: told apart with any colour vision, and in grey by their order of lightness.
BLUE, VERMILION, GREEN, PURPLE, SKY, AMBER = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00"
INK, GREY, PALE, FLOW = "#222222", "#767676", "#C9CED6", "#93A5B8"
SERIES = (BLUE, GREEN, VERMILION, PURPLE, AMBER, SKY)
LINES = ("-", "--", ":", "-.")
MARKERS = ("o", "s", "^", "D", "v", "P")
# Light to dark, as epsilon falls towards the limit.
LADDER = ("#F5C79A", "#F08C2E", "#C4480A", "#7D2600", "#2B0E00")
# 5.1 inches are 130 mm: set at 100 mm, the 9 point letters are 7 point.
WIDTH = 5.1
STYLE: Any = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 10,
    "axes.labelsize": 11,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "legend.frameon": False,
    "legend.fontsize": 9,
    "legend.handlelength": 1.8,
    "lines.linewidth": 1.5,
    # Years stand as 2020.5, and not as 0.5 beside +2.02e3.
    "axes.formatter.offset_threshold": 6,
    # Of axes in space alone.
    "grid.color": "#E3E6EA",
    "grid.linewidth": 0.6,
}
P = ParamSpec("P")


def looks() -> Iterator[dict[str, Any]]:
    """Colours, and broken lines when these are used up, for as many curves as a picture has."""
    return ({"color": colour, "ls": line} for line, colour in cycle(product(LINES, (*SERIES, INK))))


def chart(*, height: float = 3.5, solid: Callable[[Any], bool] = lambda result: False):
    """Give a chart its style, and a figure of its own when it is called without Axes."""

    def decorate(draw: Callable[Concatenate[Any, Axes, P], None]):
        # Looked up when it is first drawn.
        hints = cache(lambda: get_type_hints(draw))
        first = next(iter(signature(draw).parameters))

        @wraps(draw)
        def drawn(result, axes: Axes | None = None, /, *args: P.args, **kwargs: P.kwargs) -> Axes:
            check_noun(result, hints()[first], verb=f"charts.{draw.__name__}")
            check_options(kwargs, hints(), verb=f"charts.{draw.__name__}")
            if axes is not None and not isinstance(axes, Axes):
                raise DeclarationError(
                    "charts are drawn on matplotlib's Axes.",
                    "Leave them out to have some made.",
                    got=shown(axes),
                    value=axes,
                )
            with matplotlib.rc_context(STYLE):
                if axes is None:
                    # Twice matplotlib's margin at the sides, where the last tick label ends.
                    figure = Figure(figsize=(WIDTH, height), layout=ConstrainedLayoutEngine(w_pad=0.08))
                    FigureCanvasAgg(figure)
                    axes = cast(Axes, figure.add_subplot(projection="3d" if solid(result) else None))
                    # What a notebook shows of an object that is the value of a cell.
                    axes._repr_png_ = partial(png, axes)  # pyright: ignore[reportAttributeAccessIssue]
                elif axes.name != ("3d" if solid(result) else "rectilinear"):
                    dimension = "three-dimensional" if solid(result) else "plane"
                    raise DeclarationError(
                        f"{draw.__name__} draws on {dimension} Axes for this result.",
                        "Leave out `axes` to have them made.",
                        got=f"{axes.name} Axes",
                        value=axes.name,
                    )
                draw(result, axes, *args, **kwargs)
                add_units(axes, getattr(getattr(result, "scene", None), "units", {}))
                _fit_labels(axes)
                return axes

        return drawn

    return decorate


def _fit_labels(axes: Axes) -> None:
    """Labels that are longer than the figure, of long names, in letters as small as the axes' length asks for."""
    figure = axes.figure.bbox
    for label, within, whole in (
        (axes.xaxis.label, axes.bbox.width, figure.width),
        (axes.yaxis.label, axes.bbox.height, figure.height),
    ):
        box = label.get_window_extent()
        if (length := max(box.width, box.height)) > whole:
            label.set_fontsize(float(label.get_fontsize()) * within / length)


def add_units(axes: Axes, units: Mapping[str, str]) -> None:
    """Units behind the variables that axes are labelled by, and behind the slow and the fast time."""
    unit_of = {mathematics(name): unit for name, unit in units.items()}
    for axis in "xyz":
        label = getattr(axes, f"get_{axis}label", lambda: "")()
        unit = units.get("t") if label.startswith(("slow time ", "fast time ")) else unit_of.get(label)
        if unit and not label.endswith(f"({plain(unit)})"):
            # With its unit a label is too long to stand upright, and in space to stand as near to the numbers.
            turned = {"rotation": 90} if axis == ("z" if axes.name == "3d" else "y") else {}
            apart = {"labelpad": 11.0 if axes.name == "3d" else 4.0} if turned or axes.name == "3d" else {}
            getattr(axes, f"set_{axis}label")(f"{label} ({plain(unit)})", **turned, **apart)


# Without a time stamp and a version, so that equal figures are equal files.
FORMATS: Mapping[str, Mapping[str, None]] = {
    "png": {"Software": None},
    "pdf": {"Creator": None, "Producer": None, "CreationDate": None},
    "svg": {"Creator": None, "Date": None},
}


def png(axes: Axes) -> bytes:
    """The figure of `axes` as a PNG file, at 200 dots per inch."""
    return drawn(axes, "png")


def drawn(axes: Axes, kind: str) -> bytes:
    """The figure of `axes` as a file of the `kind` png, pdf or svg; raises `DeclarationError` for others."""
    check_noun(axes, Axes, verb="charts.drawn")
    check_among(kind, [*FORMATS], "kind is that of a file.", "There are")
    buffer = io.BytesIO()
    # SVG names its parts by random numbers unless they are salted.
    with matplotlib.rc_context({**STYLE, "svg.hashsalt": "gsp"}):
        cast(Figure, axes.figure).savefig(buffer, format=kind, dpi=200, metadata=dict(FORMATS[kind]))
    return buffer.getvalue()


def save(axes: Axes, path: str | Path) -> Path:
    """Write the figure of `axes` to `path`, as its ending says: .png, .pdf or .svg.

    Raises `OutputError` for any other ending, and when the file cannot be written; none is left half written.
    """
    target = check_chart_name(path)
    content = drawn(axes, target.suffix[1:].lower())
    write_file(content, target)
    return target


def check_chart_name(path: str | Path) -> Path:
    """`path`, when it ends in .png, .pdf or .svg; raises `OutputError` for any other ending."""
    if not isinstance(path, (str, Path)):
        raise DeclarationError(
            "path is the name of a file.", "Let it end in .png, .pdf or .svg.", got=shown(path), value=path
        )
    target = Path(path)
    if target.suffix[1:].lower() not in FORMATS:
        raise OutputError(
            "a chart is written as .png, .pdf or .svg.",
            "Give a name with one of these endings.",
            got=target.name,
        )
    return target


def mathematics(name: str) -> str:
    """`name` as mathematics, omega as the letter; plain text where matplotlib cannot set SymPy's LaTeX."""
    text = f"${name_in_tex(name)}$"
    try:
        MathTextParser("path").parse(text)
    except ValueError:
        return plain(name)
    return text


def plain(text: str, *, width: int = 44) -> str:
    """Text from a model file as a label: one line, shortened, and no mathematics in it."""
    return shorten(text, width=width, placeholder=" ...").replace("$", r"\$")


def manifold_label(small: sp.Symbol | None, value: float) -> str:
    """The label of the slow manifold at this value of the `small` parameter."""
    return rf"$M_\epsilon$, {at_epsilon(small, value)}"


def at_epsilon(small: sp.Symbol | None, value: float) -> str:
    """The label of a run at this value of the `small` parameter, by its own name."""
    return f"{mathematics(str(small))} = {value:.6g}"


def name_axes(axes: Axes, *names: str) -> None:
    """Variables as axis labels, upright ones where they are a single letter."""
    axes.set_xlabel(mathematics(names[0]))
    if len(names) > 1:
        text = mathematics(names[1])
        # A Greek letter is short, and a name of several upright ones is not.
        short = len(names[1]) < 3 or (text.startswith("$\\") and not text.startswith("$\\mathrm"))
        axes.set_ylabel(text, rotation=0 if short else 90, labelpad=9.0 if short else 4.0)


def solid_axes(axes: Any, names: Sequence[str]) -> None:
    """Variables as labels of axes in space, with few ticks and without panes."""
    for axis, name in zip((axes.xaxis, axes.yaxis, axes.zaxis), names):
        axis.set_major_locator(MaxNLocator(5))
        axis.set_pane_color((1, 1, 1, 0))
        axis.set_rotate_label(False)
        axis.set_label_text(mathematics(name))


def colour_bar(axes: Axes, picture: ScalarMappable, label: str) -> None:
    """What the colours of a picture mean, beside it."""
    bar = cast(Figure, axes.figure).colorbar(picture, ax=axes, pad=0.03, label=label)
    cast(Axes, bar.ax).tick_params(length=3)


def arrow_head(
    axes: Axes, tip: tuple[float, float], tail: tuple[float, float], colour: str, *, size: float, zorder: int
) -> None:
    """The head of an arrow at `tip`, coming from `tail`."""
    look = {"arrowstyle": "-|>", "color": colour, "lw": 0, "mutation_scale": size}
    axes.annotate("", tip, tail, arrowprops=look, zorder=zorder)


def legend(axes: Axes, *, columns: int = 3) -> None:
    """The legend above the axes, where it covers no data."""
    handles, labels = axes.get_legend_handles_labels()
    # Fewer columns where names are long.
    for count in range(min(columns, len(handles)), 0, -1):
        made = axes.legend(
            handles, labels, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=count,
            columnspacing=1.3, handletextpad=0.5, borderaxespad=0.4, labelspacing=0.35,
        )  # fmt: skip
        if made.get_window_extent().width <= axes.figure.bbox.width:
            return


def orbit(axes: Axes, x: np.ndarray, y: np.ndarray, colour: str, label: str, *, arrow: bool = True) -> None:
    """A curve with a dot where it starts and an arrow halfway along it."""
    axes.plot(x, y, color=colour, lw=2.0, label=label, zorder=4)
    axes.plot(
        x[:1], y[:1], "o", color=colour, mec="white", mew=0.8, ms=6.5, zorder=6, label="start", clip_on=False
    )
    extent = max(np.ptp(x), np.ptp(y))
    if extent <= 1e-9 * (1.0 + max(np.abs(x).max(), np.abs(y).max())):
        # A run at rest moves by rounding only, and that has no direction.
        return
    size = np.hypot(np.diff(x) / (np.ptp(x) or 1.0), np.diff(y) / (np.ptp(y) or 1.0))
    if arrow:
        half = int(np.searchsorted(size.cumsum(), 0.5 * size.sum()))
        arrow_head(axes, (x[half + 1], y[half + 1]), (x[half], y[half]), colour, size=15, zorder=5)


def darts(axes: Axes, x: np.ndarray, y: np.ndarray, angles: np.ndarray, label: str) -> None:
    """Small darts at points (x, y) that point along `angles` (radians)."""
    outline = Outline([(1.3, 0.0), (-0.8, 0.6), (-0.4, 0.0), (-0.8, -0.6), (1.3, 0.0)], closed=True)
    for angle, at in zip(angles, zip(x, y)):
        marker = MarkerStyle(outline).rotated(rad=float(angle))
        axes.plot(*at, ls="", marker=marker, color=INK, mec="white", mew=0.5, ms=11, zorder=5, clip_on=False)
    axes.plot([], [], ls="", marker=MarkerStyle(outline), color=INK, mec="white", mew=0.5, ms=11, label=label)


def limits(
    trusted: list[np.ndarray], others: list[np.ndarray], *, headroom: float = 0.05
) -> tuple[float, float]:
    """Limits of an axis that hold `trusted`, and `others` unless they leave it far behind."""
    low, high = min(map(np.min, trusted)), max(map(np.max, trusted))
    extent = 2.0 * ((high - low) or 1.0)
    for values in others:
        low = min(low, max(float(values.min()), low - extent))
        high = max(high, min(float(values.max()), high + extent))
    height = (high - low) or 1.0
    return low - 0.05 * height, high + headroom * height


def plane_axes(axes: Axes, names: tuple[str, str]) -> None:
    """Axes of a path in the plane: equal units."""
    box = axes.dataLim
    slender = not 0.4 < box.width / (box.height or 1.0) < 2.5
    axes.set_aspect("equal", adjustable="datalim" if slender else "box")
    name_axes(axes, *names)
    legend(axes, columns=5)
