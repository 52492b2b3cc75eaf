"""Sheets over one slow point: roots of a branch's equations that Newton's method comes to from many places."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import sympy as sp

from gsp.critical.sheet_points import distinct
from gsp.systems.region import Interval, check_region
from gsp.systems.scattered_points import halton
from gsp.systems.system import SlowFastSystem

Newton = Callable[[np.ndarray, float], np.ndarray]
"""From y (m, n_fast), and what counts as a unit of y, to the roots (k, n_fast) that are come to."""


def fast_bounds(system: SlowFastSystem, region: Mapping[str, object] | None) -> Mapping[str, Interval]:
    """The intervals of `region` that bound fast variables, by name."""
    if region is None:
        return {}
    checked = check_region(region, [s.name for s in system.states])
    return {s.name: checked[s.name] for s in system.y if s.name in checked}


def size_of(box: np.ndarray) -> float:
    """What counts as a unit of y in a box (n_fast, 2).

    In a small box small differences count; in a large one roots may lie as near to one another as anywhere.
    """
    return min(1.0, float(np.linalg.norm(box[:, 1] - box[:, 0])) or 1.0)


def within(y: np.ndarray, fast: Sequence[sp.Symbol], bounds: Mapping[str, Interval]) -> np.ndarray:
    """Which of the points (m, n_fast) lie within the bounds on fast variables."""
    inside = np.ones(len(y), dtype=bool)
    for i, symbol in enumerate(fast):
        if symbol.name in bounds:
            low, high = bounds[symbol.name]
            inside &= (y[:, i] >= low) & (y[:, i] <= high)
    return inside


def scattered_roots(newton: Newton, box: np.ndarray, *, size: float) -> np.ndarray:
    """Distinct roots (k, n_fast) that Newton's method comes to from places in a box (n_fast, 2)."""
    places = box[:, 0] + halton(len(box), 64) * (box[:, 1] - box[:, 0])
    return distinct(newton(places, size), size=size)


def roots_about(
    newton: Newton, y: np.ndarray, names: Sequence[str], bounds: Mapping[str, Interval]
) -> np.ndarray:
    """Distinct roots (k, n_fast): the nearest to y (n_fast,) among them, and those in `bounds` on fast variables."""
    far = 1.0 + float(np.linalg.norm(y))
    # A variable without bounds is looked for about the point.
    sides = [bounds.get(name, (value - far, value + far)) for name, value in zip(names, y.tolist())]
    box = np.array(sides) if bounds else None
    size = 1.0 if box is None else size_of(box)

    def within_reach(distance: float) -> np.ndarray:
        return scattered_roots(newton, np.column_stack([y - distance, y + distance]), size=size)

    found = newton(y[None, :], size)
    # Of a box in more variables its places say nothing.
    if len(y) > 5:
        return found
    if box is not None:
        found = np.vstack([found, scattered_roots(newton, box, size=size)])
    # Boxes about a point from which Newton's method comes to nothing, in units of 1 + |y|.
    for factor in () if len(found) else (1.0, 8.0, 64.0):
        found = within_reach(factor * far)
        if len(found):
            break
    # A root that is nearer than the nearest known lies in the box which that one spans about the point.
    distance = np.inf
    # A search about a point goes on while the nearest root comes nearer by more than this share.
    while len(found) and (nearest := float(np.linalg.norm(found - y, axis=1).min())) < 0.99 * distance:
        distance = nearest
        found = np.vstack([found, within_reach(distance)])
    return distinct(found, size=size)
