"""The inverse of the fast Jacobian in a ring: block by block where fast variables drive one another one way."""

from __future__ import annotations

import itertools

import pytest
import sympy as sp

import gsp
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
    times = coordinates.RingElement.__mul__
    monkeypatch.setattr(coordinates.RingElement, "__mul__", lambda a, b: products.append(1) or times(a, b))
    invert(chain, ring)
    assert len(products) < 3 * n * (n + 1) / 2


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["van_der_pol", "koper", "fitzhugh_nagumo"])
def test_the_coordinates_of_an_implicit_branch_move_as_its_slow_variables_do(name):
    # d/dt of what a slow variable is on M0, along the coordinates' rates, is its own rate: order by order.
    series = gsp.study(gsp.models.load(name)).series(2)
    (given,) = (s for s in series.branch.system.x if s not in series.coordinates)
    graph = series.chart.ring.to_sympy(series.chart.elements[given])
    for f, rates in zip(series.reduced_field, series.coordinate_field):
        along = sum(sp.diff(graph, s) * rates[s] for s in series.coordinates)
        assert sp.cancel(along - f[given]) == 0
        assert all(rates[s] == f[s] for s in series.coordinates if s in series.branch.system.x)


def test_a_fast_coordinate_beside_the_slow_ones_stays_on_the_branch():
    s, u, epsilon = sp.symbols("s u epsilon")
    g = s * (1 + u**2) - u - sp.exp(u - 1)
    branch = gsp.solve_critical(gsp.SlowFastSystem(slow={s: -u}, fast={u: g}, epsilon=epsilon)).branches[0]
    series = gsp.expand(branch, order=2)
    assert series.coordinates == (s, u)
    for f, rates in zip(series.reduced_field, series.coordinate_field):
        assert rates[s] == f[s]
        assert sp.simplify(sp.diff(g, s) * rates[s] + sp.diff(g, u) * rates[u]) == 0


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_a_variable_is_eliminated_where_the_others_tell_it_whatever_the_order(order):
    """v = p follows from two equations of which one loses six digits, and p from one of them only so."""
    p, q, v, a, b, epsilon = sp.symbols("p q v a b epsilon")
    fast = [
        (v, p - v),
        (a, -(10**6) * (a - b) - v - sp.sin(a + b)),
        (b, 10**6 * (q - a - b + sp.sin(a - b)) - v),
    ]
    system = gsp.SlowFastSystem(slow={p: -p, q: -q}, fast=dict(fast[k] for k in order), epsilon=epsilon)
    branch = gsp.solve_critical(system).branches[0].through({"p": 1, "q": 1, "v": 1, "a": 0.5, "b": 0.5})
    made = coordinates.chart(branch)
    assert set(made.coordinates) == {p, a, b}
    assert (made.elements[v] - made.elements[p]).is_zero
