"""Laps of a run that has settled: found from two crossings of a section on, the shortest that comes back."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from gsp.orbits.periodic.settling import _lap_in_section

TURN = 2 * np.pi


def lap(
    end: float, *, growth: float = 0.0, since: float = 0.0, doubled: float = 0.0, first: float = 0.0, **options
):
    """The lap of a circle of period 1 whose radius grows by `growth` a turn, or differs in every other turn."""

    def at(t):
        t = np.asarray(t, dtype=float)
        radius = 1.0 + growth * np.maximum(t - since, 0.0) + doubled * np.cos(np.pi * t)
        return np.array([radius * np.cos(TURN * t), radius * np.sin(TURN * t)])

    times = np.linspace(first, end, round(400 * abs(end - first)) + 1)
    options = {"closes": 1e-6, "atol": 1e-12, **options}
    return _lap_in_section(SimpleNamespace(at=at), times, at(times), 0, 0.0, **options)  # pyright: ignore[reportArgumentType]


def test_two_crossings_upward_make_a_lap_and_one_does_not() -> None:
    # x = cos rises through 0 at 3/4, 7/4, ...
    assert lap(1.7) is None
    found = lap(1.8)
    assert found is not None
    assert (found.start, found.length) == pytest.approx((0.75, 1.0))
    # Of many the last one counts.
    assert lap(5.8).start == pytest.approx(4.75)


def test_a_run_that_came_back_before_it_wandered_off_has_a_lap_where_any_will_do() -> None:
    assert lap(5.8, growth=0.1, since=3.0) is None
    found = lap(5.8, growth=0.1, since=3.0, last=False)
    assert found is not None
    assert (found.start, found.length) == pytest.approx((1.75, 1.0))


def test_a_lap_that_does_not_come_back_is_none_and_a_double_one_is_found() -> None:
    assert lap(3.8, growth=0.01) is None
    assert lap(3.8, growth=0.01, closes=0.1).length == pytest.approx(1.0)
    assert lap(1.8, doubled=0.1) is None
    assert lap(3.8, doubled=0.1).length == pytest.approx(2.0)


def test_backward_in_time_a_lap_is_as_long() -> None:
    found = lap(-3.0, first=0.0)
    assert abs(found.length) == pytest.approx(1.0)
