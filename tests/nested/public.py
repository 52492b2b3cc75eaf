"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

from functools import cache

import sympy as sp

import gsp
from tests.contracts import Contract, kind
from tests.example_nouns import michaelis

epsilon, x, y, a, b = sp.symbols("epsilon x y a b")


@cache
def nesting() -> gsp.Nesting:
    rates = {x: -x, y: (x - y) / a, b: (y - b) / (a * epsilon)}
    field = gsp.VectorField(rates, epsilon=epsilon, parameters={a: 0.1})
    ones = dict.fromkeys("xyb", 1.0)
    return gsp.nest(gsp.Scene(field, {"x": (0, 1), "y": (0, 1)}, ones, (0, 1), 0.1), small=["epsilon", "a"])


VERBS = {
    "nest": Contract(("Scene",), michaelis, lambda: {"small": ["epsilon", "kappa"]}, {"small": kind()}),
}  # fmt: skip

NOUNS = {
    "Nesting": (nesting, lambda n: (n.manifold, n.reduced_field, n.series.coefficients)),
}  # fmt: skip
