"""Taylor jets along the flow: every function by its own derivatives, and the tangents."""

import math

import numpy as np
import pytest
import sympy as sp

from gsp.errors import UnsupportedFunctionError
from gsp.kernels.jets import flow_jet_with_tangents
from gsp.lowering.compiled_flow import parameter_vector
from gsp.lowering.tape import write_tape
from gsp.systems.system import SlowFastSystem
from tests.example_systems import coupled, epsilon, sleigh, transcendental, x, y

ORDER = 8


def jet(system, start, value, order=ORDER):
    """Coefficients (n, order + 1) in fast time, and their derivatives (n_fast, n, order + 1) by the fast start."""
    tape = write_tape(system)
    nx, n = len(system.x), len(system.states)
    constants = tape.constants(parameter_vector(system, value))
    rows = len(tape.instructions)
    v, d = np.full((rows, order + 1), np.nan), np.full((n - nx, rows, order + 1), np.nan)
    z = np.array(start, dtype=float)
    flow = (tape.instructions, constants, tape.rates, value, nx)
    arguments = (flow, z[:nx].copy(), z[nx:].copy(), order)
    flow_jet_with_tangents(*arguments, v, d)
    plain = np.full_like(v, np.nan)
    flow_jet_with_tangents(*arguments, plain, d[:0])
    np.testing.assert_array_equal(plain[:n], v[:n])
    return v[:n], d[:, :n]


def of_function(expression):
    """Taylor coefficients of an expression in x at x = 0.4, from the jet of y' = F(x), x' = 1."""
    system = SlowFastSystem(slow={x: 1}, fast={y: expression - y}, epsilon=epsilon)
    v, _ = jet(system, [0.4, 0.0], 1.0)
    k = np.arange(1, ORDER + 1)
    return v[1, 1:] * k + v[1, :-1]


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "expression",
    [
        *(f(x) for f in (sp.exp, sp.log, sp.sqrt, sp.sin, sp.cos, sp.tan, sp.sinh, sp.cosh, sp.tanh)),
        *(f(x) for f in (sp.asin, sp.acos, sp.atan, sp.asinh, sp.atanh, sp.erf)),
        sp.acosh(x + 1),
        x**5,
        x**-3,
        x ** sp.Rational(7, 3),
        x ** sp.Rational(-3, 2),
        x**sp.pi,
        x**x,
        2**x,
        (1 + x**2) / (2 - sp.sin(x)) - 3 / x,
        sp.exp(-(sp.sin(x) ** 2)) * sp.tanh(x) / (1 + x) ** 2,
        (x - 1) ** 3 * sp.Rational(1, 7) - x + sp.E,
    ],
    ids=str,
)
def test_an_expression_has_the_taylor_coefficients_of_its_derivatives(expression) -> None:
    exact = [
        float(sp.diff(expression, x, k).subs(x, sp.Rational(2, 5)).evalf(30) / math.factorial(k))
        for k in range(ORDER)
    ]
    np.testing.assert_allclose(of_function(expression), exact, rtol=2e-12, atol=1e-13)


def test_the_absolute_value_is_smooth_away_from_zero() -> None:
    np.testing.assert_allclose(of_function(sp.Abs(sp.sin(x) - 1)), of_function(1 - sp.sin(x)), rtol=1e-14)


def test_jets_of_a_linear_flow_are_the_terms_of_its_matrix_exponential() -> None:
    u = sp.Symbol("u")
    system = SlowFastSystem(slow={x: y - 2 * u}, fast={y: x - 3 * y + u, u: y - u + x}, epsilon=epsilon)
    value, start = 0.2, np.array([1.0, -0.5, 2.0])
    matrix = np.array([[0, value, -2 * value], [1, -3, 1], [1, 1, -1]])
    found, tangents = jet(system, start, value)
    power = np.eye(3)
    for k in range(ORDER + 1):
        np.testing.assert_allclose(found[:, k], power @ start, rtol=1e-12)
        np.testing.assert_allclose(tangents[:, :, k], power[:, 1:].T, rtol=1e-12, atol=1e-16)
        power = matrix @ power / (k + 1)


@pytest.mark.parametrize("make", [sleigh, coupled, transcendental])
def test_tangents_are_the_derivatives_of_jets(make) -> None:
    system = make()
    nx, n = len(system.x), len(system.states)
    start = np.linspace(0.4, 0.9, n)
    _, tangents = jet(system, start, 0.1)
    step = 1e-5
    for i in range(n - nx):
        shift = step * np.eye(n)[nx + i]
        change = (jet(system, start + shift, 0.1)[0] - jet(system, start - shift, 0.1)[0]) / (2 * step)
        np.testing.assert_allclose(tangents[i], change, rtol=1e-6, atol=1e-8)


def test_a_jet_steps_along_the_flow() -> None:
    system = transcendental()
    value, tau = 0.1, 0.05
    here, _ = jet(system, [0.4, 0.3], value, order=14)
    there = here @ tau ** np.arange(15)
    back, _ = jet(system, there, value, order=14)
    np.testing.assert_allclose(back @ (-tau) ** np.arange(15), [0.4, 0.3], rtol=1e-15)


def test_equal_subexpressions_are_computed_once_and_constants_not_at_all() -> None:
    a, b = sp.symbols("a b")
    term = sp.exp(a * b) * epsilon * x**2
    system = SlowFastSystem(
        slow={x: term}, fast={y: term - y}, epsilon=epsilon, parameters={a: 2, b: sp.Rational(1, 3)}
    )
    tape = write_tape(system)
    # x, y, x^2, the constant times that, and the difference.
    assert tape.instructions.shape == (5, 4)
    values = tape.constants(parameter_vector(system, 0.5))
    np.testing.assert_allclose(values, [0.5 * math.exp(2 / 3)], rtol=1e-15)


def test_a_function_without_a_differential_equation_is_refused_by_name() -> None:
    system = SlowFastSystem(slow={x: -x}, fast={y: sp.gamma(x) - y}, epsilon=epsilon)
    with pytest.raises(UnsupportedFunctionError, match="gamma"):
        write_tape(system)
