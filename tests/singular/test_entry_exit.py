"""Phi, the integral of the eigenvalue along an orbit, against its closed form: up to where it leaves and beyond."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.errors import DeclarationError, Status
from gsp.singular.passage.delayed_exit import ExitKind
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


def test_a_buffer_point_is_found_far_from_the_origin() -> None:
    # epsilon z' = (t + 2i) z - z |z|^2 + epsilon (1 + t): the turning point t = -2i sets the buffer point t = 2. About
    # the origin z = 0 was off by rounding, which the singular slopes at t = -2i made as large as z.
    far = 10**6
    t, u, v = y - far, x + far, w - far
    square = u**2 + v**2
    system = SlowFastSystem(
        slow={y: 1},
        fast={x: t * u - 2 * v - u * square + epsilon * (1 + t), w: 2 * u + t * v - v * square},
        epsilon=epsilon,
    )
    branch = solve_critical(system).branches[0].through({"y": far - 3, "x": -far, "w": far})
    found = entry_exit(branch, start={"y": far - 3}, region={"y": (far - 4, far + 9)})
    assert found.kind is ExitKind.BUFFER
    assert found.start == {"y": far - 3, "x": -far, "w": far}
    assert dict(found.loss.point) == {"y": far, "x": -far, "w": far}
    assert found.point["y"] == pytest.approx(far + 2, abs=1e-9)
    assert found.t == pytest.approx(5, abs=1e-9)
    with pytest.raises(PassageError, match=rf"does not attract at the start, y = {far + 1},"):
        entry_exit(found.branch, start={"y": far + 1})


def test_a_start_next_to_zero_is_no_reason_to_give_up() -> None:
    # The integral of y - 1 is back at 0 at 2 less the start: a slow time of 100 times the start is not enough.
    (branch,) = solve_critical(SlowFastSystem(slow={y: 1}, fast={x: (y - 1) * x}, epsilon=epsilon)).branches
    found = entry_exit(branch, start={"y": 1e-5})
    assert found.kind is ExitKind.ENTRY_EXIT
    assert found.point["y"] == pytest.approx(2 - 1e-5, abs=1e-12)


def test_a_zero_of_one_slope_is_no_end_of_the_branch() -> None:
    # The Brusselator's rest point u = 1, v = 2 + t has g_y = [[1 + t, 1], [-2 - t, -1]], of determinant 1 and trace t.
    # Elimination divided by 1 + t.
    system = SlowFastSystem(
        slow={y: 1}, fast={x: 1 - (y + 3) * x + x**2 * w, w: (y + 2) * x - x**2 * w}, epsilon=epsilon
    )
    branch = solve_critical(system).branches[0].through({"y": -1, "x": 1, "w": 1})
    found = entry_exit(branch, start={"y": -1})
    assert found.loss.point["y"] == 0.0
    assert found.point["y"] == pytest.approx(1.0, abs=1e-12)


def test_a_region_is_left_where_it_ends_and_a_time_is_kept() -> None:
    # The exit is at y = 1. The ends of panels were told, 0.3 and 0.1 later.
    (branch,) = solve_critical(SlowFastSystem(slow={y: 1}, fast={x: y * x}, epsilon=epsilon)).branches

    def passed(region: tuple[float, float], longest: float = 9.0):
        return entry_exit(branch, start={"y": -1}, region={"y": region}, longest=longest)

    found = passed((-2, 0.5))
    assert (found.kind, found.status) == (ExitKind.NONE, Status.REGION_LEFT)
    assert found.point["y"] == pytest.approx(0.5, abs=1e-9)
    assert passed((-1, 1)).kind is ExitKind.ENTRY_EXIT
    for longest in (1e-9, 0.5, 1.9):
        found = passed((-2, 2), longest)
        assert (found.kind, found.t, found.status) == (ExitKind.NONE, longest, Status.TOO_MANY_STEPS)
    with pytest.raises(
        DeclarationError, match=r"the start, y = -1, x = 0, lies outside the region. Got y in \[0, 2\]"
    ):
        passed((0, 2))
    with pytest.raises(DeclarationError, match="amount is a rise of Phi"):
        passed((-2, 2)).time_of_rise("a")
