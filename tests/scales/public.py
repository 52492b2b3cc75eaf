"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import sympy as sp

import gsp
from tests import example_systems as systems
from tests.contracts import NAMES_OR_NONE, Contract, kind
from tests.example_nouns import ENZYME, FLOWS

x, y, z, a = sp.symbols("x y z a")

VERBS = {
    "time_scales": Contract(
        (*FLOWS, "Scene"), systems.michaelis_menten,
        lambda: {"start": ENZYME, "span": (0.0, 1.0), "epsilon": 0.01},
    ),
    "small_parameters": Contract(
        ("VectorField", "SmallParameter"),
        lambda: gsp.VectorField({x: z * (y - x), y: x - 2 * y}, epsilon=None, parameters={z: 2}),
        dict, {"dimensions": kind(inside=kind()), "vanishing": NAMES_OR_NONE, "kept": NAMES_OR_NONE},
    ),
}  # fmt: skip

NOUNS = {
    "TimeScales": (
        lambda: gsp.time_scales(systems.michaelis_menten(), start={"s": 1.0, "c": 0.0}, span=(0.0, 1.0), epsilon=0.01,
                                at=[0.0, 0.5, 1.0]),
        lambda n: (n.rates, n.exhausted, n.pointers, n.participation),
    ),
    "SmallParameter": (
        lambda: next(iter(gsp.small_parameters(gsp.VectorField({x: a * (y - x), y: x - 2 * y}, epsilon=None,
                                                               parameters={a: 2})))),
        lambda n: (n.vanishing, n.attracts, dict(n.reduced)),
    ),
}  # fmt: skip
