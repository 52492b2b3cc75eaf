"""Shared parts with names: each is written once, and the text is no deeper than it may be."""

from __future__ import annotations

import numpy as np
import sympy as sp

from gsp.algebra.sharing import DEEP, is_shared, largest, named_parts, plus, reciprocal, times
from gsp.lowering.compiled_function import compile_function

x, y = sp.symbols("x y")


def depth(expression: sp.Expr) -> int:
    return 1 + max(map(depth, expression.args), default=-1)


def test_a_part_that_is_used_twice_is_written_once_and_means_what_it_did() -> None:
    # Each doubles the one before: as a tree it has 2^60 leaves.
    doubled = plus([x, times(sp.Integer(2), y)])
    for _ in range(60):
        doubled = plus([doubled, doubled])
    named, (result,) = named_parts([doubled], iter(sp.symbols("u0:100")), {x: sp.Symbol("s")})
    assert len(named) == 60
    values = {sp.Symbol("s"): sp.Integer(1), y: sp.Integer(3)}
    for symbol, part in named:
        assert not is_shared(part)
        values[symbol] = part.xreplace(values)
    assert result.xreplace(values) == 7 * 2**60


def test_what_is_deep_has_names_on_the_way() -> None:
    deep = x
    for _ in range(5 * DEEP):
        deep = plus([y, times(y, deep)])
    named, results = named_parts([deep, x], iter(sp.symbols("u0:100")), {})
    assert max(depth(part) for part in (*(part for _, part in named), *results)) <= DEEP
    assert results[1] == x
    values = {x: sp.Integer(1), y: sp.Integer(1)}
    for symbol, part in named:
        values[symbol] = part.xreplace(values)
    assert results[0].xreplace(values) == 5 * DEEP + 1


def test_the_largest_of_what_is_shared_is_made_and_valued_without_walking_it() -> None:
    doubled = x
    for _ in range(60):
        doubled = plus([doubled, doubled])
    compiled = compile_function([largest(y, doubled)], arguments=[x, y])
    points = np.array([[1.0, 3.0], [-1.0, 3.0], [1.0, 2.0**61]])
    assert compiled(points, [np.nan])[:, 0].tolist() == [2.0**60, 3.0, 2.0**61]


def test_a_product_of_quotients_of_what_is_deep_is_compiled_without_walking_it() -> None:
    deep = x
    for _ in range(600):
        deep = plus([times(deep, y), y])
    compiled = compile_function([times(y, times(reciprocal(deep), reciprocal(deep)))], arguments=[x, y])
    # With y = 1/2 each is half of the one before and 1/2.
    assert compiled(np.array([[1.0, 0.5]]), [np.nan])[0, 0] == 0.5
