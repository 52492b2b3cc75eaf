"""What the contract of a public verb is written in: kinds of values, and what is right and wrong for each.

The module `public` beside the tests of a package holds its verbs and nouns, and the tests of all public names find them
there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp


def public(table: str) -> dict[str, Any]:
    """`VERBS` or `NOUNS` of every package, by name."""
    found: dict[str, Any] = {}
    for path in Path(__file__).parent.glob("*/public.py"):
        found |= getattr(import_module(f"tests.{path.parent.name}.public"), table, {})
    return dict(sorted(found.items()))


def a_function() -> None:
    """Something that no verb takes."""


# Numbers, text, sequences and classes where none is meant, with what each is called in a failed assertion.
WRONG = {
    "10**400": 10**400,
    "10**5000": 10**5000,
    "nan": float("nan"),
    "inf": float("inf"),
    "-1": -1,
    "0.5": 0.5,
    "text": "no such name",
    "[]": [],
    "an array": np.array([0.1, 0.2]),
    "an array of one": np.array([0.1]),
    "an array of text": np.array(["a"]),
    "a ragged list": [1.0, [2.0]],
    "complex": 1j,
    "a NumPy complex": np.complex128(1j),
    "True": True,
    "a NumPy bool": np.True_,
    "a class": float,
    "a function": a_function,
    "a dict": {"no such name": 1.0},
    "an expression": sp.Symbol("q") + 1,
    "object": object(),
    "None": None,
}


@dataclasses.dataclass(frozen=True)
class Kind:
    """What a keyword takes: which of `WRONG` are right for it, and whether it holds such values inside."""

    right: frozenset[str]
    inside: Kind | None = None


def kind(*right: str, inside: Kind | None = None) -> Kind:
    return Kind(frozenset(right), inside)


POSITIVE = kind("0.5")
NUMBER = kind("0.5", "-1")
COUNT = kind()
# Bounded from above by nothing but memory and patience, which it does not cost to ask for more.
LIMIT = kind("10**400", "10**5000")
FLAG = kind("True", "a NumPy bool")
CALLABLE = kind("a class", "a function")
SIGN = kind("-1")
# A name is text, but this one is nobody's.
NAME = kind()
NAMES = kind()
NAMES_OR_NONE = kind("[]")
POINT = kind(inside=NUMBER)
INTERVAL = kind("an array", inside=NUMBER)
REGION = kind(inside=INTERVAL)
ORDERS = kind(inside=COUNT)
ORDERS_OR_NONE = kind("[]", inside=COUNT)
LADDER = kind("an array", "an array of one", inside=POSITIVE)
TIMES = kind("an array", "an array of one", inside=NUMBER)
EXPRESSIONS = kind(inside=kind("10**400", "10**5000", "-1", "0.5", "an expression", "an array of one"))
EVENTS = kind("[]")
NUMBERS = kind(
    "-1", "0.5", "an array", "an array of one", inside=kind("-1", "0.5", "an array", "an array of one")
)
COLUMN = kind("0.5", "an array", "an array of one", inside=POSITIVE)
FOLDER = kind("text")

# The same name means the same everywhere, but for the verbs' own below.
KEYWORDS = {
    **dict.fromkeys(
        ("epsilon", "rtol", "atol", "tolerance", "step", "max_step", "period", "max_period", "longest", "limit",
         "radius"), POSITIVE,
    ),
    **dict.fromkeys(
        ("order", "degree", "max_points", "max_intervals", "resolution", "digits", "max_pieces", "correction"), COUNT
    ),
    "max_steps": LIMIT,
    "threads": LIMIT,
    **dict.fromkeys(("dense", "backward", "symbolic", "numeric", "fast", "solve", "switch_branches", "prove"), FLAG),
    "progress": CALLABLE,
    "direction": SIGN,
    "start": POINT,
    "near": POINT,
    "region": REGION,
    "bounds": REGION,
    "span": INTERVAL,
    "parameter": NAME,
    "method": NAME,
    "orders": ORDERS,
    "epsilons": LADDER,
    "at": TIMES,
    "reconstruction": EXPRESSIONS,
    "events": EVENTS,
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Contract:
    """A right call of a verb: what it takes first, what else, and what its keywords take beyond `KEYWORDS`."""

    takes: tuple[str, ...]
    first: Callable[[], Any]
    right: Callable[[], Mapping[str, Any]]
    own: Mapping[str, Kind] = dataclasses.field(default_factory=dict)
