"""The conditions of a proof of cycles one by one, on fields and polygons whose answers are known in closed form."""

from __future__ import annotations

import itertools
from collections import Counter
from fractions import Fraction
from functools import cache
from types import SimpleNamespace
from typing import Any

import flint
import numpy as np
import pytest
import sympy as sp
from flint import arb

from gsp.cycles.annulus import Annulus
from gsp.cycles.conditions import _crossed, _meet, require_nested
from gsp.cycles.enclosed_field import EnclosedField
from gsp.cycles.sectors import NotProved, Slice, _clipped, _Sliced, turn_of
from gsp.proofs import balls
from gsp.systems.system import SlowFastSystem
from tests.cycles.by_hand import (
    CUTS,
    ENDS,
    EPSILON,
    INNER,
    LEFT,
    LINEAR,
    OUTER,
    RIGHT,
    TURNS,
    crossings,
    extents,
    meetings,
    nestings,
    polygons,
    times,
    triangles,
)

x, y, epsilon = sp.symbols("x y epsilon")
SMALL = float(EPSILON)


@pytest.fixture(autouse=True)
def precision():
    with flint.ctx.workprec(balls.PRECISION):
        yield


def field(f: Any, g: Any) -> EnclosedField:
    return EnclosedField.of(SlowFastSystem(slow={x: sp.sympify(f)}, fast={y: sp.sympify(g)}, epsilon=epsilon))


def annulus(outer: list = OUTER, inner: list = INNER, cuts: list = CUTS) -> Annulus:
    return Annulus(np.array(outer, dtype=float), np.array(inner, dtype=float), tuple(cuts))


def test_constant_fields_cross_the_edges_that_they_cross() -> None:
    known = cache(field)
    for (dx, dy), side, f, g, said in crossings():
        found = _crossed(known(f, g), [3.0, 5.0], [3.0 + dx, 5.0 + dy], side, SMALL)
        assert found is said, (dx, dy, side, f, g)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("write", "start", "end"),
    [
        # g alone, along the slow variable, least within the edge, at its ends; f alone, along the fast one.
        (lambda d: (0, (x - 1) ** 2 + d), (0, 0), (4, 0)),
        (lambda d: (0, x + d), (0, 0), (4, 0)),
        (lambda d: (0, 4 - x + d), (0, 0), (4, 0)),
        (lambda d: (y + 4 * x + d, 0), (0, 4), (0, 0)),
        (lambda d: (-((y - 1) ** 2) - d, x), (0, 0), (0, 4)),
        # dx g = 4 (g - f/4) along the diagonal; both are large, and their difference is d.
        (lambda d: (4 * x + 12 * y, 4 * y + d), (0, 0), (4, 4)),
        (lambda d: (4 * sp.sin(x) + 8, sp.sin(y) + 2 + d), (0, 0), (4, 4)),
        # What epsilon adds to g moves with it: at 1/4 their sum is d.
        (lambda d: (0, x + 1 + epsilon * (-4 * x - 4 + 4 * d)), (0, 0), (4, 0)),
        # epsilon up to 1/4.
        (lambda d: (0, 1 - 4 * epsilon + d), (0, 0), (4, 0)),
    ],
)
def test_an_edge_is_crossed_as_far_as_it_is(write: Any, start: tuple, end: tuple) -> None:
    for d, said in ((sp.Rational(1, 4096), True), (-sp.Rational(1, 4096), False)):
        rates = [sp.sympify(e).subs({x: x - 3, y: y + 2}, simultaneous=True) for e in write(d)]
        one, two = ([float(point[0] + 3), float(point[1] - 2)] for point in (start, end))
        assert _crossed(field(*rates), one, two, 1, SMALL) is said


