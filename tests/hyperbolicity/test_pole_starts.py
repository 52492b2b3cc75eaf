"""Where poles are sought from: the samples nearest to a denominator's zero, or those whose tangents lead to one."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.critical.sampling import Sampler
from gsp.hyperbolicity.losses.poles import (
    MOST_STARTS,
    REACH,
    _is_pole,
    _nearest,
    _next_to_zeros,
    denominators,
    is_above_zero,
)
from gsp.systems.system import SlowFastSystem

u, v, y, eps = sp.symbols("u v y epsilon")


def sheet(slow: dict, graph: sp.Expr, box: dict) -> tuple[Sampler, np.ndarray]:
    system = SlowFastSystem(slow=slow, fast={y: graph - y}, epsilon=eps)
    sampler = Sampler(solve_critical(system).branches[0])
    return sampler, sampler.points(sampler.grid(box), box)[0]


LINE = {"u": (0.0, 4.0)}


def test_samples_from_which_the_tangent_leads_to_a_zero_within_reach_are_chosen() -> None:
    sampler, z = sheet({u: sp.Integer(1)}, u**2, LINE)
    step, notes = 4.0 / 256, []
    # u - 2 is a sample's; y - 1 has its zero at u = 1, where it falls by 2 for each step of u; u + 1 has none.
    found = _next_to_zeros(sampler, [u - 2, y - 1, u + 1, u - 2 - step / 2], z, 99, LINE, notes)
    assert found[0][:, 0] == pytest.approx(2 + step * np.arange(-REACH, REACH + 1))
    assert found[1][:, 0].tolist() == z[np.abs(z[:, 1] - 1) <= REACH * 2 * z[:, 0] * step, 0].tolist()
    assert len(found[2]) == 0
    assert found[3][:, 0] == pytest.approx(2 + step * np.arange(-1, 3))
    assert notes == []
    few = _next_to_zeros(sampler, [u - 2, u - 3], z, 3, LINE, notes)
    assert [part[:, 0].tolist() for part in few] == [pytest.approx([c - step, c, c + step]) for c in (2, 3)]
    assert _next_to_zeros(sampler, [u - 2], z, 0, LINE, notes)[0].shape == (0, 2)


def test_reaches_add_up_over_the_slow_variables_each_in_its_own_spacing() -> None:
    box = {"u": (0.0, 32.0), "v": (0.0, 3.2)}
    sampler, z = sheet({u: sp.Integer(1), v: u}, u + v, box)
    (found,) = _next_to_zeros(sampler, [u + 10 * v - 1], z, 10**6, box, [])
    # One step of either changes it by 1, so that 2 + 2 may be missing: the corner's lattice up to the sum 5.
    assert len(found) == 21
    expected = z[np.abs(z[:, 0] + 10 * z[:, 1] - 1) <= 2 * REACH + 1e-9]
    assert sorted(map(tuple, found.tolist())) == sorted(map(tuple, expected.tolist()))


def test_of_too_many_starts_the_nearest_are_kept_and_the_others_noted() -> None:
    sampler, z = sheet({u: sp.Integer(1)}, u**2, LINE)
    step = 4.0 / 256
    # Thirty zeros on samples, of which each has five within reach.
    divisors = [u - sp.Rational(1, 64) * k for k in range(20, 50)]
    notes: list[str] = []
    found = _next_to_zeros(sampler, divisors, z, 5, LINE, notes)
    assert step == 1 / 64
    assert all(len(part) >= 1 for part in found)
    assert (
        np.abs(np.concatenate(found)[:, 0][:, None] - np.arange(20, 50) / 64).min(axis=1) < 1e-12
    ).sum() >= 30
    assert len(notes) == 1
    assert f"from {MOST_STARTS} samples, and 150 lie next to" in notes[0]
    assert "0 of 30 denominators were not followed" in notes[0]


def test_the_nearest_samples_of_each_denominator_are_its_starts() -> None:
    sampler, z = sheet({u: sp.Integer(1)}, u**2, LINE)
    first, second = _nearest(sampler, [u - 1, y - 4], z, 3)
    assert sorted(first[:, 0]) == pytest.approx([1 - 1 / 64, 1, 1 + 1 / 64])
    assert sorted(second[:, 0]) == pytest.approx([2 - 1 / 64, 2, 2 + 1 / 64])
    assert first[0, 0] == 1.0


@pytest.mark.parametrize(
    ("values", "is_one"),
    [
        (lambda z: 1 / z[:, :1], True),
        (lambda z: 1 / z[:, :1] ** 2, True),
        (lambda z: np.sin(z[:, :1]) / z[:, :1], False),
        (lambda z: np.log(np.abs(z[:, :1])), False),
        (lambda z: 1 + z, False),
    ],
)
def test_a_pole_is_where_values_grow_as_it_is_approached(values, is_one: bool) -> None:
    assert _is_pole(values, np.zeros(2), np.ones(2), 100.0) is is_one


@pytest.mark.parametrize(
    ("expression", "is_positive"),
    [
        (1 + y**2, True), (y**2, False), (y**2 + u**2, False), (y**2 + sp.Rational(1, 10**9), True), (y**2 - 1, False),
        (1 + y, False), (1 + y**3, False), (1 + sp.sqrt(y), True), (2 + sp.Abs(y) * u**2, True), (sp.exp(-y), True),
        (sp.cosh(y) * sp.exp(u), True), ((1 + y**2) ** 3, True), (sp.Integer(3), True), (-sp.Integer(3), False),
        (3 * (1 + y**2), True), (-3 * (1 + y**2), False), (1 - y**2, False), (sp.sin(y) + 2, False), (1 + y**-2, True),
        (1 + y ** sp.Rational(5, 2), True), ((1 + y**2) ** sp.Rational(1, 3), True), (1 + sp.tanh(y), False),
        (1 + u**2 * y**4 + sp.exp(-y), True), (u * y + 1, False), (1 + u**y, False),
    ],
)  # fmt: skip
def test_what_is_positive_by_the_signs_of_its_parts_needs_no_search(
    expression: sp.Expr, is_positive: bool
) -> None:
    assert is_above_zero(expression) is is_positive


def test_denominators_are_factors_that_depend_on_the_variables_each_once() -> None:
    rate = u / ((y - 1) * (u + 2)) + 3 / (y - 1) ** 2 + sp.exp(-u) / 5 + 1 / sp.sin(y) + v / 7
    found = denominators([rate, 1 / (u + 2)], (y,))
    assert set(found) == {y - 1, sp.sin(y)}
    assert len(found) == 2
    assert set(denominators([rate], (u, y))) == {y - 1, u + 2, sp.sin(y)}
    assert denominators([y + u, sp.exp(-y)], (u, y)) == []
