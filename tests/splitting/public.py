"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import sympy as sp

import gsp
from gsp import models
from tests.contracts import NAME, Contract
from tests.example_nouns import van_der_pol

epsilon, x, y = sp.symbols("epsilon x y")


def scalable() -> gsp.VectorField:
    return gsp.VectorField({x: y, y: -(x + y) / epsilon**2}, epsilon=epsilon)


VERBS = {
    "split": Contract(("VectorField", "SlowFastSystem"), van_der_pol, dict, {"second": NAME}),
    "scalings": Contract(
        ("VectorField",), lambda: gsp.VectorField({x: y, y: -(x + y) / epsilon**2}, epsilon=epsilon), dict
    ),
}  # fmt: skip

NOUNS = {
    "Scaling": (lambda: gsp.scalings(scalable())[0], lambda n: (n.states, n.inverse, n.field.equations)),
    "Splitting": (
        lambda: gsp.split(models.load("chaplygin_sleigh").system), lambda n: (n.system, n.projection, n.explain())
    ),
    "Switch": (
        lambda: gsp.split(gsp.VectorField({x: y, y: -x - sp.tanh(y / epsilon)}, epsilon=epsilon)).switches[0], str
    ),
}  # fmt: skip
