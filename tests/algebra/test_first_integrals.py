"""First integrals: whatever is returned is constant along the layer flow, and known ones are found."""

from __future__ import annotations

import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from sympy.integrals import manualintegrate
from sympy.polys.matrices import DomainMatrix

from gsp.algebra import first_integrals as integrals
from gsp.algebra.first_integrals import common_factor, first_integrals

x, y, z, u, a, b = sp.symbols("x y z u a b")


def rate(phi: sp.Expr, layer: list[sp.Expr], states) -> sp.Expr:
    return sp.simplify(sum(sp.diff(phi, s) * component for s, component in zip(states, layer)))


FOUND = {
    "linear": ([a * (x - y), b * (y - x), sp.Integer(0)], 2),
    "linear over a nonlinear flow": ([x * y - z, z - x * y, 2 * (z - x * y)], 2),
    "quadratic": ([-2 * y * (x - 1), x - 1, sp.Integer(0)], 2),
    "cubic": ([3 * y**2 * (z - y), z - y, sp.Integer(0)], 2),
    "rotation": ([-y * (x + z), x * (x + z), sp.Integer(0)], 2),
    "exponential": ([x * (z - y), z - y, sp.Integer(0)], 2),
    "exponential with a parameter": ([a * x * (z - y), z - y, sp.Integer(0)], 2),
    "linear equation": ([(x + y) * (z - y), z - y, sp.Integer(0)], 2),
    "logarithm": ([1 / y * (z - y), (z - y) * x**2 * y, sp.Integer(0)], 2),
    "sine": ([sp.cos(y) * (z - y), z - y, sp.Integer(0)], 2),
    "two nonlinear": ([2 * y * (z - y), z - y, 3 * y**2 * (z - y)], 2),
    "transcendental layer": ([sp.tanh(x + z), sp.Integer(0), -y * sp.tanh(x + z)], 2),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", FOUND)
def test_known_integrals_are_found_and_are_constant_along_the_flow(case: str) -> None:
    layer, count = FOUND[case]
    found = first_integrals(layer, (x, y, z), count=count)
    assert len(found) == count
    assert all(rate(phi, layer, (x, y, z)) == 0 for phi in found)
    assert sp.Matrix(found).jacobian([x, y, z]).rank() == count


def test_states_that_stand_still_come_first_and_keep_their_names() -> None:
    assert first_integrals([x - y, sp.Integer(0), y - x], (x, y, z), count=2) == [x + z, y]
    assert first_integrals([sp.Integer(0), sp.Integer(0), y - z], (x, y, z), count=2) == [x, y]


def test_amounts_are_summed_where_a_basis_of_sums_exists() -> None:
    bound = x * y - z
    assert set(first_integrals([-bound, -bound, bound], (x, y, z), count=2)) == {x + z, y + z}
    # Two molecules of x in one of y, of which a third x makes z: amounts of x, and of what binds it.
    first, second = x * u - y, x * y - z
    layer = [-first - second, first - second, second, -first]
    assert set(first_integrals(layer, (x, y, z, u), count=2)) == {x + y + 2 * z, u + y + z}
    # An exchange in opposite directions conserves a difference and no sum; coefficients that are parameters stay.
    assert first_integrals([x - y, x - y], (x, y), count=1) == [x - y]
    (p,) = first_integrals([a * (x - y), b * (y - x)], (x, y), count=1)
    assert sp.expand(p - (b * x + a * y)) == 0


def test_coefficients_are_primitive_and_free_of_denominators() -> None:
    (p,) = first_integrals([a * x / b, -x * (1 + a**2) / (a * b)], (x, y), count=1)
    assert sp.expand(p - ((1 + a**2) * x + a**2 * y)) == 0


def test_an_integral_without_a_logarithm_is_preferred() -> None:
    (p,) = first_integrals([x * (1 - y), 1 - y], (x, y), count=1)
    assert p == x * sp.exp(-y)


def test_no_integral_is_invented() -> None:
    layer = [(1 + x * y) * (x - y), (y**2 - x - 2) * (x - y)]
    assert first_integrals(layer, (x, y), count=1) == []


def test_a_hard_quadrature_is_given_up_in_good_time() -> None:
    layer = [x * sp.sqrt(y + 1) + sp.exp(y), y**3 + a * y + 2]
    assert first_integrals(layer, (x, y), count=1) == []


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("above", "below"),
    [
        (y + 2, (y - 1) * (y + 1) * (y - 5)),
        (y**2 + 1, (y - 1) * (y + a) * (3 - y)),
        (y, (y - 3) * (y**2 + y + 1)),
    ],
    ids=["three poles", "a pole with a parameter", "a pair"],
)
def test_a_rational_quadrature_is_taken_apart_first(above: sp.Expr, below: sp.Expr, monkeypatch) -> None:
    # The rules look through every way to write a quotient: 23 s of a processor for three poles.
    asked = []
    rules = manualintegrate.integral_steps
    monkeypatch.setattr(
        manualintegrate, "integral_steps", lambda *given: asked.append(given[0]) or rules(*given)
    )
    layer = [below * x, -above * x]
    (phi,) = first_integrals(layer, (y, x), count=1)
    assert rate(phi, layer, (y, x)) == 0
    assert len(asked) < 40


