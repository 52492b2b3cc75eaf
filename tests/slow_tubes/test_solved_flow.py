"""The flow about a solved manifold: every ball holds the exact value, from the definition by SymPy, and is thin."""

import math
from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp
from flint import arb
from sympy import Rational as R

from gsp.algebra.precision import precision
from gsp.proofs import balls
from gsp.slow.chebyshev import ChebyshevSurface
from gsp.slow.sampled_manifold import SampledManifold
from gsp.slow_tubes.solved_flow import ORDER, SolvedFlow, _spread
from gsp.systems.system import SlowFastSystem

x, u, v, epsilon, z0, z1 = sp.symbols("x u v epsilon z0 z1")
F = sp.cos(x) + v / 2 - epsilon * u + u * v / 4
G = (-2 * u + v + x**2 + epsilon * u**3 / 8 + epsilon * x * v, -3 * v + sp.sin(x) + u / 2)
COEFFICIENTS = np.array([[0.5, 0.25], [-0.375, 0.5], [0.125, -0.25], [0.0625, 0.03125], [-0.015625, 0.0]])
BASIS = sp.Matrix([[1, R(1, 4)], [R(-1, 2), 2]])
PLACES = [
    {x: R(-1, 2), z0: 0, z1: 0, epsilon: R(1, 16)},
    {x: R(3, 8), z0: R(1, 32), z1: R(-1, 64), epsilon: R(1, 16)},
    {x: R(7, 8), z0: R(-1, 16), z1: R(1, 8), epsilon: R(1, 8)},
]


def about(fast: dict[sp.Symbol, sp.Expr], surface: ChebyshevSurface) -> SampledManifold:
    """What a flow asks of a manifold, with a surface that solves nothing."""
    system = SlowFastSystem(slow={x: F if v in fast else sp.Integer(1)}, fast=fast, epsilon=epsilon)
    return SimpleNamespace(branch=SimpleNamespace(system=system), surface=surface)  # pyright: ignore


@cache
def flow() -> tuple[SolvedFlow, dict[str, list[sp.Expr]]]:
    """The flow, and what its methods return as expressions in x, z0, z1 and epsilon."""
    surface = ChebyshevSurface(np.array([[-0.75, 1.0]]), COEFFICIENTS)
    low, high = (sp.Rational(float(end)) for end in surface.box[0])
    at = (2 * x - low - high) / (high - low)
    p = [
        sp.expand(sum(sp.Rational(float(c)) * sp.chebyshevt(j, at) for j, c in enumerate(column)))
        for column in surface.coefficients.T
    ]
    graph = dict(zip((u, v), sp.Matrix(p) + BASIS * sp.Matrix([z0, z1])))
    f = F.xreplace(graph)
    defects = sp.Matrix([g.xreplace(graph) - epsilon * sp.diff(q, x) * f for g, q in zip(G, p)])
    gamma = list(BASIS.inv() * defects)
    on = {z0: 0, z1: 0}
    by_z = [sp.diff(e, z) for e in gamma for z in (z0, z1)]
    exact = {
        "residual": [e.xreplace(on) for e in gamma],
        "residual_slopes": [sp.diff(e.xreplace(on), s) for e in gamma for s in (x, epsilon)],
        "normal": by_z,
        "rates": [f],
        "linearisation": [
            *(sp.diff(f, s) for s in (x, z0, z1)), *by_z, *(sp.diff(e, x) for e in gamma), *[sp.Integer(0)] * 4
        ],
        "turning": list(BASIS),
    }  # fmt: skip
    return SolvedFlow(about(dict(zip((u, v), G)), surface), BASIS), exact


def flat(found: object) -> list[arb]:
    return [entry for row in found for entry in row] if isinstance(found, tuple) else list(found)  # pyright: ignore


def arguments(name: str) -> tuple[sp.Symbol, ...]:
    return (x, epsilon) if name.startswith("residual") or name == "turning" else (x, z0, z1, epsilon)


METHODS = ("residual", "residual_slopes", "normal", "rates", "linearisation", "turning")


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", METHODS)
def test_at_a_point_the_value_is_that_of_the_definition(name: str) -> None:
    solved, exact = flow()
    method: Callable = getattr(solved, name)
    with precision(balls.PRECISION):
        for place in PLACES:
            found = flat(method([balls.exact(float(place[s])) for s in arguments(name)]))
            assert len(found) == len(exact[name])
            for ball, expression in zip(found, exact[name]):
                value = arb(str(expression.xreplace(place).evalf(40)))
                assert ball.overlaps(value + arb(0, 1e-25))
                assert float(ball.rad()) <= 1e-12


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", METHODS)
def test_over_a_box_every_value_in_it_is_held(name: str) -> None:
    solved, exact = flow()
    method: Callable = getattr(solved, name)
    width = R(1, 32)
    with precision(balls.PRECISION):
        for place in PLACES:
            box = [balls.hull(float(place[s] - width), float(place[s] + width)) for s in arguments(name)]
            found = flat(method(box))
            for signs in ((1, 1, 1, 1), (-1, 1, -1, 1), (1, -1, -1, -1), (-1, -1, 1, -1), (1, 1, -1, -1)):
                corner = {s: place[s] + k * width for s, k in zip((x, z0, z1, epsilon), signs)}
                for ball, expression in zip(found, exact[name]):
                    assert ball.overlaps(arb(str(expression.xreplace(corner).evalf(40))) + arb(0, 1e-25))
                    # It says something: all derivatives are of order 1.
                    assert float(ball.rad()) <= 1.0


def test_what_taylor_leaves_off_is_in_the_residual() -> None:
    # p = 0 and g = x^16 - u: all coefficients at 0 but the one for the rest are 0.
    surface = ChebyshevSurface(np.array([[-1.0, 1.0]]), np.zeros((1, 1)))
    solved = SolvedFlow(about({u: x**ORDER - u}, surface), sp.eye(1))
    with precision(balls.PRECISION):
        (found,) = solved.residual([balls.hull(-1.0, 1.0), arb(0)])
        assert found.contains(1)
        assert found.contains(0)
        assert float(found.rad()) < 1.1


@pytest.mark.parametrize("h", [0.0, 0.25, 2.0])
def test_coefficients_about_all_points_of_an_interval_are_held(h: float) -> None:
    q = [R(3), R(-1), R(1, 2), R(0), R(5, 4)]
    with precision(balls.PRECISION):
        found = _spread([arb(float(c)) for c in q] + [arb(0)] * ORDER, h)
        assert len(found) == ORDER + 2
        for t in (-h, -h / 2, 0.0, h):
            for k, ball in enumerate(found):
                exact = sum(math.comb(j, k) * float(q[j]) * t ** (j - k) for j in range(k, len(q)))
                assert ball.overlaps(arb(exact, 1e-12))
        sizes = [
            sum(math.comb(j, k) * abs(float(q[j])) * h ** (j - k) for j in range(k + 1, 5)) for k in range(5)
        ]
        assert [float(ball.rad()) for ball in found[:5]] == pytest.approx(sizes, rel=1e-6)
