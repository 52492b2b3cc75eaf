"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import sympy as sp

import gsp
from gsp import models
from tests.contracts import NUMBERS, Contract, kind
from tests.example_nouns import BOX, PIECE, branch, series

epsilon, x, y = sp.symbols("epsilon x y")


def roots_of_a_polynomial() -> gsp.SeriesManifold:
    """A series whose ring holds functions, roots, relations and denominators."""
    system = gsp.SlowFastSystem(
        slow={x: sp.sin(x) - y * sp.sqrt(2 + x)}, fast={y: sp.cos(x) * sp.exp(x) - y * sp.sqrt(2 + x)}, epsilon=epsilon
    )  # fmt: skip
    return gsp.expand(gsp.solve_critical(system).branches[0], order=2)


VERBS = {
    "zero_derivative": Contract(
        ("Branch",), branch, lambda: {"x": {"s": 0.5}, "epsilon": 0.01},
        {"x": NUMBERS, "near": kind("-1", "0.5", "an array", "an array of one")},
    ),
    "solve_manifold": Contract(("Branch",), branch, lambda: {"region": BOX, "epsilon": 0.01}),
    "expand": Contract(("Branch",), branch, dict),
    "carry_back": Contract(
        ("SeriesManifold",), series, lambda: {"splitting": gsp.split(models.load("michaelis_menten").system)},
        {"splitting": kind()},
    ),
}  # fmt: skip

NOUNS = {
    "SampledManifold": (
        lambda: gsp.solve_manifold(branch(), region=PIECE, epsilon=0.01), lambda n: n.evaluate({"s": 0.5})
    ),
    "SeriesManifold": (roots_of_a_polynomial, lambda n: (n.coefficients, n.evaluate({"x": 0.3}, 0.01))),
    "SlowPoints": (lambda: gsp.zero_derivative(branch(), x={"s": 0.5}, epsilon=0.01), lambda n: n.y),
}  # fmt: skip
