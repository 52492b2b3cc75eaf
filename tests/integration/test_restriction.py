"""What a reduced flow is written as, by its length and against implicit differentiation of the critical manifold."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.algebra.ring import LocalisedRing
from gsp.critical.critical_manifold import solve_critical
from gsp.integration.restriction import restrict
from gsp.lowering.compiled_flow import compile_flow
from gsp.slow.series import expand
from gsp.systems.system import SlowFastSystem


@pytest.mark.exhaustive
def test_rates_with_long_determinants_are_written_as_programs_and_are_those_of_m0() -> None:
    """Five fast variables in exponentials: det g_y has some thousand terms, and the program some hundred steps."""
    x, epsilon = sp.symbols("x epsilon")
    y = sp.symbols("y1:6")
    bumps = [sp.exp(-((sum(y[(i + j) % 5] for j in range(3)) + (i + 1) * x) ** 2) / 20) for i in range(5)]
    fast = {
        y[i]: -3 * y[i] / 2 + sum(y[j] * sp.Rational(i - j, 25) for j in range(5)) + x / 2 + bumps[i] / 5
        for i in range(5)
    }
    system = SlowFastSystem(slow={x: -x + y[0] / 3}, fast=fast, epsilon=epsilon)
    start = {"x": 0.5, **{s.name: 0.3 for s in y}}
    branch = solve_critical(system).nearest(start)
    flow = restrict(expand(branch, order=0, symbolic=False))
    parts = {part for rate in flow.rates for part in sp.preorder_traversal(rate)}
    assert len(parts) < 2000

    place = np.concatenate([[0.5], branch.points(np.array([[0.5]]))[0]])
    numbers = dict(zip(system.states, place))
    g_x, g_y = (sp.Matrix(list(fast.values())).jacobian(list(s)).xreplace(numbers) for s in ([x], y))
    slope = -np.linalg.solve(np.array(g_y, dtype=float), np.array(g_x, dtype=float))[:, 0]
    rate = -place[0] + place[1] / 3
    assert {s.name for s in flow.states} == {"x", *(f"{s.name}0" for s in y)}
    by_name = {"x": place[0], **{f"{s.name}0": v for s, v in zip(y, place[1:])}}
    found = compile_flow(flow).rates(np.array([by_name[s.name] for s in flow.states]), np.array([0.1]))
    expected = {"x": rate, **{f"{s.name}0": v * rate for s, v in zip(y, slope)}}
    assert found == pytest.approx([expected[s.name] for s in flow.states], rel=1e-9)


def test_flows_of_many_orders_are_written_in_the_work_of_the_highest(monkeypatch: pytest.MonkeyPatch) -> None:
    x, y, epsilon = sp.symbols("x y epsilon")
    system = SlowFastSystem(slow={x: -y}, fast={y: x / (1 + x) - y}, epsilon=epsilon)
    series = expand(solve_critical(system).branches[0], order=6, symbolic=False)
    counted: list[int] = []
    horner = LocalisedRing.horner
    monkeypatch.setattr(LocalisedRing, "horner", lambda *given: counted.append(1) or horner(*given))
    for order in range(7):
        restrict(series, order=order)
    # x and y of M0, and h_k and f_k.
    assert len(counted) <= 2 + 2 * 7
