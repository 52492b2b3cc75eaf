"""Charts of a family of cycles: amplitude against the parameter with its explosion, and the cycles over M0."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.ticker import MaxNLocator

from gsp.charts.critical_lines import critical_lines
from gsp.charts.insets import emptiest
from gsp.charts.runs import dense_phases
from gsp.charts.sampling import widened
from gsp.charts.style import (
    AMBER,
    BLUE,
    GREEN,
    GREY,
    INK,
    PALE,
    PURPLE,
    VERMILION,
    chart,
    legend,
    mathematics,
    name_axes,
)
from gsp.errors import DeclarationError
from gsp.orbits.periodic.family import CycleKind, OrbitFamily, stability_runs
from gsp.singular.singularities.canard_points import CanardError
from gsp.singular.singularities.canard_value import CanardValue
from gsp.systems.system import SlowFastSystem

# Small to large, all the way from the Hopf point to relaxation.
GROWING = LinearSegmentedColormap.from_list("growing", [BLUE, GREEN, AMBER, VERMILION, PURPLE])
MARKERS: dict[CycleKind, str] = {
    CycleKind.FOLD: "o",
    CycleKind.BRANCH_POINT: "P",
    CycleKind.PERIOD_DOUBLING: "D",
    CycleKind.TORUS: "*",
}
STABILITY = {True: ("stable", BLUE, "-"), False: ("unstable", VERMILION, "--")}


@chart(height=3.9)
def canard_explosion(
    family: OrbitFamily, axes: Axes, *, name: str | None = None, canard: CanardValue | None = None
) -> None:
    """Amplitude of a state against the family's parameter, the first explosion enlarged in an inset.

    `name` is the state; the first fast one of a slow-fast system unless given, else the first. With `canard`, its
    value at the family's epsilon is marked.
    """
    state = name or _plane(family)[0]
    values, amplitude = family[family.parameter], family.amplitude(state)
    _amplitudes(axes, family, values, amplitude)
    parameter = mathematics(family.parameter)
    if family.hopf is not None:
        axes.plot(
            family.hopf.value, 0.0, "s", color=GREEN, mec=INK, ms=6, clip_on=False, label="Hopf point", zorder=6
        )  # fmt: skip
    name_axes(axes, family.parameter)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_ylabel(f"amplitude of {mathematics(state)}")
    axes.set_ylim(0.0, 1.06 * float(amplitude.max()))
    value = None if canard is None else _value(canard, family)
    if value is not None:
        axes.axvline(value, color=GREY, lw=1.0, ls=":", zorder=1, label="canard value")
    if family.explosions:
        explosion = family.explosions[0]
        centre = explosion.value if value is None else value
        height = amplitude[explosion.rows] / amplitude.max()
        # The inset shows the explosion between these shares of the largest amplitude.
        middle = (height >= 0.25) & (height <= 0.75)
        spread = float(np.abs(values[explosion.rows][middle] - centre).max(initial=0.0)) or explosion.width
        # A round width, so that the ticks can be read, in which the error of the cycles is not seen.
        blur = 20.0 * max(orbit.error for orbit in family.orbits[explosion.rows]) * float(np.ptp(values))
        exponent = int(np.ceil(np.log10(max(spread, blur, 1e-15 * max(1.0, abs(centre))))))
        # In shares of the axes: left, bottom, width, height.
        places = [(left, bottom, 0.4, 0.42) for bottom in (0.15, 0.48) for left in (0.13, 0.55)]
        inset: Any = axes.inset_axes(emptiest(axes, places)[0])
        _amplitudes(inset, family, (values - centre) / 10.0**exponent, amplitude)
        if value is not None:
            inset.axvline(0.0, color=GREY, lw=1.0, ls=":", zorder=1)
        inset.set_xlim(-1.0, 1.0)
        inset.set_ylim(0.0, 1.06 * float(amplitude.max()))
        inset.set_title(
            f"({parameter} $-$ {centre:.{max(2, 3 - exponent)}f}) / $10^{{{exponent}}}$", fontsize=8, pad=4
        )
        inset.tick_params(labelsize=8)
    legend(axes, columns=4)


@chart(height=3.9)
def canard_cycles(family: OrbitFamily, axes: Axes, *, names: tuple[str, str] | None = None) -> None:
    """Cycles of a family in the plane of two states, coloured from small to large, over M0 of a planar system.

    They are those up to the end of the first explosion, or to the largest without one. `names` are the states of the
    two axes; the first fast one and the first slow one unless given.
    """
    across, up = names or _plane(family)
    found = family.explosions
    last = found[0].last if found else int(np.argmax(family.amplitude(across)))
    # Evenly spread as the cycles change in amplitude and in period: with a head they grow in neither for long.
    measures = np.array([family.amplitude(across), family.amplitude(up), family.period])[:, : last + 1]
    measures /= measures.max(axis=1, keepdims=True)
    along = np.append(0.0, np.linalg.norm(np.diff(measures, axis=1), axis=0).cumsum())
    # Nine cycles are drawn.
    lengths = np.linspace(0.0, along[-1], 10)[1:]
    rows = sorted({int(np.argmin(np.abs(along - w))) for w in lengths})
    curves = []
    for orbit in (family.orbits[row] for row in rows):
        phases = dense_phases(orbit)
        curves.append((orbit.values(across, phases), orbit.values(up, phases)))
    # M0 where the explosion is; the parameter hardly moves over it.
    _critical_manifold(axes, family, found[0].row if found else last, (across, up), curves)
    for place, (x, y) in enumerate(curves):
        share = place / max(len(curves) - 1, 1)
        label = "smallest" if place == 0 else "largest cycle" if place == len(curves) - 1 else None
        axes.plot(x, y, color=GROWING(share), lw=1.5, label=label, zorder=3 + place)
    if family.hopf is not None:
        axes.plot(
            family.hopf.point[across], family.hopf.point[up], "s", color=GREEN, mec=INK, ms=5, zorder=20,
            label="Hopf point",
        )  # fmt: skip
    name_axes(axes, across, up)
    legend(axes, columns=4)


def _plane(family: OrbitFamily) -> tuple[str, str]:
    """The states to draw: the first fast and the first slow one, or the first two."""
    flow = family.flow
    if isinstance(flow, SlowFastSystem):
        return flow.y[0].name, flow.x[0].name
    names = [symbol.name for symbol in flow.states]
    return names[0], names[1]


def _amplitudes(axes: Any, family: OrbitFamily, values: np.ndarray, amplitude: np.ndarray) -> None:
    """Amplitude over the parameter by stability, with the special orbits."""
    shown: set[str] = set()
    for rows, stable in stability_runs(family):
        label, colour, line = STABILITY[stable]
        axes.plot(values[rows], amplitude[rows], color=colour, ls=line, lw=1.7, label=_once(label, shown))
    for special in family.special:
        axes.plot(
            values[special.row], amplitude[special.row], MARKERS[special.kind], color=INK, ms=5, zorder=5,
            label=_once(str(special.kind), shown),
        )  # fmt: skip


def _once(label: str, shown: set[str]) -> str | None:
    new = label not in shown
    shown.add(label)
    return label if new else None


def _value(canard: CanardValue, family: OrbitFamily) -> float | None:
    """The canard value in double precision, or to the digits that its series has at this epsilon."""
    if family.epsilon is None or canard.parameter.name != family.parameter:
        raise DeclarationError(
            f"the canard value is one of {canard.parameter} in a system with epsilon.",
            "Take the canard value of the family's parameter.",
            got=f"a family in {family.parameter}",
            value=family.parameter,
        )
    for digits in range(17, 0, -1):
        try:
            return float(canard.value(family.epsilon, digits=digits))
        except CanardError:
            continue
    return None


def _critical_manifold(axes: Axes, family: OrbitFamily, row: int, names: tuple[str, str], curves) -> None:
    system = family.flow
    if not isinstance(system, SlowFastSystem) or len(system.states) != 2 or family.epsilon is None:
        return
    order = [names.index(symbol.name) for symbol in system.states]
    cycles = np.concatenate(curves, axis=1)[order]
    here = system.with_parameters(**family.orbits[row].parameters)
    for line in critical_lines(here, *widened(cycles.min(axis=1), cycles.max(axis=1), 0.1)):
        # Two states: what puts them in order puts them back.
        axes.plot(*line[:, order].T, color=PALE, lw=4.0, zorder=1)
    axes.plot([], [], color=PALE, lw=4.0, label="$M_0$")
    axes.margins(0.0)
