"""Layers against solutions in closed form: where they are sampled, how far they are followed, which way time runs."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.errors import BranchError, DeclarationError
from gsp.fibres.base_points import project
from gsp.fibres.decaying_signals import chebyshev
from gsp.fibres.inner_expansion import expand_inner
from gsp.fibres.layer_flow import LayerFlow
from gsp.fibres.layer_orbit import GONE, Landing, _collocate, land
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


def test_a_stiff_linear_layer_from_far_is_an_exponential() -> None:
    """Rates 1 and 4000: an explicit method would need hundreds of thousands of steps down to the branch."""
    s, a, b, eps = sp.symbols("s a b epsilon")
    system = SlowFastSystem(slow={s: -s}, fast={a: -4000 * (a - s), b: s - b}, epsilon=eps)
    found = land(solve_critical(system).branches[0], np.array([0.0]), np.array([3.0, 5.0]))
    for tau, (fast, slow) in zip(found.panels.tau.ravel(), found.samples.reshape(-1, 2)):
        assert fast == pytest.approx(3.0 * np.exp(-4000.0 * tau), abs=1e-13)
        assert slow == pytest.approx(5.0 * np.exp(-tau), abs=1e-13)


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
    found = _collocate(
        LayerFlow(system, np.ones(1), np.ones(1)), np.array([1.0]), np.array([-1.0]), 0.25, guess
    )
    exact = -2 / (1 + np.exp(2 * 0.25 * (nodes + 1)))
    np.testing.assert_allclose(np.asarray(found)[:, 0], exact, atol=1e-13)


def test_panels_end_where_the_layer_crosses_a_kink() -> None:
    # y' = 1 - 2 y down to y = 1, and y' = -y from there: y = 1/2 + 5/2 exp(-2 tau), and exp(log(5)/2 - tau).
    system = SlowFastSystem(slow={x: y}, fast={y: sp.Min(1, y) - 2 * y}, epsilon=eps)
    (branch,) = solve_critical(system).branches
    found = land(branch.through({"x": 0, "y": 0}), np.zeros(1), np.array([3.0]))
    (kink,) = found.kinks
    assert kink == pytest.approx(np.log(5) / 2, rel=1e-14)
    assert kink in found.panels.ends
    tau = found.panels.tau
    exact = np.where(tau <= kink, 0.5 + 2.5 * np.exp(-2 * tau), np.exp(kink - tau))
    np.testing.assert_allclose(found.samples[:, :, 0], exact, rtol=1e-8, atol=1e-13)
    inner = expand_inner(branch, {"x": 0, "y": 3}, order=4)
    # b_1 is the integral of y, 1 + log(5)/4 and 1.
    assert inner.base["x"] == pytest.approx((0.0, 2 + np.log(5) / 4, 0.0), abs=1e-13)
    with pytest.raises(DeclarationError, match=r"crosses a kink of the field at fast time 0.8047, .* order 2"):
        inner.require(3)


@pytest.mark.exhaustive
def test_base_points_through_kinks_of_f_and_g_are_those_of_shadowing_through_order_two() -> None:
    slow = {x: -x + y + sp.Abs(y - 2) / 3}
    fast = {y: sp.Min(1 + x / 4, y) - 2 * y + x**2 / 5 - y**2 / 20}
    (branch,) = solve_critical(SlowFastSystem(slow=slow, fast=fast, epsilon=eps)).branches
    branch, start = branch.through({"x": 1, "y": 0}), {"x": 1, "y": 3}
    inner = expand_inner(branch, start, order=5)
    assert inner.order == 2
    sizes = (0.02, 0.01)
    exact = [project(branch, start, epsilon=e, numeric=True)["x"] for e in sizes]
    for order in range(3):
        own = [sum(c * e**k for k, c in enumerate(inner.base["x"][: order + 1])) for e in sizes]
        coarse, fine = (abs(a - b) for a, b in zip(own, exact))
        assert np.log2(coarse / fine) == pytest.approx(order + 1, abs=0.05)
    with pytest.raises(DeclarationError, match="known through order 2"):
        project(branch, start, epsilon=0.01, order=2)
    assert project(branch, start, epsilon=0.01, order=1).error == pytest.approx(abs(inner.base["x"][2]) * 1e-4)


def test_a_layer_through_a_jump_is_refused() -> None:
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: -y * (2 + sp.sign(y - 1)) - y**3}, epsilon=eps)
    with pytest.raises(BranchError, match="not smooth there"):
        land(
            solve_critical(system).nearest({"x": 0.0, "y": 0.0}).through({"x": 0, "y": 0}),
            np.zeros(1),
            np.array([3.0]),
        )


def met(slow: sp.Expr, fast: sp.Expr) -> Landing:
    """The layer over x = 1 from y = 5 down to y = 2 x, which meets y = 3 on its way."""
    system = SlowFastSystem(slow={x: slow}, fast={y: fast}, epsilon=eps)
    return land(solve_critical(system).nearest({"x": 1.0, "y": 2.0}), np.array([1.0]), np.array([5.0]))


def test_a_layer_is_cut_where_a_slow_rate_jumps_and_at_kinks() -> None:
    """y - 2 = 3 exp(-tau) is 1 after ln 3; with a kink in g, 2/5 + 13/5 exp(-5 tau/4) is 1 after 4/5 ln(13/3)."""
    plain = -(y - 2 * x)
    jumping = met(1 + sp.sign(y - 3), plain)
    assert jumping.jumps == jumping.kinks == pytest.approx([np.log(3.0)], rel=1e-12)
    assert met(1 + sp.Abs(y - 3), plain).jumps == ()
    assert met(1 + sp.Abs(y - 3), plain).kinks == pytest.approx([np.log(3.0)], rel=1e-12)
    found = met(sp.Integer(1), plain - sp.Abs(y - 3) / 4 + sp.Rational(1, 4))
    assert found.kinks == pytest.approx([0.8 * np.log(13 / 3)], rel=1e-9)


@pytest.mark.parametrize("sign", [-1, 1])
def test_eigenvalues_are_those_of_the_layer_as_it_is_followed(sign: int) -> None:
    found = landing(sign * (y - 2 * x), 5.0, 2.0)
    assert found.eigenvalues == pytest.approx([-1.0])


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_start_outside_the_basin_is_told_which_way_the_layer_was_followed(sign: int) -> None:
    with pytest.raises(BranchError, match="outside the basin") as caught:
        landing(sign * (y**3 - y), -0.5, 1.0)
    assert ("run backward, as the branch repels" in str(caught.value)) is (sign > 0)
    assert "leads to y = -1" in str(caught.value) or "leads to y = 0" in str(caught.value)


def test_a_layer_that_goes_off_to_infinity_is_told_so() -> None:
    with pytest.raises(BranchError, match=r"leads off to infinity after fast time .* Move the start") as caught:
        landing(y**2 - 1, 3.0, -1.0)
    assert "e+" not in str(caught.value)


@pytest.mark.exhaustive
@pytest.mark.parametrize("unit", [1, sp.Rational(1, 10**6), 10**9])
def test_what_rounding_leaves_of_large_variables_is_no_layer_to_be_resolved(unit: sp.Expr) -> None:
    """u rests at the leak z - x of a pump, a small number beside z: its rate is rounding of that of z."""
    z, u = sp.symbols("z u")
    leak, own = sp.Rational(1, 10**6), u * unit
    fast = {z: 3000 * (x - z) - z / 1000, u: (leak * (z - x) - own + leak * own**2) / unit}
    critical = solve_critical(SlowFastSystem(slow={x: -x}, fast=fast, epsilon=eps))
    start = {"x": 1.0, "z": 1.0, "u": 0.0}
    branch = critical.nearest(
        start, region={"x": (0.5, 2), "z": (0, 2), "u": (-1 / float(unit), 1 / float(unit))}
    )
    found = land(branch, np.array([1.0]), np.array([1.0, 0.0]))
    assert len(found.panels.ends) < 200
    assert found.point[1] * float(unit) == pytest.approx(-1e-9 / (3000 + 1e-3), rel=1e-6)


def test_a_term_that_vanishes_beside_others_of_its_order_is_resolved() -> None:
    """A body on a stiff, damped joint follows to every order, and what is left of corrections is rounding."""
    w, z, u = sp.symbols("w z u")
    force, drag = -sp.sin(x), -31 * (z - x) - 9 * (u - w) - (u - w) ** 3
    system = SlowFastSystem(
        slow={x: w, w: force}, fast={u: drag + eps * force, z: u - w + eps * w}, epsilon=eps
    )
    start = {"x": 0.5, "w": 0.0, "u": 0.0, "z": 0.5003}
    branch = solve_critical(system).nearest(start, region=dict.fromkeys(start, (-2, 2)))
    found = expand_inner(branch, start, order=2)
    assert not found.is_exact
