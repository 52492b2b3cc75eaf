"""An annulus between two squares whose integrals are known in closed form, and which edges which fields cross."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Iterator
from fractions import Fraction

OUTER = [(4, 1), (4, 4), (-4, 4), (-4, 1), (-4, -1), (-4, -4), (4, -4), (4, -1)]
INNER = [(2, 2), (-2, 2), (-2, 1), (-2, -1), (-2, -2), (2, -2), (2, -1), (2, 1)]
# Above y = 1 and below -1 the sectors are slow ones, 8 wide, which closed orbits pass for |x| <= 2; those beside them
# are fast ones, 2 high.
CUTS = [(0, 7), (3, 2), (4, 3), (7, 6)]
GRIDS = [[-4, -2, 2, 4], [-1, 1], [-4, -2, 2, 4], [-1, 1]]
EPSILON = Fraction(1, 4)

# Linear f and g (the constant, the coefficients of x and y), the least and the greatest time and the integral of
# g_y + epsilon f_x over |rate|: of a rate r a strip takes width/r, in fast sectors epsilon times that.
TURNS: list[tuple[tuple[int, int, int], tuple[int, int, int], Fraction, Fraction, Fraction]] = [
    ((2, 0, 0), (8, 0, 0), Fraction(4), Fraction(8) + EPSILON * 4 / 8, Fraction(0)),
    ((-4, 0, 0), (-8, 0, 0), Fraction(2), Fraction(4) + EPSILON * 4 / 8, Fraction(0)),
    # In fast sectors |g| is from 7 to 9.
    ((2, 0, 0), (8, 0, -1), Fraction(4), Fraction(8) + EPSILON * 4 / 7, Fraction(-4)),
    ((-2, 0, 0), (8, 0, 1), Fraction(4), Fraction(8) + EPSILON * 4 / 7, Fraction(8) + EPSILON * 4 / 7),
    (
        (1, 0, 0),
        (-8, 1, 0),
        Fraction(8),
        Fraction(16) + EPSILON * (2 / Fraction(4) + 2 / Fraction(10)),
        Fraction(0),
    ),
    # Edges along x = 2 and -2 belong to the strips on both sides: f is from 9 to 12, and from 4 to 7.
    ((8, 0, 1), (8, 0, 0), Fraction(19, 21), Fraction(26, 9) + EPSILON * 4 / 8, Fraction(0)),
]


def crossings() -> Iterator[tuple[tuple[int, int], int, int, int, bool]]:
    """Edges, sides and constant rates f and g, and whether orbits of x' = f, epsilon y' = g cross the edge to that
    side for every epsilon in (0, 1/4]: by its ends.
    """
    ways = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (2, -1), (-1, -2)]
    for (dx, dy), side, f, g in itertools.product(ways, (1, -1), (-4, 0, 4, 9), (-1, 0, 1)):
        ends = [side * (dx * Fraction(g) / small - dy * f) for small in (EPSILON, EPSILON / 10**9)]
        yield (dx, dy), side, f, g, all(to > 0 for to in ends)


Vertex = tuple[float, float]


def nestings() -> Iterator[tuple[list[Vertex], list[Vertex], list[tuple[int, int]], bool]]:
    """Polygons and cuts, and whether these are an annulus."""

    def inner(place: int, *points: Vertex) -> list[Vertex]:
        return [*INNER[:place], *points, *INNER[place + 1 :]]

    yield OUTER, INNER, CUTS, True
    yield OUTER, inner(0, (3.5, 3.5)), CUTS, True
    # On an edge of the outer one, on a vertex of it, across it, across itself, back on its own edge, the other way.
    yield OUTER, inner(0, (4, 3)), CUTS, False
    yield OUTER, inner(0, (4, 4)), CUTS, False
    yield OUTER, inner(0, (5, 5)), CUTS, False
    yield OUTER, inner(0, (-3, 0)), CUTS, False
    yield OUTER, inner(0, (2, 3), (2, 1.5)), [(o, i + 1) for o, i in CUTS], False
    yield OUTER, inner(0, (2, 2), (2, 2)), [(o, i + 1) for o, i in CUTS], False
    yield OUTER, INNER[::-1], [(o, 7 - i) for o, i in CUTS], False
    yield OUTER[::-1], INNER, [(7 - o, i) for o, i in CUTS], False
    yield INNER, OUTER, [(i, o) for o, i in CUTS], False
    for away in (-20, 20):
        yield OUTER, [(u + away, v) for u, v in INNER], CUTS, False
        yield OUTER, [(u, v + away) for u, v in INNER], CUTS, False
    yield OUTER, [(2, 1), (-2, 1)], [(0, 0), (3, 1)], False
    yield OUTER, [(2, 1), (0, 1), (-2, 1)], [(0, 0), (3, 2)], False
    # Cuts that begin elsewhere, out of turn, twice the same, the other way, askew, from one side to the other, too few.
    for k in range(4):
        yield OUTER, INNER, CUTS[k:] + CUTS[:k], True
    for order in ([0, 2, 1, 3], [1, 0, 3, 2], [0, 0, 1, 2], [0, 3, 2, 1]):
        yield OUTER, INNER, [CUTS[k] for k in order], False
    yield OUTER, INNER, [(0, 0), *CUTS[1:]], False
    yield OUTER, INNER, [(0, 2), (3, 7)], False
    yield OUTER, INNER, CUTS[:2], True
    # Both or one of them clockwise.
    yield OUTER[::-1], INNER[::-1], [(7 - o, 7 - i) for o, i in CUTS[::-1]], False
    yield OUTER[::-1], INNER, [(7, 7), (4, 2)], False
    yield OUTER, INNER[::-1], [(0, 0), (3, 5)], False
    # Along eight rays: they meet where one is not farther from the middle than the other on all of these.
    rays = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
    draw = random.Random(3)
    for place in (*range(8), -1, -2):
        for _ in range(8):
            far = [draw.randint(2, 40) for _ in rays]
            near = [draw.randint(1, r - 1) for r in far]
            if place >= 0:
                near[place] = draw.randint(far[place], 42)
            if place == -2:
                near, far = far, near
            outer, inner = ([(r * u, r * v) for r, (u, v) in zip(row, rays)] for row in (far, near))
            yield outer, inner, [(0, 0), (4, 4)], place == -1


def meetings() -> Iterator[tuple[list[tuple[int, int]], tuple[int, int], tuple[int, int], bool]]:
    """Points, two segments by the places of their ends, and whether they meet other than in an end of both."""
    places = list(itertools.product(range(4), range(3)))
    draw = random.Random(2)
    for _ in range(300):
        a, b, c, d = points = [draw.choice(places) for _ in range(4)]
        if a != b and c != d:
            said = _common(a, b, c, d)
            yield points, (0, 1), (2, 3), said
            yield points, (2, 3), (1, 0), said
        if len({a, b, d}) == 3:
            (u, v), (p, q) = (b[0] - a[0], b[1] - a[1]), (d[0] - a[0], d[1] - a[1])
            said = u * q == v * p and u * p + v * q > 0
            yield points, (0, 1), (3, 0), said
            yield points, (1, 0), (0, 3), said


def _common(a: tuple[int, int], b: tuple[int, int], c: tuple[int, int], d: tuple[int, int]) -> bool:
    """Whether a + s (b - a) = c + t (d - c) with s and t in [0, 1]."""
    (u, v), (p, q), (r, s) = (
        (b[0] - a[0], b[1] - a[1]),
        (d[0] - c[0], d[1] - c[1]),
        (c[0] - a[0], c[1] - a[1]),
    )
    turn = u * q - v * p
    if turn:
        return 0 <= Fraction(r * q - s * p, turn) <= 1 and 0 <= Fraction(r * v - s * u, turn) <= 1
    if r * v != s * u:
        return False
    least, most = sorted((r * u + s * v, (d[0] - a[0]) * u + (d[1] - a[1]) * v))
    return least <= u * u + v * v and most >= 0


def triangles() -> Iterator[tuple[list[tuple[int, int]], list[tuple[int, int]], str]]:
    """Two triangles, and what is wrong with them as an annulus, in a word."""
    draw = random.Random(4)
    while True:
        outer, inner = (
            [(draw.randint(k, w), draw.randint(k, w) + 50) for _ in range(3)] for k, w in ((0, 16), (5, 9))
        )
        if not (_twice_area(*outer) > 0 and _twice_area(*inner) > 0):
            continue
        sides = [[(t[k - 1], t[k]) for k in range(3)] for t in (outer, inner)]
        meet = any(_common(*one, *two) for one, two in itertools.product(*sides))
        inside = all(_twice_area(a, b, inner[0]) > 0 for a, b in sides[0])
        yield outer, inner, "meet" if meet else "" if inside else "inside"


def _twice_area(a: tuple[int, int], b: tuple[int, int], c: tuple[int, int]) -> int:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def extents(polygon: list, axis: int, low: Fraction, high: Fraction) -> list[Fraction]:
    """The least and the greatest coordinate across the axis of a polygon's edges over [low, high]; none where it is
    elsewhere.
    """
    cut = []
    for p, q in zip(polygon, [*polygon[1:], polygon[0]]):
        (u, v), (s, t) = sorted([(p[axis], p[1 - axis]), (q[axis], q[1 - axis])])
        cut += [Fraction(w) for c, w in ((u, v), (s, t)) if low <= c <= high]
        cut += [v + Fraction(t - v, s - u) * (c - u) for c in (low, high) if u < c < s]
    return [min(cut), max(cut)] if cut else []


def polygons() -> Iterator[tuple[list[tuple[int, int]], int, list[Fraction]]]:
    """Polygons, an axis, and a grid along it."""
    draw = random.Random(1)
    for _ in range(30):
        polygon = [(draw.randint(-6, 6), draw.randint(-6, 6)) for _ in range(draw.randint(3, 7))]
        for axis in (0, 1):
            first, last = (end(p[axis] for p in polygon) for end in (min, max))
            between = [Fraction(draw.randint(2 * first, 2 * last), 2) for _ in range(3)]
            yield polygon, axis, sorted({Fraction(first), *between, Fraction(last)})


# f = 16 + p x + q y, over 1/4 <= x <= 1/2, between the points that a strip has at its two sides.
LINEAR = [(0, 0), (1, 0), (-2, 1), (0, 2), (3, -1), (2, 4)]
LEFT, RIGHT, ENDS = (
    Fraction(1, 4),
    Fraction(1, 2),
    ((Fraction(1), Fraction(5, 4)), (Fraction(3, 2), Fraction(7, 4))),
)


def times(p: int, q: int) -> Iterator[float]:
    """The integral of 1/f along lines from one side of the strip to the other."""
    for first, last in itertools.product(*ENDS):
        one, two = (float(16 + p * x + q * y) for x, y in ((LEFT, first), (RIGHT, last)))
        yield 0.25 / one if one == two else 0.25 * math.log(two / one) / (two - one)
