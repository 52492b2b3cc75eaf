"""The conditions of the checker of cycles one by one, on fields and polygons whose answers are known in closed form."""

from __future__ import annotations

import contextlib
import itertools
from collections import Counter
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import pytest

from gsp.proofs import cycle_checker
from gsp.proofs import intervals as ia
from gsp.proofs.band_checker import MOST_VERTICES, _chain, _even, _meet, area, orientation
from gsp.proofs.checked_cycle import CheckedAnnulus
from gsp.proofs.cycle_checker import _Annulus
from gsp.proofs.programs import IntervalProgram, Rejected
from tests.cycles.by_hand import (
    CUTS,
    ENDS,
    EPSILON,
    GRIDS,
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
from tests.proof_files import holds, row

F = Fraction
NEAR = 2.0**-20


def plain(**more: Any) -> dict:
    return {
        "epsilon": float(EPSILON).hex(),
        "outer": row(*itertools.chain(*OUTER)),
        "inner": row(*itertools.chain(*INNER)),
        "cuts": [list(cut) for cut in CUTS],
        "strips": 1,
        "unique": False,
        "contraction": (0.0).hex(),
        "period": row(0, 100),
        "grids": [row(*grid) for grid, _ in zip(GRIDS, more.get("cuts", CUTS))],
    } | more


def annulus(f: str, g: str, **more: Any) -> _Annulus:
    return _Annulus(plain(**more), IntervalProgram((f, g, "0"), 3))


def crosses(f: str, g: str, one: tuple[int, int], two: tuple[int, int], side: int = 1) -> bool:
    return holds(lambda found: found.require_crossed(one, two, side), annulus(f, g))


def nested(**more: Any) -> bool:
    return holds(lambda found: found._require_nested(), annulus("1", "1", **more))


@pytest.mark.exhaustive
def test_constant_fields_cross_the_edges_that_they_cross() -> None:
    for (dx, dy), side, f, g, said in crossings():
        assert crosses(str(f), str(g), (3, 5), (3 + dx, 5 + dy), side) is said, (dx, dy, side, f, g)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("f", "g", "two"),
    [
        # g alone, along the slow variable, least within the edge, at its ends; f alone, along the fast one.
        ("0", "(z0 - 1)**2 + {0}", (4, 0)),
        ("0", "z0 + {0}", (4, 0)),
        ("0", "4 - z0 + {0}", (4, 0)),
        ("z1 + 4*z0 + {0}", "0", (0, -4)),
        ("-(z1 - 1)**2 - {0}", "z0", (0, 4)),
        # dx g = 4 (g - f/4) along the diagonal; both are large, and their difference is {0}.
        ("4*z0 + 12*z1", "4*z1 + {0}", (4, 4)),
        ("4*sin(z0) + 8", "sin(z1) + 2 + {0}", (4, 4)),
        # epsilon up to 1/4.
        ("0", "1 - 4*z2 + {0}", (4, 0)),
    ],
)
def test_an_edge_is_crossed_as_far_as_it_is(f: str, g: str, two: tuple[int, int]) -> None:
    start, end = ((0, 4), (0, 0)) if two == (0, -4) else ((0, 0), two)
    for u, v in ((0, 0), (3, -2)):
        for shift, said in (("1/4096", True), ("(-1/4096)", False)):
            rates = [
                t.format(shift).replace("z0", f"(z0 - {u})").replace("z1", f"(z1 - ({v}))") for t in (f, g)
            ]
            one, other = ((p + u, q + v) for p, q in (start, end))
            assert crosses(*rates, one, other) is said


@pytest.mark.parametrize("place", [0.0625 + k / 4 for k in range(16)])
def test_no_part_of_an_edge_is_left_out(place: float) -> None:
    # g < 0 within 1/64 of the place.
    assert not crosses("0", f"(z0 - {F(place)})**2 - 1/4096", (0, 0), (4, 0))


def test_epsilon_goes_down_to_zero() -> None:
    with pytest.raises(ia.OutOfDomain):
        crosses("0", "1 + 0*sqrt(z2)", (0, 0), (4, 0))
    with pytest.raises(ia.OutOfDomain):
        annulus("1", "1 + 0*sqrt(z2)").turn()


@pytest.mark.parametrize(("f", "g", "least", "most", "contraction"), TURNS)
def test_times_and_divergences_of_a_turn_are_their_closed_forms(
    f: tuple[int, int, int], g: tuple[int, int, int], least: Fraction, most: Fraction, contraction: Fraction
) -> None:
    # Finer boxes say more where g varies.
    for strips in (1,) if any(g[1:]) else (1, 3):
        found = annulus(*(f"({a}) + ({b})*z0 + ({c})*z1" for a, b, c in (f, g)), strips=strips).turn()
        for value, exact, side in zip(found, (least, most, contraction), (-1, 1, 1)):
            assert 0 <= side * (value - exact) <= F(1, 2**80)


