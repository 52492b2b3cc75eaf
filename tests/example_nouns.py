"""One of every noun that the tests of all public names start from; each is made once."""

from __future__ import annotations

from functools import cache
from typing import Any

import sympy as sp

import gsp
from gsp import models
from tests import example_systems as systems

epsilon, x, y, z, a = sp.symbols("epsilon x y z a")

FLOWS = ("SlowFastSystem", "VectorField", "ReducedFlow")
ENZYME = {"s": 1.0, "c": 0.0}
OSCILLATOR = {"x": 2.0, "y": 0.5}
ON_FOLD = {"x": 1.0, "y": -2 / 3}
BOX = {"s": (0.1, 1.0)}
PIECE = {"s": (0.2, 1.0)}


@cache
def van_der_pol() -> gsp.SlowFastSystem:
    return systems.van_der_pol()


@cache
def michaelis() -> gsp.Scene:
    return models.load("michaelis_menten")


@cache
def branch() -> gsp.Branch:
    return gsp.solve_critical(systems.michaelis_menten()).branches[0]


@cache
def series() -> gsp.SeriesManifold:
    return gsp.expand(branch(), order=1)


@cache
def canard_system() -> gsp.SlowFastSystem:
    return gsp.SlowFastSystem(slow={y: a - x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon, parameters={a: 1})


@cache
def node_system() -> gsp.SlowFastSystem:
    return gsp.SlowFastSystem(slow={x: z / 18 - 10 * y / 9, z: 1}, fast={y: x + y**2}, epsilon=epsilon)


@cache
def node() -> gsp.FoldedSingularity:
    return gsp.folded_singularities(node_system(), region={"y": (-1, 1)})[0]


@cache
def hopf() -> gsp.HopfPoint:
    (found,) = gsp.hopf_points(
        canard_system().with_parameters(a=1.1), start={"x": 1.1, "y": -0.6}, parameter="a",
        bounds=(0.5, 1.5), epsilon=0.01,
    )  # fmt: skip
    return found


def blank(noun: type) -> Any:
    """An instance that holds nothing: who looks further than at its type fails."""
    return object.__new__(noun)


@cache
def study() -> gsp.Study:
    found = gsp.study(michaelis())
    found.series(2)
    return found
