"""Code written for one flow: expressions in lanes against one at a time, whole steps against the kernels' loops."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
import sympy as sp
from llvmlite import ir

from gsp.errors import GspError, Status
from gsp.integration.methods import SOLVERS, Method, choose_method
from gsp.integration.trajectory import integrate
from gsp.kernels import integrator
from gsp.kernels.compilation import address_of
from gsp.kernels.engine import LONGEST_SCHEDULED, build, effort
from gsp.kernels.radau import radau
from gsp.kernels.radau_block import memory_size
from gsp.lowering.compiled_flow import COLLOCATION_LOOPS, compile_flow
from gsp.lowering.compiled_function import compile_function
from gsp.lowering.steps.collocation import CollocationCode
from gsp.lowering.steps.emission import LIBRARY, Emitter
from gsp.lowering.steps.flow_code import is_worth_writing
from gsp.lowering.steps.values import DOUBLE, SIGNATURE, load, store
from gsp.systems.system import VectorField

POINTER = ctypes.POINTER(ctypes.c_double)
FUNCTION = ctypes.CFUNCTYPE(None, ctypes.c_double, POINTER, POINTER, POINTER)
x, y, a, b = sp.symbols("x y a b")


def run(address: int, t: float, *arrays: np.ndarray) -> None:
    FUNCTION(address)(t, *(array.ctypes.data_as(POINTER) for array in arrays))


def in_lanes(expressions, points: np.ndarray, p: np.ndarray, *, shared: bool) -> np.ndarray:
    """Values (m, outputs) of functions of (x, y) and the constants (a, b) at `points` (m, 2), all at once."""
    m = len(points)
    module = ir.Module()
    function = ir.Function(module, SIGNATURE, "f")
    builder = ir.IRBuilder(function.append_basic_block())
    _, z, constants, out = function.args
    vector = ir.VectorType(DOUBLE, m)
    lanes = [ir.Constant(ir.IntType(32), k) for k in range(m)]
    columns = []
    for i in range(2):
        value = ir.Constant(vector, ir.Undefined)
        for k in range(m):
            value = builder.insert_element(value, load(builder, z, 2 * k + i), lanes[k])
        columns.append(value)
    values = dict(zip((x, y), columns))
    known = {a: load(builder, constants, 0), b: load(builder, constants, 1)}
    if not shared:
        values |= known
    emitter = Emitter(builder, values, constants=known if shared else None, width=m)
    for i, value in enumerate(emitter.write(expressions)):
        for k in range(m):
            one = builder.extract_element(value, lanes[k]) if isinstance(value.type, ir.VectorType) else value
            store(builder, one, out, k * len(expressions) + i)
    builder.ret_void()
    engine = build(str(module), library=LIBRARY)
    result = np.empty((m, len(expressions)))
    run(engine.get_function_address("f"), 0.0, points.ravel().copy(), p, result)
    return result


EXPRESSIONS = [
    x * y / a - x / (a * y) + b / (a * b),
    sp.sin(a * x) * sp.cos(x) ** 2 + sp.exp(-y) + sp.tanh(x * y) + sp.atan2(x, y),
    sp.sqrt(x**2 + 1) ** 3 + sp.Pow(x**2 + b, sp.Rational(1, 3)) + x**17 + (x**2 + 1) ** -2 + 2**x,
    sp.Piecewise((x, x > y), (a * y, sp.And(x < 0, sp.Not(y > 1))), (sp.Integer(7), True)),
    sp.Piecewise((x, a > b), (y, True)) + sp.Piecewise((sp.Integer(1), sp.Or(sp.Eq(x, 0), a > 0))),
    sp.Abs(x) + sp.sign(y) + sp.Heaviside(x) + sp.Max(x, y, a) - sp.Min(x, b),
    a * b + sp.log(a) / b,
    -x * sp.Rational(2, 3),
    sp.pi * a,
]


@pytest.mark.parametrize("shared", [False, True])
def test_lanes_hold_what_one_point_at_a_time_gives(shared):
    points = np.array([[0.3, 1.5], [-1.2, 0.4], [0.0, -2.0], [2.5, 2.5], [-0.7, -0.7]])
    p = np.array([0.6, 1.7])
    alone = compile_function(EXPRESSIONS, arguments=(x, y), epsilon=a, parameters=(b,))(points, p)
    lanes = in_lanes(EXPRESSIONS, points, p, shared=shared)
    assert np.isfinite(alone).all()
    assert lanes == pytest.approx(alone, rel=1e-14, abs=1e-15)
    if not shared:
        # Nothing is divided once and multiplied often.
        assert np.array_equal(lanes, alone)


def test_no_number_stays_none_in_every_lane():
    points = np.array([[np.nan, 1.0], [1.0, np.inf], [0.0, 0.0]])
    p = np.array([0.6, 1.7])
    expressions = [sp.Max(x, y), sp.sign(x), x / y, sp.Piecewise((x, x > 0), (y, x < 0))]
    alone = compile_function(expressions, arguments=(x, y), epsilon=a, parameters=(b,))(points, p)
    assert np.array_equal(in_lanes(expressions, points, p, shared=True), alone, equal_nan=True)


def test_a_symbol_that_is_neither_state_nor_constant_is_named():
    with pytest.raises(GspError, match=r"c is no argument and no parameter\. The arguments are x, y, a, b"):
        in_lanes([sp.Symbol("c") * x], np.ones((2, 2)), np.ones(2), shared=True)


def random_field(n: int, density: float, seed: int) -> VectorField:
    """Cubic rates on a random sparse pattern, stiff in the first half, with a parameter and functions."""
    rng = np.random.default_rng(seed)
    states = sp.symbols(f"z0:{n}")
    epsilon, k = sp.symbols("epsilon k")
    rates = {}
    for i, state in enumerate(states):
        rate = -state - k * state**3
        for j in range(n):
            if j != i and rng.random() < density:
                weight = sp.Rational(int(rng.integers(-9, 10)), 10)
                rate += weight * (sp.sin(states[j]) if rng.random() < 0.3 else states[j])
        rates[state] = rate / epsilon if 2 * i < n else rate
    return VectorField(rates, epsilon=epsilon, parameters={k: sp.Rational(1, 3)})


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("n", "density"), [(1, 1.0), (2, 1.0), (3, 0.5), (6, 0.4), (8, 0.3), (9, 0.2), (21, 0.05)]
)
def test_a_step_written_for_a_flow_is_that_of_the_loops(n, density):
    compiled = compile_flow(random_field(n, density, n))
    assert is_worth_writing(compiled.expressions)
    p = np.array([0.01, 1.0 / 3.0])
    start = np.cos(np.arange(n))
    records = []
    for program in (
        SOLVERS[Method.RADAU9].program(compiled),
        np.array([compiled.field, compiled.jacobian, 0, address_of(*COLLOCATION_LOOPS), 0]),
    ):
        y, rate = start.copy(), compiled.rates(start, p)
        memory, counters = np.zeros(memory_size(5, n)), np.zeros(integrator.COUNTERS_SIZE, dtype=np.int64)
        memory[integrator.STEP] = 0.02
        times, states = np.empty(1), np.empty((1, n))
        dense = np.empty((1, 5, n))
        state, record = (y, rate, memory, counters), (times, states, dense)
        code = radau((program, p), np.array([1.0]), (1e-3, 1e-3, 100), state, record)
        assert code == integrator.RECORD_FULL
        records.append((times, states, dense, rate))
    for one, other in zip(*records):
        assert one == pytest.approx(other, rel=1e-9, abs=1e-12)


def test_collocation_steps_of_sixteen_states_are_scheduled():
    """Their code is long, and each of its functions is not. Of twenty states, runs take 1.9 times as long without."""
    z = sp.symbols("z0:16")
    field = VectorField({a: b * a - a**3 + b**2 for a, b in zip(z, (*z[1:], z[0]))}, epsilon=None)
    text = CollocationCode(compile_flow(field).expressions, 7).text()
    assert text.count("\n") > LONGEST_SCHEDULED
    assert effort(text) == 1


def test_one_full_jacobian_is_left_to_the_loops_and_a_sparse_one_of_any_size_is_not():
    states = sp.symbols("z0:12")
    full = VectorField({s: -s * sum(states) for s in states}, epsilon=None)
    assert compile_flow(full).collocation(5) is None
    chain = VectorField({s: t - s**3 for s, t in zip(states, states[1:] + states[:1])}, epsilon=None)
    assert compile_flow(chain).collocation(5) is not None
    assert choose_method(compile_flow(full), 1e-5) is Method.RADAU13
    assert choose_method(compile_flow(chain), 1e-5) is Method.RADAU13
    for field in (full, chain):
        run = integrate(field, start=dict.fromkeys(states, 0.5), span=(0, 1), method=Method.RADAU9, rtol=1e-6)
        exact = integrate(
            field, start=dict.fromkeys(states, 0.5), span=(0, 1), method=Method.DOP853, rtol=1e-12
        )
        assert run.y[:, -1] == pytest.approx(exact.y[:, -1], rel=1e-5)


def test_pivots_that_cannot_be_trusted_cost_no_digit():
    """x' = 10^9 y, y' = -10^9 x + ...: the diagonal is nothing beside the rest, and the loops take over."""
    field = VectorField({x: 10**9 * y + x, y: -(10**9) * x - y + 1}, epsilon=None)
    compiled = compile_flow(field)
    assert compiled.collocation(5) is not None
    found = integrate(field, start={x: 1, y: 0}, span=(0, 1e-8), method=Method.RADAU9, rtol=1e-9, atol=1e-12)
    exact = integrate(field, start={x: 1, y: 0}, span=(0, 1e-8), method=Method.DOP853, rtol=1e-13, atol=1e-14)
    assert found.status is Status.SUCCESS
    assert found.y[:, -1] == pytest.approx(exact.y[:, -1], rel=1e-7)
