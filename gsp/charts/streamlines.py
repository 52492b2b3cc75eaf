"""Evenly spaced streamlines, each drawn whole: a line ends only at the edge, at rest, or where it would merge.

The placement is that of B. Jobard and W. Lefer, "Creating evenly-spaced streamlines of arbitrary density" (1997),
with the longest lines first. Matplotlib's own leave gaps at lines of equilibria and crowd where orbits converge.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from gsp.charts.style import arrow_head

# In units of the frame: the step, and the longest way in each direction.
STEP, LONGEST = 0.004, 2.0
SEEDS, CELLS = 26, 250


def streamlines(
    axes: Axes, u: np.ndarray, v: np.ndarray, rates: np.ndarray, *, distance: float, colour: str
) -> None:
    """Streamlines of a field on a grid: `rates` (len(v) len(u), 2), u running fastest, nan where there is none.

    `distance` between lines is in units of the frame.
    """
    size = np.array([u[-1] - u[0], v[-1] - v[0]])
    field = rates.reshape(len(v), len(u), 2) / size
    speed = np.linalg.norm(field, axis=2)
    rest = 1e-9 * np.nanmax(speed, initial=0.0)
    middle = (np.arange(SEEDS) + 0.5) / SEEDS
    seeds = np.stack([a.ravel() for a in np.meshgrid(middle, middle)], axis=1)
    back, ahead = _trace(field, seeds, -1.0, rest), _trace(field, seeds, 1.0, rest)
    length = np.isfinite(back[..., 0]).sum(axis=0) + np.isfinite(ahead[..., 0]).sum(axis=0)
    taken, close = (np.zeros((CELLS, CELLS), dtype=bool) for _ in range(2))
    # How near to another line one may run, as a share of the distance at which lines are seeded.
    wide, narrow = _disc(distance), _disc(0.3 * distance)
    for i in np.argsort(-length, kind="stable"):
        if _at(taken, seeds[i : i + 1])[0]:
            continue
        line = np.vstack([_free(back[:, i], close)[::-1], seeds[i : i + 1], _free(ahead[:, i], close)])
        # A shorter line is not drawn.
        if len(line) * STEP < 0.06:
            continue
        _mark(taken, line, wide)
        _mark(close, line, narrow)
        x, y = (np.array([u[0], v[0]]) + line * size).T
        axes.plot(x, y, color=colour, lw=0.7, zorder=1)
        half = len(x) // 2
        arrow_head(axes, (x[half], y[half]), (x[half - 1], y[half - 1]), colour, size=7, zorder=1)


def _trace(field: np.ndarray, start: np.ndarray, sign: float, rest: float) -> np.ndarray:
    """Points (steps, seeds, 2) by the midpoint rule at unit speed; nan from where a line has ended."""
    z = start.copy()
    before = np.zeros_like(z)
    points = np.full((int(LONGEST / STEP), *z.shape), np.nan)
    for k in range(len(points)):
        first = _direction(field, z, rest)
        step = (sign * STEP) * _direction(field, z + 0.5 * sign * STEP * first, rest)
        # A direction that turns round within a step has met a line of equilibria.
        step[(step * before).sum(axis=1) < 0.0] = np.nan
        z, before = z + step, step
        points[k] = z
        if np.isnan(z[:, 0]).all():
            break
    return points


def _direction(field: np.ndarray, z: np.ndarray, rest: float) -> np.ndarray:
    """Unit vectors (m, 2) of the field, interpolated bilinearly; nan at rest and outside the frame."""
    rows, columns = field.shape[:2]
    inside = np.all((z >= 0.0) & (z <= 1.0), axis=1)
    x, y = np.where(inside[:, None], z, 0.0).T * np.array([[columns - 1], [rows - 1]])
    j, i = (np.minimum(a.astype(int), n - 2) for a, n in ((x, columns), (y, rows)))
    s, t = (x - j)[:, None], (y - i)[:, None]
    value = (1 - t) * ((1 - s) * field[i, j] + s * field[i, j + 1])
    value += t * ((1 - s) * field[i + 1, j] + s * field[i + 1, j + 1])
    speed = np.linalg.norm(value, axis=1)
    moving = inside & (speed > rest)
    return np.where(moving[:, None], value / np.where(moving, speed, 1.0)[:, None], np.nan)


def _free(points: np.ndarray, close: np.ndarray) -> np.ndarray:
    """The points up to where the line ends or comes close to another."""
    points = points[np.isfinite(points).all(axis=1)]
    met = np.flatnonzero(_at(close, points))
    return points[: met[0]] if met.size else points


def _disc(radius: float) -> np.ndarray:
    """Offsets (m, 2) of the cells within a radius."""
    cells_around = int(radius * CELLS) + 1
    offsets = np.stack(np.meshgrid(*[np.arange(-cells_around, cells_around + 1)] * 2), axis=-1).reshape(-1, 2)
    return offsets[np.linalg.norm(offsets, axis=1) <= radius * CELLS]


def _at(cells: np.ndarray, points: np.ndarray) -> np.ndarray:
    place = (points * CELLS).astype(int).clip(0, CELLS - 1)
    return cells[place[:, 1], place[:, 0]]


def _mark(cells: np.ndarray, points: np.ndarray, offsets: np.ndarray) -> None:
    # A cell is as wide as a step: one point in two is enough.
    place = (points[::2] * CELLS).astype(int)
    near = (place[:, None] + offsets[None]).reshape(-1, 2).clip(0, CELLS - 1)
    cells[near[:, 1], near[:, 0]] = True
