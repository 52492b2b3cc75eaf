"""Hopf points of the full system at a given epsilon, where families of cycles begin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import cast

import numpy as np
import sympy as sp

from gsp.critical.branch import Branch
from gsp.critical.continuation.critical_curve import uninterrupted
from gsp.critical.continuation.curve_continuation import continue_critical
from gsp.critical.loss_kind import LossKind
from gsp.errors import BranchError, DeclarationError
from gsp.lowering.compiled_flow import parameter_vector
from gsp.orbits.periodic.orbit import check_name
from gsp.results.card import Card
from gsp.systems.arguments import check_noun
from gsp.systems.declaration import exact
from gsp.systems.flow import Flow, Point, complete, in_words
from gsp.systems.region import Interval, check_interval
from gsp.systems.system import SlowFastSystem


@dataclass(frozen=True, eq=False, repr=False)
class HopfPoint(Card):
    """An equilibrium `point` of `flow` with eigenvalues +-i `omega`, at `value` of `parameter`.

    `l1` is the first Lyapunov coefficient (negative: the cycles are born stable), `crossing` the rate of the real
    part with the parameter, `vector` (n,) the eigenvector of i omega.
    """

    flow: Flow
    epsilon: float | None
    parameter: str
    value: float
    point: Mapping[str, float]
    omega: float
    l1: float
    crossing: float
    vector: np.ndarray

    def __repr__(self) -> str:
        return (
            f"HopfPoint({self.parameter} = {self.value:.12g} at {in_words(self.point, 10)}, omega = {self.omega:.6g}, "
            f"l1 = {self.l1:.6g})"
        )


def hopf_points(
    flow: Flow,
    *,
    start: Point,
    parameter: sp.Symbol | str,
    bounds: Interval,
    epsilon: float | None = None,
) -> tuple[HopfPoint, ...]:
    """The Hopf points on the curve of equilibria through `start`, with `parameter` within `bounds`.

    `start` is a guess of an equilibrium at the flow's own parameters. The curve is followed by `continue_critical`,
    through folds. Raises `DeclarationError` for a call that is not well formed and `BranchError` when there is no
    equilibrium near `start`, or when the curve ends before the bounds and no Hopf point is on it.

    >>> x, y, a, eps = sp.symbols("x y a epsilon")
    >>> system = SlowFastSystem(slow={y: a - x}, fast={x: y - x**3/3 + x}, epsilon=eps, parameters={a: 1.1})
    >>> hopf_points(system, start={"x": 1.1, "y": -0.6}, parameter="a", bounds=(0.5, 1.5), epsilon=0.01)
    (HopfPoint(a = 1 at y = -0.6666666667, x = 1, omega = 10, l1 = -4.9505),)
    """
    check_noun(flow, Flow, verb="hopf_points")
    symbol = check_name(flow, parameter)
    low, high = check_interval(bounds, what="bounds", remedy="Give (low, high) of the parameter.")
    guess = complete(start, flow.states, what="start")
    p = parameter_vector(flow, epsilon)
    own = float(p[1 + list(flow.parameters).index(symbol)])
    if not low <= own <= high:
        raise DeclarationError(
            f"{symbol} starts outside the bounds.",
            "Widen them, or give the flow another value by with_parameters.",
            got=f"{symbol} = {own:g} and ({low:g}, {high:g})",
        )
    # Equilibria are the critical manifold of the layer problem z' = F(z): the curve needs nothing else.
    taken = {s.name for s in (*flow.states, *flow.parameters)}
    small, time = (sp.Symbol(_free_name(name, taken)) for name in ("epsilon", "t"))
    known = {} if flow.epsilon is None else {flow.epsilon: exact(cast(float, epsilon))}
    frozen = SlowFastSystem(
        slow={time: sp.Integer(1)},
        fast={z: cast(sp.Expr, rate.xreplace(known)) for z, rate in zip(flow.states, flow.rates)},
        epsilon=small,
        parameters=dict(flow.parameters),
    )
    names = [z.name for z in flow.states]
    # With the parameter held: a correction that is free to move it may land on another curve, or beside a fold of it.
    beside = Branch(frozen, frozen.g, None).through({**dict(zip(names, guess)), time.name: 0.0})
    assert beside.seed is not None
    curve = uninterrupted(
        continue_critical(
            frozen,
            start={**dict(zip(names, beside.seed[1])), time.name: 0.0},
            parameter=symbol,
            bounds={symbol.name: (low, high)},
        )
    )
    found_points = curve.of_kind(LossKind.HOPF)
    if not found_points and not curve.status.ok:
        raise BranchError(
            f"no Hopf point was found, and the curve of equilibria was not followed to the bounds: {curve.message}.",
            "Start on another part of the curve, or change the bounds.",
        )
    return tuple(
        HopfPoint(
            flow=flow,
            epsilon=None if flow.epsilon is None else float(p[0]),
            parameter=symbol.name,
            value=found[symbol.name],
            point=MappingProxyType({name: found[name] for name in names}),
            omega=found.coefficients["omega"],
            l1=found.coefficients["l1"],
            crossing=found.coefficients["crossing"],
            vector=np.asarray(found.right, dtype=complex),
        )
        for found in found_points
    )


def _free_name(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "0"
    return name
