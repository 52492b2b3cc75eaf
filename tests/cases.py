"""Cases of a long list: a few for every run, the others for `pytest -m exhaustive`."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def sampled(cases: Iterable[Any], always: Collection[Any]) -> list[Any]:
    """`cases` for `parametrize`: those in `always` run every time, the others only when everything is asked for."""
    listed = list(cases)
    assert set(always) <= set(listed), set(always) - set(listed)
    return [case if case in always else pytest.param(case, marks=pytest.mark.exhaustive) for case in listed]
