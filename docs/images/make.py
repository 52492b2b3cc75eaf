"""Draw the pictures of the documents again: `python docs/images/make.py`."""

import re
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import sympy as sp
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from PIL import Image, ImageOps

import gsp
from gsp import charts
from gsp.charts.style import STYLE

FOLDER = Path(__file__).parent


def ensemble() -> None:
    """The figure of docs/ensembles.md."""
    field = gsp.models.load("chaplygin_sleigh").system
    cloud = np.random.default_rng(0).uniform(-1, 1, (1000, 3))
    times = 0.05 * np.linspace(0, 1, 60) ** 2
    landing = gsp.integrate_many(field, cloud, span=(0, 0.05), epsilon=0.01, at=times, rtol=1e-6)
    charts.save(charts.spread(landing, name="w"), FOLDER / "ensemble.png")


def sleigh() -> None:
    """The figures of README.md, one of which moves."""
    analysis = gsp.analyse(gsp.models.load("chaplygin_sleigh"))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
        charts.convergence(analysis, left)
        charts.error_against_epsilon(analysis.comparison, right)
        figure.savefig(FOLDER / "sleigh.png", dpi=140)
    gsp.animate(gsp.models.load("chaplygin_sleigh"), FOLDER / "sleigh.gif", seconds=5)


def enzyme() -> None:
    """The picture that the Python of README.md draws."""
    readme = (FOLDER.parent.parent / "README.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", readme, re.DOTALL | re.MULTILINE)
    names: dict = {}
    exec(compile(code, "README.md", "exec"), names)
    # As small as it is shown, so that its letters are not.
    names["axes"].figure.set_size_inches(3.6, 3.2)
    names["axes"].figure.savefig(FOLDER / "enzyme.png", dpi=150)


def averaging() -> None:
    """The figure of docs/averaging.md."""
    example = FOLDER.parent.parent / "examples/scales/averaging.py"
    names: dict = {}
    exec(compile(example.read_text(encoding="utf-8"), str(example), "exec"), names)
    charts.save(charts.averaging(names["found"]), FOLDER / "averaging.png")


def ramps() -> None:
    """The figures of docs/ramps.md."""
    example = FOLDER.parent.parent / "examples/passage/ramps.py"
    names: dict = {}
    exec(compile(example.read_text(encoding="utf-8"), str(example), "exec"), names)
    charts.save(charts.critical_rate(names["found"]), FOLDER / "ramp-threshold.png")
    charts.save(charts.rate_diagram(names["diagram"]), FOLDER / "ramp-diagram.png")


# Part of a picture, as shares of its width and height from the left and from the top.
THUMBNAILS = {
    "sleigh": ("sleigh.png", (0.03, 0.2, 0.4, 0.95)),
    "canard": ("canard_explosion.png", (0.5, 0.09, 1.0, 1.0)),
    "relaxation": ("relaxation.png", (0.0, 0.14, 0.5, 1.0)),
    "folded-node": ("folded_node.png", (0.55, 0.12, 1.0, 0.95)),
    "buffer": ("demo-shishkova.png", (0.018, 0.262, 0.317, 0.614)),
    "failures": ("failures.png", (0.0, 0.2, 0.525, 1.0)),
}
THUMBNAIL = (280, 220)


def thumbnails() -> None:
    """The gallery of README.md, from the other pictures of this folder."""
    for name, (source, (left, top, right, bottom)) in THUMBNAILS.items():
        picture = Image.open(FOLDER / source).convert("RGB")
        w, h = picture.size
        part = ImageOps.contain(
            picture.crop((int(left * w), int(top * h), int(right * w), int(bottom * h))), THUMBNAIL
        )
        framed = ImageOps.pad(part, THUMBNAIL, color="white")
        framed.quantize(128).save(FOLDER / f"thumbnail-{name}.png", optimize=True)


def work_precision() -> None:
    """The figure of docs/work-precision.md."""
    found = gsp.work_precision(gsp.models.load("chaplygin_sleigh"))
    charts.save(charts.work_precision(found), FOLDER / "work.png")


def failure_map() -> None:
    """The figure of docs/failure-map.md."""
    found = gsp.failure_map(gsp.models.load("van_der_pol"))
    charts.save(charts.failure_map(found), FOLDER / "failures.png")


