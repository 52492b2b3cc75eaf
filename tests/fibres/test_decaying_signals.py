"""Signals: panels that are exact on polynomials, arithmetic that keeps the parts apart, and solved linear problems."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gsp.fibres.decaying_signals import DEGREE, FUNCTIONS, Panels, Signal, SignalRing, chebyshev, tail

PANELS = Panels(
    np.array([0.0, 0.25, 0.6, 1.1, 1.8, 2.7, 3.9, 5.4, 7.3, 9.7, 12.7, 16.5, 21.0, 26.0, 32.0, 40.0])
)
TAU = PANELS.tau
RING = SignalRing(PANELS, np.array([[-1.0]]), np.zeros((*TAU.shape, 1, 1)), np.ones(1))
TIMES = np.array([0.0, 0.1, 0.25, 0.7, 3.0, 11.0, 39.0])


def total(signal: Signal, tau: np.ndarray = TIMES) -> np.ndarray:
    return np.polyval(signal.outer[::-1], tau) + signal.decaying(tau)


def signal(*outer: float, decay: float = 0.0) -> Signal:
    """A polynomial plus decay exp(-tau)."""
    return Signal(RING, np.array(outer), decay * np.exp(-TAU) if decay else None)


CASES = [signal(2.0), signal(0.5, -1.0), signal(3.0, decay=0.4), signal(1.0, 0.0, 2.0, decay=-0.7)]


def test_panels_integrate_and_interpolate_what_they_resolve() -> None:
    nodes, weights, S = chebyshev()
    assert (nodes[0], nodes[-1], len(nodes)) == (-1.0, 1.0, DEGREE + 1)
    for power in range(DEGREE + 1):
        np.testing.assert_allclose(
            S @ nodes**power, (nodes ** (power + 1) - (-1.0) ** (power + 1)) / (power + 1), atol=1e-13
        )
    # The weights are those of barycentric interpolation: differences of any polynomial of lower degree vanish.
    assert abs(weights @ nodes ** (DEGREE - 1)) < 1e-12
    np.testing.assert_array_equal(TAU[:, 0], PANELS.ends[:-1])
    np.testing.assert_allclose(TAU[:, -1], PANELS.ends[1:], rtol=1e-15)
    decay = np.exp(-TAU)
    np.testing.assert_allclose(PANELS.interpolate(decay, TIMES), np.exp(-TIMES), rtol=1e-7)
    np.testing.assert_array_equal(PANELS.interpolate(decay, TAU[2]), decay[2])
    assert PANELS.interpolate(decay, np.array([40.0, 40.0001, 1e9])).tolist() == [decay[-1, -1], 0.0, 0.0]
    np.testing.assert_allclose(PANELS.remaining(decay), decay - math.exp(-40.0), rtol=1e-7, atol=1e-30)


@pytest.mark.parametrize(("degree", "size"), [(DEGREE, 1.0), (DEGREE - 2, 1.0), (DEGREE - 3, 0.0), (0, 0.0)])
def test_the_tail_is_the_largest_of_the_last_three_coefficients(degree: int, size: float) -> None:
    samples = np.cos(degree * np.arccos(chebyshev()[0]))
    assert tail(np.stack([samples, -3 * samples])) == pytest.approx([size, 3 * size], abs=1e-13)


@pytest.mark.parametrize("i", range(len(CASES)))
@pytest.mark.parametrize("j", range(len(CASES)))
def test_arithmetic_is_that_of_the_sums_and_keeps_the_parts_apart(i: int, j: int) -> None:
    a, b = CASES[i], CASES[j]
    for found, expected in (
        (a + b, total(a) + total(b)),
        (a - b, total(a) - total(b)),
        (a * b, total(a) * total(b)),
    ):
        np.testing.assert_allclose(total(found), expected, rtol=1e-11, atol=1e-11)
        assert (found.samples is None) == (a.samples is None and b.samples is None)
    np.testing.assert_array_equal((a * b).outer, np.convolve(a.outer, b.outer))
    np.testing.assert_allclose(total(-a + 3), 3 - total(a), atol=1e-13)
    np.testing.assert_allclose(total(2.5 * a), 2.5 * total(a))
    # Late, where the polynomials are large, what decays keeps its digits.
    late = np.array([30.0])
    outer_a, outer_b = (np.polyval(s.outer[::-1], late) for s in (a, b))
    expected = outer_a * b.decaying(late) + outer_b * a.decaying(late) + a.decaying(late) * b.decaying(late)
    np.testing.assert_allclose((a * b).decaying(late), expected, rtol=1e-9, atol=1e-300)
    assert (a.key == b.key) == (i == j)
    assert a.reduced() is a


def test_zero_is_what_neither_stays_nor_decays() -> None:
    assert RING.zero.is_zero
    assert signal(0.0, 0.0).is_zero
    assert not any(s.is_zero for s in (RING.one, signal(0.0, decay=1.0), signal(0.0, 1.0)))
    assert total(RING.one).tolist() == [1.0] * len(TIMES)


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
@pytest.mark.parametrize("decay", [0.0, 0.3])
def test_functions_are_those_of_the_values(name: str, decay: float) -> None:
    start = 1.4 if name == "acosh" else 0.4
    u = signal(start, decay=decay)
    function = {"erf": np.vectorize(math.erf)}.get(name) or FUNCTIONS[name]
    found = u.apply(name)
    np.testing.assert_allclose(total(found), function(start + decay * np.exp(-TIMES)), rtol=1e-9, atol=1e-12)
    assert found.outer.tolist() == [pytest.approx(float(function(start)))]
    assert (found.samples is None) == (decay == 0.0)


def test_powers_inverses_and_constants() -> None:
    u = signal(2.0, decay=0.5)
    np.testing.assert_allclose(total(u.apply("pow", RING.constant(1.5))), total(u) ** 1.5, rtol=1e-10)
    np.testing.assert_allclose(total(u.inverse()), 1 / total(u), rtol=1e-10)
    assert signal(4.0).inverse().outer.tolist() == [0.25]
    assert [total(u.apply(name))[0] for name in ("pi", "E")] == pytest.approx([math.pi, math.e])
    # The exponential of what decays keeps its relative accuracy where it is far below 1.
    tiny = u.apply("exp").decaying(np.array([36.0]))[0]
    assert tiny == pytest.approx(math.exp(2.0) * 0.5 * math.exp(-36.0), rel=1e-8)


def test_the_slow_equation_is_integrated_from_its_start() -> None:
    X = RING.slow(signal(2.0, 3.0, decay=0.5), 7.0)
    np.testing.assert_allclose(
        total(X), 7 + 2 * TIMES + 1.5 * TIMES**2 + 0.5 * (1 - np.exp(-TIMES)), rtol=1e-11
    )
    np.testing.assert_allclose(X.outer, [7.5, 2.0, 1.5])
    assert RING.slow(signal(2.0), 7.0).samples is None


def test_the_fast_equation_is_solved_with_coefficients_that_decay() -> None:
    limit, coupling = np.array([[-2.0, 1.0], [0.5, -3.0]]), np.array([[0.3, -0.2], [0.1, 0.4]])
    jacobian = coupling * np.exp(-TAU)[:, :, None, None]
    ring = SignalRing(PANELS, limit, jacobian, np.array([1.0, 1e6]))
    rest = [
        Signal(ring, np.array([1.0, -0.5]), 0.2 * np.exp(-2 * TAU)),
        Signal(ring, np.array([0.0, 0.0, 0.1])),
    ]
    start = [0.7, -0.3]
    Y = ring.fast(rest, start)

    def rate(tau: float, y: np.ndarray) -> np.ndarray:
        forcing = np.array([1 - 0.5 * tau + 0.2 * math.exp(-2 * tau), 0.1 * tau**2])
        return (limit + coupling * math.exp(-tau)) @ y + forcing

    run = solve_ivp(rate, (0, 12), start, method="DOP853", rtol=1e-12, atol=1e-13, t_eval=TIMES[TIMES <= 12])
    for found, expected in zip(Y, run.y):
        np.testing.assert_allclose(total(found, run.t), expected, rtol=1e-8, atol=1e-9)
    # The polynomial solves the limit's equation by itself.
    Q = np.array([y.outer for y in Y])
    forcing = np.array([[1.0, -0.5, 0.0], [0.0, 0.0, 0.1]])
    slopes = np.column_stack([Q[:, 1], 2 * Q[:, 2], [0.0, 0.0]])
    np.testing.assert_allclose(slopes, limit @ Q + forcing, atol=1e-13)


def test_the_ends_of_a_panel_have_the_sign_within_it() -> None:
    # The panels end at 1.1: there the sign is that of the side.
    value = Signal(RING, np.array([-1.0]), 1.1 - TAU + 1.0)
    signs = value.apply("sign").samples
    assert signs is not None
    left = PANELS.ends[:-1, None] < 1.1
    np.testing.assert_array_equal(signs, np.where(np.broadcast_to(left, TAU.shape), 2.0, 0.0))


def test_signals_that_decay_differently_are_told_apart() -> None:
    first, second, plain = signal(2.0, decay=0.5), signal(2.0, decay=-0.5), signal(2.0)
    assert len({first.key, second.key, plain.key}) == 3
    assert plain.key == signal(2.0).key
