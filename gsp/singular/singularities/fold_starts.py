"""Where Newton's method starts for canard points that algebra does not give: at the folds of M0, in any units."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.hyperbolicity.losses.roots import gauss_newton
from gsp.lowering.compiled_function import compile_function
from gsp.roots import roots
from gsp.singular.singularities.located_points import with_slopes


def fold_starts(
    g: sp.Expr, x: sp.Symbol, y: sp.Symbol, a: sp.Symbol, declared: float, beside: float | None = None
) -> Iterator[tuple[float, float, float]]:
    """(x, y, a) next to folds {g = g_y = 0} at a = `declared`, x slow and y fast: those met over many decades of y.

    And where y is `beside`, if that is given and g is affine in x.
    """
    here = g.xreplace({a: sp.Rational(declared)})
    slope = derivative(here, x)
    found = _in_plane(here, x, y) if slope.has(x) or slope == 0 else _along(here, slope, x, y, beside)
    return ((u, v, declared) for u, v in found)


def _sizes(a_decade: int, decades: int) -> np.ndarray:
    """Sizes of a state at which folds are looked for, of both signs, so many `decades` about 1 each way."""
    sizes = np.logspace(-decades, decades, 2 * decades * a_decade + 1)
    return np.concatenate([-sizes[::-1], [0.0], sizes])


def _along(
    g: sp.Expr, slope: sp.Expr, x: sp.Symbol, y: sp.Symbol, beside: float | None
) -> Iterator[tuple[float, float]]:
    """Folds of x = X(y), where g is affine in x: sign changes of g_y on it, and its point over `beside`."""
    graph = -g.xreplace({x: sp.Integer(0)}) / slope
    function = compile_function([graph, derivative(g, y).xreplace({x: graph})], arguments=[y])
    if beside is not None and np.isfinite(u := function(np.array([[beside]]), [0.0])[0, 0]):
        yield float(u), beside
    rows = _sizes(64, 12)
    values = function(rows[:, None], [0.0])[:, 1]
    changed = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0)
    found = roots(lambda v: function(v[:, None], [0.0])[:, 1], rows[changed], rows[changed + 1])
    for k, v, (u, left) in zip(changed, found, function(found[:, None], [0.0])):
        # At a pole of X the sign changes through infinity; the next places to both sides may be next to it too.
        beyond = np.abs(values[max(k - 1, 0)]), np.abs(values[min(k + 2, len(values) - 1)])
        if np.isfinite(u) and abs(left) <= min(beyond):
            yield float(u), float(v)


def _in_plane(g: sp.Expr, x: sp.Symbol, y: sp.Symbol) -> Iterator[tuple[float, float]]:
    """Folds that Newton's method reaches from sizes of x and y."""
    evaluate = with_slopes([g, derivative(g, y)], [x, y])
    known: list[np.ndarray] = []
    # In the plane, where M0 is not solved for the slow variable, one a decade.
    for start in itertools.product(_sizes(1, 4), repeat=2):
        u = gauss_newton(evaluate, np.array(start))
        if u is None or any(np.abs(u - v).max() < 1e-6 * (1.0 + np.abs(u).max()) for v in known):
            continue
        known.append(u)
        yield float(u[0]), float(u[1])
