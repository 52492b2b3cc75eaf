"""The inverse of the fast Jacobian in a ring: block by block where fast variables drive one another one way."""

from __future__ import annotations

import sympy as sp

from gsp.algebra.ring import LocalisedRing, read
from gsp.slow import coordinates
from gsp.slow.coordinates import invert

x, y = sp.symbols("x y")


def test_an_inverse_by_blocks_is_the_inverse():
    ring = LocalisedRing((x, y), constants=(), functions=False, derivations=1)
    rows = [[x, 1, 0, y], [2, 1 + x**2, 0, 0], [0, 3, y, 0], [0, 0, 0, x * y]]
    matrix = [[read(sp.sympify(e), ring, {}) for e in row] for row in rows]
    inverse = sp.Matrix([[ring.horner(e) for e in row] for row in invert(matrix, ring)])
    assert (sp.Matrix(rows) * inverse).applyfunc(sp.simplify) == sp.eye(4)


def test_the_inverse_of_a_chain_takes_one_product_or_two_for_each_entry(monkeypatch):
    ring = LocalisedRing((x,), constants=(), functions=False, derivations=1)
    n = 24
    chain = [[read(1 + x**2 if i == j else x * int(i == j + 1), ring, {}) for j in range(n)] for i in range(n)]
    products = []
    times = coordinates.Element.__mul__
    monkeypatch.setattr(coordinates.Element, "__mul__", lambda a, b: products.append(1) or times(a, b))
    invert(chain, ring)
    assert len(products) < 3 * n * (n + 1) / 2
