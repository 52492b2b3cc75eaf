"""Machine code for what is finite and made of parts that overflow."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.algebra.differentiation import derivative
from gsp.algebra.languages import PYTHON
from gsp.algebra.printing import Printer
from gsp.errors import Status
from gsp.kernels import jets
from gsp.lowering.compiled_function import compile_function
from gsp.lowering.tape import write_tape

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
SUMS = {
    "softplus": sp.log(1 + sp.exp(U)),
    "softplus below": sp.log(3 + x**2 + 2 * sp.exp(-U)),
    "two sums": (x + 10 * sp.exp(U)) / (1 + sp.exp(U)),
    "sums of powers": sp.exp(U) * (x + 10 * sp.exp(U) + 1) / (1 + sp.exp(U)) ** 3,
    "tanh written out": (sp.exp(U) - sp.exp(-U)) / (sp.exp(U) + sp.exp(-U)),
    "cosh in both": (x + 10 * sp.cosh(U)) * sp.sinh(U) / sp.cosh(U) ** 3,
    "within roots": (x + sp.sqrt(2 + sp.exp(U / 9))) / (1 + sp.sqrt(1 + sp.exp(U / 9))),
    "logarithm of roots": sp.log(1 + sp.sqrt(2 + sp.exp(U / 9))),
    "roots": (sp.exp(U / 2) - sp.exp(U / 3)) / (1 + sp.exp(U)),
    "one of two": sp.exp(U - 3) * (2 + sp.exp(U)) / (1 + sp.exp(U)) ** 2,
}
PLACES = (sp.Rational(1, 20), sp.Rational(49, 100), HALF, sp.Rational(51, 100), sp.Rational(19, 20))


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


@pytest.mark.parametrize("part", SUMS.values(), ids=SUMS)
def test_quotients_and_logarithms_of_sums_of_exponentials_have_their_values_on_every_way(part) -> None:
    system = gsp.SlowFastSystem(slow={x: part}, fast={y: -y}, epsilon=eps)
    tape = write_tape(system)
    steps, (result,) = Printer(PYTHON, {x: "x"}).steps([part], iter("abcdefghijk"))
    code = "".join(f"{name} = {line}\n" for name, line in steps) + f"value = {result}"
    for at in PLACES:
        exact = float(sp.N(part.subs(x, at), 30, maxn=4000))
        slope = float(sp.N(sp.diff(part, x).subs(x, at), 30, maxn=4000))
        close = pytest.approx(exact, rel=1e-12, abs=sys.float_info.min)
        assert compile_function([part], arguments=[x])([float(at)], [np.nan])[0] == close
        names = {"np": np, "x": float(at)}
        exec(code, names)
        assert names["value"] == close
        coefficients = np.zeros((len(tape.instructions), 2))
        coefficients[:2] = [[float(at), 1.0], [0.0, 0.0]]
        constants = tape.constants(np.array([0.01]))
        for k in (0, 1):
            jets.values(tape.instructions, constants, coefficients, k, 2)
        assert coefficients[tape.rates[0], 0] == close
        assert coefficients[tape.rates[0], 1] == pytest.approx(slope, rel=1e-9, abs=1e-11)


@pytest.mark.parametrize("name", ["gate", "gate, the other way", "cosh", "softplus"])
def test_series_and_reduced_flows_pass_where_exponentials_overflow(name: str) -> None:
    gate = {**GATES, **SUMS}[name]
    system = gsp.SlowFastSystem(slow={x: 1 - x * y / 100}, fast={y: -y + gate}, epsilon=eps)
    series = gsp.expand(gsp.solve_critical(system).branches[0], order=1)
    first = -sp.diff(gate, x) * (1 - x * gate / 100)
    for at in PLACES:
        exact = [float(sp.N(h.subs(x, at), 30, maxn=4000)) for h in (gate, 1e-6 * first)]
        assert series.terms({"x": float(at)}, epsilon=1e-6)[:, 0] == pytest.approx(exact, rel=1e-9, abs=1e-13)
    for start in (-1, 1):
        run = gsp.integrate(gsp.restrict(series, order=0), start={"x": start}, span=(0, 1e-3), epsilon=1e-6)
        assert run.status is Status.SUCCESS
        assert np.isfinite([run["x"][-1], run["y"][-1]]).all()


def test_quotients_of_exponentials_keep_their_digits_in_any_unit() -> None:
    # A diode whose voltage is 1e-9: the power of exp(x) would be off by 2e9 times its rounding.
    steep = sp.exp(2000000000 * x)
    part = (1 - steep) * sp.exp(3000000000 * x) / (steep + HALF)
    at = 1.21e-9
    exact = float(sp.N(part.subs(x, sp.Rational(at)), 30))
    assert compile_function([part], arguments=[x])([at], [np.nan])[0] == pytest.approx(exact, rel=1e-14)
    # In steps of collocation, too.
    flow = gsp.VectorField({x: part}, epsilon=None)
    run = gsp.integrate(flow, start={"x": at}, span=(0, 1e-12), epsilon=None, rtol=1e-12, atol=1e-22)
    assert run.stats.steps < 100


@pytest.mark.parametrize("shift", [1, sp.Rational(1, 3), sp.Rational(-7, 9)])
def test_a_logarithm_of_a_sum_just_above_one_keeps_its_digits(shift) -> None:
    # Below zero by its rounding it has no root.
    part = sp.log(1 + sp.exp(50 * (x - shift))) ** sp.Rational(3, 2)
    at = np.linspace(-19.0, -2.0, 41)
    exact = [float(sp.exp(75 * (sp.Rational(v) - shift)).evalf(20)) for v in at]
    found = compile_function([part], arguments=[x])(at[:, None], [np.nan])[:, 0]
    assert found == pytest.approx(exact, rel=1e-11, abs=1e-300)
    steps, (result,) = Printer(PYTHON, {x: "x"}).steps([part], iter("abcdefghijk"))
    names = {"np": np, "x": at}
    exec("".join(f"{name} = {line}\n" for name, line in steps) + f"value = {result}", names)
    assert names["value"] == pytest.approx(exact, rel=1e-11, abs=1e-300)


@pytest.mark.parametrize("within", [sp.log(1 + sp.exp(U)), 1 / (1 + sp.log(2 + sp.exp(U)) ** 2)])
def test_logarithms_within_quotients_of_sums_of_exponentials_are_bounded_in_texts(within) -> None:
    part = (x + within) * sp.exp(U) / (1 + sp.exp(U))
    steps, (result,) = Printer(PYTHON, {x: "x"}).steps([part], iter("abcdefghijklmnop"))
    code = "".join(f"{name} = {line}\n" for name, line in steps) + f"value = {result}"
    for at in PLACES:
        names = {"np": np, "x": float(at)}
        exec(code, names)
        assert names["value"] == pytest.approx(float(sp.N(part.subs(x, at), 30, maxn=4000)), rel=1e-12)
