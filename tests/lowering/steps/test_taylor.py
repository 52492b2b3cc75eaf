"""Taylor series as machine code, and the integrator that steps by them."""

import ctypes
import math
from typing import NamedTuple

import numpy as np
import pytest
import sympy as sp

from gsp.errors import GspError, Status, UnsupportedFunctionError
from gsp.integration.ensemble import integrate_many
from gsp.integration.events import Event
from gsp.integration.methods import taylor_order
from gsp.integration.trajectory import Method, integrate
from gsp.kernels import ledger
from gsp.kernels.taylor import TAIL
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.lowering.steps.flow_code import FlowCode
from gsp.lowering.steps.taylor import TaylorCode, dense_rows, has_parts
from gsp.systems.system import VectorField
from tests.cases import thinned

x, y, u, v, k, t, epsilon = sp.symbols("x y u v k t epsilon")
ORDER = 12


def called(address: int, number: float, z, p, size: int) -> np.ndarray:
    """What the compiled function writes into `size` doubles."""
    pointer = ctypes.POINTER(ctypes.c_double)
    function = ctypes.CFUNCTYPE(None, ctypes.c_double, pointer, pointer, pointer)(address)
    out = np.full(size, np.nan)
    arrays = [np.ascontiguousarray(array, dtype=float) for array in (z, p, out)]
    function(number, *(array.ctypes.data_as(pointer) for array in arrays))
    return arrays[-1]


class Code(NamedTuple):
    """What a program holds."""

    expand: int
    advance: int
    interpolate: int
    order: int
    stride: int


def expansion(field: VectorField, start, *, order=ORDER, scale=1.0, value=None) -> tuple[Code, np.ndarray]:
    """The code, and what `expand` makes at a start."""
    code = Code(*compile_flow(field).taylor_program(order).tolist()[ledger.CODE :])
    size = (order + 1) * code.stride + TAIL
    return code, called(code.expand, scale, [*start, 1e-8, 1e-10], parameter_vector(field, value), size)


def series(field: VectorField, start, **options) -> np.ndarray:
    """Coefficients (n, order + 1)."""
    code, block = expansion(field, start, **options)
    return block[: (code.order + 1) * code.stride].reshape(-1, code.stride)[:, : len(field.states)].T


# Coefficients


def test_the_series_of_the_exponential_function_and_of_a_pole():
    found = series(VectorField({x: x, y: y**2}, epsilon=None), [1, 1])
    np.testing.assert_allclose(found[0], [1 / math.factorial(j) for j in range(ORDER + 1)], rtol=1e-15)
    np.testing.assert_allclose(found[1], np.ones(ORDER + 1), rtol=1e-14)


@pytest.mark.parametrize(
    "expression",
    thinned(
        [
            *(f(x) for f in (sp.exp, sp.log, sp.sqrt, sp.sin, sp.cos, sp.tan, sp.sinh, sp.cosh, sp.tanh)),
            *(f(x) for f in (sp.asin, sp.acos, sp.atan, sp.asinh, sp.atanh, sp.erf)),
            sp.acosh(x + 1),
            *(x**exponent for exponent in (5, -3, sp.Rational(7, 3), sp.Rational(-3, 2), sp.pi, x)),
            2**x,
            (1 + x**2) / (2 - sp.sin(x)) - 3 / x,
            sp.exp(-(sp.sin(x) ** 2)) * sp.tanh(x) / (1 + x) ** 2,
            (x - 1) ** 3 * sp.Rational(1, 7) - x + sp.E,
        ],
        5,
    ),
    ids=str,
)
def test_every_function_has_the_series_of_its_derivatives(expression):
    """x' = 1 and y' = F(x): the coefficients of F are k + 1 times the next of y."""
    order, scale = 8, 0.5
    found = series(
        VectorField({x: sp.Integer(1), y: expression}, epsilon=None), [0.4, 0.0], order=order, scale=scale
    )
    exact = [
        float(sp.diff(expression, x, j).subs(x, sp.Rational(2, 5)).evalf(30) / math.factorial(j))
        for j in range(order)
    ]
    j = np.arange(order)
    np.testing.assert_allclose(found[1, 1:] * (j + 1) / scale ** (j + 1), exact, rtol=2e-12, atol=1e-13)