@pytest.mark.parametrize(
    ("p", "q", "r"), [(1, 0, 0), (0, 1, 0), (0, 0, 1), (2, -3, 0), (2, -1, 0), (1, -3, 1), (-1, 5, -3)]
)
def test_from_a_corner_the_fast_rate_is_that_of_its_second_derivatives(p: int, q: int, r: int) -> None:
    # g = p x^2 + q x y + r y^2, and f is to one side or the other.
    for f in (-1, 1):
        over = field(f, p * x**2 + q * x * y + r * y**2)
        for (dx, dy), side in itertools.product([(1, 1), (1, -1), (-1, 1), (2, 1), (-1, -2)], (1, -1)):
            said = side * dx * (p * dx * dx + q * dx * dy + r * dy * dy) >= 0 and -side * dy * f > 0
            found = _crossed(over, [0.0, 0.0], [float(dx), float(dy)], side, SMALL, corner=True)
            assert found is said, (dx, dy, side, f)


def test_epsilon_goes_down_to_zero() -> None:
    # g is negative for epsilon below 1e-12 only.
    over = field(-1, epsilon - sp.Rational(1, 10**12))
    assert not _crossed(over, [0.0, 0.0], [4.0, 1.0], 1, SMALL)
    with pytest.raises(NotProved):
        turn_of(over, annulus(), SMALL, 2)


@pytest.mark.exhaustive
@pytest.mark.parametrize("place", [0.0625 + k / 4 for k in range(16)])
def test_no_part_of_an_edge_is_left_out(place: float) -> None:
    # g < 0 within 1/64 of the place.
    over = field(0, (x - sp.Rational(place)) ** 2 - sp.Rational(1, 4096))
    assert not _crossed(over, [0.0, 0.0], [4.0, 0.0], 1, SMALL)


@pytest.mark.parametrize(("f", "g", "least", "most", "contraction"), TURNS)
def test_times_and_divergences_of_a_turn_are_their_closed_forms(
    f: tuple[int, int, int], g: tuple[int, int, int], least: Fraction, most: Fraction, contraction: Fraction
) -> None:
    found = turn_of(field(*(a + b * x + c * y for a, b, c in (f, g))), annulus(), SMALL, 2)
    # Strips are finer here: of a rate that varies less time passes than at its least, and more than at its greatest.
    slow, fast = (0.1 if any(f[1:]) else 1e-9), (float(EPSILON) / 5 if any(g[1:]) else 1e-8)
    assert -slow <= least - Fraction(found.period[0]) <= 1e-8
    assert -max(10 * slow, fast) <= Fraction(found.period[1]) - most <= 1e-8
    assert -fast * (contraction > 0) <= Fraction(found.contraction) - contraction <= 1e-8


def test_the_slow_rate_counts_for_the_divergence_by_epsilon() -> None:
    # f = 8 + x/2: epsilon f_x is at most 1/8, over f from 7 to 9 where orbits pass, and at least 6.
    found = turn_of(field(8 + x / 2, -8), annulus(), SMALL, 2).contraction
    log = 2 * float(EPSILON) / 2 * 2 * np.log(10 / 6)
    assert log <= found <= 1.1 * (log + 4 * SMALL**2 / 16)
    assert 0 <= turn_of(field(8 - x / 2, -8), annulus(), SMALL, 2).contraction <= 1e-8


@pytest.mark.parametrize(("f", "g"), [(x + 1, 1), (1, y), (y, y + sp.Rational(1, 2)), (0, 1), (1, 0)])
def test_a_rate_that_changes_its_sign_in_a_sector_is_refused(f: Any, g: Any) -> None:
    with pytest.raises(NotProved, match="sign"):
        turn_of(field(f, g), annulus(), SMALL, 2)


def test_strips_hold_the_ends_of_edges_over_them() -> None:
    for polygon, axis, grid in polygons():
        found = _clipped(np.array(polygon, dtype=float), axis, [float(v) for v in grid])
        for (a, b), line in zip(itertools.pairwise(grid), found):
            assert all(a <= c <= b for c, _, _ in line)
            exact = extents(polygon, axis, a, b)
            low, high = min(v for _, v, _ in line), max(v for _, _, v in line)
            assert 0 <= exact[0] - Fraction(low) <= 1e-14
            assert 0 <= Fraction(high) - exact[1] <= 1e-14


