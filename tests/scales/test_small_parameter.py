"""One small parameter: its field in epsilon, the reduction by `split`, attraction by eigenvalues at points."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import sympy as sp

from gsp.scales.special_values import small_parameters
from gsp.splitting.splitting import split
from gsp.systems.system import VectorField
from tests.scales.fields import field, michaelis_menten, mutualism, rosenzweig_macarthur, small_of

x, y, z, a, b, k = sp.symbols("x y z a b k")


@pytest.mark.parametrize("make", [michaelis_menten, rosenzweig_macarthur])
def test_at_epsilon_one_the_field_is_the_original(make) -> None:
    for each in small_of(make):
        assert all(
            sp.expand(rate.subs(each.epsilon, 1) - own) == 0
            for rate, own in zip(each.field.rates, each.original.rates)
        )


@pytest.mark.exhaustive
@pytest.mark.parametrize(("make", "dimension"), [(rosenzweig_macarthur, 2), (michaelis_menten, 1)])
def test_the_reduction_is_that_of_split(make, dimension: int) -> None:
    """Pi G of the splitting, whatever its route, on the manifold."""
    for each in small_parameters(make(), dimensions=[dimension]):
        reduced = dict(zip(each.original.states, split(each.field).reduced_field))
        assert each.graph is not None
        for state, rate in each.reduced.items():
            assert sp.cancel(reduced[state].xreplace(dict(each.graph)) - rate) == 0


@pytest.mark.exhaustive
@pytest.mark.parametrize("make", [michaelis_menten, rosenzweig_macarthur])
def test_what_is_said_of_attraction_holds_at_points(make) -> None:
    random = np.random.default_rng(3)
    decided = 0
    for each in small_of(make):
        layer = sp.Matrix([sp.limit(rate * each.epsilon, each.epsilon, 0) for rate in each.field.rates])
        linear = layer.jacobian(each.original.states)
        assert each.graph is not None
        free = [s for s in (*each.original.states, *each.original.parameters) if s not in each.graph]
        on_manifold = [s.subs(each.graph) for s in each.original.states]
        at = sp.lambdify([free], [on_manifold, linear.subs(each.graph)])
        signs = set()
        for _ in range(40):
            point, matrix = at(random.integers(1, 300, len(free)) / 100)
            if min(point) < 0:
                continue
            values = np.linalg.eigvals(np.array(matrix, dtype=float))
            fast = values[np.argsort(-np.abs(values))][: len(each.graph)]
            signs.add(bool(fast.real.max() < 0))
        if each.is_positive is False:
            assert signs == set()
        elif each.attracts is not None and signs:
            assert signs == {each.attracts}
            decided += 1
    assert decided > 5


@pytest.mark.parametrize(
    ("gate", "attracts"),
    [
        (sp.sin(x), None),
        (sp.log(x), None),
        (sp.tanh(x - 1), None),
        (sp.tanh(x), True),
        (sp.exp(-1 / x), True),
        (sp.log(1 + x), True),
        # Below exp(-1) the eigenvalue -1 - log x is positive.
        (1 + sp.log(x), None),
        (-sp.exp(-x), False),
        (sp.exp(a * x), True),
    ],
)
def test_a_function_of_positive_states_attracts_where_its_sign_is_known(
    gate: sp.Expr, attracts: bool | None
) -> None:
    slow, fast = k * (1 - x), -gate * (y - x)
    gated = VectorField({x: slow, y: fast}, parameters={k: 0.01, a: -2})
    found = small_parameters(gated, vanishing=("k",))
    assert [each.attracts for each in found] == [attracts]


def test_a_logarithm_may_be_of_either_sign() -> None:
    """y = k log x is positive for x > 1 alone, and has points with positive states."""
    field = VectorField({x: a * (2 - x), y: k * sp.log(x) - y}, parameters={a: 0.01, k: 1})
    (found,) = small_parameters(field, vanishing=("a",), kept=("k",))
    assert (found.attracts, found.is_positive) == (True, None)


def test_negative_parameters_are_taken_as_they_are() -> None:
    equations = {x: b * (y - x), y: -k * y}
    (stable,) = [e for e in small_parameters(field(equations, (b, k), b=2)) if e.vanishing == ("k",)]
    (unstable,) = [e for e in small_parameters(field(equations, (b, k), b=-2)) if e.vanishing == ("k",)]
    assert (stable.attracts, unstable.attracts) == (True, False)


def test_of_three_fast_directions_hurwitz_decides() -> None:
    """A fast chain with feedback: lambda^3 + ... with a1 a2 > a3 for every positive rate, and not without friction."""
    u, v, w = sp.symbols("u v w")
    chain = {u: -a * u + x - b * w, v: a * (u - v), w: a * (v - w), x: -k * x}
    found = [e for e in small_parameters(field(chain, (a, b, k)), dimensions=[1]) if e.vanishing == ("k",)]
    assert [e.attracts for e in found] == [None]
    plain = {u: -a * u + x, v: a * (u - v), w: b * (v - w), x: -k * x}
    found = [e for e in small_parameters(field(plain, (a, b, k)), dimensions=[1]) if e.vanishing == ("k",)]
    assert [e.attracts for e in found] == [True]


def test_texts_and_what_is_left() -> None:
    found = small_of(michaelis_menten)
    standard = next(each for each in found if each.vanishing == ("e0",))
    assert str(standard) == "e0 -> 0: C = 0, attracts"
    assert standard.kept == ("k1", "km1", "k2")
    assert standard.error is None
    assert "12 special values" in repr(found)
    negative = next(each for each in found if each.is_positive is False)
    assert "no points with positive states" in str(negative)
    assert negative.attracts is False
    still = next(each for each in found if each.vanishing == ("e0", "k1"))
    assert still.is_trivial
    assert not standard.is_trivial


def test_names_in_use_do_not_become_epsilon() -> None:
    taken = sp.Symbol("epsilon")
    found = small_parameters(field({x: a * (y - x), y: -taken * y}, (a, taken)))
    assert {str(each.epsilon) for each in found} == {"epsilon_"}


@pytest.mark.exhaustive
def test_every_manifold_of_the_mutualism_is_one_of_equilibria() -> None:
    """Independently: the fast part vanishes on the graph, and its linear part has rank one there."""
    for each in itertools.islice(
        small_parameters(mutualism(), dimensions=[2], kept=["k1", "k2", "k3"]), 0, None, 4
    ):
        slow = dict.fromkeys((p for p in each.original.parameters if p.name in each.vanishing), 0)
        layer = sp.Matrix([rate.subs(slow) for rate in each.original.rates])
        assert each.graph is not None
        assert layer.subs(dict(each.graph)).applyfunc(sp.cancel) == sp.zeros(3, 1)
        linear = layer.jacobian(each.original.states).subs(dict(each.graph)).applyfunc(sp.cancel)
        assert linear.rank() == 1
        assert sp.cancel(linear.trace()) != 0
