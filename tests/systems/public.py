"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import sympy as sp

from gsp import models
from tests.contracts import EXPRESSIONS, Contract, kind
from tests.example_nouns import van_der_pol

epsilon, x, y = sp.symbols("epsilon x y")

VERBS = {
    "SlowFastSystem": Contract(
        ("BasePoint",), lambda: {y: -y}, lambda: {"fast": {x: y - x}, "epsilon": epsilon},
        {"fast": EXPRESSIONS, "epsilon": kind(), "parameters": EXPRESSIONS, "name": kind("text"),
         "observables": EXPRESSIONS},
    ),
    "VectorField": Contract(
        ("BasePoint",), lambda: {x: -x}, lambda: {"epsilon": None},
        {"epsilon": kind("None"), "parameters": EXPRESSIONS, "name": kind("text"), "observables": EXPRESSIONS},
    ),
}  # fmt: skip

NOUNS = {
    "SlowFastSystem": (van_der_pol, lambda n: hash(n) and n.with_parameters().rates),
    "VectorField": (lambda: models.load("chaplygin_sleigh").system, lambda n: n.equations),
}  # fmt: skip
