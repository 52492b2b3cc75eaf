"""Layers against solutions in closed form: where they are sampled, how far they are followed, which way time runs."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.fibres.decaying_signals import chebyshev
from gsp.fibres.layer_orbit import GONE, Landing, _collocate, _Layer, land
from gsp.systems.system import SlowFastSystem

x, y, eps = sp.symbols("x y epsilon")


def landing(rate: sp.Expr, start: float, value: float) -> Landing:
    """The layer over x = 1 from y = `start` to the branch of `rate` through `value`."""
    critical = solve_critical(SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: rate}, epsilon=eps))
    return land(critical.nearest({"x": 1.0, "y": value}), np.array([1.0]), np.array([start]))


@pytest.mark.parametrize("rate", [-0.25, -4.0, 0.25, 4.0])
def test_a_linear_layer_is_an_exponential_and_is_followed_until_it_is_gone(rate: float) -> None:
    found = landing(rate * (y - 2 * x), 5.0, 2.0)
    gap = abs(rate)
    assert found.point == pytest.approx([2.0])
    assert (found.direction, found.gap) == (-np.sign(rate), pytest.approx(gap))
    assert found.limit == pytest.approx(np.array([[-gap]]))
    np.testing.assert_allclose(
        found.samples[:, :, 0], 3 * np.exp(-gap * found.panels.tau), rtol=1e-8, atol=1e-13
    )
    # Two slowest times at most lie in one panel.
    last = 3 * np.exp(-gap * found.panels.ends[-1])
    assert GONE * np.exp(-2.0) / 3 < last < 3 * GONE
    assert np.diff(found.panels.ends).max() <= 2.0 / gap * (1 + 1e-12)


def test_a_nonlinear_layer_is_that_of_its_closed_form() -> None:
    # y' = x - y^2 from 0: y = tanh(tau), whose distance from 1 ends as 2 exp(-2 tau).
    found = landing(x - y**2, 0.0, 1.0)
    tau = found.panels.tau
    np.testing.assert_allclose(found.samples[:, :, 0], -2 / (1 + np.exp(2 * tau)), rtol=1e-7, atol=1e-14)
    assert GONE * np.exp(-4.0) < 2 * np.exp(-2 * found.panels.ends[-1]) < 3 * GONE


def test_panels_cut_in_two_carry_the_same_layer() -> None:
    found = landing(x - y**2, 0.0, 1.0)
    chosen = np.arange(len(found.samples)) % 2 == 0
    halved = found.halved(chosen)
    assert len(halved.samples) == len(found.samples) + chosen.sum()
    assert set(found.panels.ends) < set(halved.panels.ends)
    exact = -2 / (1 + np.exp(2 * halved.panels.tau))
    np.testing.assert_allclose(halved.samples[:, :, 0], exact, rtol=1e-6, atol=1e-13)


def test_a_panel_is_rough_where_its_last_coefficients_are_above_rounding_of_the_term() -> None:
    found = landing(-(y - 2 * x), 5.0, 2.0)
    (smooth,) = found.signals(found.ring())
    assert not found.rough([smooth]).any()
    kink = smooth.samples.copy()
    kink[1] = np.abs(np.linspace(-1.0, 1.0, kink.shape[1]))
    rough = found.rough([smooth, type(smooth)(smooth.ring, smooth.outer, kink)])
    assert np.flatnonzero(rough).tolist() == [1]
    # Beside a value that stays and is larger by far the same kink is rounding.
    assert not found.rough([type(smooth)(smooth.ring, np.array([1e12]), kink)]).any()


def test_collocation_goes_on_until_no_node_moves() -> None:
    # From a guess that is right at the first node alone, where the layer begins.
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: x - y**2}, epsilon=eps)
    nodes = chebyshev()[0]
    guess = np.where(nodes[:, None] == nodes[0], -1.0, 0.0)
    found = _collocate(_Layer(system, np.array([1.0])), np.array([1.0]), 2.0, np.array([-1.0]), 0.25, guess)
    exact = -2 / (1 + np.exp(2 * 0.25 * (nodes + 1)))
    np.testing.assert_allclose(np.asarray(found)[:, 0], exact, atol=1e-13)
