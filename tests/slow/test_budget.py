"""Exact series stop within a budget of terms, and say where they stopped and what helps."""

import numpy as np
import pytest
import sympy as sp

from gsp.algebra import ring
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import BudgetError
from gsp.scenes.study import study_of
from gsp.slow.expansion import Expansion
from gsp.slow.series import expand
from gsp.systems.system import SlowFastSystem
from tests.cases import sampled
from tests.random_systems import random_scene

s, c, k, m, epsilon = sp.symbols("s c k m epsilon")


@pytest.mark.exhaustive
def test_a_high_power_with_parameters_has_no_polynomials_and_the_terms_and_remedies_are_told():
    system = SlowFastSystem(
        slow={s: -s + (s + c + k + m) ** 100}, fast={c: s - c}, parameters={k: 1, m: 2}, epsilon=epsilon
    )
    (branch,) = solve_critical(system).branches
    with pytest.raises(BudgetError, match=r"order 3 was reached through order 0.* [\d,]+ .*terms") as caught:
        Expansion(branch).through(3)
    assert "take order 0 or less" in str(caught.value)
    assert "values of the 2 parameters" in str(caught.value)
    # On c = s: the terms of (2 s + k + m)^100, and s.
    assert expand(branch, order=0).sizes == (sp.binomial(102, 2) + 1,)
    # As a program it has: h_1 = -f_0 on c = s.
    series = expand(branch)
    assert series.is_program
    assert series.terms({"s": -1.2}, 1.0)[:2, 0] == pytest.approx(
        [-1.2, -1.2 - (2 * -1.2 + 3.0) ** 100], rel=1e-12
    )


@pytest.mark.exhaustive
def test_series_with_functions_whose_polynomials_are_too_long_are_programs_with_the_same_terms():
    rates = {
        c: -3 * c + s - 2 * k / 3 + sp.tanh(7 * s / 9 + c / 2 + 6 * k / 7) / 2,
        k: -3 * k - s / 5 + c / 4 + sp.tanh(s / 4 - c + 2 * k) / 2,
    }
    system = SlowFastSystem(slow={s: c - s + k / 3 + sp.tanh(s + c - k / 5)}, fast=rates, epsilon=epsilon)
    (branch,) = solve_critical(system).branches
    series = expand(branch, order=4)
    assert series.is_program
    assert not expand(branch, order=3).is_program
    # The defect falls with epsilon^5.
    sizes = [np.linalg.norm(series.residual({"s": 0.7}, small, near=[0.3, 0.0])) for small in (2e-2, 1e-2)]
    assert sizes[0] / sizes[1] == pytest.approx(2**5, rel=0.02)
    # The polynomials of the orders that have them.
    terms = [e.terms({"s": 0.7}, 1.0, near=[0.3, 0.0])[:3] for e in (series, expand(branch, order=2))]
    np.testing.assert_allclose(*terms, rtol=1e-9)


@pytest.mark.exhaustive
def test_twenty_quadratic_fast_variables_have_a_series_by_programs_alone():
    y = sp.symbols("y:20")
    fast = {
        y[i]: s - 3 * y[i] + y[(i + 1) % 20] ** 2 / 10 + y[(i + 7) % 20] * y[(i + 3) % 20] / 20
        for i in range(20)
    }
    system = SlowFastSystem(slow={s: -s}, fast=fast, epsilon=epsilon)
    (branch,) = solve_critical(system).branches
    series = expand(branch, order=1)
    assert series.is_program
    # All components are alike: h = 3 y - 3 y^2/20 = s, and g_y h_1 = -Dh_0 s with the row sum -3 + 3 y/10.
    h = np.roots([-0.15, 3.0, -0.4])[-1]
    slope = 1.0 / (3.0 - 0.3 * h)
    terms = series.terms({"s": 0.4}, 1.0, near=np.full(20, 0.1))
    np.testing.assert_allclose(terms, [[h] * 20, [slope * 0.4 * slope] * 20], rtol=1e-13)
    with pytest.raises(BudgetError, match="straight-line programs"):
        _ = series._h[0][1].numerator


def test_the_work_of_a_series_is_counted_and_a_lower_order_takes_less(monkeypatch):
    system = SlowFastSystem(
        slow={s: -s + c * k}, fast={c: s - (s + k) * c - c**3}, parameters={k: 1}, epsilon=epsilon
    )
    (branch,) = solve_critical(system).branches
    spent = [expand(branch, order=order).chart.ring.spent for order in (1, 2, 3)]
    assert 0 < spent[0] < spent[1] < spent[2]
    monkeypatch.setattr(ring, "BUDGET", spent[1])
    assert expand(branch, order=2).order == 2
    with pytest.raises(BudgetError, match="reached through order 2"):
        Expansion(branch).through(3)


def test_a_series_that_cannot_be_looked_ahead_of_is_evaluated_with_the_orders_it_has(monkeypatch):
    system = SlowFastSystem(slow={s: -s}, fast={c: s - c - c**3}, epsilon=epsilon)
    (branch,) = solve_critical(system).branches
    series = expand(branch, order=2)
    free = series.evaluate({"s": 0.1}, 0.01, near=[0.1])
    monkeypatch.setattr(ring, "BUDGET", series.chart.ring.spent)
    bounded = expand(branch, order=2)
    assert bounded.evaluate({"s": 0.1}, 0.01, near=[0.1]) == pytest.approx(free, rel=1e-14)


@pytest.mark.parametrize("seed", sampled(range(4), always=[2]))
def test_random_systems_of_two_kinds_of_functions_expand(seed):
    branch = study_of(random_scene(seed)).branch
    assert expand(branch, order=4, symbolic=False).order == 4


def test_where_a_budget_ended_is_known_and_the_orders_before_it_are_there(monkeypatch):
    system = SlowFastSystem(
        slow={s: -s + c * k}, fast={c: s - (s + k) * c - c**3}, parameters={k: 1}, epsilon=epsilon
    )
    (branch,) = solve_critical(system).branches
    free = Expansion(branch)
    chart, rows, _ = free.through(2)
    assert free.end == (None, "")
    monkeypatch.setattr(ring, "BUDGET", expand(branch, order=2).chart.ring.spent)
    bounded = Expansion(branch)
    for order in (3, 4):
        with pytest.raises(BudgetError, match=f"through order {order} was reached through order 2"):
            bounded.through(order)
        assert bounded.end[0] == 2
        assert "terms" in bounded.end[1]
    for order in (2, 1, 0):
        other, own, _ = bounded.through(order)
        for row, known in zip(own, rows):
            assert [str(other.ring.to_sympy(e)) for e in row] == [
                str(chart.ring.to_sympy(e)) for e in known[: order + 1]
            ]
