"""Proof files as they are saved, changed and counted over, for tests of their checkers."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import pytest

import gsp
from gsp.proofs import intervals
from gsp.proofs.programs import Rejected
from tests.cases import sampled

# Built-in scenes that are proved, and whose proofs are checked.
SCENES = sampled(
    gsp.models.names(),
    always=["chaplygin_sleigh", "fitzhugh_nagumo", "koper", "michaelis_menten", "rolling_ball", "van_der_pol"],
)


Change = Callable[[dict], None]


class Saved(Protocol):
    """What can be saved as a proof file."""

    def save(self, path: Path) -> object: ...


def written(found: Saved, path: Path) -> dict:
    """The content of the file that `found` saves."""
    found.save(path)
    return json.loads(path.read_text(encoding="utf-8"))


def holds(check: Callable[[Any], object], proof: Any) -> bool:
    """Whether a checker accepts a proof."""
    try:
        check(proof)
    except Rejected:
        return False
    return True


def row(*values: float) -> list[str]:
    """Numbers as they stand in a proof file."""
    return [float(value).hex() for value in values]


def in_pairs(turn: Callable[[list], list]) -> Callable[[list], list]:
    """A change of a row of coordinates as a list of pairs."""
    return lambda given: [v for pair in turn(list(zip(given[::2], given[1::2]))) for v in pair]


def number(text: str, change: Callable[[float], float]) -> str:
    """A number of a proof file, changed."""
    return change(float.fromhex(text)).hex()


def changed(keys: list, value: object) -> Change:
    """Set the place that `keys` lead to; a function of the old value gives the new one."""

    def mutate(proof: dict) -> None:
        at = proof
        for key in keys[:-1]:
            at = at[key]
        at[keys[-1]] = value(at[keys[-1]]) if callable(value) else value

    return mutate


def counted_products(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many products of intervals are taken from now on, in a list of one number."""
    multiply, calls = intervals.multiply, [0]

    def counted(one: intervals.Interval, two: intervals.Interval) -> intervals.Interval:
        calls[0] += 1
        return multiply(one, two)

    monkeypatch.setattr(intervals, "multiply", counted)
    return calls
