"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

from functools import cache

import sympy as sp

import gsp
from tests.contracts import ORDERS, Contract, kind

u, v, epsilon = sp.symbols("u v epsilon")


@cache
def oscillator() -> gsp.Scene:
    field = gsp.VectorField(
        {u: v / epsilon, v: -u / epsilon + (1 - u**2) * v}, epsilon=epsilon, name="van_der_pol"
    )
    return gsp.Scene(
        field,
        {"u": (-3, 3)},
        {"u": 1, "v": 0},
        (0, 3),
        0.05,
        name="weak_van_der_pol",
        phase=gsp.FastPhase(pair=("u", "v")),
    )


@cache
def averaging() -> gsp.Averaging:
    return gsp.average(oscillator(), order=2)


VERBS = {
    "average": Contract(
        ("Scene", "SlowFastSystem", "VectorField"), oscillator, lambda: {"pair": ("u", "v"), "order": 1},
        {"phase": kind(), "pair": kind(), "region": kind()},
    ),
    "compare_averaged": Contract(
        ("Averaging",), averaging, lambda: {"orders": (0,)}, {"orders": ORDERS}
    ),
}  # fmt: skip

NOUNS = {
    "FastPhase": (lambda: gsp.FastPhase(pair=("u", "v")), str),
    "Averaging": (averaging, lambda n: (n.averaged_field, n.frequency, n.transformation)),
}  # fmt: skip
