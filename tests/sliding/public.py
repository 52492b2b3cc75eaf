"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

from functools import cache

import sympy as sp

import gsp
from tests.contracts import EXPRESSIONS, NUMBER, POINT, Contract, kind

epsilon, x, y = sp.symbols("epsilon x y")


@cache
def sliding() -> gsp.PiecewiseField:
    return gsp.PiecewiseField({x: 1, y: x}, {x: 1, y: 1}, y)


VERBS = {
    "switching": Contract(
        ("BasePoint",), lambda: {x: 1, y: x},
        lambda: {"minus": {x: 1, y: 1}, "surface": y, "phi": "tanh", "epsilon": epsilon},
        {"minus": EXPRESSIONS, "surface": kind(), "phi": kind(), "epsilon": kind(), "parameters": kind(inside=NUMBER),
         "name": kind("text")},
    ),
    "sharpened": Contract(
        ("VectorField",), lambda: gsp.VectorField({x: y, y: sp.tanh(y / epsilon)}, epsilon=epsilon), dict
    ),
    "run_piecewise": Contract(
        ("PiecewiseField", "CrossingField"), sliding, lambda: {"start": {"x": -1.0, "y": 0.0}, "span": (0.0, 1.0)},
        {"phi": kind()},
    ),
    "sliding_exit": Contract(
        ("PiecewiseField",), sliding, lambda: {"fold": {"x": 0.0, "y": 0.0}, "phi": "cubic"},
        {"fold": POINT, "phi": kind()},
    ),
}  # fmt: skip

NOUNS = {
    "CrossingField": (lambda: gsp.CrossingField({x: 0, y: 0}, [{x: -2}, {y: -1}], [x, y]), lambda n: n.surfaces),
    "PiecewiseField": (sliding, lambda n: n.sliding.equations),
    "PiecewiseRun": (
        lambda: gsp.run_piecewise(sliding(), start={"x": -1.0, "y": 0.0}, span=(0.0, 1.0)), lambda n: n["x"]
    ),
    "SlidingExit": (
        lambda: gsp.sliding_exit(sliding(), {"x": 0.0, "y": 0.0}, phi="cubic"), lambda n: n.exit(0.01)
    ),
}  # fmt: skip
