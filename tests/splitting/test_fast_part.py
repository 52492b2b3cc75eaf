"""The fast part of a field: its pole and its rest, and matrices inverted exactly."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import sympy as sp

from gsp.algebra.elimination_over_rationals import numbers_at
from gsp.lowering.compiled_function import compile_function
from gsp.splitting.fast_part import (
    TIDY_LIMIT,
    _by_elimination,
    factorised,
    inverse,
    jacobian,
    principal_part,
    reduced,
    tidy,
)
from gsp.splitting.layer_rank import layer_rank
from gsp.splitting.splitting import split
from gsp.systems.system import VectorField

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


def test_no_pivot_is_taken_that_elimination_has_made_zero() -> None:
    """After the first column the second of the first two rows is zero, and in the third row it is small."""
    matrix = sp.Matrix([[a, a, 0], [a, a, 1], [0, sp.Rational(1, 100), 1]])
    assert (matrix * _by_elimination(matrix)).subs(a, 17) == sp.eye(3)


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
@pytest.mark.parametrize("kind", ["linear", "quadratic", "tanh", "rational"])
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
    origin = dict.fromkeys(z, sp.S.Zero)
    directions, slopes, whole = (
        np.array(numbers_at(m, origin), dtype=float) for m in (N, jacobian(chosen, z), jacobian(layer, z))
    )
    assert np.linalg.matrix_rank(directions) == 5
    assert np.allclose(directions @ slopes, whole, atol=1e-12)
