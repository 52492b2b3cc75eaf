"""The checker of delays on rates whose integrals are known in closed form: it accepts as far as they reach."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import pytest

from gsp.proofs import intervals as ia
from gsp.proofs.checked_passage import CheckedDelay, CheckedPassage
from gsp.proofs.passage_checker import DelayChecker
from gsp.proofs.programs import IntervalProgram, Rejected
from tests import proof_files
from tests.proof_files import row

F = Fraction
NEAR = 2.0**-20


def delay(
    way: int, f: str, k: str, places: tuple[float, ...], stays: int, leaves: int | None, **more: Any
) -> DelayChecker:
    """Along x' = `way` f, v' = k v/epsilon, with x and the grid turned by `way`."""
    turned = ("" if way > 0 else "-"), ("z0" if way > 0 else "(-z0)")
    rates = f"{turned[0]}({f.replace('z0', turned[1])})", k.replace("z0", turned[1])
    plain = {
        "epsilon": (0.0625).hex(), "width": (0.125).hex(), "above": False, "grid": row(*(way * v for v in places)),
        "kept": stays, "left": leaves, "time": row(0, 100), "depth": (0.0).hex(),
    }  # fmt: skip
    return DelayChecker(plain | more, IntervalProgram(rates, 3))


def holds(*given: Any, **more: Any) -> bool:
    return proof_files.holds(lambda checker: checker.checked(), delay(*given, **more))


# k, and where orbits from -1 are kept to and have left by: (x^2 - 1)/2, with v up to 1/8 either way, and epsilon.
ENDS = [
    ("z0", 1.0, 1.0),
    ("z0 + z1", 0.75, 1.25),
    ("z0 - z1", 0.75, 1.25),
    ("z0 + z2", 0.875, 1.0),
    ("z0 - z2", 1.0, 1.125),
]


@pytest.mark.parametrize("way", [-1, 1])
@pytest.mark.parametrize(("k", "kept", "left"), ENDS)
def test_orbits_are_kept_and_leave_as_far_as_the_integral_says(
    way: int, k: str, kept: float, left: float
) -> None:
    # Ever shorter strips: what may be gained within one is not to be more than what is left.
    near = (-1.0, -0.5, 0.0, *(kept - 2.0**-i for i in range(1, 21)))
    assert holds(way, "1", k, near, 22, None)
    assert not holds(way, "1", k, (*near, kept + NEAR), 23, None)
    for place, said in ((left - NEAR / 2, False), (left + NEAR, True)):
        assert holds(way, "1", k, (*near, place), 22, 23) is said
    # The first strip begins with a loss all over it, and a later one does not gain in between what it loses in all.
    assert not holds(way, "1", k, (-1.0, 0.5), 1, None)
    assert not holds(way, "1", "1 - 3*z0**2", (-1.0, -0.75, 0.75), 2, None)
    assert not holds(way, "1", "1 - 3*z0**2", (-1.0, -0.75, 1.125), 2, None)


@pytest.mark.parametrize("way", [-1, 1])
@pytest.mark.parametrize(
    ("f", "least", "most"),
    [("1", 1.0, 1.0), ("2", 0.5, 0.5), ("1 + z2", 16 / 17, 1.0), ("1 + z1", 8 / 9, 8 / 7)],
)
def test_time_and_depth_are_within_what_is_claimed(way: int, f: str, least: float, most: float) -> None:
    grid = (-1.0, -0.5, 0.0)
    for low, high, said in (
        (least - NEAR, most + NEAR, True), (least + NEAR, most + NEAR, False), (least - NEAR, most - NEAR, False),
    ):  # fmt: skip
        assert holds(way, f, "z0", grid, 2, None, time=row(low, high)) is said
    if f in ("1", "2"):
        assert holds(way, f, "z0", grid, 2, None, depth=(0.5 / float(f) - NEAR).hex())
        for depth, said in ((0.5 / float(f) - NEAR, True), (0.5 / float(f) + NEAR, False)):
            assert holds(way, f, "z0", (*grid, 0.25), 3, None, depth=depth.hex()) is said


@pytest.mark.parametrize(
    ("f", "more"),
    [
        ("z0 + 1/2", {}), ("0", {}), ("-1", {}), ("1", {"epsilon": (0.0).hex()}), ("1", {"width": (0.0).hex()}),
        ("1", {"above": 0}), ("1", {"grid": row(-1.0, -1.0, -0.5)}), ("1", {"grid": row(-1.0, -0.5, -0.75)}),
        ("1", {"grid": row(-1.0)}), ("1", {"kept": 0}), ("1", {"kept": 3}), ("1", {"left": 1}), ("1", {"left": 0}),
    ],
)  # fmt: skip
def test_what_is_no_delay_is_refused(f: str, more: dict) -> None:
    assert holds(1, "1", "z0", (-1.0, -0.5, 0.0), 2, None)
    with pytest.raises(Rejected):
        delay(1, f, "z0", (-1.0, -0.5, 0.0), 1 if "left" in more else 2, None, **more).checked()


@pytest.mark.parametrize("above", [False, True])
def test_the_integral_over_a_strip_is_open_by_so_much_as_the_slopes_leave(above: bool) -> None:
    # k = -2 in the middle of [1/4, 1/2], k_x from -1 to 1 and k_v from -2 to 2: (1/8)^2/2 2, and (1/4) (1/8) 2.
    found = delay(1, "1", "z0", (0.25, 0.5), 1, None, above=above)
    rates = [[ia.ZERO] * 3, [(-ia.ONE, ia.ONE), (-2 * ia.ONE, 2 * ia.ONE), ia.ZERO]]
    wide, middle = [ia.UNIT, (-9 * ia.ONE, 9 * ia.ONE)], [ia.UNIT, (-2 * ia.ONE, -2 * ia.ONE)]
    taken = iter((wide, middle))
    stub: Any = SimpleNamespace(values=lambda at: next(taken), derivatives=lambda at: rates)
    found.program = stub
    (low, high), crude, time, _ = found._strip(F(1, 4), F(1, 2))
    for end, exact in ((-low, F(1, 2) + F(5, 64)), (high, -F(1, 2) + F(5, 64))):
        assert 0 <= end - exact * ia.ONE <= 8
    assert crude == (-9 * ia.ONE // 4, 9 * ia.ONE // 4)
    assert time == (ia.ONE // 4, ia.ONE // 4)


def test_what_is_proved_above_the_sheet_is_said_of_no_orbit_below_it() -> None:
    # k = y - 10 v attracts above v = 0, and repels at once at (-1, -1/5), where it is 1.
    grid = tuple(k / 64 - 1.0 for k in range(64))
    with pytest.raises(Rejected):
        delay(1, "1", "z0 - 10*z1", grid, 60, None, above=False, width=(0.2).hex()).checked()
    found = delay(1, "1", "z0 - 10*z1", grid, 60, None, above=True, width=(0.2).hex()).checked()
    passage = CheckedPassage(("y", "v", "epsilon"), ("1", "z0 - 10*z1"), (F(0), F(0)), found)
    assert "orbits with 0 <= z1 <= 0.2 over z0 = -1" in str(passage)
    assert passage.as_dict()["above"] is True
    both = CheckedPassage(
        ("y", "v", "epsilon"), ("1", "z0"), (F(0), F(0)), delay(1, "1", "z0", grid, 60, None).checked()
    )
    assert "orbits with |z1| <= 0.125 over z0 = -1" in str(both)


def test_what_is_told_is_what_is_claimed() -> None:
    found = delay(
        1, "1", "z0", (-1.0, -0.5, 0.0, 1.5), 2, 3, time=row(0.75, 2.5), depth=(0.375).hex()
    ).checked()
    assert found == CheckedDelay(0.0625, 0.125, -1.0, 0.0, 1.5, (0.75, 2.5), 0.375, False)


def test_the_sheet_itself_and_epsilon_zero_are_among_what_is_looked_at() -> None:
    for inside in ("z1", "z2"):
        with pytest.raises(ia.OutOfDomain):
            holds(1, f"1 + 0*sqrt({inside})", "z0", (-1.0, -0.5, 0.0), 2, None, above=True)


def test_above_the_sheet_only_one_side_of_it_counts() -> None:
    # The root has no value below the sheet, nor the integral a bound.
    assert holds(1, "1 + 0*sqrt(z1 + 1/16)", "z0", (-1.0, -0.5, 0.0), 2, None, above=True)
    with pytest.raises(ia.OutOfDomain):
        holds(1, "1 + 0*sqrt(z1 + 1/16)", "z0", (-1.0, -0.5, 0.0), 2, None)