def test_coordinates_are_fractions() -> None:
    # All of the first case eight times as small.
    outer, inner = (row(*(F(v, 8) for p in polygon for v in p)) for polygon in (OUTER, INNER))
    grids = [row(*(F(v, 8) for v in grid)) for grid in GRIDS]
    least, most, _ = annulus("2", "8", outer=outer, inner=inner, grids=grids).turn()
    assert 0 <= F(1, 2) - least <= F(1, 2**80)
    assert 0 <= most - TURNS[0][3] / 8 <= F(1, 2**80)


def test_the_slow_rate_counts_for_the_divergence_by_epsilon() -> None:
    # f = 8 + x/2 from 7 to 9 where orbits pass, and 6 to 10 in all: epsilon f_x = 1/8 at most, and not less than 0.
    _, _, found = annulus("8 + z0/2", "-8").turn()
    exact = F(1, 8) * (2 * (4 / F(7) + 2 / F(6) + 2 / F(9)) + EPSILON * 4 / 8)
    assert 0 <= found - exact <= F(1, 2**80)
    _, _, found = annulus("8 - z0/2", "-8").turn()
    assert 0 <= found <= F(1, 2**80)


@pytest.mark.parametrize(("f", "g"), [("z0 + 1", "1"), ("1", "z1"), ("z1", "z1 + 1/2"), ("0", "1"), ("1", "0")])
def test_a_rate_that_changes_its_sign_in_a_sector_is_refused(f: str, g: str) -> None:
    with pytest.raises(Rejected, match="sign"):
        annulus(f, g).turn()


@pytest.mark.parametrize("grid", [[-4, -2, 2, 3.5], [-3.5, 4], [-4, -4, 4], [4, -4], [4], []])
def test_a_grid_rises_and_covers_its_sector(grid: list[float]) -> None:
    with pytest.raises(Rejected, match="grid"):
        annulus("1", "1", grids=[row(*grid), *(row(*g) for g in GRIDS[1:])]).turn()


def test_strips_hold_the_ends_of_edges_over_them() -> None:
    for polygon, axis, grid in polygons():
        strips = {(a, b): line for a, b, line in annulus("1", "1")._strips(polygon, axis, grid)}
        for a, b in itertools.pairwise(grid):
            line = strips.get((a, b), [])
            assert all(a <= c <= b for c, _ in line)
            across = [v for _, v in line]
            assert [min(across), max(across)] == extents(polygon, axis, a, b)


@pytest.mark.parametrize(("p", "q"), LINEAR)
@pytest.mark.parametrize("sign", [-1, 1])
def test_the_time_over_a_strip_is_that_along_every_line(p: int, q: int, sign: int) -> None:
    one = annulus(f"({sign})*(16 + ({p})*z0 + ({q})*z1)", "1")
    low, high = one._time(LEFT, RIGHT, [(x, y) for x, side in zip((LEFT, RIGHT), ENDS) for y in side])
    known = list(times(p, q))
    assert low / ia.ONE <= min(known) * (1 + 1e-12)
    assert max(known) * (1 - 1e-12) <= high / ia.ONE
    # Jumps from one side to the other are allowed for, and little more.
    assert (high - low) / ia.ONE <= 4 * (max(known) - min(known)) + 1e-5


