"""Sheets followed in compiled code: onto the point in closed form, and given up where that cannot be trusted."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.branch import Branch
from gsp.kernels.sheets import follow_sheet
from gsp.systems.system import SlowFastSystem

u, v, x, y, eps = sp.symbols("u v x y epsilon")


def branch(fast: dict, seed: dict[str, float], slow: tuple = (u, v)) -> Branch:
    system = SlowFastSystem(slow=dict.fromkeys(slow, sp.Integer(1)), fast=fast, epsilon=eps)
    return Branch(system, tuple(fast.values()), None).through(seed)


def followed(sheet: Branch, target: list[float], *, pieces: int = 1, rounds: int = 40) -> np.ndarray | None:
    assert sheet.seed is not None
    x0, y0 = (np.array(part, dtype=float) for part in sheet.seed)
    p = np.array(sheet._own.values, dtype=float)
    reached = follow_sheet(tuple(sheet._sheet[:3]), p, x0, y0, np.array(target), pieces, 1e-12, rounds)
    return y0 if reached else None


def test_a_linear_sheet_is_met_by_the_first_step_and_seen_to_be_by_the_first_correction() -> None:
    sheet = branch({x: 2 * x + y - u + 3 * v, y: x - 4 * y + 5 * u + v}, {"u": 0, "v": 0, "x": 0, "y": 0})
    expected = np.linalg.solve([[2.0, 1.0], [1.0, -4.0]], -np.array([[-1.0, 3.0], [5.0, 1.0]]) @ [0.7, -0.4])
    for pieces in (1, 3):
        assert followed(sheet, [0.7, -0.4], pieces=pieces, rounds=1) == pytest.approx(expected, rel=1e-13)


def test_a_curved_sheet_is_followed_in_steps_that_are_short_enough() -> None:
    # x = u^2 and y = u^2 v; both rates depend on all four variables.
    first, second = u**2 - x, y - x * v
    sheet = branch({x: first + second / 2, y: 3 * second - first}, {"u": 1, "v": 1, "x": 1, "y": 1})
    assert followed(sheet, [1.5, 0.5], pieces=8, rounds=6) == pytest.approx([2.25, 1.125], rel=1e-12)
    # From u = 1 to 3 the tangent leads to x = 5 in place of 9.
    assert followed(sheet, [3.0, 1.0]) is None
    assert followed(sheet, [3.0, 1.0], pieces=16) == pytest.approx([9.0, 9.0], rel=1e-12)


def test_no_sheet_is_followed_past_its_fold_nor_by_steps_that_may_lead_to_another() -> None:
    sheet = branch({y: y**2 - u}, {"u": 1, "y": 1}, slow=(u,))
    assert followed(sheet, [-0.5], pieces=64) is None
    assert followed(sheet, [0.01]) is None
    assert followed(sheet, [0.01], pieces=64) == pytest.approx([0.1], rel=1e-9)


def test_many_points_are_reached_each_for_itself() -> None:
    sheet = branch({y: y**2 - u}, {"u": 1, "y": 1}, slow=(u,))
    found = sheet.over_each(np.array([[0.5], [1.2], [-0.5], [0.3]]))
    assert found[:, 0] == pytest.approx([0.5**0.5, 1.2**0.5, np.nan, 0.3**0.5], rel=1e-12, nan_ok=True)
