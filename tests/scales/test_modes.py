"""Modes of a Jacobian against closed forms: simple, close, complex, repeated and conserved rates."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from gsp.scales.modes import Coordinates, Modes, modes_of


def modes(matrix, sizes=None) -> Modes:
    n = len(matrix)
    coordinates = Coordinates(np.zeros((0, n)), np.arange(n), np.eye(n))
    return modes_of(np.array(matrix, dtype=float), coordinates, np.ones(n) if sizes is None else sizes)


PLANE = {
    "far": (-1.0, 3.0, 0.2, -1000.0),
    "near": (-3.0, 2.0, 1.0, -7.0),
    "close": (-1.0, 1e-3, 1e-4, -1.0001),
    "of two signs": (2.0, 1.0, 1.0, -1.0),
}


@pytest.mark.parametrize("name", PLANE)
def test_pointers_are_those_of_the_closed_form(name: str) -> None:
    a, b, c, d = PLANE[name]
    found = modes([[a, b], [c, d]])
    with mpmath.workdps(40):
        half, square = mpmath.mpf(a + d) / 2, mpmath.sqrt(((mpmath.mpf(a) - d) / 2) ** 2 + mpmath.mpf(b) * c)
        first, second = sorted((half + square, half - square), key=abs, reverse=True)
        wanted = np.array([(a - second) / (first - second), (d - second) / (first - second)], dtype=float)
        rates = np.array([first, second], dtype=float)
    assert found.rates == pytest.approx(rates, rel=1e-13)
    # Rounding of the matrix over the distance of the rates.
    atol = 1e-14 * np.abs(rates).max() / np.abs(np.diff(rates))[0]
    assert np.abs(found.pointers[0] - wanted).max() < atol
    assert np.abs(found.pointers[1] - (1.0 - wanted)).max() < atol
    assert found.groups.tolist() == [0, 1]


@pytest.mark.parametrize(
    "matrix",
    [
        [[-1.0, 5.0], [-2.0, -3.0]],
        [[0.0, 1.0], [-1.0, 0.0]],
        [[-1.0, 1.0], [0.0, -1.0]],
        [[-2.0, 0.0], [0.0, -2.0]],
        [[2.0, 1.0], [-1.0, 4.0]],
        [[0.0, 0.0], [0.0, 0.0]],
    ],
)
def test_complex_pairs_and_repeated_rates_are_one_subspace(matrix) -> None:
    """Each has half of the unit: for a complex pair the real part of ((a - l2)/(l1 - l2), (d - l2)/(l1 - l2))."""
    found = modes(matrix)
    assert found.groups.tolist() == [0, 0]
    assert found.pointers == pytest.approx(np.full((2, 2), 0.5), abs=1e-14)
    first, second = found.rates
    if first.imag:
        pointer = (np.diag(matrix) - second) / (first - second)
        assert found.pointers[0] == pytest.approx(pointer.real, abs=1e-14)


def test_repeated_rates_are_told_from_rounding_in_any_basis() -> None:
    jordan = np.diag([-1.0, -1.0, -1.0, -2.0]) + np.diag([1.0, 1.0, 0.0], 1)
    basis = np.random.default_rng(0).standard_normal((4, 4))
    found = modes(basis @ jordan @ np.linalg.inv(basis))
    assert found.groups.tolist() == [0, 1, 1, 1]
    slow = basis[:, :3] @ np.linalg.inv(basis)[:3]
    assert found.right[:, 1:] @ found.left[1:] == pytest.approx(slow, abs=1e-9)


def test_a_chain_without_rates_does_not_blur_the_others() -> None:
    """What drifts and turns nothing back, x' = v cos phi: a nilpotent block of any size beside rates of any size."""
    matrix = np.zeros((7, 7))
    matrix[0, 0], matrix[1, 1] = -20.0, -0.3
    matrix[3:, :3] = np.random.default_rng(2).standard_normal((4, 3))
    found = modes(matrix)
    assert found.groups.tolist() == [0, 1, 2, 2, 2, 2, 2]
    assert found.rates[:2] == pytest.approx([-20.0, -0.3])
    assert np.abs(found.rates[2:]).max() < 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_rates_do_not_change_with_the_variables_and_projections_follow(seed: int) -> None:
    random = np.random.default_rng(seed)
    matrix = random.standard_normal((6, 6)) - np.diag([1e3, 50.0, 50.0, 3.0, 1.0, 0.1])
    basis = random.standard_normal((6, 6))
    here, there = modes(matrix), modes(np.linalg.inv(basis) @ matrix @ basis)
    assert there.groups.tolist() == here.groups.tolist()
    # A pair may come with either sign first.
    assert np.sort_complex(there.rates) == pytest.approx(np.sort_complex(here.rates), rel=1e-7)
    for m in here.ends:
        first = here.right[:, :m] @ here.left[:m]
        second = basis @ there.right[:, :m] @ there.left[:m] @ np.linalg.inv(basis)
        assert second == pytest.approx(first, abs=1e-7)
    assert here.left @ here.right == pytest.approx(np.eye(6), abs=1e-10)
    assert here.left @ matrix @ here.right == pytest.approx(
        np.where(here.groups[:, None] == here.groups, here.left @ matrix @ here.right, 0.0), abs=1e-8
    )
    assert here.pointers.sum(axis=0) == pytest.approx(np.ones(6), abs=1e-10)


