"""Charts of passages: through a fold, and along a branch that has lost its stability."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter

from gsp.charts.critical_lines import draw_critical_lines
from gsp.charts.insets import emptiest
from gsp.charts.sampling import margins
from gsp.charts.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    LADDER,
    PALE,
    PURPLE,
    SKY,
    VERMILION,
    at_epsilon,
    chart,
    legend,
    mathematics,
    name_axes,
)
from gsp.cycles.passage_certificate import PassageCertificate
from gsp.errors import DeclarationError
from gsp.results.bounds import at_least
from gsp.singular.passage.delay_measurement import MeasuredDelay
from gsp.singular.passage.delayed_exit import DelayedExit
from gsp.singular.passage.fold_measurement import FoldExit
from gsp.singular.passage.fold_passage import FoldPassage


@chart(height=3.9)
def fold_passage(passage: FoldPassage, axes: Axes, *, exits: Sequence[FoldExit]) -> None:
    """Measured orbits through a fold at a ladder of epsilons, with the delay against epsilon in the corner.

    `exits` are results of `fold_exit` in one section. The first slow variable is drawn across, and upwards the fast
    variable of the section; the critical manifold too where there is one variable of each kind.
    """
    if not exits:
        raise DeclarationError("exits are empty.", "Give results of fold_exit.", got="[]", value=exits)
    system = passage.system
    across, (up, value) = system.x[0].name, exits[0].section
    low_x, high_x, low_y, high_y = _frame(passage, exits, across, up, value)
    if len(system.x) == len(system.y) == 1:
        draw_critical_lines(system, axes, np.array([low_x, low_y]), np.array([high_x, high_y]))
    ladder = sorted(exits, key=lambda found: -found.epsilon)
    for colour, found in zip(LADDER, ladder):
        times = np.linspace(found.run.t[0], min(found.t * 1.02, found.run.t[-1]), 400)
        # The jump takes the last moments: the integrator's own steps resolve it.
        times = np.union1d(times, found.run.t[found.run.t <= found.run.t[-1]])
        run = found.run.sample(times)
        inside = (run[up] > low_y - (high_y - low_y)) & (run[up] < high_y + (high_y - low_y))
        label = at_epsilon(system.epsilon, found.epsilon)
        axes.plot(run[across][inside], run[up][inside], color=colour, lw=1.4, label=label)
    axes.plot(passage.point[across], passage.point[up], "o", color=INK, ms=5.5, zorder=6, label="fold")
    if passage.drop.lands:
        axes.plot(
            [passage.point[across], passage.drop.point[across]],
            [passage.point[up], passage.drop.point[up]],
            color=GREY, lw=1.0, ls=(0, (1, 2)), zorder=1,
        )  # fmt: skip
        axes.plot(
            passage.drop.point[across], passage.drop.point[up], "s", color=INK, mfc="white", ms=5.5, zorder=6,
            label="landing point",
        )  # fmt: skip
    axes.axhline(value, color=PALE, lw=1.0, zorder=0)
    axes.text(
        0.995 if passage.slow_rate[0] > 0.0 else 0.005,
        value,
        "section",
        transform=axes.get_yaxis_transform(),
        color=GREY,
        fontsize=8,
        ha="right" if passage.slow_rate[0] > 0.0 else "left",
        va="bottom",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8},
    )
    axes.set_xlim(low_x, high_x)
    axes.set_ylim(low_y, high_y)
    name_axes(axes, across, up)
    legend(axes, columns=4)
    if len(ladder) > 2:
        _scaling(passage, axes, ladder, across)


def _frame(passage, exits, across: str, up: str, value: float) -> tuple[float, float, float, float]:
    """Limits that hold the fold, the section, the landing point and the longest passage."""
    x0, y0 = passage.point[across], passage.point[up]
    extent = max(abs(found.point[across] - x0) for found in exits) or 1.0
    towards = np.sign(passage.slow_rate[0]) or 1.0
    ends = sorted((x0 - 3.0 * towards * extent, x0 + 1.6 * towards * extent))
    far = passage.drop.point[up] if passage.drop.lands else value
    height = abs(far - y0)
    back = y0 - np.sign(far - y0) * 0.55 * height
    beyond = far + np.sign(far - y0) * 0.12 * height
    return ends[0], ends[1], min(back, beyond), max(back, beyond)


@chart(height=3.9)
def passage_strip(certificate: PassageCertificate, axes: Axes) -> None:
    """The strip in which orbits are proved to pass a loss of hyperbolicity, with its sections, over M0; or the tube in
    which they are proved to stay.

    Raises `DeclarationError` where nothing is proved.
    """
    if certificate.strip is None and certificate.delay is None:
        raise DeclarationError("there is no proof to draw.", got=f"UNDECIDED: {certificate.reason}")
    up_to = f"{mathematics(certificate.system.epsilon.name)} up to {at_least(certificate.epsilon_0, 3)}"
    if certificate.strip is not None:
        strip = certificate.strip.strip
        origin = np.array([float(v) for v in certificate.strip.origin])
        corners = np.vstack([strip.outer, strip.inner[::-1]]) + origin
        axes.fill(*corners.T, fc=SKY, ec=INK, lw=0.5, alpha=0.5, zorder=2, label=f"strip, {up_to}")
        for place, colour, label in ((0, BLUE, "entry"), (-1, VERMILION, "exit")):
            ends = np.stack([strip.outer[place], strip.inner[place]]) + origin
            axes.plot(*ends.T, color=colour, lw=2.4, zorder=5, label=label)
    else:
        corners = _delay_tube(certificate, axes, up_to)
    limits = np.array([margins(row, 0.08) for row in corners.T])
    draw_critical_lines(certificate.system, axes, *limits.T, width=1.3)
    axes.set(xlim=limits[0], ylim=limits[1])
    name_axes(axes, *certificate.names)
    legend(axes, columns=3)


def _delay_tube(certificate: PassageCertificate, axes: Axes, up_to: str) -> np.ndarray:
    """The tube of a delay, with where orbits stay to and where they have left: its corners (k, 2)."""
    exit, delay = certificate.passage, certificate.delay
    assert isinstance(exit, DelayedExit)
    assert delay is not None
    last = delay.kept if delay.left is None else delay.left
    at = delay.grid[: last + 1]
    sheet = exit.branch.points(at[:, None])[:, 0]
    axes.fill_between(
        at, sheet - delay.width, sheet + delay.width, fc=SKY, ec=INK, lw=0.5, alpha=0.5, zorder=2,
        label=f"tube, {up_to}",
    )  # fmt: skip
    for place, colour, label in ((delay.kept, BLUE, "stay so far"), (delay.left, VERMILION, "have left")):
        if place is not None:
            ends = sheet[place] + delay.width * np.array([-2.0, 2.0])
            axes.plot(np.full(2, at[place]), ends, color=colour, lw=1.8, zorder=5, label=label)
    reach = np.concatenate([sheet - 4.0 * delay.width, sheet + 4.0 * delay.width])
    return np.column_stack([np.tile(at, 2), reach])


def _scaling(passage: FoldPassage, axes: Axes, ladder: Sequence[FoldExit], across: str) -> None:
    """The distance of the exits from the fold against epsilon, and its leading term, in the emptiest corner."""
    x0 = passage.point[across]
    places = [(x, y, 0.3, 0.26) for y in np.linspace(0.66, 0.1, 15) for x in np.linspace(0.1, 0.69, 15)]
    corner, covered = emptiest(axes, places)
    if covered:
        # Room on the side that orbits come from.
        low, high = axes.get_ylim()
        margin = 0.32 * (high - low)
        upwards = (
            passage.y0[[s.name for s in passage.system.y].index(ladder[0].section[0])] < ladder[0].section[1]
        )
        axes.set_ylim(low - margin * upwards, high + margin * (not upwards))
        corner, _ = emptiest(axes, places)
    inset = axes.inset_axes(corner)
    epsilons = np.array([found.epsilon for found in ladder])
    delays = np.array([abs(found.point[across] - x0) for found in ladder])
    line = np.geomspace(epsilons.min() / 1.6, epsilons.max() * 1.6, 50)
    inset.plot(line, abs(passage.leading[0]) * line ** (2.0 / 3.0), color=BLUE, lw=1.1)
    for colour, epsilon, delay in zip(LADDER, epsilons, delays):
        inset.plot(epsilon, delay, "o", color=colour, ms=4.5, mec="white", mew=0.5)
    inset.set_xscale("log")
    inset.set_yscale("log")
    inset.xaxis.set_minor_locator(LogLocator(subs=()))
    inset.yaxis.set_minor_formatter(NullFormatter())
    inset.tick_params(labelsize=7.5)
    name = mathematics(across).strip("$")
    inset.set_title(
        rf"$|{name} - {name}_0|$ and $\Omega_0$ term, against $\epsilon$", fontsize=8, color=INK, pad=3
    )
    inset.patch.set_alpha(0.9)


@chart(height=4.0)
def delayed_exit(measured: MeasuredDelay, axes: Axes) -> None:
    """The distance from the branch along slow time, in extended and in double precision, with what was expected.

    Thin lines are the growth that int Re lambda predicts: dashed from the limit of the loss or from the entry, dotted
    from rounding.
    """
    delayed, epsilon = measured.delayed, measured.epsilon
    loss = delayed.loss
    t, distance = measured.extended_distance
    # Distances below this are not drawn: what is left of a start long forgotten.
    settled = distance[(distance > 1e-40) & (t > 0.1 * loss.t)]
    bottom = min(0.02 * float(np.min(settled, initial=measured.radius)), 1e-4 * measured.radius)
    top = 30.0 * max(measured.radius, float(distance[0]))
    axes.semilogy(
        *_clipped(*measured.double_distance, top), color=VERMILION, lw=1.5, label="double precision", zorder=3
    )
    axes.semilogy(*_clipped(t, distance, top), color=BLUE, lw=2.0, label=f"{measured.digits} digits", zorder=4)
    phi_loss = float(np.interp(loss.t, delayed.times, delayed.phi))
    after = delayed.times >= loss.t
    phi_exit = float(np.interp(delayed.t, delayed.times, delayed.phi))
    with np.errstate(under="ignore"):
        grown = measured.radius * np.exp(np.clip((delayed.phi - phi_exit) / epsilon, -600.0, 600.0))
        noisy = np.exp(np.clip((delayed.phi - phi_loss) / epsilon - delayed.rounding, -600.0, 600.0))
    growths = [(grown, r"$\exp(\Phi/\epsilon)$", BLUE, (0, (4, 2)))]
    if measured.expected_double is not None:
        growths.append((noisy, "from rounding", VERMILION, (0, (1, 2))))
    for growth, name, colour, dashes in growths:
        keep = after & (growth < top) & (growth > bottom)
        axes.semilogy(delayed.times[keep], growth[keep], color=colour, lw=0.9, ls=dashes, zorder=2, label=name)
    axes.axhline(measured.radius, color=PALE, lw=1.0, zorder=0)
    marks = [(loss.t, str(loss.kind), GREY), (delayed.t, str(delayed.kind), GREEN)]
    if delayed.buffer is not None and abs(delayed.buffer - delayed.t) > 1e-6:
        marks.append((delayed.buffer, "buffer point", PURPLE))
    for place, name, colour in marks:
        axes.axvline(place, color=colour, lw=1.0, ls="-", zorder=1, label=name)
    axes.set_ylim(bottom, top)
    end = max(delayed.t, delayed.buffer or 0.0)
    axes.set_xlim(0.0, end + 0.12 * (end - 0.0))
    decades = int(np.ceil(np.log10(top / bottom)))
    powers = np.arange(np.ceil(np.log10(bottom)), np.log10(top), max(1, decades // 7))
    axes.yaxis.set_major_locator(FixedLocator([float(10.0**p) for p in powers]))
    axes.yaxis.set_minor_locator(FixedLocator([]))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel(r"slow time after the entry")
    axes.set_ylabel("distance from $M_0$")
    axes.text(
        0.015, 0.03, at_epsilon(delayed.branch.system.epsilon, epsilon), transform=axes.transAxes, color=INK
    )
    legend(axes, columns=3)


def _clipped(t: np.ndarray, values: np.ndarray, top: float) -> tuple[np.ndarray, np.ndarray]:
    """A run up to where it leaves the picture, zeros left out."""
    beyond = np.flatnonzero((values > top) | ~np.isfinite(values))
    end = int(beyond[0]) + 1 if beyond.size else len(values)
    shown = np.where(values[:end] > 0.0, values[:end], np.nan)
    return t[:end], np.minimum(shown, top * 10.0)