def test_the_time_over_a_strip_is_open_by_so_much_as_the_slopes_leave() -> None:
    # f = 1/2 in the middle; f_x from -1 to 1, f_y from -2 to 2 where f is taken as 1. From 1/4 to 1/2 along a line of
    # slope 1/2, others 1/32 from it: (1/8)^2/2 times the range of f_x + f_y/2, and 2 (1/8) (1/32) 2.
    one = annulus("1", "1")
    slopes = [(-ia.ONE, ia.ONE), (-2 * ia.ONE, 2 * ia.ONE), ia.ZERO]
    one._over = lambda box: ([ia.UNIT] * 3, [slopes] * 3)  # pyright: ignore[reportAttributeAccessIssue]
    one.program = SimpleNamespace(values=lambda at: [(ia.ONE // 2, ia.ONE // 2)])  # pyright: ignore
    places = ((LEFT, F(0)), (LEFT, F(1, 16)), (RIGHT, F(1, 8)), (RIGHT, F(3, 16)))
    low, high = one._time(LEFT, RIGHT, list(places))
    for found, exact in ((-low, -F(1, 2) + F(3, 64)), (high, F(1, 2) + F(3, 64))):
        assert 0 <= found - exact * ia.ONE <= 8


def test_the_polygons_are_nested_and_the_cuts_follow_one_another() -> None:
    for outer, inner, cuts, said in nestings():
        rows = {"outer": row(*itertools.chain(*outer)), "inner": row(*itertools.chain(*inner))}
        assert nested(cuts=[list(cut) for cut in cuts], **rows) is said, (outer, inner, cuts)


@pytest.mark.parametrize(
    "wrong",
    [
        {"cuts": [[0, 0]]}, {"cuts": [[0, 0], [3, 3], [4, 4]]}, {"cuts": [[0, 8], [3, 3]]}, {"cuts": [[8, 0], [3, 3]]},
        {"strips": 0}, {"strips": 5001}, {"unique": 1}, {"unique": True}, {"period": row(1)}, {"grids": []},
        {"outer": row(1, 2, 3)}, {"epsilon": (0.0).hex()}, {"epsilon": (-1.0).hex()},
        {"outer": ["0x1p-256", *plain()["outer"][1:]]}, {"outer": ["0x1p256", *plain()["outer"][1:]]},
    ],
)  # fmt: skip
def test_what_is_no_annulus_is_refused(wrong: dict) -> None:
    with pytest.raises(Rejected):
        annulus("1", "1", **wrong)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({}, "do not cross"),
        ({"annuli": [plain()] * 4}, "do not cross"),
        ({"annuli": [plain()] * 5}, "from 1 to 4 annuli"),
        ({"annuli": []}, "from 1 to 4 annuli"),
        ({"annuli": {"0": plain()}}, "from 1 to 4 annuli"),
        ({"format": "gsp relaxation cycle 1"}, "format"),
        ({"names": ["x", "y"]}, "three rates"),
        ({"names": ["x", "y", "epsilon", "a"]}, "three rates"),
        ({"rates": ["1"]}, "three rates"),
        ({"rates": ["1", "1"]}, "three rates"),
        ({"rates": "111"}, "three rates"),
        ({"rates": ["z2", "1", "0"]}, "do not cross"),
        ({"rates": ["z3", "1", "0"]}, "unknown name"),
    ],
)
def test_a_file_holds_names_rates_and_annuli(more: dict, said: str) -> None:
    top = {
        "format": cycle_checker.FORMAT,
        "names": ["x", "y", "epsilon"],
        "rates": ["1", "1", "0"],
        "annuli": [plain()],
    }
    with pytest.raises(Rejected, match=said):
        cycle_checker.check(top | more)


def claimed(**more: Any) -> CheckedAnnulus | None:
    """x' = -2, epsilon y' = 8 - y with edges that are taken as crossed."""
    one = annulus("-2", "8 - z1", **more)
    one.require_crossed = lambda *args: None  # pyright: ignore[reportAttributeAccessIssue]
    with contextlib.suppress(Rejected):
        return one.checked()
    return None


def test_claims_are_no_sharper_than_what_is_found() -> None:
    # From 4 to 8 + 1/7, and an integral of -4.
    most = 8.0 + 1.0 / 7.0
    for least, said in ((4.0 - NEAR, True), (4.0 + NEAR, False)):
        assert (claimed(period=row(least, 9)) is not None) is said
    for greatest, said in ((most - NEAR, False), (most + NEAR, True)):
        assert (claimed(period=row(3, greatest)) is not None) is said
    for bound, said in ((-4.0 - NEAR, False), (-4.0 + NEAR, True)):
        assert (claimed(unique=True, contraction=bound.hex()) is not None) is said
        assert claimed(unique=False, contraction=bound.hex())
    found = claimed(unique=True, contraction=(-3.5).hex(), period=row(3, 9))
    assert found == CheckedAnnulus(0.25, True, (3.0, 9.0), -3.5, 2 * (((-4.0, -2.0), (2.0, 4.0)),), (8, 8))


def test_triangles_within_one_another_are_told_from_others() -> None:
    seen = Counter()
    for outer, inner, wrong in itertools.islice(triangles(), 400):
        one = annulus(
            "1",
            "1",
            outer=row(*itertools.chain(*outer)),
            inner=row(*itertools.chain(*inner)),
            cuts=[[0, 0], [1, 1]],
        )
        one.cuts = []
        with pytest.raises(Rejected, match=wrong) if wrong else contextlib.nullcontext():
            one._require_nested()
        seen[wrong] += 1
    assert min(seen.values()) > 5


def test_segments_meet_where_they_have_a_point_in_common() -> None:
    for points, one, two, said in meetings():
        assert _meet(points, one, two) is said, (points, one, two)


def test_polygons_by_their_vertices() -> None:
    assert area([(0, 0), (3, 0), (0, 2)]) == 6
    assert area([(0, 0), (0, 2), (3, 0)]) == -6
    assert orientation((0, 0), (1, 0), (5, 1)) == 1
    assert orientation((0, 0), (1, 0), (5, -1)) == -1
    assert orientation((1, 1), (2, 2), (5, 5)) == 0
    assert _chain(OUTER, 1, 3) == OUTER[1:4]
    assert _chain(OUTER, 6, 1) == [*OUTER[6:], *OUTER[:2]]
    assert _even(["0", "1"]) == 2
    for wrong in (["0"], "01", ["0"] * (2 * MOST_VERTICES + 2)):
        with pytest.raises(Rejected):
            _even(wrong)
