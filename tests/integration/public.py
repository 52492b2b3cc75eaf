"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import numpy as np
import sympy as sp

import gsp
from tests import example_systems as systems
from tests.contracts import COLUMN, Contract, kind
from tests.example_nouns import ENZYME, FLOWS, series, study

x = sp.Symbol("x")

VERBS = {
    "restrict": Contract(("SeriesManifold",), series, dict),
    "integrate": Contract(
        (*FLOWS, "Scene"), systems.michaelis_menten,
        lambda: {"start": ENZYME, "span": (0.0, 1.0), "epsilon": 0.01},
    ),
    "integrate_many": Contract(
        FLOWS, systems.michaelis_menten,
        lambda: {"starts": {"s": 1.0, "c": 0.0}, "span": (0.0, 1.0), "epsilon": 0.01},
        {"epsilon": COLUMN, "starts": kind("an array", inside=kind("0.5", "-1", "an array", "an array of one")),
         "parameters": kind(inside=kind("0.5", "-1", "an array", "an array of one"))},
    ),
    "Event": Contract(
        (), lambda: "x", dict, {"terminal": kind("True", "a NumPy bool", "10**400", "10**5000"), "name": kind("text")}
    ),
}  # fmt: skip

NOUNS = {
    "Ensemble": (
        lambda: gsp.integrate_many(
            systems.michaelis_menten(), starts={"s": np.array([1.0, 0.5]), "c": 0.0}, span=(0.0, 1.0), epsilon=0.01
        ),
        lambda n: n["s"],
    ),
    "Event": (lambda: gsp.Event(x - 1), lambda n: n.expression),
    "ReducedFlow": (
        lambda: study().reduced(2),
        lambda n: gsp.integrate(n, start={"s": 1.0}, span=(0.0, 1.0), epsilon=0.01)["s"],
    ),
    "Trajectory": (lambda: study().full(0.01), lambda n: (n["s"], n.at(0.37))),
}  # fmt: skip
