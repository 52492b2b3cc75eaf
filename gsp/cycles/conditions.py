"""What is decided about an annulus or a strip, in balls or exactly: theorems 7 and 10 of docs/proofs.md.

For every epsilon in (0, epsilon_0] orbits cross both lines of edges into it. What holds in its sectors is in `sectors`.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise

import numpy as np
import sympy as sp
from flint import arb

from gsp.cycles.annulus import Annulus, Band, Strip
from gsp.cycles.enclosed_field import EnclosedField
from gsp.cycles.sectors import NotProved, Turn, turn_of
from gsp.proofs import balls

# Halvings of an edge.
DEEPEST = 20


def proved(field: EnclosedField, band: Band, epsilon: float, fineness: int) -> Turn:
    """What holds for every epsilon in (0, `epsilon`]; raises `NotProved` when an annulus is no proof of a cycle, or a
    strip none of a passage.

    Sectors are bounded over 2 `fineness` strips of as many as `fineness` boxes.
    """
    if isinstance(band, Strip):
        require_strip(band)
        if band.cornered:
            _require_corner(field)
    else:
        assert isinstance(band, Annulus)
        require_nested(band)
    edges = [(*pair, 1) for pair in pairwise(band.outer.tolist())]
    edges += [(*pair, -1) for pair in pairwise(band.inner.tolist())]
    if isinstance(band, Strip):
        edges += [(band.outer[o].tolist(), band.inner[i].tolist(), -1) for o, i in band.cuts]
    else:
        edges += [(p[-1].tolist(), p[0].tolist(), side) for p, side in ((band.outer, 1), (band.inner, -1))]
    for one, two, side in edges:
        corner = isinstance(band, Strip) and band.cornered and [0.0, 0.0] in (one, two)
        if not _crossed(field, one, two, side, epsilon, corner=corner):
            raise NotProved(f"orbits are not proved to cross the edge from {tuple(one)} to {tuple(two)}")
    return turn_of(field, band, epsilon, fineness)


# -- the polygons, exactly -----------------------------------------------------------------------------


def require_nested(annulus: Annulus) -> None:
    """Both polygons are simple and counterclockwise, one is inside the other, and the cuts join them without meeting
    anything else; raises `NotProved`.
    """
    outer, inner = annulus.outer, annulus.inner
    n, m = len(outer), len(inner)
    points = np.vstack([outer, inner])
    if not np.isfinite(points).all() or min(n, m) < 3 or len({tuple(p) for p in points.tolist()}) < n + m:
        raise NotProved("the polygons have at least three vertices, each its own")
    pairs = [(i, (i + 1) % n) for i in range(n)]
    pairs += [(n + i, n + (i + 1) % m) for i in range(m)]
    _require_apart(points, pairs + [(o, n + i) for o, i in annulus.cuts])
    if not (_area(outer) > 0 and _area(inner) > 0):
        raise NotProved("the polygons are counterclockwise")
    if not _inside(inner[0], outer):
        raise NotProved("the inner polygon is inside the outer one")
    for places in zip(*annulus.cuts):
        turned = np.roll(places, -int(np.argmin(places)))
        if not (np.diff(turned) > 0).all():
            raise NotProved("the cuts follow one another around both polygons")
    if len(annulus.cuts) < 2 or len(annulus.cuts) % 2:
        raise NotProved("there is an even number of cuts")
    if any(outer[o, 1] != inner[i, 1] for o, i in annulus.cuts):
        raise NotProved("the cuts lie along the slow variable")


def require_strip(strip: Strip) -> None:
    """The lines are simple and meet nowhere, cuts join them in order without meeting anything else, the first and the
    last at their ends, and each sector is counterclockwise; raises `NotProved`.
    """
    n, m = len(strip.outer), len(strip.inner)
    points = np.vstack([strip.outer, strip.inner])
    if not np.isfinite(points).all() or min(n, m) < 2 or len({tuple(p) for p in points.tolist()}) < n + m:
        raise NotProved("the lines have at least two vertices, each its own")
    if strip.cuts[:1] != ((0, 0),) or strip.cuts[-1] != (n - 1, m - 1):
        raise NotProved("the first cut and the last join the ends of the lines")
    if not (np.diff(strip.cuts, axis=0) > 0).all():
        raise NotProved("the cuts follow one another along both lines")
    pairs = [*pairwise(range(n)), *pairwise(range(n, n + m))]
    _require_apart(points, pairs + [(o, n + i) for o, i in strip.cuts])
    if any(_area(sector) <= 0 for sector in strip.sectors):
        raise NotProved("the sectors are counterclockwise")


def _require_corner(field: EnclosedField) -> None:
    """At (0, 0) g vanishes for epsilon = 0, and so do its slopes, exactly."""
    x, y, small = field.arguments
    g = field.rates[1]
    at = {x: sp.S.Zero, y: sp.S.Zero}
    if g.has(small) or any(e.xreplace(at) != 0 for e in (g, sp.diff(g, x), sp.diff(g, y))):
        raise NotProved("the fast rate and its slopes are not seen to vanish where branches meet")


def _require_apart(points: np.ndarray, pairs: list[tuple[int, int]]) -> None:
    """No two segments meet, but where they share an end."""
    for a, b in _near(points, np.array(pairs)):
        if _meet(points, pairs[a], pairs[b]):
            raise NotProved(f"two edges meet at {tuple(points[pairs[a][0]].tolist())}")


def _near(points: np.ndarray, pairs: np.ndarray) -> Iterator[tuple[int, int]]:
    """Pairs of segments whose boxes meet; comparisons of doubles are exact."""
    ends = points[pairs]
    low, high = ends.min(axis=1), ends.max(axis=1)
    for i in range(len(pairs) - 1):
        others = ((low[i + 1 :] <= high[i]) & (high[i + 1 :] >= low[i])).all(axis=1)
        for j in np.flatnonzero(others).tolist():
            yield i, i + 1 + j


def _meet(points: np.ndarray, one: tuple[int, int], two: tuple[int, int]) -> bool:
    """Whether two segments with meeting boxes have a point in common, other than an end that belongs to both."""
    shared = set(one) & set(two)
    if len(shared) > 1:
        return True
    if shared:
        (s,) = shared
        a, b = (next(v for v in pair if v != s) for pair in (one, two))
        # They go on from the same end: on one line, and not away from one another.
        return _side(points[a], points[s], points[b]) == 0 and _dot(points[s], points[a], points[b]) > 0
    (a, b), (c, d) = (points[list(pair)] for pair in (one, two))
    # On one line, or touching: the boxes meet.
    return _side(a, b, c) * _side(a, b, d) <= 0 and _side(c, d, a) * _side(c, d, b) <= 0


def _side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> int:
    """The sign of the area of a triangle."""
    (p, q), (r, s), (u, v) = (map(Fraction, point.tolist()) for point in (a, b, c))
    area = (r - p) * (v - q) - (s - q) * (u - p)
    return (area > 0) - (area < 0)


def _dot(s: np.ndarray, a: np.ndarray, b: np.ndarray) -> Fraction:
    (p, q), (u, v), (x, y) = (map(Fraction, point.tolist()) for point in (s, a, b))
    return (u - p) * (x - p) + (v - q) * (y - q)


def _area(polygon: np.ndarray) -> Fraction:
    points = [tuple(map(Fraction, p)) for p in polygon.tolist()]
    return sum((a * d - b * c for (a, b), (c, d) in zip(points, [*points[1:], points[0]])), Fraction(0))


def _inside(point: np.ndarray, polygon: np.ndarray) -> bool:
    """Whether a point off the polygon is inside it: edges that a ray to the right passes."""
    inside = False
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0)):
        if (a[1] > point[1]) != (b[1] > point[1]):
            inside ^= _side(a, b, point) == (1 if b[1] > a[1] else -1)
    return inside


# -- edges ---------------------------------------------------------------------------------------------


def _crossed(
    field: EnclosedField, one: list[float], two: list[float], side: int, epsilon: float, *, corner: bool = False
) -> bool:
    """Whether orbits cross an edge to the left (1) or to the right (-1) of the way from `one` to `two`.

    Across it the field is limit + epsilon slow, limit = dx g and slow = dx h - dy f: positive on (0, epsilon_0] where
    limit >= 0 and limit + epsilon_0 slow > 0. At a `corner` in (0, 0) g and its slopes vanish: limit >= 0 where
    dx (g_xx dx^2 + 2 g_xy dx dy + g_yy dy^2) >= 0 on the whole edge, and slow > 0 is asked for.
    """
    x, y = arb(one[0]), arb(one[1])
    dx, dy = side * (arb(two[0]) - x), side * (arb(two[1]) - y)
    small, largest = balls.hull(0.0, epsilon), arb(epsilon)
    pieces = [(0, 0)]
    while pieces:
        depth, place = pieces.pop()
        width = 0.5**depth
        share, middle = balls.hull(place * width, (place + 1) * width), arb((place + 0.5) * width)
        at = [x + side * share * dx, y + side * share * dy]
        f, g, h, f_x, f_y, g_x, g_y, h_x, h_y = field.with_slopes(*at, small)
        f_m, g_m, h_m = field.over(x + side * middle * dx, y + side * middle * dy, small)
        offset = side * (share - middle)
        along_f, along_g, along_h = f_x * dx + f_y * dy, g_x * dx + g_y * dy, h_x * dx + h_y * dy
        slow, slow_m, along_slow = dx * h - dy * f, dx * h_m - dy * f_m, dx * along_h - dy * along_f
        if corner:
            bends = field.bends([*at, small])
            bent = dx * (bends[0] * dx**2 + 2 * bends[1] * dx * dy + bends[2] * dy**2)
            if bent >= 0 and (slow > 0 or slow_m + along_slow * offset > 0) and g.is_finite():
                continue
        else:
            total = dx * g + largest * slow
            # From the middle f, g and h move together.
            sharper = dx * g_m + largest * slow_m + (dx * along_g + largest * along_slow) * offset
            limit = dx * g >= 0 or dx * (g_m + along_g * offset) >= 0
            if limit and (total > 0 or sharper > 0) and total.is_finite():
                continue
        if depth >= DEEPEST:
            return False
        pieces += [(depth + 1, 2 * place), (depth + 1, 2 * place + 1)]
    return True
