"""The rank of a layer problem on its critical manifold, and the search for its equilibria."""

from __future__ import annotations

import random

import numpy as np
import pytest
import sympy as sp

from gsp.errors import SplittingError
from gsp.splitting.fast_part import principal_part
from gsp.splitting.layer_rank import (
    RANK_TOLERANCE,
    Blocks,
    _by_rows,
    _equilibrium,
    _matrices_in_units,
    _numerical_ranks,
    _ranks,
    layer_rank,
)
from gsp.splitting.splitting import split
from gsp.systems.system import VectorField
from tests.rescaling import rescaled, scene

x, y, z, eps = sp.symbols("x y z epsilon")
ONE = Blocks.of([(0, 0)], 1)


def field(*rates: sp.Expr) -> VectorField:
    return VectorField(dict(zip((x, y, z), rates)), epsilon=eps)


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


@pytest.mark.parametrize(
    ("layer", "rank"),
    [
        # Newton's steps halve the states.
        ([-x * (x - y), 2 * y * (x - y), 0], 1),
        ([-(x + y) * (x - y), (x + 2 * y) * (x - y), 0], 1),
        ([-(x + 1) * (x - 1 - y), y * (x - 1 - y), z * (x - 1 - y)], 1),
        ([-(x**2) * (x - y), y**2 * (x - y), x * y * (x - y)], 1),
        ([-x * (x - y) - z * (y - z), y * (x - y), z * (y - z)], 2),
    ],
)
def test_a_field_that_vanishes_twice_in_one_point_has_the_rank_of_its_manifold(layer: list, rank: int) -> None:
    assert layer_rank([sp.sympify(e) for e in layer], field(x / eps, y, z)) == rank


def test_a_field_that_vanishes_twice_all_over_its_manifold_is_refused() -> None:
    with pytest.raises(SplittingError, match="vanishes to second order"):
        layer_rank([-x * (x - y) ** 2, y * (x - y) ** 2, sp.S.Zero], field(x / eps, y, z))


def test_ranks_are_numerical_and_rows_are_judged_by_their_own_size() -> None:
    least = RANK_TOLERANCE * 2.0
    assert _numerical_ranks(np.diag([1.0, 1.01 * least])[None]) == [2]
    assert _numerical_ranks(np.diag([1.0, 0.99 * least])[None]) == [1]
    assert _numerical_ranks(np.diag([1e6, 0.2])[None]) == [2]
    assert _numerical_ranks(np.zeros((2, 2))[None]) == [0]
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
    found = _matrices_in_units(
        starts,
        np.array([1e8, 1e4]),
        (values, matrix),
        np.array([]),
        Blocks.of([(0, 0), (0, 1), (1, 0), (1, 1)], 2),
    )
    assert [_ranks(there, _by_rows) for there in found] == [[(1, 1)]] * 3
    # Newton's method in these units takes a few steps from each start.
    assert len(asked) < 40


def test_equilibria_are_searched_with_steps_no_longer_than_the_point() -> None:
    visited = []

    def value(z: np.ndarray, _) -> np.ndarray:
        visited.append(z.copy())
        return z - 100.0

    found, converged = _equilibrium(np.array([0.0]), (value, lambda *_: np.ones(1)), np.array([]), ONE)
    assert converged
    assert found == pytest.approx([100.0])
    # Each step is at most 1 + |z|.
    assert [float(v[0]) for v in visited[:5]] == pytest.approx([0.0, 1.0, 3.0, 7.0, 15.0])
    far = _equilibrium(np.array([0.0]), (lambda z, _: z - 2e6, lambda *_: np.ones(1)), np.array([]), ONE)
    assert not far[1]
    none = _equilibrium(np.array([1.0]), (lambda z, _: z * np.nan, lambda *_: np.ones(1)), np.array([]), ONE)
    assert (none[0].tolist(), none[1]) == ([1.0], False)
    endless = _equilibrium(np.array([1.0]), (lambda z, _: 1.0 + z**2, lambda z, _: 2 * z), np.array([]), ONE)
    assert not endless[1]


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


def pairs(count: int) -> VectorField:
    """`count` fast pairs of states, each with the flux 2 a^2 - b from a to b, in shuffled order."""
    rates = {}
    for k in range(count):
        a, b = sp.symbols(f"a{k} b{k}")
        rates |= {a: -(2 * a**2 - b) / eps - a, b: (2 * a**2 - b) / eps}
    shuffled = list(rates.items())
    random.Random(count).shuffle(shuffled)
    return VectorField(dict(shuffled), epsilon=eps)


def test_pairs_that_move_apart_take_matrices_of_two(monkeypatch) -> None:
    """A hundred of them took 22 s: 476 steps and 128 ranks of 200 states."""
    sizes = []
    for name in ("svd", "lstsq"):
        own = getattr(np.linalg, name)
        monkeypatch.setattr(
            np.linalg, name, lambda m, *a, own=own, **k: sizes.append(np.shape(m)[-1]) or own(m, *a, **k)
        )
    own = pairs(20)
    assert layer_rank(principal_part(own)[0], own) == 20
    assert set(sizes) == {2}
    found = split(pairs(3))
    assert found.is_standard
    assert len(found.layer) == 3


def test_parts_far_apart_in_speed_have_each_its_rank() -> None:
    """Of rates of 1e9 beside rates of one the latter were rounding."""
    a, b, c, d = sp.symbols("a b c d")
    flux, slow = 10**9 * (a**2 - b), c - d**2
    apart = VectorField({a: -flux / eps, c: -slow / eps, b: flux / eps, d: slow / eps}, epsilon=eps)
    assert layer_rank(principal_part(apart)[0], apart) == 2


def test_blocks_solve_and_rank_as_the_whole_matrix_does() -> None:
    draw = np.random.default_rng(3)
    for size, states in ((6, 9), (14, 9), (30, 9), (3, 4)):
        places = sorted({tuple(draw.integers(0, states, 2).tolist()) for _ in range(size)})
        blocks = Blocks.of(places, states)
        values, right = draw.standard_normal(len(places)), draw.standard_normal(states)
        whole = np.zeros((states, states))
        whole[tuple(np.array(places).T)] = values
        expected = np.linalg.lstsq(whole, right, rcond=1e-10)[0]
        assert blocks.step(values, right) == pytest.approx(expected, rel=1e-9, abs=1e-9)
        ranks = tuple(int(np.linalg.matrix_rank(m)) for m in (whole, whole @ whole))
        assert _ranks(blocks.matrices(values)) == [ranks]