def test_the_common_factor_is_what_all_components_share() -> None:
    assert sp.expand(common_factor([2 * a * x * (x - y), (x - y) * y / b], (x, y)) - (x - y)) in (
        0,
        2 * (y - x),
    )
    assert common_factor([x, y], (x, y)) == 1


small = st.integers(-2, 2)


@pytest.mark.exhaustive
@given(st.lists(small, min_size=4, max_size=4), st.lists(small, min_size=4, max_size=4))
@settings(max_examples=25)
def test_a_layer_with_a_planted_quadratic_integral_gives_it_back(linear: list[int], square: list[int]) -> None:
    planted = (
        sum(c * s for c, s in zip(linear, (x, y))) + square[0] * x**2 + square[1] * x * y + square[2] * y**2
    )
    gradient = [sp.diff(planted, s) for s in (x, y)]
    assume(any(g != 0 for g in gradient))
    factor = 1 + x - 3 * y
    layer = [factor * gradient[1], -factor * gradient[0]]
    (found,) = first_integrals(layer, (x, y), count=1)
    assert sp.expand(sp.diff(found, x) * gradient[1] - sp.diff(found, y) * gradient[0]) == 0
    assert found.has(x) or found.has(y)


@pytest.mark.exhaustive
@given(st.permutations([0, 1, 2]))
@settings(max_examples=6)
def test_permuted_states_permute_the_integrals(order: list[int]) -> None:
    states = (x, y, z)
    layer = [2 * y * (x - z), x - z, (x - z) * a]
    direct = first_integrals(layer, states, count=2)
    permuted = first_integrals([layer[i] for i in order], [states[i] for i in order], count=2)
    for phi in permuted:
        both = sp.Matrix([*direct, phi]).jacobian(list(states))
        assert both.rank() == 2


def test_rational_quotients_without_useful_antiderivative_are_not_tried() -> None:
    layer = [(a * y**3 + b * y + 1) * x**3 * (x**3 + b), (y**2 + u * y + 2) * (x**2 + a)]
    assert first_integrals(layer, (x, y), count=1) == []


def test_an_integrand_is_tried_once_whatever_stands_before_it() -> None:
    x, y, a = sp.symbols("x y a")
    # The exponential integral, which is not elementary.
    integrand = sp.exp(a * y) / y
    integrals._by_rules.cache_clear()
    assert integrals._antiderivative(integrand, y) is None
    assert integrals._antiderivative(integrand / (10 * x), y) is None
    assert integrals._by_rules.cache_info().misses == 1
    assert integrals._antiderivative(3 * a * sp.cos(a * y), y) == 3 * sp.sin(a * y)


@pytest.mark.parametrize(
    ("combination", "shown"),
    [
        ((1, 1), (1, 1)),
        ((2, 3), (2, 3)),
        ((sp.Rational(1, 2), 1), (1, 2)),
        ((1, sp.Rational(473, 954), sp.Rational(500, 999)), (1, sp.Rational(473, 954), sp.Rational(500, 999))),
    ],
)
def test_a_linear_integral_is_written_in_the_fewest_digits(combination: tuple, shown: tuple) -> None:
    states = sp.symbols(f"z0:{len(combination)}")
    # The layer moves along what the combination does not see.
    last, rate = combination[-1], 1 + states[0] ** 2
    layer = [rate * last] + [rate * (k + 2) * last for k in range(1, len(states) - 1)]
    layer.append(-sum((c * part for c, part in zip(combination, layer)), sp.S.Zero) / last)
    found = first_integrals([sp.expand(e) for e in layer], states, count=len(states) - 1)
    wanted = sum(c * z for c, z in zip(shown, states))
    if len(states) == 2:
        assert found == [wanted]
    total = max(found, key=lambda e: len(e.free_symbols))
    assert sum(len(str(sp.sympify(c))) for c in sp.Poly(total, *states).coeffs()) <= 8 * len(states)
    assert all(sp.expand(sum(sp.diff(e, z) * g for z, g in zip(states, layer))) == 0 for e in found)


def test_relations_of_parts_that_share_nothing_are_sought_in_each(monkeypatch) -> None:
    """Of 300 pairs the relations took 13 s: each step of one elimination multiplied every row."""
    sizes = []
    null = DomainMatrix.nullspace
    monkeypatch.setattr(DomainMatrix, "nullspace", lambda self: sizes.append(self.shape) or null(self))
    states = sp.symbols("s:12")
    fluxes = [a * states[k] ** 2 - b * states[k + 6] for k in range(6)]
    layer = [*fluxes, *(-flux for flux in fluxes)]
    expected = [states[k] + states[k + 6] for k in range(6)]
    assert first_integrals(layer, states, count=6) == expected
    assert set(sizes) == {(2, 2)}
    # Without a rate a state is one by itself, and relations come in the order of the last state in them.
    assert integrals.linear_relations([*fluxes[:1], sp.S.Zero, -2 * fluxes[0]], states) == [
        [0, 1, 0],
        [2, 0, 1],
    ]
