"""Regions and intervals: what is accepted, in which order it comes back, and what is refused."""

from __future__ import annotations

import pytest
import sympy as sp

from gsp.errors import DeclarationError
from gsp.systems.flow import LARGEST
from gsp.systems.region import check_interval, check_region, shown_ends, shown_within


def test_a_region_comes_back_in_the_order_of_the_states() -> None:
    region = check_region({"y": (0, 1), sp.Symbol("x"): [-1, 2.5]}, ["x", "y", "z"], required=["x"])
    assert list(region.items()) == [("x", (-1.0, 2.5)), ("y", (0.0, 1.0))]


def test_a_region_cannot_be_changed() -> None:
    region = check_region({"x": (0, 1)}, ["x"])
    with pytest.raises(TypeError):
        region["x"] = (0, 2)  # pyright: ignore[reportIndexIssue]


@pytest.mark.parametrize(
    ("region", "words"),
    [
        ({"x": (1, 1)}, r"region of x is empty. Got \(1, 1\)"),
        ({"x": (2, 1)}, r"region of x is reversed. Got \(2, 1\)"),
        ({"x": (0, float("inf"))}, "inf. Give a finite number"),
        ({"x": (float("nan"), 1)}, "nan. Give a finite number"),
        ({"x": ("a", 1)}, "no real number"),
        ({"x": (0, 1, 2)}, "pair of numbers. Got 3 of them"),
        ({"x": 3}, "pair of numbers. Got 3"),
        ({"x": "01"}, "pair of numbers. Got '01'"),
        ({"xx": (0, 1)}, 'bounds "xx", which is no state. The states are x, y'),
        ({"speed": (0, 1)}, "no state"),
        ({"y": (0, 1)}, "no interval for x"),
        ({}, "region bounds no state"),
        ([("x", (0, 1))], "maps states to intervals"),
        (
            {"x": (-1e300, 1e300)},
            r"region of x reaches beyond 1e\+100 or is narrower than 1e-100. Got \(-1e\+300, 1e\+300\)",
        ),
        ({"x": (0, 1), "y": (0, 2e100)}, "Rescale y"),
        ({"x": (0, 1), "y": (-2e100, 1)}, "Rescale y"),
        ({"x": (0, 5e-101)}, "Rescale x"),
        ({"x": (0, 1), sp.Symbol("x"): (0, 2)}, '"x" twice'),
    ],
)
def test_what_is_no_region_is_refused_with_its_place(region, words: str) -> None:
    with pytest.raises(DeclarationError, match=words):
        check_region(region, ["x", "y"], required=["x"])


def test_a_region_at_the_limits_is_taken() -> None:
    widest, narrowest = (-LARGEST, LARGEST), (0.0, 1.0 / LARGEST)
    assert dict(check_region({"x": widest, "y": narrowest}, ["x", "y"])) == {"x": widest, "y": narrowest}


def test_a_misspelt_state_is_answered_with_the_nearest() -> None:
    with pytest.raises(DeclarationError, match='Did you mean "omega"'):
        check_region({"omgea": (0, 1)}, ["v", "omega"])


def test_an_interval_is_named_in_its_error() -> None:
    assert check_interval((0, 20), what="span", remedy="") == (0.0, 20.0)
    with pytest.raises(DeclarationError, match=r"the span is reversed.*Swap them"):
        check_interval((1, 0), what="span", remedy="Swap them.")


def test_bounds_are_plural() -> None:
    with pytest.raises(DeclarationError, match="the bounds are reversed"):
        check_interval((2, 1), what="bounds", remedy="Give (low, high).")


@pytest.mark.parametrize(
    ("bounds", "shown"),
    [
        ((0.0, 12.3456), ("0", "12.3456")),
        ((1e9 - 5, 1e9 + 5), ("999999995", "1000000005")),
        ((2020.25, 2020.75), ("2020.25", "2020.75")),
        ((-1e308, 1e308), ("-1e+308", "1e+308")),
        ((1.0, 1.0 + 2.0**-52), ("1", "1.0000000000000002")),
    ],
)
def test_ends_are_told_apart(bounds, shown) -> None:
    assert shown_ends(bounds) == shown
    assert len(set(shown_ends(bounds))) == 2


def test_a_place_between_two_ends_is_told_from_both() -> None:
    assert shown_within(2020.5, (2020.25, 2020.75)) == "2020.5"
    assert shown_within(0.123456, (0.0, 12.0)) == "0.1235"
