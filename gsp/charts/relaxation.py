"""Charts of relaxation: a singular orbit with the full orbits that close in on it, and mixed modes over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from gsp.analysis.analysis import Analysis
from gsp.charts.critical_lines import draw_critical_lines
from gsp.charts.runs import POINTS, dense_phases
from gsp.charts.sampling import dense_run, margins
from gsp.charts.style import (
    BLUE,
    GREY,
    INK,
    LADDER,
    PALE,
    SKY,
    VERMILION,
    arrow_head,
    at_epsilon,
    chart,
    legend,
    mathematics,
    name_axes,
)
from gsp.cycles.axis_cycle import ProvedCircuit
from gsp.cycles.cycle_certificate import CycleCertificate, ProvedAnnulus
from gsp.errors import DeclarationError
from gsp.integration.trajectory import Trajectory
from gsp.orbits.periodic.orbit import PeriodicOrbit
from gsp.results.bounds import at_least
from gsp.singular.mixed_modes import MixedMode
from gsp.singular.singular_orbit import SingularOrbit
from gsp.singular.slow_pieces import SlowPiece

# Light to dark as epsilon falls.
DARKENING = LinearSegmentedColormap.from_list("darkening", LADDER[:3])


@chart(height=4.0)
def singular_orbit(
    orbit: SingularOrbit,
    axes: Axes,
    *,
    orbits: Sequence[PeriodicOrbit] = (),
    names: tuple[str, str] | None = None,
) -> None:
    """Slow pieces and drops over the critical manifold, with full periodic orbits, darker as epsilon falls.

    `names` are a slow and a fast variable, across and upwards; the first of each unless given. The critical
    manifold is drawn for one variable of each kind.
    """
    across, up = names or (orbit.branch.system.x[0].name, orbit.branch.system.y[0].name)
    system = orbit.branch.system
    slow, fast = [s.name for s in system.x], [s.name for s in system.y]
    if across not in slow or up not in fast:
        raise DeclarationError(
            f"a singular orbit is drawn over a slow variable, one of {', '.join(slow)}, and a fast one, one "
            f"of {', '.join(fast)}.",
            got=f"{(across, up)!r}",
        )
    leading = len(orbit.pieces) - orbit.period_pieces if orbit.closes else 0
    runs = [dense_run(piece.run) for piece in orbit.pieces]
    corners = [np.stack([run[across], run[up]]) for run in runs]
    approach = leading > 0 and _leaves(corners[:leading], corners[leading:])
    for i, piece in enumerate(orbit.pieces):
        colour, width = (SKY, 1.4) if i < leading else (BLUE, 2.4)
        label = "what leads to it" if approach and i == 0 else "slow piece" if i == leading else None
        axes.plot(*corners[i], color=colour, lw=width, zorder=5, label=label, solid_capstyle="round")
        if piece.fold is not None:
            corners.append(_drop(axes, piece, across, up, colour, labelled=i == leading))
    ladder = sorted(orbits, key=lambda found: -(found.epsilon or 0.0))
    for i, found in enumerate(ladder):
        dense = dense_phases(found)
        line = np.stack([found.values(across, dense), found.values(up, dense)])
        corners.append(line)
        label = None if found.epsilon is None else at_epsilon(found.flow.epsilon, found.epsilon)
        colour = DARKENING(i / max(len(ladder) - 1, 1))
        axes.plot(*line, color=colour, lw=1.0, zorder=4, label=label)
    together = np.concatenate(corners, axis=1)
    limits = np.array([margins(row, 0.08) for row in together])
    if len(slow) == len(fast) == 1:
        draw_critical_lines(system, axes, *limits.T, colour=GREY, width=1.3)
    axes.set(xlim=limits[0], ylim=limits[1])
    name_axes(axes, across, up)
    legend(axes, columns=4)


def _leaves(approach: list[np.ndarray], cycle: list[np.ndarray]) -> bool:
    """Whether what leads to a cycle begins away from it, further than the width of a line."""
    together = np.concatenate([*approach, *cycle], axis=1)
    size = np.ptp(together, axis=1)
    away = (np.concatenate(cycle, axis=1) - approach[0][:, :1]) / np.where(size > 0.0, size, 1.0)[:, None]
    return bool(np.hypot(*away).min() > 0.01)


def _drop(axes: Axes, piece: SlowPiece, across: str, up: str, colour: str, *, labelled: bool) -> np.ndarray:
    """The drop from a fold, at constant slow variables, with a double arrow: its two ends (2, 2)."""
    assert piece.fold is not None
    ends = [piece.fold.point]
    if piece.fold.drop.lands:
        ends.append(piece.fold.drop.point)
    line = np.array([[end[name] for end in ends] for name in (across, up)])
    axes.plot(*line[:, 0], "o", color=INK, ms=5.5, zorder=7, label="fold" if labelled else None)
    if len(ends) > 1:
        axes.plot(*line, color=colour, lw=1.4, zorder=5, label="drop" if labelled else None)
        # The two heads of a drop's arrow, as shares of the way.
        for share in (0.5, 0.58):
            tail, head = (line[:, 0] + part * (line[:, 1] - line[:, 0]) for part in (share - 0.02, share))
            arrow_head(axes, tuple(head), tuple(tail), colour, size=14, zorder=6)
        axes.plot(
            *line[:, 1],
            "s",
            color=INK,
            mfc="white",
            ms=5,
            zorder=7,
            label="landing point" if labelled else None,
        )
    return line


@chart(height=4.0)
def cycle_annulus(cycle: CycleCertificate, axes: Axes) -> None:
    """The annuli in which a relaxation cycle is proved, the narrower one darker, about the singular orbit."""
    singular_orbit(cycle.orbit, axes)
    _annuli(axes, cycle)
    legend(axes, columns=2)


def _annuli(axes: Axes, cycle: CycleCertificate) -> None:
    """Annuli as areas, with room for them."""
    small = cycle.orbit.branch.system.epsilon
    # Where one annulus serves for both, it is drawn as that of the only cycle.
    alone = cycle.existence is cycle.uniqueness
    for one, colour, what in (
        (None if alone else cycle.existence, PALE, "a cycle"),
        (cycle.uniqueness, SKY, "the only cycle"),
    ):
        if one is None:
            continue
        borders = _borders(one)
        codes = [[Path.MOVETO, *[Path.LINETO] * (len(p) - 2), Path.CLOSEPOLY] for p in borders]
        label = f"{what}, {mathematics(small.name)} up to {at_least(one.epsilon, 3)}"
        axes.add_patch(
            PathPatch(
                Path(np.vstack(borders), np.concatenate(codes)), fc=colour, ec=INK, lw=0.5, alpha=0.5, zorder=1,
                label=label,
            )
        )  # fmt: skip
        for i, (row, limits, put) in enumerate(
            (
                (borders[0], axes.get_xlim(), axes.set_xlim),
                (borders[0], axes.get_ylim(), axes.set_ylim),
            )
        ):
            low, high = margins(row[:, i], 0.04)
            put(min(low, limits[0]), max(high, limits[1]))


def _borders(one: ProvedAnnulus | ProvedCircuit) -> list[np.ndarray]:
    """Closed lines about the area: of an annulus, or of a strip with the tube of its delay."""
    if isinstance(one, ProvedAnnulus):
        return [np.vstack([p, p[:1]]) for p in (one.annulus.outer, one.annulus.inner[::-1])]
    # The line from further on is about the other one; its ends go down to the invariant sheet.
    way = one.delays[0].grid[-1] - one.delays[0].grid[0]
    inner, outer = sorted((one.strip.outer, one.strip.inner), key=lambda line: line[0, 0] * way)
    feet = [(outer[-1, 0], 0.0), (outer[0, 0], 0.0)]
    level = np.array([0.0, float(one.level)])
    return [np.vstack([outer, feet, outer[:1]]) + level, np.vstack([inner[::-1], inner[-1:]]) + level]


@chart(height=4.0)
def relaxation(analysis: Analysis, axes: Axes) -> None:
    """The full system through the folds, in the plane of the slow and the first fast variable, over M0.

    With the singular orbit below it where that closes: its slow pieces, its jumps and where they land; and with the
    annulus in which a cycle is proved for every epsilon up to that of the scene.

    Raises `DeclarationError` where the analysis has no such run.
    """
    run = analysis.phenomenon
    if not isinstance(run, Trajectory):
        raise DeclarationError(
            f"no run of {analysis.scene.name or 'this scene'} swings over folds of one slow variable.",
            "Draw `phase_portrait` instead.",
        )
    system, found = analysis.study.system, analysis.boundary.orbit
    across, up = system.x[0].name, system.y[0].name
    dense = dense_run(run)
    line = np.stack([dense[across], dense[up]])
    limits = np.array([margins(row, 0.08) for row in line])
    proved = analysis.boundary.cycle
    if found is not None and (found.closes or (proved is not None and proved.epsilon_0 > 0.0)):
        singular_orbit(found, axes)
        if proved is not None:
            _annuli(axes, proved)
        drawn = np.array([axes.get_xlim(), axes.get_ylim()])
        limits = np.column_stack([np.minimum(limits, drawn)[:, 0], np.maximum(limits, drawn)[:, 1]])
    elif len(system.y) == 1:
        draw_critical_lines(system, axes, *limits.T, colour=GREY, width=1.3)
    axes.plot(
        *line,
        color=VERMILION,
        lw=1.0,
        zorder=6,
        label=f"full run, {at_epsilon(analysis.scene.system.epsilon, analysis.scene.epsilon)}",
    )
    axes.plot(*line[:, :1], "o", color=VERMILION, mec="white", mew=0.8, ms=6.5, zorder=8, label="start")
    axes.set(xlim=limits[0], ylim=limits[1])
    name_axes(axes, across, up)
    legend(axes, columns=3)


@chart(height=3.3)
def mixed_mode(mode: MixedMode, axes: Axes) -> None:
    """The variable over time, its maxima told apart as large and small swings, the signature as title.

    Of more than 40 maxima the last are shown.
    """
    # Maxima shown at most, the last ones: more run together.
    times = mode.times[-40:]
    first = mode.times.size - times.size
    begin, end = (times[0], times[-1]) if times.size else (mode.run.t[0], mode.run.t[-1])
    # A little before the first maximum, so that its rise is seen.
    begin = max(float(begin) - 0.02 * (end - begin), float(mode.run.t[0]))
    end = min(float(end) + 0.05 * (end - begin), float(mode.run.t[-1]))
    inside = mode.run.t[(mode.run.t >= begin) & (mode.run.t <= end)]
    run = mode.run.sample(np.unique([*inside, *np.linspace(begin, end, POINTS)]))
    axes.plot(run.t, run[mode.name], color=INK, lw=1.0, zorder=2)
    tops = mode.run.sample(times)[mode.name] if times.size else times
    for large, colour, marker, label in (
        (True, VERMILION, "^", "large swing"),
        (False, BLUE, "o", "small swing"),
    ):
        kind = mode.is_large[first:] == large
        if kind.any():
            axes.plot(
                times[kind], tops[kind], marker, color=colour, mec="white", mew=0.5, ms=7 if large else 5.5,
                zorder=3, label=label,
            )  # fmt: skip
    axes.margins(x=0.01)
    axes.set_xlabel("$t$")
    axes.set_ylabel(mathematics(mode.name), rotation=0 if len(mode.name) < 3 else 90, labelpad=9.0)
    legend(axes, columns=2)
    unit = " ".join(rf"{large}^{{{small}}}" for large, small in mode.pattern)
    axes.set_title(f"${unit}$" if unit else "no repeating pattern", loc="right", fontsize=12, color=INK)
