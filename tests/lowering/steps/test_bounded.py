"""Machine code for what is finite and made of parts that overflow."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.algebra.differentiation import derivative
from gsp.errors import Status
from gsp.lowering.compiled_function import compile_function

x, y, eps = sp.symbols("x y epsilon")
HALF = sp.Rational(1, 2)
U = 2000 * (x - HALF)
GATES = {
    "gate": 1 / (1 + sp.exp(-U)),
    "gate, the other way": sp.exp(U) / (1 + sp.exp(U)),
    "in decimals": 1 / (1 + sp.Float("0.7") * sp.exp(U)) ** 2,
    "with a factor": x * sp.exp(U) / (2 + 3 * sp.exp(U)),
    "between two": sp.exp(-U) / (1 + sp.exp(-U)) ** 2,
    "cosh": 1 / sp.cosh(U),
}


@pytest.mark.parametrize("gate", GATES.values(), ids=GATES)
@pytest.mark.parametrize("slopes", [0, 1, 2])
def test_gates_and_their_slopes_have_their_values_where_exponentials_overflow(gate, slopes) -> None:
    expression = gate
    for _ in range(slopes):
        expression = derivative(expression, x)
    function = compile_function([expression], arguments=[x])
    for at in (sp.Rational(1, 20), sp.Rational(49, 100), sp.Rational(51, 100), sp.Rational(19, 20)):
        exact = sp.N(expression.subs(x, at), 60, maxn=4000)
        (found,) = function([float(at)], [np.nan])
        # The argument of exp is rounded by 2000 units in the last place, and sums of slopes by their largest term.
        assert found == pytest.approx(float(exact), rel=1e-10, abs=1e-14 * 2000.0**slopes)


@pytest.mark.parametrize("name", ["gate", "gate, the other way", "cosh"])
def test_runs_and_layers_pass_where_exponentials_overflow(name: str) -> None:
    system = gsp.SlowFastSystem(slow={x: 1 - y}, fast={y: -y + GATES[name]}, epsilon=eps)
    start = {"x": 0, "y": 0.5}
    run = gsp.integrate(system, start=start, span=(0, 0.4), epsilon=0.01)
    # No gate is open before x = 0.49: y = exp(-t/epsilon)/2 and x = t - epsilon (1/2 - y).
    assert run.status is Status.SUCCESS
    assert run.at(0.4)[0] == pytest.approx(0.395, abs=1e-6)
    base = gsp.project(gsp.expand(gsp.solve_critical(system).branches[0], order=1), start, epsilon=0.01)
    assert base["x"] == pytest.approx(-0.005, abs=1e-12)


def test_a_formula_of_the_critical_manifold_that_overflows_is_no_loss_of_hyperbolicity() -> None:
    # g_y = -sqrt(1 - x gate) is -1 at the start, and both formulas hold exp(1000).
    system = gsp.SlowFastSystem(slow={x: 1}, fast={y: -y + x + y**2 * GATES["gate"] / 4}, epsilon=eps)
    for branch in gsp.solve_critical(system).branches:
        flow = gsp.restrict(gsp.expand(branch, order=0), order=0)
        run = gsp.integrate(flow, start={"x": 0}, span=(0, 0.9), epsilon=0.01)
        assert run.status is Status.NON_FINITE, run.message
