"""The fast part of a field: its pole and its rest, matrices inverted exactly, ranks, and the search for equilibria."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import sympy as sp

from gsp.errors import SplittingError
from gsp.lowering.compiled_function import compile_function
from gsp.splitting.fast_part import (
    RANK_TOLERANCE,
    TIDY_LIMIT,
    _by_elimination,
    _by_rows,
    _equilibrium,
    _matrices_in_units,
    _numerical_rank,
    _ranks,
    factorised,
    inverse,
    jacobian,
    layer_rank,
    principal_part,
    reduced,
    tidy,
)
from gsp.splitting.splitting import split
from gsp.systems.system import VectorField
from tests.cases import thinned
from tests.rescaling import rescaled, scene

x, y, z, a, eps = sp.symbols("x y z a epsilon")


def field(*rates: sp.Expr, parameters=None) -> VectorField:
    return VectorField(dict(zip((x, y, z), rates)), epsilon=eps, parameters=parameters or {})


@pytest.mark.exhaustive
def test_elimination_passes_by_pivots_that_vanish_for_all_values() -> None:
    # The first step leaves 0 in another place for each order of the rows, which the numbers beside it have to follow.
    p, q, r, s = sp.symbols("p q r s")
    rows = [[p, q, 1, r], [p, q, 2, s], [1, r, s, p], [2 * p, 2 * q, p, 1]]
    for order in itertools.islice(itertools.permutations(range(4)), 0, 24, 5):
        matrix = sp.Matrix([rows[k] for k in order])
        at = dict(zip((p, q, r, s), (sp.Rational(3), sp.Rational(5), sp.Rational(-2), sp.Rational(1, 7))))
        product = matrix.xreplace(at) * _by_elimination(matrix).xreplace(at)
        assert np.allclose(np.array(product.evalf(20), dtype=float), np.eye(4), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_a_matrix_times_its_inverse_is_the_identity(n: int) -> None:
    entries = np.random.default_rng(n).integers(-5, 6, (n, n)).tolist()
    matrix = sp.Matrix(entries) + 20 * sp.eye(n)
    assert matrix * inverse(matrix) == sp.eye(n)
    if n > 4:
        return
    symbolic = sp.Matrix(n, n, lambda i, j: a if i == j else entries[i][j])
    assert (symbolic * inverse(symbolic)).subs(a, 17) == sp.eye(n)


@pytest.mark.parametrize(
    ("rate", "pole", "rest"),
    [
        (x / eps + y, x, y),
        (y, 0, y),
        ((x + eps * y) / eps, x, y),
        ((x + eps) * (y - eps) / eps, x * y, y - x - eps),
        (x / (eps * (1 + eps)), x, -x / (1 + eps)),
        (x / eps - x / eps + y, 0, y),
        (eps * x - 3, 0, eps * x - 3),
    ],
)
def test_a_rate_is_its_pole_and_its_rest(rate: sp.Expr, pole: sp.Expr, rest: sp.Expr) -> None:
    (layer, *_), (drift, *_) = principal_part(VectorField({x: rate, y: 1 / eps}, epsilon=eps))
    assert sp.simplify(layer - pole) == 0
    assert sp.simplify(drift - rest) == 0


def test_exponentials_stay_exponentials() -> None:
    # A power exp(x)**(1/5) overflows where exp(x/5) does not, and has a base at which powers are not smooth.
    rate = (sp.exp(-x / 5) * (y + 1) - y) / eps + sp.exp(x / 7)
    layer, drift = principal_part(VectorField({x: rate, y: -y}, epsilon=eps))
    assert {p for e in (*layer, *drift) for p in e.atoms(sp.Pow) if isinstance(p.base, sp.exp)} == set()
    assert sp.expand(layer[0] / eps + drift[0] - rate) == 0


@pytest.mark.parametrize(
    ("layer", "rank"),
    [
        ([y - x, x - y, 0], 1),
        ([y - x, z - y, 0], 2),
        ([y - x, z - y, y - z], 2),
        ([x * (y - 1), y - 1, 0], 1),
        ([1 - x**2, -y, -z], 3),
        ([10**6 * (y - x), 0, 0], 1),
    ],
)
def test_the_rank_is_the_number_of_fast_directions(layer: list, rank: int) -> None:
    layer = [sp.sympify(e) for e in layer]
    own = field(*(e / eps for e in layer))
    assert layer_rank(layer, own) == rank
    if rank < 3:
        N, f = factorised(layer, own, rank)
        assert (N.shape, f.shape) == ((3, rank), (rank, 1))
        on = {y: x, z: x} if [y - x] == layer[:1] else {y: 1}
        difference = (N * jacobian(f, (x, y, z)) - jacobian(layer, (x, y, z))).subs(on)
        assert difference.applyfunc(sp.simplify) == sp.zeros(3, 3)


@pytest.mark.parametrize(
    ("layer", "words"),
    [
        ([0, 0, 0], "no rate has a pole"),
        ([3, y, 0], "which has no equilibrium"),
        ([1 + x**2, 0, 0], "no real equilibrium"),
        ([x**2, 0, 0], "vanishes to second order"),
        ([y, 0, 0], "tangent to its own zeros"),
    ],
)
def test_fast_parts_without_a_critical_manifold_are_refused(layer: list, words: str) -> None:
    layer = [sp.sympify(e) for e in layer]
    with pytest.raises(SplittingError, match=words):
        layer_rank(layer, field(x / eps, y, z))


def test_ranks_are_numerical_and_rows_are_judged_by_their_own_size() -> None:
    least = RANK_TOLERANCE * 2.0
    assert _numerical_rank(np.diag([1.0, 1.01 * least])) == 2
    assert _numerical_rank(np.diag([1.0, 0.99 * least])) == 1
    assert _numerical_rank(np.diag([1e6, 0.2])) == 2
    assert _numerical_rank(np.zeros((2, 2))) == 0
    assert _by_rows(np.array([[2.0, -4.0], [0.0, 0.0], [1e-9, 0.0]])).tolist() == [
        [0.5, -1.0],
        [0.0, 0.0],
        [1.0, 0.0],
    ]


def test_zeros_far_apart_in_size_are_found_in_units_of_the_states() -> None:
    # L = (z_0^2/10^12 - z_1) (1, -1): zero at z_0 = 10^8 and z_1 = 10^4.
    asked = []

    def values(z: np.ndarray, _) -> np.ndarray:
        asked.append(z)
        return (z[0] ** 2 / 1e12 - z[1]) * np.array([1.0, -1.0])

    def matrix(z: np.ndarray, _) -> np.ndarray:
        return np.outer([1.0, -1.0], [2 * z[0] / 1e12, -1.0]).ravel()

    starts = np.array([[1.0, 2.0], [3.0, 0.5], [0.2, 1.5]])
    found = _matrices_in_units(starts, np.array([1e8, 1e4]), (values, matrix), np.array([]))
    assert [_ranks(there, _by_rows) for there in found] == [[(1, 1)]] * 3
    # Newton's method in these units takes a few steps from each start.
    assert len(asked) < 40


def test_equilibria_are_searched_with_steps_no_longer_than_the_point() -> None:
    visited = []

    def value(z: np.ndarray, _) -> np.ndarray:
        visited.append(z.copy())
        return z - 100.0

    found, converged = _equilibrium(np.array([0.0]), (value, lambda *_: np.ones(1)), np.array([]))
    assert converged
    assert found == pytest.approx([100.0])
    # Each step is at most 1 + |z|.
    assert [float(v[0]) for v in visited[:5]] == pytest.approx([0.0, 1.0, 3.0, 7.0, 15.0])
    far = _equilibrium(np.array([0.0]), (lambda z, _: z - 2e6, lambda *_: np.ones(1)), np.array([]))
    assert not far[1]
    none = _equilibrium(np.array([1.0]), (lambda z, _: z * np.nan, lambda *_: np.ones(1)), np.array([]))
    assert (none[0].tolist(), none[1]) == ([1.0], False)
    endless = _equilibrium(np.array([1.0]), (lambda z, _: 1.0 + z**2, lambda z, _: 2 * z), np.array([]))
    assert not endless[1]


def test_expressions_are_shortened_unless_they_are_long() -> None:
    assert tidy(x * y + x * z) == x * (y + z)
    assert tidy((x**2 - 1) / (x - 1)) == x + 1
    long = sp.Add(*[sp.sin(x) ** k * y for k in range(1, TIDY_LIMIT)])
    assert tidy(long) is long
    assert reduced(sp.Matrix([(x**2 - y**2) / (x - y)])) == sp.Matrix([x + y])
    fraction = sum(((x**2 - 1) / (x - 1) + sp.sin(k * x) for k in range(TIDY_LIMIT)), sp.Integer(0))
    assert reduced(sp.Matrix([fraction])) == sp.Matrix([fraction])
    # It is the whole matrix that is long or not.
    many = sp.Matrix([(x**2 - 1) / (x - 1) + sp.sin(k * x) for k in range(TIDY_LIMIT)])
    assert reduced(many) == many
    assert reduced(many[:2, :]) == sp.Matrix([x + 1, x + 1 + sp.sin(x)])


def test_functions_of_the_same_argument_are_kept_the_same() -> None:
    function = sp.tanh(2 * x + 2 * y)
    assert all(
        function in tidy(e).atoms(sp.tanh) for e in (3 * function + 3 * y, function * y - function, function)
    )


def full(n: int, seed: int) -> sp.Matrix:
    """A matrix of rationals without zeros whose diagonal dominates."""
    entries = np.random.default_rng(seed).integers(1, 9, (n, n)).tolist()
    return sp.Matrix(entries) / 7 + 3 * n * sp.eye(n)


def values(matrix: sp.Matrix, there: np.ndarray) -> np.ndarray:
    return compile_function(list(matrix), arguments=sp.symbols("z1:7"))(there, [1.0]).reshape(matrix.shape)


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", thinned(["linear", "quadratic", "tanh", "rational"], 2))
def test_six_coupled_states_are_split_and_projected_by_formulas_in_any_coordinates(kind: str) -> None:
    # One slow direction, five fast ones, and every coefficient a fraction.
    z = sp.symbols("z1:7")
    coupled = full(6, 1) * sp.Matrix(z)
    bent = {
        "linear": lambda u: u / 2,
        "quadratic": lambda u: u**2 / 90,
        "tanh": sp.tanh,
        "rational": lambda u: u / (1 + sum(s**2 for s in z)),
    }[kind]
    g = [-200 * z[i] + bent(coupled[i]) for i in range(5)]
    change = full(6, 2)
    rates = change * sp.Matrix([*(e / eps for e in g), 1 - z[5]])
    result = split(VectorField(dict(zip(z, (sp.expand_mul(e) for e in rates))), epsilon=eps))
    assert result.is_standard
    assert len(result.system.y) == 5
    assert result.N.free_symbols == set()
    there = np.array([2, -3, 1, 4, -1, 5]) / 11

    N, f, layer, Pi, Df, G, reduced_field = (
        values(matrix, there)
        for matrix in (
            *(result.N, result.layer, change * sp.Matrix([*g, 0]), result.projection),
            *(jacobian(result.layer, z), result.drift, result.reduced_field),
        )
    )
    assert np.allclose(N @ f, layer, atol=1e-9)
    assert np.allclose(Df @ Pi, 0.0, atol=1e-8)
    assert np.allclose(reduced_field, Pi @ G, atol=1e-8)


def test_directions_that_turn_are_found_by_elimination_to_digits() -> None:
    # Five fast directions that depend on all states: no relation is linear, and the third fast rate is no sum of two.
    z = sp.symbols("z1:7")
    f = [sp.tanh(e) for e in (full(6, 3) * sp.Matrix(z) / 40)[:5]]
    turning = sp.Matrix(6, 5, lambda i, j: (2 if i == j else 0) + (z[5] if i == 5 else z[j] * z[i] / 20))
    layer = list(turning * sp.Matrix(f))
    N, chosen = factorised(layer, VectorField({s: e / eps for s, e in zip(z, layer)}, epsilon=eps), 5)
    directions, slopes, whole = (values(m, np.zeros(6)) for m in (N, jacobian(chosen, z), jacobian(layer, z)))
    assert np.linalg.matrix_rank(directions) == 5
    assert np.allclose(directions @ slopes, whole, atol=1e-12)


def test_a_switch_that_is_flat_in_most_units_is_fast() -> None:
    # tanh(10^6 z) is flat to rounding wherever zeros are looked for first.
    rate = -(sp.tanh(10**6 * z) + x * y / 10**3)
    field = VectorField({x: -y, y: x, z: rate / eps}, epsilon=eps)
    assert layer_rank([sp.S.Zero, sp.S.Zero, rate], field) == 1


@pytest.mark.parametrize("power", [-12, -9, 9, 12])
def test_the_rank_is_the_same_in_all_units_of_time(power: int) -> None:
    """Rates of 1e-9 were taken to vanish to second order."""
    faster = sp.Integer(10) ** power
    for rates, rank in (
        ({x: (sp.tanh(y) - x) / eps, y: (x - sp.tanh(y)) / eps, z: x - z}, 1),
        ({x: (y**2 - x) / eps, y: (x - y**2 + sp.exp(z) - y) / eps, z: (y - sp.exp(z)) / eps + x}, 2),
    ):
        own = VectorField({s: faster * rate for s, rate in rates.items()}, epsilon=eps)
        assert layer_rank(principal_part(own)[0], own) == rank


def test_the_rank_is_the_same_where_units_of_the_states_are_far_apart() -> None:
    """A gene's messenger and its dimers, 1e-6 beside 1e6: most entries of DL are nothing beside the largest."""
    plain = scene("gene_dimers")
    for powers in ({}, {"M": -6, "P": 6, "D": -6}, {"M": 6, "P": -6, "D": 6}):
        own = rescaled(plain, powers).system
        assert isinstance(own, VectorField)
        assert layer_rank(principal_part(own)[0], own) == 2


@pytest.mark.parametrize(("length", "speed"), [(0, 0), (-3, 3), (2, -3), (-3, 4)])
def test_the_rank_is_the_same_in_units_of_length_and_speed(length: int, speed: int) -> None:
    """Two wagons: where they are 1e3 long and 1e-3 fast the rank was 1, or no equilibrium was found."""
    a, b, u, v = states = sp.symbols("a b u v")
    far, fast = sp.Integer(10) ** length, sp.Integer(10) ** speed
    pull = (900 * (b - a) * far + 50 * (v - u) * fast + sp.sin(a * far) / 4) / fast
    layer = [(u - v) * fast / far, (v - u) * fast / far, pull, -pull]
    own = VectorField({s: rate / eps for s, rate in zip(states, layer)}, epsilon=eps)
    assert layer_rank(layer, own) == 2
