"""Compiled functions against SymPy at high precision, exact Jacobians, and what cannot be compiled."""

from __future__ import annotations

import gc
import threading
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gsp.algebra.differentiation import derivative
from gsp.errors import DeclarationError, GspError, UnsupportedFunctionError
from gsp.integration.methods import Method
from gsp.integration.trajectory import integrate
from gsp.kernels import engine
from gsp.lowering import compiled_function
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.lowering.compiled_function import compile_function
from gsp.systems.system import SlowFastSystem, VectorField

x, y, z, a, epsilon = sp.symbols("x y z a epsilon")
NO_EPSILON = [float("nan")]
ULP = 2.0**-52


def value(expression: sp.Expr, *point: float) -> float:
    arguments = (x, y, z)[: len(point)]
    function = compile_function([expression], arguments=arguments, epsilon=None, parameters=[])
    return float(function(point, NO_EPSILON)[0])


REAL_LINE = [
    sp.sin(x),
    sp.cos(x),
    sp.tan(x),
    sp.atan(x),
    sp.atan2(x, 2 - x),
    sp.sinh(x),
    sp.cosh(x),
    sp.tanh(x),
    sp.asinh(x),
    sp.exp(x),
    sp.erf(x),
    sp.Abs(x),
    sp.sign(x),
    sp.Max(x, 1, -3 * x),
    sp.Min(x, 1, -3 * x),
    sp.Heaviside(x),
    sp.Piecewise((x**2, x < -1), (sp.Rational(1, 3), (x <= 1) & sp.Ne(x, 0)), (sp.exp(x), True)),
    sp.Piecewise((1, (x > 1) | (x < -2)), (2, sp.Not(x >= 0)), (3, True)),
    x**7,
    x**16,
    x**17,
    x**-3,
    2**x,
    (1 + x**2) ** x,
]
POSITIVE = [
    sp.sqrt(x),
    1 / sp.sqrt(x),
    x ** sp.Rational(3, 2),
    x ** sp.Rational(-5, 2),
    x ** sp.Rational(1, 3),
    x**sp.pi,
    sp.log(x),
    x / sp.Rational(3, 7) - sp.sqrt(2) * sp.pi * x + sp.E,
]
UNIT_INTERVAL = [sp.asin(x), sp.acos(x), sp.atanh(x), sp.acosh(1 / x)]


@pytest.mark.parametrize(
    ("expression", "low", "high"),
    [(e, -3.0, 3.0) for e in REAL_LINE]
    + [(e, 0.1, 9.0) for e in POSITIVE]
    + [(e, 0.05, 0.95) for e in UNIT_INTERVAL],
    ids=str,
)
def test_each_function_agrees_with_sympy_to_a_few_units_in_the_last_place(expression, low, high):
    generator = np.random.default_rng(2023)
    points = generator.uniform(low, high, size=(12, 1))
    function = compile_function([expression], arguments=[x], epsilon=None, parameters=[])
    computed = function(points, NO_EPSILON)[:, 0]
    exact = [expression.subs(x, sp.Rational(float(u))).evalf(40) for u in points[:, 0]]
    # A rounding inside the expression acts like one of x, which moves f by |x f'| units.
    slope = [abs(sp.N(derivative(expression, x).subs(x, sp.Rational(float(u))), 20)) for u in points[:, 0]]
    scale = [abs(e) + abs(s * u) for e, s, u in zip(exact, slope, points[:, 0])]
    errors = [float(abs(sp.Float(float(c), 40) - e)) for c, e in zip(computed, exact)]
    assert all(error <= 4 * ULP * float(size) for error, size in zip(errors, scale))


def test_constants_are_rounded_correctly():
    big = sp.Rational(10**40 + 1, 3 * 10**39)
    for constant in (
        sp.pi,
        sp.E,
        big,
        sp.Rational(1, 10),
        sp.sqrt(2),
        sp.exp(sp.Rational(1, 3)),
        sp.GoldenRatio,
    ):
        assert value(constant + 0 * x, 0.0) == float(constant.evalf(40))
    assert value(sp.Integer(10) ** 400 * x, 1.0) == np.inf


def test_nan_is_never_hidden():
    nan = float("nan")
    for expression in (
        sp.Max(x, 0),
        sp.Max(0, x, 1),
        sp.Min(x, 0),
        sp.sign(x),
        sp.Abs(x),
        sp.Heaviside(x),
        x**2 + 1,
    ):
        assert np.isnan(value(expression, nan))
    assert np.isnan(value(sp.Piecewise((1, x < 0)), 1.0)), "no branch holds"
    assert np.isnan(value(sp.sqrt(x), -1.0))
    assert np.isnan(value(x ** sp.Rational(1, 3), -1.0)), "the principal root is not real"


