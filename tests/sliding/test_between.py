"""Strips that a step passes over, against where closed forms have them."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.optimize import brentq

from gsp.mechanics import DryFrictionSystem, LagrangianSystem, with_friction
from gsp.sliding.piecewise_field import PiecewiseField
from gsp.sliding.piecewise_run import Side, run_piecewise

x, y, v, xdot, ydot, epsilon = sp.symbols("x y v xdot ydot epsilon")
# In u, the distance from the middle of a strip in its widths: where X+ comes back to the surface.
BACK = brentq(lambda u: u + 1 - 2 * np.arctan(u) - np.pi / 2, 2, 4)


@pytest.mark.parametrize("width", [0.1, 1e-3, 1e-5, 1e-6])
def test_a_run_leaves_a_surface_in_a_strip_far_narrower_than_a_step(width: float) -> None:
    """X+ leads away where |u| < 1, u = (x - sqrt(2))/width, and nothing else depends on x: one step takes all of it."""
    u = (x - sp.sqrt(2)) / sp.nsimplify(width)
    field = PiecewiseField({x: 1, y: -1 + 2 / (1 + u**2)}, {x: 1, y: 1}, y)
    run = run_piecewise(field, start={"x": 0, "y": 0}, span=(0, 3))
    assert [piece.side for piece in run.pieces] == [Side.SLIDING, Side.PLUS, Side.SLIDING]
    assert run.changes == pytest.approx(np.sqrt(2) + width * np.array([-1, BACK]), abs=1e-9)


def sled(grip: sp.Expr) -> DryFrictionSystem:
    """A sled along x whose runners hold a side force of 1."""
    body = LagrangianSystem((xdot**2 + ydot**2) / 2 + y, [x, y], [xdot, ydot])
    return with_friction(body, [ydot], epsilon=epsilon, frame={v: xdot}, law="coulomb", mu=grip, normal=1)


@pytest.mark.parametrize("width", [1, 0.01])
def test_no_slip_fails_on_an_icy_patch_far_narrower_than_a_step(width: float) -> None:
    """mu = 2 - 3/2 exp(-u^2) is 1 at u^2 = ln(3/2)."""
    u = (x - sp.sqrt(50)) / sp.nsimplify(width)
    sharp = sled(2 - sp.Rational(3, 2) * sp.exp(-(u**2)))
    begins = np.sqrt(50) - width * np.sqrt(np.log(1.5))
    start, span = {"x": 0, "y": 0, "v": 1}, (0, 20)
    assert sharp.no_slip(start=start, span=span).time == pytest.approx(begins, abs=1e-9)
    run = sharp.run(start=start, span=span)
    assert [piece.side for piece in run.pieces] == [Side.SLIDING, Side.PLUS, Side.SLIDING]
    assert run.changes[0] == pytest.approx(begins, abs=1e-9)


def test_what_has_no_enclosure_is_said_to_leave_room_for_a_strip() -> None:
    start, span = {"x": 0, "y": 0, "v": 1}, (0, 20)
    rough = sled(2 + sp.Abs(x - 3) / 10).no_slip(start=start, span=span)
    assert rough.holds
    assert "in a narrow strip between two such times is not excluded" in str(rough)
    smooth = sled(2 + sp.sin(x) / 2).no_slip(start=start, span=span)
    assert smooth.is_clear
    assert "strip" not in str(smooth)
