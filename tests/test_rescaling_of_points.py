"""Verbs that are asked about one point or one region, in other units of the states: the same verdicts and places."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.sliding.piecewise_field import PiecewiseField
from gsp.sliding.sliding_exit import sliding_exit
from tests.cases import sampled
from tests.rescaling import in_units

eps, x, y, z, t = sp.symbols("epsilon x y z t")
R = sp.Rational

# A verb in units of the given powers of ten: what is said, and numbers and points, by name, that do not depend on them.
Answer = tuple[object, list[float], Mapping[str, float]]
Asked = Callable[[Mapping[str, int]], Answer]


def system(slow: Mapping, fast: Mapping, powers: Mapping[str, int]) -> gsp.SlowFastSystem:
    return gsp.SlowFastSystem(slow=in_units(slow, powers), fast=in_units(fast, powers), epsilon=eps)


def moved(point: Mapping[str, Any], powers: Mapping[str, int]) -> dict[str, Any]:
    return {name: np.multiply(value, 10.0 ** powers[name]).tolist() for name, value in point.items()}


def passage(slow: Mapping, fast: Mapping, start: Mapping, region: Mapping | None = None) -> Asked:
    def ask(powers: Mapping[str, int]) -> Answer:
        branch = gsp.solve_critical(system(slow, fast, powers)).branches[0]
        if not branch.is_explicit:
            branch = branch.through(moved(start, powers))
        given = {s.name: moved(start, powers)[s.name] for s in slow}
        box = region and moved(region, powers)
        found = gsp.entry_exit(branch, start=given, region=box)
        losses = [(loss.kind, loss.outcome, len(loss.turning_points)) for loss in found.losses]
        said = (found.kind, found.status, found.invariant, losses)
        return said, [found.t, *(loss.t for loss in found.losses)], found.point

    return ask


def sliding(plus: Mapping, minus: Mapping, surface: sp.Expr, fold: Mapping) -> Asked:
    def ask(powers: Mapping[str, int]) -> Answer:
        inner = in_units({sp.Symbol("surface"): surface}, powers)
        field = PiecewiseField(in_units(plus, powers), in_units(minus, powers), *inner.values())
        found = sliding_exit(field, moved(fold, powers), phi="cubic")
        return (found.kind, found.side), [found.time(0.01)], found.point

    return ask


def blown_up(slow: Mapping, fast: Mapping, near: Mapping) -> Asked:
    def ask(powers: Mapping[str, int]) -> Answer:
        try:
            found = gsp.blow_up(system(slow, fast, powers), near=moved(near, powers))
        except gsp.GspError as error:
            return type(error), [], {}
        return (dict(found.weights), found.degree), [], {s: float(found.point[s]) for s in near}

    return ask


def proof(slow: Mapping, fast: Mapping, region: Mapping, start: Mapping | None = None) -> Asked:
    def ask(powers: Mapping[str, int]) -> Answer:
        branch = gsp.solve_critical(system(slow, fast, powers)).branches[0]
        branch = branch if start is None else branch.through(moved(start, powers))
        found = gsp.certify(branch, region=moved(region, powers), epsilon=0.1)
        return (found.verdict, found.witness and found.witness.kind), [], {}

    return ask


FALLING = ({y: -x}, {x: y + x - x**3 / 3})
ASKED: dict[str, Asked] = {
    "a pair and its buffer point": passage(
        {t: 1}, {x: t * x - y + eps, y: x + t * y}, {"t": -2}, {"t": (-3, 3), "x": (-1, 1), "y": (-1, 1)}
    ),
    "an implicit branch": passage(
        {t: 1}, {x: t * x - y - x**2 / 3 + t**2, y: x + t * y + eps}, {"t": -1.5, "x": 0.8, "y": 0.2},
        {"t": (-3, 3), "x": (-3, 3), "y": (-3, 3)},
    ),
    "an escape": passage({y: 1}, {x: 2 * y * x + x**2 + 4 * eps}, {"y": -1}),
    "an exit by the start": passage({y: 1}, {x: y * x - x**3}, {"y": -0.7}),
    "the end of sliding": sliding({x: 1, y: x}, {x: 1, y: 1}, y, {"x": 0.01, "y": 0}),
    "the nearest end of a line of them": sliding(
        {x: 1, y: x - 1 + z**2, z: x * z}, {x: z, y: 1 + x**2, z: 1}, y - z / 8, {"x": 0.7, "y": 0.05, "z": 0.4}
    ),
    "a fold": blown_up({x: 1}, {y: x + y**2 - y**3 / 3}, {"x": -4 / 3, "y": 2}),
    "a cusp": blown_up(
        {x: 1, z: y - z}, {y: x - 1 + z * (y - R(1, 3)) + (y - R(1, 3)) ** 3}, {"x": 1, "z": 0, "y": 1 / 3}
    ),
    "a fold by Newton's method": blown_up({x: 1}, {y: sp.sin(y) - x}, {"x": 1, "y": 1.57}),
    "no fold": blown_up({x: 1}, {y: sp.sin(y) - x}, {"x": 0.9, "y": 1}),
    "a sheet": proof(*FALLING, {"y": (1, 2)}, {"y": 2 / 3, "x": 2}),
    "a sheet that is lost": proof(*FALLING, {"y": (-1, 2)}, {"y": 2 / 3, "x": 2}),
    "a branch at zero": proof({x: -x}, {y: -y * (1 + x**2) - y**3}, {"x": (-1, 1)}),
    "two fast variables": proof(
        {x: -x}, {y: x**2 - y + z / 3 + y * z / 9, z: y - 2 * z + sp.exp(-x)}, {"x": (-1, 1)}
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    "name", sampled(ASKED, always=["an exit by the start", "a fold", "no fold", "a branch at zero"])
)
def test_what_is_asked_of_a_point_or_a_region_does_not_depend_on_units(name: str) -> None:
    ask, names = ASKED[name], "txyz"
    said, numbers, point = ask(dict.fromkeys(names, 0))
    for powers in ((-6, -6, -6, -6), (6, -6, 6, -6)):
        by_name = dict(zip(names, powers))
        told, others, place = ask(by_name)
        assert told == said, powers
        assert others == pytest.approx(numbers, rel=1e-6, abs=1e-9)
        in_old = {n: value * 10.0 ** -by_name[n] for n, value in place.items()}
        assert in_old == pytest.approx(dict(point), rel=1e-6, abs=1e-9)