def test_division_by_zero_is_infinite():
    assert value(1 / x, 0.0) == np.inf
    assert value(-1 / x**2, 0.0) == -np.inf


def test_steps_at_the_jump():
    assert value(sp.sign(x), 0.0) == 0.0
    assert value(sp.Heaviside(x), 0.0) == 0.5
    assert value(sp.Heaviside(x, 1), 0.0) == 1.0
    assert value(sp.DiracDelta(x), 0.0) == 0.0


@pytest.mark.parametrize(
    "expression", [sp.gamma(x), sp.besselj(0, x), sp.floor(x), sp.re(x), sp.zeta(x + 2)], ids=str
)
def test_a_function_without_machine_code_is_named_with_a_remedy(expression):
    with pytest.raises(UnsupportedFunctionError, match=expression.func.__name__ + r".*Write it in"):
        compile_function([1 + expression], arguments=[x], epsilon=None, parameters=[])


def test_complex_constants_are_refused():
    with pytest.raises(UnsupportedFunctionError, match="not a real number"):
        compile_function([x * sp.asin(2)], arguments=[x], epsilon=None, parameters=[])


def test_an_unknown_symbol_is_named():
    with pytest.raises(GspError, match=r"^a is no argument"):
        compile_function([a * x], arguments=[x], epsilon=None, parameters=[])


def test_one_point_and_many_points():
    function = compile_function([x * y, x / epsilon, a], arguments=[x, y], epsilon=epsilon, parameters=[a])
    assert function.outputs == 3
    assert function.arguments == (x, y)
    assert np.array_equal(function([2.0, 3.0], [0.5, 7.0]), [6.0, 4.0, 7.0])
    many = function(np.arange(8.0).reshape(4, 2), [0.5, 7.0])
    assert many.shape == (4, 3)
    assert np.array_equal(many[1], [6.0, 4.0, 7.0])
    assert function(np.empty((0, 2)), [0.5, 7.0]).shape == (0, 3)


def test_input_may_be_read_only_or_strided():
    function = compile_function([x - y], arguments=[x, y], epsilon=None, parameters=[])
    points = np.arange(12.0).reshape(2, 6).T[::2]
    points.setflags(write=False)
    assert np.array_equal(function(points, NO_EPSILON)[:, 0], points[:, 0] - points[:, 1])


def test_no_outputs_and_no_arguments():
    nothing = compile_function([], arguments=[x], epsilon=None, parameters=[])
    assert nothing([[1.0], [2.0]], NO_EPSILON).shape == (2, 0)
    constant = compile_function([a**2], arguments=[], epsilon=None, parameters=[a])
    assert np.array_equal(constant(np.empty((3, 0)), [np.nan, 3.0]), np.full((3, 1), 9.0))


def test_wrong_shapes_are_refused_before_memory_is_read():
    function = compile_function([x * a], arguments=[x], epsilon=None, parameters=[a])
    with pytest.raises(GspError, match=r"\(m, 1\).*Got \(2,\)"):
        function([1.0, 2.0], [np.nan, 1.0])
    with pytest.raises(GspError, match=r"p has shape \(2,\).*Got \(1,\)"):
        function([1.0], NO_EPSILON)


def test_equal_calls_share_their_code():
    first = compile_function([x + 1], arguments=[x], epsilon=None, parameters=[])
    assert compile_function((x + 1,), arguments=(x,), epsilon=None, parameters=()) is first


@pytest.mark.exhaustive
def test_code_lives_as_long_as_the_function():
    functions = [compile_function([x * k], arguments=[x], epsilon=None, parameters=[]) for k in range(20)]
    gc.collect()
    assert [float(f([2.0], NO_EPSILON)[0]) for f in functions] == [2.0 * k for k in range(20)]


@pytest.mark.parametrize(
    "name", ["lambda", "out", "t", "p", "y", "f", "z", "sin", "double", "__import__", '"};']
)
def test_a_state_named_like_code_is_harmless(name):
    state, other = sp.Symbol(name), sp.Symbol("llvm")
    function = compile_function(
        [state - other, state * other], arguments=[state, other], epsilon=None, parameters=[]
    )
    assert np.array_equal(function([5.0, 3.0], NO_EPSILON), [2.0, 15.0])


