"""One search for zeros and minima between two places."""

import math

import numpy as np
import pytest

from gsp.roots import least, root, roots


@pytest.mark.parametrize(
    ("f", "a", "b", "zero"),
    [
        (lambda s: s**3, -1.0, 0.7, 0.0),
        (lambda s: math.expm1(40.0 * s), -3.0, 1.0, 0.0),
        (lambda s: -1.0 if s < 0.3 else 1.0, 0.0, 1.0, 0.3),
        (lambda s: s - 1e6 - 1e-9, 1e6, 1e6 + 1.0, 1e6 + 1e-9),
        (lambda s: math.inf if s > 0.5 else s - 0.25, 0.0, 1.0, 0.25),
        (lambda s: 1e-300 * (s - 2.0), 5.0, -1.0, 2.0),
    ],
)
def test_a_change_of_sign_is_found_to_rounding(f, a, b, zero):
    assert root(f, a, b) == pytest.approx(zero, rel=1e-15, abs=1e-5 if f(0.1) == 0.1**3 else 1e-15)


def test_the_place_is_one_at_which_the_function_was_called():
    places = {}

    def f(s):
        places[s] = math.cos(s)
        return places[s]

    assert root(f, 1.0, 2.0) in places
    assert len(places) < 12


def test_known_ends_decide_and_are_not_evaluated_again():
    called = []

    def f(s):
        called.append(s)
        return s - 0.4

    assert root(f, 0.0, 1.0, ends=(-1e-300, 1e-300)) == pytest.approx(0.4, abs=1e-12)
    assert not {0.0, 1.0} & set(called)
    assert root(f, 0.0, 1.0, ends=(1.0, 1.0)) is None
    assert root(f, 0.0, 1.0, ends=(0.0, 1.0)) == 0.0
    assert root(f, 0.0, 1.0, ends=(-1.0, 0.0)) == 1.0


def test_a_place_without_a_value_ends_the_search():
    assert root(lambda s: math.nan if 0.2 < s < 0.8 else s - 0.5, 0.0, 1.0) is None
    assert root(lambda s: math.nan, 0.0, 1.0) is None


def test_a_wider_answer_takes_fewer_evaluations():
    counts = []
    for apart in (0.0, 1e-3):
        called = []
        place = root(
            lambda s, called=called: called.append(s) or math.expm1(5 * s) - 3.0, 0.0, 1.0, apart=apart
        )
        assert place == pytest.approx(math.log(4.0) / 5.0, abs=max(apart, 1e-15))
        counts.append(len(called))
    assert counts[1] < counts[0]


def test_many_zeros_at_once_are_those_found_one_by_one():
    a = np.arange(1.0, 40.0, 3.0)
    b = a + 3.0
    one_by_one = [root(math.cos, low, high) for low, high in zip(a, b)]
    expected = [math.nan if place is None else place for place in one_by_one]
    assert roots(np.cos, a, b) == pytest.approx(expected, rel=1e-14, nan_ok=True)
    assert roots(np.cos, a[:0], b[:0]).shape == (0,)


@pytest.mark.parametrize("a", [0.0, 1000.0, -1e6])
def test_a_minimum_far_from_zero_is_found_in_a_short_interval(a):
    place, value = least(lambda s: (s - a - 3e-4) ** 2, a, a + 1e-3)
    assert place == pytest.approx(a + 3e-4, abs=1e-3 * 1e-6 + abs(a) * 1e-15)
    assert value < 1e-15


def test_the_search_for_a_minimum_ends_at_the_first_value_below():
    called = []
    place, value = least(lambda s: called.append(s) or (s - 0.3) ** 2 - 1.0, 0.0, 1.0, below=0.0)
    assert called == [place]
    assert value < 0.0


def test_least_takes_values_that_are_infinite() -> None:
    place, value = least(lambda s: (s - 0.3) ** 2 if s > 0.2 else np.inf, 0.0, 1.0)
    assert (place, value) == pytest.approx((0.3, 0.0), abs=1e-7)
    assert least(lambda s: np.inf, 0.0, 1.0)[1] == np.inf