def sweeps() -> None:
    """The figures of docs/sweeps.md."""
    with tempfile.TemporaryDirectory() as scratch:
        maps = gsp.sweep(
            "failure_map",
            model="chaplygin_sleigh",
            over={
                "a": (0.1, 0.2, 0.4, 0.8),
                "epsilon": np.geomspace(1e-3, 0.3, 24),
                "tolerance": np.geomspace(1e-10, 1e-1, 28),
            },
            into=Path(scratch, "maps"),
        ).to_xarray()
        reduced = maps.holds.sel(method=[f"reduced flow {n}" for n in range(4)]).values
        least = np.where(reduced.any(axis=-1), reduced.argmax(axis=-1), 4)
        file = Path(scratch, "family.toml")
        file.write_text(
            '[parameters]\na = 1\nb = 1\nc = 1\n[slow]\ny = "a - x"\n[fast]\nx = "b*x - c*x^3/3 + y"\n'
            "[region]\ny = [-0.5, 0.5]\nx = [1.5, 3]\n[start]\nx = 2\ny = 0\n"
            "[scene]\nspan = [0, 1]\nepsilon = 0.01\n"
        )
        canards = gsp.sweep(
            "canard_value",
            model=file,
            over={"b": np.linspace(0.6, 2.0, 15), "c": np.linspace(0.6, 2.0, 15)},
            options={"parameter": "a"},
            into=Path(scratch, "canards"),
        ).to_xarray()
        values = canards.value.values
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 2.9), layout="constrained")
        panels = figure.subplots(1, 4, sharey=True)
        colours = ListedColormap(
            [*matplotlib.colormaps["YlOrBr"]([0.15, 0.4, 0.65, 0.9]), (0.85, 0.85, 0.88, 1.0)]
        )
        for panel, a, cells in zip(panels, maps.a.values, least):
            panel.pcolormesh(maps.epsilon, maps.tolerance, cells.T, cmap=colours, vmin=-0.5, vmax=4.5)
            panel.set(xscale="log", yscale="log", xlabel=r"$\epsilon$", title=f"$a = {a:g}$")
        panels[0].set_ylabel("tolerance")
        names = ["order 0", "order 1", "order 2", "order 3", "none"]
        handles = [Patch(facecolor=colours(k), label=name) for k, name in enumerate(names)]
        figure.legend(handles=handles, loc="outside upper center", ncols=5)
        figure.savefig(FOLDER / "sweep_failures.png", dpi=140)
        figure = Figure(figsize=(4.6, 3.8), layout="constrained")
        axes = figure.subplots()
        lines = axes.contour(canards.c, canards.b, values, levels=12, cmap="viridis")
        axes.clabel(lines, fontsize=8)
        axes.set(xlabel="$c$", ylabel="$b$")
        figure.savefig(FOLDER / "sweep_canards.png", dpi=140)


def switches() -> None:
    """The figure of docs/choosing.md."""
    oscillator = replace(
        gsp.models.load("van_der_pol"),
        region={"y": (-2, 2), "x": (-3, 3)},
        span=(0, 4),
        epsilon=0.01,
        tolerance=1e-3,
    )
    charts.save(charts.switches(gsp.simulate(oscillator)), FOLDER / "switches.png")


def canard_explosion() -> None:
    """The figure of docs/periodic-orbits.md: van der Pol's cycles from the Hopf point to relaxation."""
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
        figure.savefig(FOLDER / "canard_explosion.png", dpi=140)


def folded_node() -> None:
    """The figure of docs/canards.md: the self-coupled FitzHugh-Nagumo system of AUTO's demo fnc at epsilon = 0.015."""
    v, h, s, epsilon = sp.symbols("v h s epsilon")
    system = gsp.SlowFastSystem(
        slow={h: -2 * h - sp.Rational(13, 5) * v, s: -sp.Rational(113, 200) * s},
        fast={v: h - (v**3 - v + 1) / 2 - s * v / 2},
        epsilon=epsilon,
    )
    (node,) = gsp.folded_singularities(system, region={"v": (-1, 0)})
    found = gsp.folded_canards(
        node, epsilon=0.015, section={"s": 0.2797}, attracting={"h": -6}, repelling={"v": 0}
    )
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 4.4), layout="constrained")
        charts.canard_section(found, figure.add_subplot(1, 2, 1))
        charts.canard_orbits(found, figure.add_subplot(1, 2, 2, projection="3d"))
        figure.savefig(FOLDER / "folded_node.png", dpi=140)


def relaxation() -> None:
    """The figure of docs/relaxation.md: van der Pol's singular orbit, and Koper's mixed modes."""
    x, y, z, epsilon = sp.symbols("x y z epsilon")
    oscillator = gsp.SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon)
    start = {"x": 2, "y": 0.6}
    orbit = gsp.singular_orbit(gsp.solve_critical(oscillator).nearest(start), start)
    full = [gsp.periodic_orbit(oscillator, start=start, epsilon=small) for small in (0.1, 0.03, 0.01, 0.001)]
    koper = gsp.SlowFastSystem(
        slow={y: x - 2 * y + z, z: y - z}, fast={x: -10 * y - x**3 + 3 * x + 7}, epsilon=epsilon
    )
    mode = gsp.mixed_mode(koper, "x", start={"x": -1.5, "y": 0.5, "z": 0.5}, span=(0, 80), epsilon=0.05)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2)
        charts.singular_orbit(orbit, left, orbits=full)
        charts.mixed_mode(mode, right)
        figure.savefig(FOLDER / "relaxation.png", dpi=140)


def main() -> None:
    """Write the pictures beside this file."""
    drawn = (
        sleigh,
        enzyme,
        ensemble,
        work_precision,
        failure_map,
        switches,
        canard_explosion,
        folded_node,
        relaxation,
        averaging,
        ramps,
    )
    for draw in drawn:
        draw()
    thumbnails()


if __name__ == "__main__":
    main()