# Jacobians


def smooth_expressions() -> st.SearchStrategy[sp.Expr]:
    leaves = st.sampled_from([x, y, sp.Integer(2), sp.Rational(-1, 3), a])
    return st.recursive(
        leaves,
        lambda inner: st.one_of(
            st.tuples(inner, inner).map(lambda pair: pair[0] + pair[1]),
            st.tuples(inner, inner).map(lambda pair: pair[0] * pair[1]),
            st.tuples(inner, inner).map(lambda pair: pair[0] / (1 + pair[1] ** 2)),
            inner.map(sp.sin),
            inner.map(sp.tanh),
            inner.map(lambda e: sp.sqrt(1 + e**2)),
            inner.map(lambda e: sp.exp(-(e**2))),
        ),
        max_leaves=8,
    )


@pytest.mark.exhaustive
@settings(max_examples=10)
@given(
    smooth_expressions(),
    smooth_expressions(),
    st.floats(-1.5, 1.5),
    st.floats(-1.5, 1.5),
)
def test_the_jacobian_agrees_with_finite_differences(f, g, u, v):
    compiled = compile_flow(VectorField({x: f, y: g}, epsilon=None, parameters={a: "0.7"}))
    p, h = np.array([np.nan, 0.7]), 1e-3
    jacobian = compiled.derivatives([u, v], p).reshape(2, 2)
    centre = np.array([u, v])
    for j, direction in enumerate(np.eye(2)):
        shifts = compiled.rates([centre + k * h * direction for k in (-2, -1, 1, 2)], p)
        slope = np.array([1, -8, 8, -1]) @ shifts / (12 * h)
        assert jacobian[:, j] == pytest.approx(slope, rel=1e-5, abs=1e-5 * (1 + np.abs(shifts).max()))


@pytest.mark.parametrize(
    ("expression", "at", "expected"),
    [
        (sp.Abs(x**3 - 8), 1.0, -3.0),
        (sp.Abs(sp.sin(x)) * x, -1.0, np.sin(1) + np.cos(1)),
        (sp.sign(x) * x, -2.0, -1.0),
        (sp.Max(x, 0) ** 2, 3.0, 6.0),
        (sp.Max(x, 0) ** 2, -3.0, 0.0),
        (sp.Min(2 * x, x**2), 1.0, 2.0),
        (sp.Heaviside(x - 1) * x, 2.0, 1.0),
        (sp.Piecewise((x**2, x < 0), (sp.sin(x), True)), -1.0, -2.0),
    ],
    ids=str,
)
def test_derivatives_of_functions_with_corners(expression, at, expected):
    assert value(derivative(expression, x), at) == pytest.approx(expected, rel=1e-14)


def test_the_derivative_of_a_symbolic_power_exists_at_zero():
    n = sp.Symbol("n")
    hill = compile_flow(VectorField({x: x**n / (1 + x**n)}, epsilon=None, parameters={n: 2}))
    assert hill.derivatives([0.0], [np.nan, 2.0])[0] == 0.0
    assert hill.derivatives([0.0], [np.nan, 1.0])[0] == 1.0


def test_a_field_of_twenty_states_and_its_jacobian():
    states = sp.symbols("x0:20")
    rates = {
        s: states[(i + 1) % 20] * states[i - 1] / (1 + s**2) - sp.sin(s) / epsilon for i, s in enumerate(states)
    }
    compiled = compile_flow(VectorField(rates, epsilon=epsilon))
    assert compiled.size == 20
    point = np.linspace(-1, 1, 20)
    p = np.array([0.01])
    up, down = np.roll(point, -1), np.roll(point, 1)
    expected = up * down / (1 + point**2) - np.sin(point) / 0.01
    assert compiled.rates(point, p) == pytest.approx(expected, rel=1e-13, abs=1e-13)
    jacobian = compiled.derivatives(point, p).reshape(20, 20)
    diagonal = -2 * point * up * down / (1 + point**2) ** 2 - np.cos(point) / 0.01
    assert np.diag(jacobian) == pytest.approx(diagonal, rel=1e-13)
    assert np.count_nonzero(jacobian) <= 60


# Flows