def test_units_of_the_states_change_no_pointer() -> None:
    matrix = np.array([[-100.0, 3.0, 1.0], [2.0, -1.0, 0.5], [0.1, 0.2, -0.1]])
    units = np.array([1e-12, 1.0, 1e9])
    assert modes(matrix * units[:, None] / units).pointers == pytest.approx(modes(matrix).pointers, abs=1e-12)


def test_a_state_that_drives_others_and_is_driven_by_none_may_have_any_unit() -> None:
    """A clock, or the first of a chain: balancing has nothing to weigh its column against."""
    for first in (0.0, -0.1):
        matrix = np.array([[first, 0.0, 0.0], [1.0, -1.0, 0.5], [2.0, 0.5, -100.0]])
        for unit in (1e-12, 1e12):
            units = np.array([unit, 1.0, 1.0])
            found = modes(matrix * units[:, None] / units, units)
            assert found.groups.tolist() == [0, 1, 2]
            assert found.pointers == pytest.approx(modes(matrix).pointers, abs=1e-12)
            assert found.left @ found.right == pytest.approx(np.eye(3), abs=1e-9)


def test_what_is_conserved_is_taken_out_first() -> None:
    """A <-> B at 1e12, B -> C -> B at 1e-6: rounding of 1e12 hides a rate of 1e-6 unless A + B + C is taken out."""
    k, slow = 1e12, 1e-6
    matrix = np.array([[-k, k, 0.0], [k, -k - slow, slow], [0.0, slow, -slow]])
    embedding = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    found = modes_of(matrix, Coordinates(np.ones((1, 3)), np.array([1, 2]), embedding), np.ones(3))
    assert found.rates[2] == 0.0
    assert found.groups.tolist() == [0, 1, 2]
    # lambda^2 + (2k + 2 slow) lambda + 3 k slow = 0, whose small root is -3 slow/2 but for slow^2/k.
    assert found.rates[0] == pytest.approx(-2 * k)
    assert found.pointers.sum(axis=0) == pytest.approx(np.ones(3))
    assert found.pointers[2] == pytest.approx(np.full(3, 1 / 3))
    # The vectors may have any length: rounding is measured by their own.
    lengths = np.linalg.norm(found.left, axis=1)[:, None] * np.linalg.norm(found.right, axis=0)
    assert np.abs((found.left @ found.right - np.eye(3)) / lengths).max() < 1e-15


def test_all_may_be_conserved() -> None:
    found = modes_of(np.zeros((2, 2)), Coordinates(np.eye(2), np.arange(0), np.zeros((2, 0))), np.ones(2))
    assert found.rates.tolist() == [0.0, 0.0]
    assert found.pointers == pytest.approx(np.full((2, 2), 0.5))


def test_sizes_of_states_may_be_further_apart_than_whole_numbers_reach() -> None:
    # SciPy's balancing warned of units beyond 1e19, which it takes for numbers of rows.
    found = modes([[-1.0, 1e-300], [1e300, -3.0]])
    assert sorted(found.rates.real) == pytest.approx([-2 - 2**0.5, -2 + 2**0.5])
