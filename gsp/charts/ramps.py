"""Charts of ramps: what tracks, what tips and the threshold between, and critical rates against the amplitude."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from gsp.charts.style import BLUE, GREEN, GREY, INK, PURPLE, VERMILION, chart, legend, mathematics
from gsp.errors import DeclarationError
from gsp.singular.ramps.critical_rate import CriticalRate
from gsp.singular.ramps.ramp_run import RampRun
from gsp.singular.ramps.rate_diagram import RateDiagram
from gsp.systems.arguments import check_among, check_whole

# Runs beside a threshold are at its rate times and divided by this.
BESIDE = 1.3
# What leaves the window is drawn this far beyond the rest points, in shares of the way between them.
BEYOND = 0.6


@chart(height=3.9)
def critical_rate(found: CriticalRate, axes: Axes, *, name: str | None = None, threshold: int = 0) -> None:
    """A state over time for rates on both sides of a threshold, with the one that meets the edge state between.

    `name` is the state, the first that moves unless given; `threshold` counts those that were found, from the lowest.
    Time is 0 half way along the ramp. Rest points are those of the parameters of the moment.
    """
    states = [x.name for x in found.ramped.field.states]
    if found.end is None or not found.rates:
        why = (
            "no critical rate was found"
            if not found.rates
            else "the ramp has no end"
            if found.ramped.ramp.ends[1] is None
            else "what tips is told by a level, and there is no edge state"
        )
        raise DeclarationError(f"there is no threshold to draw: {why}.", got=str(found.verdict))
    check_whole(threshold, what="threshold", most=len(found.rates) - 1)
    rate = found.rates[threshold]
    tips_below = found.slow_tips != bool(threshold % 2)
    runs = [(found.run(rate * factor), factor) for factor in (1 / BESIDE, BESIDE)]
    middle = found.run(rate)
    moves = np.ptp(middle.x, axis=0) > 1e-9 * np.abs(middle.x - found.ramped.centre.x).max(axis=0)
    state = states[int(np.argmax(moves))] if name is None else name
    check_among(state, states, "name is that of a state.", "They are")
    # Beyond the edge state rounding alone decides where the orbit on the threshold goes.
    away = np.abs(middle[state] - found.end.x[states.index(state)])
    nearest = int(np.argmin(away))
    # The orbit on the threshold is drawn until it has left the edge state by this share of its way.
    left = np.flatnonzero(away[nearest:] > 0.01 * away.max())
    stays = slice(0, nearest + int(left[0]) if len(left) else len(away))
    still = [_rest(found, middle, state, which) for which in (0, 1)]
    for values, label, colour in zip(still, ("rest point", "edge state"), (GREY, PURPLE)):
        axes.plot(middle.t, values, color=colour, lw=1.2, ls="--", zorder=1, label=label)
    for run, factor in runs:
        tips = tips_below == (factor < 1)
        axes.plot(
            run.t, run[state], color=VERMILION if tips else GREEN, lw=1.8, zorder=3,
            label=f"{'tips' if tips else 'tracks'}, $r$ = {run.rate:.3g}",
        )  # fmt: skip
    label = f"threshold, $r$ = {rate:.6g}"
    axes.plot(middle.t[stays], middle[state][stays], color=INK, lw=1.6, zorder=4, label=label)
    low, high = np.nanmin(still), np.nanmax(still)
    spread = max(high - low, float(np.ptp(middle[state][stays])))
    reach = (low - 4 * spread, high + 4 * spread)
    inside = [bool(np.all((reach[0] < run[state]) & (run[state] < reach[1]))) for run, _ in runs]
    ends = [f(run[state]) for (run, _), stay in zip(runs, inside) if stay for f in (np.min, np.max)]
    bottom, top = min([low, *ends]), max([high, *ends])
    if not all(inside):
        bottom, top = bottom - BEYOND * spread, top + BEYOND * spread
    axes.set_ylim(bottom - 0.06 * (top - bottom), top + 0.06 * (top - bottom))
    axes.set_xlim(middle.t[0], max(middle.t[stays][-1], -middle.t[0]))
    axes.set_xlabel("$t$")
    axes.set_ylabel(mathematics(state))
    legend(axes, columns=3)


def _rest(found: CriticalRate, run: RampRun, state: str, which: int) -> np.ndarray:
    """A state at the rest point of the start, or of the edge, over the phases of a run; NaN where that is lost."""
    own, centre = found.about_centres, found.ramped.centre
    assert own.end is not None
    first, last = own.ramped.ends
    way = own.ramped.followed(own.end, first) if which else own.ramped.followed(own.begin, last)
    i = [x.name for x in found.ramped.field.states].index(state)
    s, x = np.array([p.s for p in way]) + centre.s, np.array([p.x[i] for p in way]) + centre.x[i]
    order = np.argsort(s)
    outside = (run.phase < s.min()) | (run.phase > s.max())
    near = np.abs(run.phase - np.clip(run.phase, s.min(), s.max())) <= 1e-3 * abs(last - first)
    return np.where(outside & ~near, np.nan, np.interp(run.phase, s[order], x[order]))


@chart(height=4.0)
def rate_diagram(found: RateDiagram, axes: Axes) -> None:
    """Which rates tip at which amplitudes, and the critical rates between, on a logarithmic axis of rates."""
    rates = found.rates
    if not np.isfinite(rates).any():
        raise DeclarationError("no critical rate was found at any amplitude.", got=repr(found))
    low, high = np.nanmin(rates) / 3.0, np.nanmax(rates) * 3.0
    grid = np.geomspace(low, high, 500)
    answers = [[found.tips(i, rate) for rate in grid] for i in range(len(found.amplitudes))]
    shades = np.array([[np.nan if a is None else float(a) for a in row] for row in answers]).T
    edges = found.amplitudes
    for value, colour, label in ((0.0, GREEN, "tracks"), (1.0, VERMILION, "tips")):
        for k, column in enumerate((shades == value).T):
            left = edges[0] if k == 0 else 0.5 * (edges[k - 1] + edges[k])
            right = edges[-1] if k == len(edges) - 1 else 0.5 * (edges[k] + edges[k + 1])
            starts = np.flatnonzero(np.diff(np.concatenate([[0], column.astype(int), [0]])) == 1)
            stops = np.flatnonzero(np.diff(np.concatenate([[0], column.astype(int), [0]])) == -1)
            for a, b in zip(starts, stops):
                bottom, top = grid[a], grid[min(b, len(grid) - 1)]
                axes.fill_between([left, right], bottom, top, color=colour, alpha=0.16, lw=0, label=label)
                label = None
    axes.plot(np.repeat(edges, rates.shape[1]), rates.ravel(), ".", color=INK, ms=4.0, label="critical rate")
    axes.axvline(1.0, color=BLUE, lw=0.9, ls=":", label="the ramp as given") if edges[0] < 1.0 < edges[
        -1
    ] else None
    axes.set_yscale("log")
    axes.set_xlim(edges[0], edges[-1])
    axes.set_ylim(low, high)
    axes.set_xlabel("amplitude, in that of the ramp")
    axes.set_ylabel("rate $r$")
    legend(axes, columns=4)