@pytest.mark.parametrize(("p", "q"), LINEAR)
@pytest.mark.parametrize("sign", [-1, 1])
def test_the_time_over_a_strip_is_that_along_every_line(p: int, q: int, sign: int) -> None:
    row = [(float(u), float(low), float(high)) for u, (low, high) in zip((LEFT, RIGHT), ENDS)]
    strip = Slice((float(LEFT), float(RIGHT), 0.0, 1.0), row, is_passed=True)
    found = _Sliced(field(sign * (16 + p * x + q * y), 1), 0, arb(SMALL), strip, 1.0).along(
        *strip.box[:2], row, sign
    )
    known = list(times(p, q))
    assert all(found.overlaps(arb(exact, 1e-13)) for exact in known)
    # Jumps from one side to the other are allowed for, and little more.
    assert 2 * float(found.rad()) <= 4 * (max(known) - min(known)) + 1e-5


def test_the_time_over_a_strip_is_open_by_so_much_as_the_slopes_leave() -> None:
    # f = 1/2 in the middle; f_x from -1 to 1, f_y from -2 to 2 where f is taken as 1. From 1/4 to 1/2 along a line of
    # slope 1/2, others 1/32 from it: (1/8)^2/2 times the range of f_x + f_y/2, and 2 (1/8) (1/32) 2.
    slopes = [arb(1), arb(1), arb(0), balls.hull(-1.0, 1.0), balls.hull(-2.0, 2.0), *[arb(0)] * 4]
    stub: Any = SimpleNamespace(with_slopes=lambda *box: slopes, over=lambda *at: [arb(0.5), arb(1), arb(0)])
    row = [(0.25, 0.0, 0.0625), (0.5, 0.125, 0.1875)]
    strip = Slice((0.25, 0.5, 0.0, 0.1875), row, is_passed=True)
    found = _Sliced(stub, 0, arb(SMALL), strip, 1.0).along(0.25, 0.5, row, 1)
    assert float(found.mid()) == 0.5
    assert 3 / 64 <= float(found.rad()) <= 3 / 64 + 1e-8


def test_the_polygons_are_nested_and_the_cuts_follow_one_another() -> None:
    for outer, inner, cuts, said in nestings():
        try:
            require_nested(annulus(outer, inner, cuts))
        except NotProved:
            assert not said, (outer, inner, cuts)
        else:
            assert said, (outer, inner, cuts)


def test_triangles_within_one_another_are_told_from_others() -> None:
    seen = Counter()
    for outer, inner, wrong in itertools.islice(triangles(), 400):
        # Without cuts there is always something to say.
        with pytest.raises(NotProved, match={"meet": "meet|each its own"}.get(wrong, wrong or "cuts")):
            require_nested(annulus(outer, inner, []))
        seen[wrong] += 1
    assert min(seen.values()) > 5


def test_segments_meet_where_they_have_a_point_in_common() -> None:
    for points, one, two, said in meetings():
        # Small ones, so that no product is as large as 1.
        small = np.array(points) / 16.0
        ends = small[[list(one), list(two)]]
        # Segments with boxes apart are not asked about.
        if (ends.min(axis=1).max(axis=0) <= ends.max(axis=1).min(axis=0)).all():
            assert _meet(small, one, two) is said, (points, one, two)


def test_sectors_fill_the_annulus_and_grids_cover_them() -> None:
    found = annulus()
    for k, sector in enumerate(found.sectors):
        u, v = sector.T
        assert 0.5 * float(u @ np.roll(v, -1) - v @ np.roll(u, -1)) == (4.0 if k % 2 else 20.0)
        grid, along = np.array(found.grid(k, 4)), sector[:, k % 2]
        assert (grid[0], grid[-1]) == (along.min(), along.max())
        assert 0.0 < np.diff(grid).min() <= np.diff(grid).max() <= np.ptp(along) / 8
        assert k % 2 or {-4.0, -2.0, 2.0, 4.0} <= set(grid)
    assert found.ends(0) == [[2.0, 4.0], [-4.0, -2.0]]
    assert found.ends(3) == [[2.0, 4.0]] * 2