def test_parameter_values_and_epsilon_compile_nothing_new():
    system = SlowFastSystem(slow={x: -x}, fast={y: x - a * y}, epsilon=epsilon, parameters={a: 1})
    other = system.with_parameters(a=3)
    assert compile_flow(system) is compile_flow(system)
    assert compile_flow(system).field == compile_flow(other).field
    assert compile_flow(system).jacobian == compile_flow(other).jacobian
    rates = compile_flow(other).rates([2.0, 0.5], parameter_vector(other, 0.1))
    assert rates == pytest.approx([-2.0, 5.0])


def test_observables_see_states_parameters_and_epsilon():
    energy = sp.Symbol("E")
    field = VectorField(
        {x: -x / epsilon}, epsilon=epsilon, parameters={a: 3}, observables={energy: a * x**2 + epsilon}
    )
    assert compile_flow(field).observables([[2.0]], parameter_vector(field, 0.5))[0, 0] == 12.5


def test_the_parameter_vector():
    field = VectorField({x: -a * x / epsilon + y, y: x}, epsilon=epsilon, parameters={a: "0.1", z: 2})
    assert np.array_equal(parameter_vector(field, 0.25), [0.25, 0.1, 2.0])
    still = VectorField({x: -x}, epsilon=None)
    assert np.isnan(parameter_vector(still, None)).all()
    with pytest.raises(DeclarationError, match="no small parameter"):
        parameter_vector(still, 0.1)
    with pytest.raises(DeclarationError, match="Give its value"):
        parameter_vector(field, None)
    for wrong in (0.0, -1.0, float("nan"), float("inf"), "much"):
        with pytest.raises(DeclarationError):
            parameter_vector(field, wrong)


def test_expressions_nested_a_few_thousand_deep_are_compiled():
    x = sp.Symbol("x")
    nested: sp.Expr = x
    for k in range(3000):
        nested = sp.Add(sp.Mul(nested, x, evaluate=False), sp.Rational(1, k + 1), evaluate=False)
    function = compile_function([nested], arguments=[x], epsilon=None, parameters=[])
    expected = 0.5
    for k in range(3000):
        expected = expected * 0.5 + 1 / (k + 1)
    assert function([[0.5]], [float("nan")])[0, 0] == pytest.approx(expected, rel=1e-14)


def at_once(count, function):
    """What `function` gives in so many threads that begin together."""
    gate, found = threading.Barrier(count), []

    def work():
        gate.wait()
        found.append(function())

    threads = [threading.Thread(target=work) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


@pytest.mark.exhaustive
@pytest.mark.parametrize("method", [Method.RADAU9, Method.RADAU13])
def test_threads_that_use_a_flow_first_and_together_get_the_same_bits(method):
    u, w = sp.symbols("u w")
    options = {"start": {"u": 2, "w": 0}, "span": (0, 3), "rtol": 1e-5, "method": method}
    for k in range(6):
        fresh = VectorField({u: w, w: (1 - u**2) * w * (20 + k) - u}, epsilon=None)
        run = partial(integrate, fresh, **options)
        found = at_once(4, run)
        alone = run()
        assert len(found) == 4
        for other in found:
            assert other.stats == alone.stats
            assert np.array_equal(other.y, alone.y)


@pytest.mark.exhaustive
def test_long_code_is_cut_into_functions_that_give_the_same_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """A line of cells, an output that is 0 in places, and a parameter that some of the parts have."""
    w = sp.symbols("w0:601")
    outputs = [a * p**3 - q / (1 + p**2) if i % 100 else a + epsilon for i, (p, q) in enumerate(pairwise(w))]
    outputs += [sp.S.Zero] * 100
    texts: list[str] = []

    def build(text: str, **options) -> engine.Engine:
        texts.append(text)
        return engine.build(text, **options)

    monkeypatch.setattr(compiled_function, "build", build)
    found = []
    for longest in (10**9, 2000):
        monkeypatch.setattr(compiled_function, "LONGEST_SCHEDULED", longest)
        compiled_function._compile.cache_clear()
        f = compile_function(outputs, arguments=w, epsilon=epsilon, parameters=[a], scheduled=True)
        found.append(f(np.linspace(-1.0, 2.0, 601), [0.1, 3.0]))
    assert np.array_equal(*found)
    whole, parts = (text.count("define void") for text in texts)
    assert (whole, parts) == (1, 1 + texts[0].count("\n") // compiled_function.LENGTH_OF_PART)
    longest_function = max(text.count("\n") for text in texts[1].split("\ndefine "))
    assert longest_function < 1.25 * compiled_function.LENGTH_OF_PART
    compiled_function._compile.cache_clear()