@pytest.mark.parametrize("n", range(1, 10))
def test_linear_flows_of_any_size_have_the_terms_of_their_matrix_exponential(n):
    """Also with an epsilon and a parameter, whose products with anything are constants."""
    states = sp.symbols(f"z0:{n}")
    matrix = np.random.default_rng(n).integers(1, 4, (n, n)) * (-1) ** n
    rates = {s: k * sum(int(a) * z for a, z in zip(row, states)) / epsilon for s, row in zip(states, matrix)}
    field = VectorField(rates, epsilon=epsilon, parameters={k: "0.5"})
    start = np.linspace(1, 2, n)
    code, block = expansion(field, start, value=2.0, scale=-0.5)
    found = series(field, start, value=2.0, scale=-0.5)
    power = start
    for j in range(ORDER + 1):
        np.testing.assert_allclose(found[:, j], power, rtol=1e-12, atol=1e-14)
        power = -0.5 * 0.5 / 2.0 * matrix @ power / (j + 1)
    # The end, the rate there, and the defect, which is the next term's.
    share = 0.25
    out = called(code.advance, share, block, parameter_vector(field, 2.0), 2 * code.stride + 1)
    end = found @ share ** np.arange(ORDER + 1)
    np.testing.assert_allclose(out[:n], end, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(out[code.stride :][:n], 0.25 * matrix @ end, rtol=1e-13, atol=1e-14)
    assert out[-1] < 1e-6
    rows = called(code.interpolate, share, block, parameter_vector(field, 2.0), dense_rows(ORDER) * n).reshape(
        -1, n
    )
    s = 0.3
    total = np.zeros(n)
    for m in range(len(rows) - 1, -1, -1):
        total = rows[m] + (s if m % 2 == 0 else 1 - s) * total
    between = (1 - s) * start + s * end + s * (1 - s) * total
    np.testing.assert_allclose(between, found @ (s * share) ** np.arange(ORDER + 1), rtol=1e-10)


@pytest.mark.parametrize("order", [8, 12])
def test_the_measured_order_of_a_step(order):
    """x = 1/(1 - t) from t = 0: the error of one step is O(h^(K + 1))."""
    found = series(VectorField({x: x**2}, epsilon=None), [1], order=order)[0]
    steps = np.array([0.15, 0.18, 0.21, 0.25])
    errors = [abs(sum(c * h**j for j, c in enumerate(found)) - 1 / (1 - h)) for h in steps]
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order + 1 < slope < order + 1.4


# Accuracy

PROBLEMS = {
    "pendulum": (VectorField({x: y, y: -sp.sin(x)}, epsilon=None), [1.5, 0], 20.0),
    "van der Pol": (VectorField({x: y, y: (1 - x**2) * y - x}, epsilon=None), [2, 0], 10.0),
    "Brusselator": (VectorField({x: 1 + x**2 * y - 4 * x, y: 3 * x - x**2 * y}, epsilon=None), [1.5, 3], 20.0),
    "rational": (
        VectorField({x: y, y: -x / (1 + x**2) - sp.exp(-(x**2)) * y / 10}, epsilon=None),
        [2, 0],
        20.0,
    ),
    "slaved": (VectorField({x: -20 * (x - sp.cos(y)), y: sp.Integer(1)}, epsilon=None), [0, 0], 10.0),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_end_and_the_dense_output_are_within_three_tolerances(name):
    field, start, end = PROBLEMS[name]
    options = {"start": dict(zip((s.name for s in field.states), start)), "span": (0, end)}
    grid = np.linspace(0, end, 301)
    exact = integrate(field, method=Method.RADAU13, rtol=1e-14, atol=1e-15, at=grid, **options).y
    size = np.abs(exact).max(axis=1, keepdims=True)
    for exponent in range(4, 13):
        rtol = 10.0**-exponent
        found = integrate(field, method=Method.TAYLOR, rtol=rtol, atol=1e-2 * rtol, **options)
        assert found.status is Status.SUCCESS
        # Of the thirteen decimals that the reference has.
        errors = np.maximum(np.abs(found.at(grid) - exact) - 1e-13 * size, 0.0) / (rtol * (1e-2 + size))
        assert errors.max() < 3, (rtol, errors.max(axis=1))


def test_a_series_that_pauses_is_found_out():
    """1/(1 + t^30) has no term of order 1 to 29 at 0, so that its last terms there allow for any step."""
    field = VectorField({x: -30 * y**29 * x**2, y: sp.Integer(1)}, epsilon=None)
    run = integrate(field, start={"x": 1, "y": 0}, span=(0, 2), method=Method.TAYLOR, rtol=1e-9, atol=1e-11)
    assert run.stats.rejected > 0
    assert run["x"] == pytest.approx(1 / (1 + run.t**30), rel=1e-7, abs=1e-9)


def test_steps_are_as_long_in_any_unit_of_time():
    """Coefficients are scaled by the step: those of a unit of 1e-30 do not overflow."""
    runs = []
    for unit in (1, sp.Integer(10) ** 30, sp.Rational(1, 10**30)):
        field = VectorField({x: unit * y, y: -unit * sp.sin(x)}, epsilon=None)
        runs.append(integrate(field, start={"x": 1.5, "y": 0}, span=(0, float(20 / unit)), method="taylor"))
        assert runs[-1].status is Status.SUCCESS
        assert runs[-1].stats.steps == runs[0].stats.steps
        assert runs[-1].y[:, -1] == pytest.approx(runs[0].y[:, -1], rel=1e-6)


def test_where_stability_bounds_the_step_no_step_is_rejected_and_little_is_lost():
    """The border of stability grows like the order, and what builds up beside it stays below the tolerance."""
    field = VectorField({x: -100 * (x - sp.cos(y)), y: sp.Integer(1)}, epsilon=None)
    run = integrate(field, start={"x": 0, "y": 0}, span=(0, 10), method=Method.TAYLOR, rtol=1e-8, atol=1e-8)
    assert run.stats.steps < 1000 / 6
    assert run.stats.rejected == 0
    grid = np.linspace(1, 10, 500)
    exact = (100**2 * np.cos(grid) + 100 * np.sin(grid)) / (100**2 + 1)
    assert run.at(grid)[0] == pytest.approx(exact, abs=2e-8)


# The integrator


def test_the_order_follows_the_tolerance():
    assert [taylor_order(rtol) for rtol in (1e-2, 1e-5, 1e-6, 1e-9, 1e-10, 1e-14)] == [12, 12, 16, 16, 20, 20]


def test_events_are_located_and_can_end_the_run():
    field = PROBLEMS["pendulum"][0]
    options = {"start": {"x": 1.5, "y": 0}, "span": (0, 20), "rtol": 1e-10, "atol": 1e-12}
    event = Event("x", direction=1)
    found, other = (
        integrate(field, method=method, events=event, **options).events["x"]
        for method in (Method.TAYLOR, Method.RADAU13)
    )
    assert found.times == pytest.approx(other.times, abs=1e-8)
    assert found.states == pytest.approx(other.states, abs=1e-8)
    ended = integrate(field, events=Event("x", terminal=True), **options)
    assert ended.stats.method is Method.TAYLOR
    assert ended.status is Status.EVENT_REACHED
    assert ended["x"][-1] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("rtol", [1e-4, 1e-7])
def test_an_ensemble_whose_members_begin_differently_is_each_of_them_alone(rtol):
    """Some stay with the series, some hand over, some never begin with them."""
    field = VectorField({x: -(x - sp.cos(y)) / epsilon, y: 1 + 30 * y**2 / (1 + y**2)}, epsilon=epsilon)
    values = [1.0, 0.1, 0.02, 1e-3]
    many = integrate_many(field, {"x": 1, "y": 0}, epsilon=values, span=(0, 3), rtol=rtol, at=[1, 3])
    methods = set()
    for i, value in enumerate(values):
        one = integrate(field, start={"x": 1, "y": 0}, epsilon=value, span=(0, 3), rtol=rtol, at=[1, 3])
        assert np.array_equal(many.y[i], one.y)
        assert many.member(i).stats == one.stats
        methods.add(one.stats.method)
    assert Method.TAYLOR in methods
    assert len(methods) == 2


@pytest.mark.parametrize(
    "rate",
    [sp.Abs(x), sp.sign(x), sp.Max(x, 0), sp.Heaviside(x), sp.Piecewise((x, x > 0), (0, True))],
    ids=str,
)
def test_a_field_without_series_is_refused_by_name_and_left_to_others(rate):
    field = VectorField({x: -x + rate / 10}, epsilon=None)
    with pytest.raises(UnsupportedFunctionError, match=r"Method\.DOP853"):
        integrate(field, start={x: 1}, span=(0, 1), method=Method.TAYLOR)
    with pytest.raises(UnsupportedFunctionError):
        integrate_many(field, {"x": [1, 2]}, span=(0, 1), method=Method.TAYLOR)
    assert integrate(field, start={x: 1}, span=(0, 1)).stats.method is Method.RADAU13


def test_what_does_not_depend_on_the_states_may_have_a_kink():
    field = VectorField({x: -sp.Abs(k) * x}, epsilon=None, parameters={k: -2})
    assert integrate(field, start={x: 1}, span=(0, 1), method="taylor")["x"][-1] == pytest.approx(math.exp(-2))


def test_code_that_would_take_minutes_to_build_is_refused():
    states = sp.symbols("z0:1000")
    field = VectorField({s: -(s**2) for s in states}, epsilon=None)
    with pytest.raises(GspError, match="Use another method"):
        integrate(field, start=dict.fromkeys(states, 1), span=(0, 1), method=Method.TAYLOR)


def test_expressions_nested_a_thousand_deep_have_instructions():
    nested: sp.Expr = x
    for _ in range(1000):
        nested = sp.Add(sp.Mul(nested, x, evaluate=False), sp.Rational(1, 2), evaluate=False)
    code = TaylorCode(FlowCode((x,), (nested,), None, ()))
    assert len(code.instructions.rows) == 2001
    assert not has_parts(code.flow, at_most=3000)


def test_which_flows_begin_with_series():
    """By |J| times the span at the start, 50, 250 and 10^4 here, in whatever units."""
    stiff = VectorField({x: -x / epsilon, y: x - y}, epsilon=epsilon)
    methods = {
        (value, rtol): integrate(stiff, start={x: 1, y: 1}, span=(0, 10), epsilon=value, rtol=rtol).stats.method
        for value in (0.2, 0.04, 1e-3)
        for rtol in (1e-4, 1e-8)
    }
    assert methods[0.2, 1e-4] is methods[0.2, 1e-8] is Method.TAYLOR
    assert methods[0.04, 1e-4] is methods[1e-3, 1e-4] is Method.RADAU9
    assert methods[0.04, 1e-8] is methods[1e-3, 1e-8] is Method.RADAU13

    for unit in (1, 10**4):
        # The Jacobian's norm is 10^5 in the other units.
        oscillator = VectorField({x: -x + unit * y, y: -x / unit - y}, epsilon=None)
        run = integrate(oscillator, start={x: unit, y: 1}, span=(0, 10), rtol=1e-6, atol=1e-30)
        assert run.stats.method is Method.TAYLOR

    class Reduced(VectorField):
        is_stiff = False

    reduced = Reduced({x: -x}, epsilon=None)
    assert integrate(reduced, start={x: 1}, span=(0, 1)).stats.method is Method.DOP853
    kinked = VectorField({x: -sp.Abs(x)}, epsilon=None)
    assert integrate(kinked, start={x: 1}, span=(0, 1)).stats.method is Method.RADAU13
