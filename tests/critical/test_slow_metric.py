"""The metric of the slow variables in which the reduced flow parts neighbours least."""

import numpy as np
import pytest
from scipy.linalg import expm

from gsp.critical.slow_metric import MOST_COUPLED, NEAR, frozen_rates, least_metric

RANDOM = np.random.default_rng(5)


def least(A) -> float:
    """The largest rate over `A`, matrices or one of them, in the least metric."""
    A = np.atleast_3d(np.asarray(A, dtype=float)).reshape(-1, *np.shape(A)[-2:])
    return float(least_metric(A).rates(A).max())


@pytest.mark.exhaustive
@pytest.mark.parametrize("size", [2, 3, 5])
def test_of_one_matrix_the_rate_is_its_largest_real_part(size: int) -> None:
    A = RANDOM.standard_normal((size, size))
    exact = np.abs(np.linalg.eigvals(A).real).max()
    assert exact <= least(A) * (1 + 1e-12)
    assert least(A) == pytest.approx(exact, rel=1e-2)


def test_what_is_one_flow_in_many_units_has_one_rate() -> None:
    for c in (1e-9, 1.0, 1e9):
        # Drift in a position, an oscillation, and a cascade: nothing grows; nothing; the faster of the two.
        assert least([[0, c], [0, 0]]) == 0.0
        assert least([[0, c], [-1 / c, 0]]) == 0.0
        assert least([[-2, 0], [c, 1]]) == pytest.approx(2, rel=1e-12)


def test_matrices_that_no_metric_serves_alike_have_the_least_that_one_can_do() -> None:
    """A = [[0, a], [-b, 0]] and [[0, b], [-a, 0]]: by symmetry P = 1, with the rate (a - b)/2 of either."""
    A = np.array([[[0.0, 3.0], [-1.0, 0.0]], [[0.0, 1.0], [-3.0, 0.0]]])
    assert least(A) == pytest.approx(1.0, rel=2e-3)
    assert frozen_rates(A) == pytest.approx([0.0, 0.0], abs=1e-12)
    turn = np.array([[2.0, 1.0], [0.5, -3.0]])
    assert least(turn @ A @ np.linalg.inv(turn)) == pytest.approx(1.0, rel=2e-3)


@pytest.mark.exhaustive
def test_no_metric_tried_at_random_does_better() -> None:
    A = RANDOM.standard_normal((5, 3, 3))
    found = least(A)
    for _ in range(300):
        T = expm(RANDOM.standard_normal((3, 3)))
        B = T @ A @ np.linalg.inv(T)
        assert np.abs(np.linalg.eigvalsh(B + B.transpose(0, 2, 1))).max() / 2 >= found * (1 - 1e-2)
    assert found >= frozen_rates(A).max()


@pytest.mark.exhaustive
@pytest.mark.parametrize("size", [2, 4, MOST_COUPLED + 3])
@pytest.mark.parametrize("power", [3, 6])
def test_units_and_order_change_no_rate(size: int, power: int) -> None:
    A = RANDOM.standard_normal((40, size, size))
    # The last variable is driven by the others, and drives none.
    A[:, :-1, -1] = 0.0
    units = 10.0 ** (power * RANDOM.uniform(-1, 1, size))
    order = RANDOM.permutation(size)
    expected = least(A)
    assert least(units[:, None] * A / units) == pytest.approx(expected, rel=10 * NEAR)
    assert least(A[:, order][:, :, order]) == pytest.approx(expected, rel=10 * NEAR)


def test_a_metric_that_is_written_down_has_the_rate_but_for_the_drives() -> None:
    A = np.array([[[-1.0, 0.0, 0.0], [1e5, 0.0, 7.0], [0.0, -7.0, 0.0]]])
    T = least_metric(A).written(A, least=0.0)
    B = T @ A[0] @ np.linalg.inv(T)
    assert np.abs(np.linalg.eigvalsh(B + B.T)).max() / 2 == pytest.approx(1.0, rel=1e-5)


def test_the_largest_rate_is_told_with_its_matrix_sign_and_direction() -> None:
    """Decay at rate 3 along (2, 1), in the second of two."""
    V = np.array([[2.0, 0.0], [1.0, 1.0]])
    A = np.array([V @ np.diag(d) @ np.linalg.inv(V) for d in ([1.0, -1.0], [-3.0, 1.0])])
    metric = least_metric(A)
    i, rate, direction = metric.extreme(A)
    assert (i, rate) == (1, pytest.approx(-3.0, rel=1e-3))
    assert direction[1] / direction[0] == pytest.approx(0.5, rel=1e-2)


@pytest.mark.parametrize("least_rate", [0.0, 5.0])
def test_parts_that_drive_one_another_in_turn_are_written_in_units_of_their_own(least_rate: float) -> None:
    """A cascade of a state, a spiral with a metric of its own and two states: drives are 1e-6 of a rate, no more."""
    A = np.zeros((1, 5, 5))
    A[0, 0, 0] = -1.0
    A[0, 1:3, 1:3] = [[-2.0, 3e4], [-1e-4, -0.5]]
    A[0, 3, 3], A[0, 4, 4] = 0.25, -0.75
    for later, earlier, drive in (
        (1, 0, 1e3),
        (2, 0, -40.0),
        (3, 1, 2e5),
        (3, 2, 8.0),
        (4, 0, 3.0),
        (4, 3, 1e-7),
    ):
        A[0, later, earlier] = drive
    metric = least_metric(A)
    T = metric.written(A, least=least_rate)
    B = T @ A[0] @ np.linalg.inv(T)
    aim = 1e-6 * max(least_rate, float(metric.rates(A)[0]))
    for place, part in enumerate(metric.parts[1:], 1):
        before = np.concatenate(metric.parts[:place])
        assert np.abs(B[np.ix_(part, before)]).max() == pytest.approx(aim, rel=1e-9)
    assert np.abs(np.linalg.eigvalsh(B + B.T)).max() / 2 == pytest.approx(float(metric.rates(A)[0]), rel=1e-4)
