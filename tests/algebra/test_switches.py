"""Functions of s/epsilon: the surface that is found, and the function in v = s/epsilon."""

from __future__ import annotations

import pytest
import sympy as sp

from gsp.algebra.switches import in_fast, misplaced_pieces, surface_of

x, u, v, V, k, eps = sp.symbols("x u v V k epsilon")
w = (V - u) / eps


@pytest.mark.parametrize(
    ("piece", "surface", "in_v"),
    [
        (sp.tanh(w), V - u, sp.tanh(v)),
        (sp.tanh(sp.expand(w)), V - u, sp.tanh(v)),
        (sp.tanh(2 * k * w), V - u, sp.tanh(2 * k * v)),
        (sp.tanh(x * u / eps + x), x * u, sp.tanh(v + x)),
        (sp.Max(-1, sp.Min(1, w)), V - u, sp.Max(-1, sp.Min(1, v))),
        (sp.sqrt(1 + w**2), V - u, sp.sqrt(1 + v**2)),
        (1 / sp.sqrt(x**2 + eps**2), x, 1 / (eps * sp.sqrt(1 + v**2))),
        (1 / sp.sqrt(x**2 + 4 * eps**2), x, 1 / (eps * sp.sqrt(4 + v**2))),
        ((x**4 + eps**4) ** sp.Rational(1, 4), x, eps * (1 + v**4) ** sp.Rational(1, 4)),
        (sp.exp(-(sp.atan(x / eps) ** 2)), x, sp.exp(-(sp.atan(v) ** 2))),
    ],
)
def test_a_switch_is_a_function_of_its_surface_over_epsilon(piece: sp.Expr, surface, in_v) -> None:
    found = surface_of(piece, eps, (x, u))
    assert found is not None
    assert sp.simplify(found - surface) == 0
    new = in_fast(piece, eps, found, v)
    assert new is not None
    numbers = [sp.Rational(n) for n in ("7/3", "3/2", "2", "5/4", "1/3")]
    place = dict(zip((x, u, V, k, eps), numbers))
    there = new.xreplace({v: found / eps}).xreplace(place)
    assert abs(sp.N(there - piece.xreplace(place), 30)) < 1e-25
    assert sp.simplify(new - in_v) == 0


@pytest.mark.parametrize(
    "piece",
    [
        sp.exp(-1 / (eps * x)),
        sp.sqrt(1 + eps * x),
        sp.sin(x + eps),
        sp.tanh(x / eps + u * eps),
        sp.tanh(eps / x),
        sp.tanh(x / eps**2 + x / eps),
        sp.tanh(V / eps),
        sp.sqrt(eps),
        x**eps,
        sp.exp(x / eps + sp.exp(u / eps)),
        sp.sin(sp.tanh(x / eps) / eps),
        sp.sqrt(x**2 + eps),
    ],
)
def test_other_functions_of_epsilon_are_no_switches(piece: sp.Expr) -> None:
    assert surface_of(piece, eps, (x, u)) is None


def test_pieces_are_the_largest_functions_that_epsilon_stands_in() -> None:
    pieces = [sp.tanh(w), sp.sqrt(x**2 + eps**2)]
    whole = eps * x + (u * pieces[0] + 1 / eps) ** 2 - pieces[1] / (1 + eps)
    assert set(misplaced_pieces([whole, x], eps)) == set(pieces)
