"""Phi, the integral of the eigenvalue along an orbit, against its closed form: up to where it leaves and beyond."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.singular.passage.entry_exit import entry_exit
from gsp.singular.passage.failure import PassageError
from gsp.systems.system import SlowFastSystem

w, x, y, epsilon = sp.symbols("w x y epsilon")


@pytest.mark.parametrize(
    ("rate", "integral"),
    [
        (y + y**2, lambda y: y**2 / 2 + y**3 / 3),
        # In panels, several of them beyond the exit.
        (
            y * (2 + sp.cos(40 * y)),
            lambda y: y**2 + y * np.sin(40 * y) / 40 + np.cos(40 * y) / 1600,
        ),
    ],
)
def test_phi_is_its_closed_form_also_beyond_the_exit(rate: sp.Expr, integral) -> None:
    """y' = 1 from -1/2: charts show Phi beyond the exit, and how far rounding carries an orbit is read off it."""
    (branch,) = solve_critical(SlowFastSystem(slow={y: 1}, fast={x: rate * x}, epsilon=epsilon)).branches
    found = entry_exit(branch, start={"y": -0.5})
    place = found.times - 0.5
    assert (found.times > found.t).sum() > 5
    assert found.phi == pytest.approx(integral(place) - integral(-0.5), abs=1e-11)


@pytest.mark.parametrize("start", [-1.0, -0.7])
@pytest.mark.parametrize("rate", [-(y**2), sp.cos(y) - 1])
def test_an_eigenvalue_that_only_touches_zero_may_let_orbits_leave(start: float, rate: sp.Expr) -> None:
    # x^2 + rate x + epsilon has no root beside y = 0, so that orbits are at x = 1 before: no verdict is given. With
    # the other sign there are two roots throughout, and orbits stay.
    def passed(push: int):
        system = SlowFastSystem(slow={y: 1}, fast={x: x**2 + rate * x + push * epsilon}, epsilon=epsilon)
        return entry_exit(solve_critical(system).nearest({"x": 0, "y": start}), start={"y": start}, longest=2.0)

    with pytest.raises(PassageError, match="comes up to 0 near y = 0, x = 0 and falls again"):
        passed(1)
    assert passed(0).losses == passed(-1).losses == ()


def test_a_push_of_second_order_lets_orbits_leave_after_a_logarithm_more() -> None:
    # w = x - y^2 - 2 epsilon has epsilon w' = (y - 4 epsilon) w - w^2 - 4 epsilon^2.
    system = SlowFastSystem(slow={y: 1}, fast={x: (x - y**2) * (y - x + y**2)}, epsilon=epsilon)
    found = entry_exit(solve_critical(system).nearest({"x": 1, "y": -1}), start={"y": -1})
    assert found.loss.coefficients["rho_k"] == pytest.approx(-4, rel=1e-2)
    assert "O((epsilon ln 1/epsilon)^(1/2))" in found.message


@pytest.mark.parametrize(("moved", "push"), [((0, 0), epsilon), (((y**2 - 1) / 2, y), 0)])
def test_a_turning_point_at_which_nothing_is_pushed_is_no_buffer_point(moved: tuple, push: sp.Expr) -> None:
    # epsilon z' = (y + i)(z - moved + push): z = moved - push, or moved + epsilon, is invariant and analytic, so that
    # orbits stay until the integral of y is back at 0; the buffer point of the turning point -i would be y = 1.
    u, v = x - moved[0] + push, w - moved[1]
    system = SlowFastSystem(slow={y: 1}, fast={x: y * u - v, w: u + y * v}, epsilon=epsilon)
    found = entry_exit(solve_critical(system).branches[0], start={"y": -2})
    assert found.point["y"] == pytest.approx(2.0)
    assert found.buffer is None
