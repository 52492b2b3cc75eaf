"""Cases of a long list: a few for every run, the others for `pytest -m exhaustive`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable
from typing import Any

import pytest


def sampled(cases: Iterable[Any], always: Collection[Any]) -> list[Any]:
    """`cases` for `parametrize`: those in `always` run every time, the others only when everything is asked for."""
    listed = list(cases)
    assert set(always) <= set(listed), set(always) - set(listed)
    return [case if case in always else pytest.param(case, marks=pytest.mark.exhaustive) for case in listed]


def crossed(*lists: Iterable[Any]) -> list[Any]:
    """Combinations of one case of each list for `parametrize`: those in which all lists go round together run every
    time, each case of each list among them; the others only when everything is asked for."""
    cases = [list(each) for each in lists]
    rounds = math.lcm(*map(len, cases))
    together = {tuple(i % len(each) for each in cases) for i in range(rounds)}
    return [
        pytest.param(
            *(each[i] for each, i in zip(cases, places)),
            marks=() if places in together else pytest.mark.exhaustive,
        )
        for places in itertools.product(*(range(len(each)) for each in cases))
    ]


def thinned(cases: Iterable[Any], step: int) -> list[Any]:
    """`cases` for `parametrize`: the first and every `step`-th after it run every time, the others only when everything
    is asked for. A tuple is one case of several arguments."""
    return [
        pytest.param(
            *(case if isinstance(case, tuple) else (case,)),
            marks=pytest.mark.exhaustive if place % step else (),
        )
        for place, case in enumerate(cases)
    ]
