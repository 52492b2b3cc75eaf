"""A run as a moving picture: what it draws in a plane, and one of its variables against time."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, FuncAnimation, PillowWriter
from matplotlib.figure import Figure

from gsp.charts.sampling import along, margins
from gsp.charts.style import BLUE, GREY, INK, SKY, STYLE, VERMILION, add_units, mathematics
from gsp.errors import OutputError
from gsp.integration.trajectory import Trajectory
from gsp.results.files import write_file
from gsp.scenes.view import TIME
from gsp.systems.arguments import shown

FRAMES_PER_SECOND = 20
# Ends of files that can be written, with what writes them.
KINDS = (".gif", ".mp4")


@dataclass(frozen=True)
class Body:
    """A body that moves along the path: outlines (k, 2) in its own frame, with whether each is drawn strongly.

    `angle` names the quantity by which it is turned.
    """

    angle: str
    parts: tuple[tuple[np.ndarray, bool], ...]


@dataclass(frozen=True)
class Motion:
    """What moves: the full run, the limit run if there is one, the plane of two names, and what stands against time.

    `curve` (2, k) is the critical manifold in the plane, with gaps of nan. `title` says what is seen. `ranges` bounds
    axes of the plane that are not to follow the run, and `units` stand behind the names on the axes.
    """

    full: Trajectory
    limit: Trajectory | None
    plane: tuple[str, str]
    against_time: str
    title: str
    body: Body | None = None
    curve: np.ndarray | None = None
    is_path: bool = False
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)


def write_motion(
    motion: Motion, path: str | Path, *, seconds: float, progress: Callable[[float], object] | None = None
) -> Path:
    """Write the moving picture to `path`, .gif or .mp4, whole or not at all.

    Raises `OutputError` for another ending, for .mp4 where ffmpeg is not installed, and when it cannot be written.
    """
    target = check_motion_name(path)
    frames = max(2, round(seconds * FRAMES_PER_SECOND))
    with matplotlib.rc_context(STYLE), tempfile.TemporaryDirectory(prefix="gsp-") as scratch:
        animation = _animation(motion, frames)
        writer: AbstractMovieWriter = (
            PillowWriter(fps=FRAMES_PER_SECOND)
            if target.suffix.lower() == ".gif"
            else FFMpegWriter(fps=FRAMES_PER_SECOND, extra_args=["-pix_fmt", "yuv420p"])
        )
        built = Path(scratch, f"built{target.suffix.lower()}")

        def tell(frame: int, total: int) -> None:
            if progress is not None:
                progress((frame + 1) / frames)

        animation.save(built, writer=writer, dpi=100, progress_callback=tell)
        return write_file(built.read_bytes(), target)


def check_motion_name(path: str | Path) -> Path:
    """`path`, when a moving picture can be written there; raises `OutputError` with the remedy when not."""
    if not isinstance(path, (str, Path)):
        raise OutputError("path is the name of a file, .gif or .mp4.", got=shown(path), value=path)
    target = Path(path)
    if target.suffix.lower() not in KINDS:
        raise OutputError(
            "a moving picture is written to a path that ends in .gif or .mp4.",
            "Give such a name.",
            got=target.name,
        )
    if target.suffix.lower() == ".mp4" and not FFMpegWriter.isAvailable():
        raise OutputError(
            f"{target.name} takes ffmpeg, which is not installed.", "Install it, or write a .gif."
        )
    return target


def _animation(motion: Motion, frames: int) -> FuncAnimation:
    full, limit = motion.full, motion.limit
    begun, ended = whole_cycles(full, (*motion.plane, motion.against_time))
    figure = Figure(figsize=(8.0, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    times = np.linspace(begun, ended, frames)
    run = full.sample(times)
    line = full.sample(np.unique([*full.t, *np.linspace(full.t[0], full.t[-1], 3000)]))
    other = None if limit is None else limit.sample(np.linspace(limit.t[0], limit.t[-1], 1000))
    first, second = motion.plane
    across, up, against = along(line, first), along(line, second), line[motion.against_time]
    left.set(
        xlim=motion.ranges.get(first) or _ends(across, motion),
        ylim=motion.ranges.get(second) or _ends(up, motion),
        xlabel=mathematics(first),
        ylabel=mathematics(second),
    )
    if motion.is_path:
        left.set_aspect("equal", adjustable="box")
    if motion.curve is not None:
        left.plot(*motion.curve, color=SKY, lw=4.0, alpha=0.6, label="$M_0$", zorder=0)
    if other is not None:
        left.plot(
            along(other, first),
            along(other, second),
            color=BLUE,
            lw=1.2,
            ls=(0, (5, 3)),
            label=r"limit $\epsilon \to 0$",
        )
        right.plot(other.t, other[motion.against_time], color=BLUE, lw=1.2, ls=(0, (5, 3)))
    right.set(
        xlim=(full.t[0], full.t[-1]),
        ylim=margins(against),
        xlabel="slow time $t$",
        ylabel=mathematics(motion.against_time),
    )
    right.plot(line.t, against, color=INK, lw=0.8, alpha=0.2)
    for axes in (left, right):
        add_units(axes, motion.units)
    figure.suptitle(motion.title, fontsize="medium", color=GREY)
    (trail,) = left.plot([], [], color=INK, lw=1.4, label="full")
    (dot,) = left.plot([], [], "o", color=VERMILION, ms=6, zorder=5)
    (past,) = right.plot([], [], color=INK, lw=1.4)
    (now,) = right.plot([], [], "o", color=VERMILION, ms=6, zorder=5)
    body = motion.body
    outlines = []
    if body is not None:
        for _, strong in body.parts:
            style = {"color": VERMILION, "lw": 2.4} if strong else {"color": INK, "lw": 1.0}
            outlines.append(left.plot([], [], zorder=4, **style)[0])
        dot.set_visible(False)
    left.legend(loc="best", fontsize="small", frameon=False)
    # Laid out once: doing it for each frame takes longer than drawing.
    figure.canvas.draw()
    figure.set_layout_engine("none")

    # Read once: an observable is worked out anew whenever it is asked for.
    places = np.column_stack([along(run, first), along(run, second)])
    against_now = run[motion.against_time]
    angles = None if body is None else run[body.angle]

    def draw(frame: int) -> Sequence:
        t = times[frame]
        until = np.searchsorted(line.t, t, side="right")
        trail.set_data(across[:until], up[:until])
        past.set_data(line.t[:until], against[:until])
        dot.set_data(*places[frame, :, None])
        now.set_data([t], [against_now[frame]])
        if body is not None and angles is not None:
            angle = angles[frame]
            turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            for outline, (points, _) in zip(outlines, body.parts):
                outline.set_data(*(points @ turn + places[frame]).T)
        return trail, dot, past, now, *outlines

    return FuncAnimation(figure, draw, frames=frames, blit=False)


def whole_cycles(run: Trajectory, names: Sequence[str]) -> tuple[float, float]:
    """The times between which a run goes round a closed orbit as often as it does, else its first and last time.

    They are those at which the last of `names` rises through its middle: all that agree with the last of them, in every
    one of `names` to a hundredth of its range.
    """
    first, last = float(run.t[0]), float(run.t[-1])
    t = np.linspace(first, last, 20_000)
    values = np.array([along(run.sample(t), name) for name in dict.fromkeys(names) if name != TIME])
    reach = np.ptp(values, axis=1)
    middle = values[-1].min() + 0.5 * reach[-1]
    rises = np.flatnonzero((values[-1, :-1] < middle) & (values[-1, 1:] >= middle))
    if len(rises) < 2 or not np.isfinite(values).all() or not (reach > 0).all():
        return first, last
    share = (middle - values[-1, rises]) / (values[-1, rises + 1] - values[-1, rises])
    at = t[rises] + share * (t[1] - t[0])
    states = values[:, rises] + share * (values[:, rises + 1] - values[:, rises])
    agree = (np.abs(states - states[:, -1:]) <= 0.01 * reach[:, None]).all(axis=0)
    begun = len(at) - 1 - int(np.argmin(agree[::-1])) + 1 if not agree.all() else 0
    return (float(at[begun]), float(at[-1])) if begun < len(at) - 1 else (first, last)


def _ends(values: np.ndarray, motion: Motion) -> tuple[float, float]:
    """Ends of an axis: the full run, and on a path the body beside it."""
    low, high = margins(values, 0.06)
    if motion.body is None:
        return low, high
    extent = max(float(np.abs(points).max()) for points, _ in motion.body.parts)
    return low - extent, high + extent
