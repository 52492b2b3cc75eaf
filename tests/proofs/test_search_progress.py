"""A share that is told rises from 0 to 1, whatever a search tries, and is told again within a step."""

import math

import pytest

from gsp.proofs.search_progress import SearchProgress


def test_the_share_is_that_of_the_halvings_of_a_bracket() -> None:
    shares: list[float] = []
    shown = SearchProgress(shares.append)
    shown.part(0.0, 0.5)
    for good, bad in ((0.0, math.inf), (1.0, math.inf), (1.0, 4.0), (1.0, 2.0), (2**0.5, 2.0), (1.0, 1.001)):
        shown.bracketed(good, bad, 2.0**0.125)
    assert shares == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.125, 0.25, 0.5])
    shown.part(0.5, 1.0)
    shown.reached(2.0)
    assert shares[-2:] == [0.5, 1.0]


def test_it_never_falls_and_looks_tell_it_again() -> None:
    shares: list[float] = []
    shown = SearchProgress(shares.append)
    shown.reached(0.75)
    shown.reached(0.25)
    shown.looked()
    assert shares == [0.75, 0.75, 0.75]
    SearchProgress().reached(1.0)
