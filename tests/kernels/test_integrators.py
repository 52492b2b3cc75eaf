"""The integrators step by step: coefficients, measured orders, resumption, and the linear algebra below."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from gsp.integration import loop
from gsp.integration.methods import SOLVERS, Method
from gsp.integration.trajectory import integrate
from gsp.kernels import dop853_tableau, integrator, radau_tableau
from gsp.kernels.dense_output import interpolate_many
from gsp.kernels.dop853 import dop853
from gsp.kernels.linear_algebra import factorise, solve
from gsp.kernels.radau import radau
from gsp.kernels.radau_block import memory_size
from gsp.lowering.compiled_flow import CompiledFlow, compile_flow
from gsp.systems.system import VectorField

METHODS = {
    "dop853": (dop853, dop853_tableau.DENSE_ROWS),
    "radau9": (radau, 5),
    "radau13": (radau, 7),
}
STAGES = {"radau9": 5, "radau13": 7}
NO_PARAMETERS = np.array([np.nan])

x, y, z = sp.symbols("x y z")


class Run:
    """One integration by hand: the caller's side of the contract."""

    def __init__(
        self,
        method,
        compiled: CompiledFlow,
        start,
        stops,
        *,
        rtol=1e-8,
        atol=1e-10,
        capacity=10_000,
        loops=False,
    ):
        solver = SOLVERS[Method(method)]
        self.kernel, self.rows = solver.kernel, solver.rows
        self.compiled = compiled
        self.stops = np.array(stops[1:], dtype=float)
        self.tolerances = (rtol, atol)
        self.y = np.array(start, dtype=float)
        self.rate = np.zeros(self.y.size)
        self.memory = np.zeros(
            memory_size(self.rows, self.y.size) if self.kernel is radau else integrator.MEMORY_SIZE
        )
        self.memory[integrator.TIME] = stops[0]
        self.counters = np.zeros(integrator.COUNTERS_SIZE, dtype=np.int64)
        self.capacity = capacity
        self.keeps_dense = True
        self.program = solver.program(compiled).copy()
        solver.give_loops(self.program)
        if loops:
            self.program = np.array([*self.program[: integrator.CODE], 0])
        self.times, self.states = [np.array([float(stops[0])])], [self.y[np.newaxis].copy()]
        self.dense = [np.empty((0, self.rows, self.y.size))]

    def force_step(self, h: float) -> Run:
        """Propose `h` for the first step; what follows can only grow when the tolerance is slack."""
        self.rate[:] = self.compiled.rates(self.y, NO_PARAMETERS)
        self.memory[integrator.STEP] = h
        return self

    def advance(self, max_steps: int = 10**9) -> int:
        n = self.y.size
        times, states = np.empty(self.capacity), np.empty((self.capacity, n))
        dense = np.empty((self.capacity if self.keeps_dense else 0, self.rows, n))
        before = self.counters[integrator.STEPS]
        code = self.kernel(
            (self.program, NO_PARAMETERS),
            self.stops,
            (*self.tolerances, max_steps),
            (self.y, self.rate, self.memory, self.counters),
            (times, states, dense),
        )
        new = self.counters[integrator.STEPS] - before
        self.times.append(times[:new])
        self.states.append(states[:new])
        self.dense.append(dense[:new])
        return code

    def at(self, t) -> np.ndarray:
        out = np.empty((self.y.size, len(t)))
        interpolate_many(
            np.concatenate(self.times),
            np.concatenate(self.states),
            np.concatenate(self.dense),
            np.array(t),
            out,
        )
        return out


def fixed_steps(method: str, compiled: CompiledFlow, start, *, end: float, count: int, slack=1e9) -> Run:
    """`count` equal steps: every step lands on a stop, and the tolerance is so slack that none is shorter."""
    run = Run(method, compiled, start, np.linspace(0.0, end, count + 1), rtol=slack, atol=slack)
    assert run.force_step(end).advance() == integrator.FINISHED
    assert run.counters[integrator.STEPS] == count
    return run


@pytest.fixture(scope="module")
def pendulum() -> CompiledFlow:
    return compile_flow(VectorField({x: y, y: -sp.sin(x)}, epsilon=None))


@pytest.fixture(scope="module")
def swing() -> CompiledFlow:
    """x' = x cos(y), y' = 1: nonlinear, with the solution x = e^(sin t) from (1, 0)."""
    return compile_flow(VectorField({x: x * sp.cos(y), y: sp.Integer(1)}, epsilon=None))


# Coefficients


def test_dop853_rows_sum_to_the_nodes():
    assert dop853_tableau.A.sum(axis=1) == pytest.approx(dop853_tableau.C, abs=5e-15)


@pytest.mark.parametrize("k", range(8))
def test_dop853_weights_satisfy_the_quadrature_conditions_of_order_8(k):
    nodes = dop853_tableau.C[: dop853_tableau.STAGES]
    assert math.fsum(dop853_tableau.B * nodes**k) == pytest.approx(1 / (k + 1), abs=2e-15)


def test_dop853_satisfies_nested_order_conditions():
    b, c = dop853_tableau.B, dop853_tableau.C[:12]
    a = dop853_tableau.A[:12, :12]
    # sum b_i a_ij c_j^k = 1/((k+1)(k+2)), and sum b_i c_i a_ij c_j^k = 1/((k+1)(k+3)), to total order 8.
    for k in range(1, 7):
        assert b @ a @ c**k == pytest.approx(1 / ((k + 1) * (k + 2)), abs=1e-14)
    for k in range(1, 6):
        assert (b * c) @ a @ c**k == pytest.approx(1 / ((k + 1) * (k + 3)), abs=1e-14)
    assert b @ a @ a @ c**5 == pytest.approx(1 / (6 * 7 * 8), abs=1e-14)


def test_dop853_error_weights_vanish_on_constants_and_to_their_order():
    nodes = dop853_tableau.C[:12]
    for k in range(5):
        assert dop853_tableau.ERROR_5 @ nodes**k == pytest.approx(0, abs=1e-14)
    for k in range(3):
        assert dop853_tableau.ERROR_3 @ nodes**k == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize("family", range(2))
def test_radau_is_collocation_at_the_nodes_with_a_quadrature_of_order_2s_minus_1(family):
    stages = radau_tableau.STAGES[family]
    a, c = radau_tableau.A[family, :stages, :stages], radau_tableau.NODES[family, :stages]
    assert c[-1] == 1.0
    for k in range(1, stages + 1):
        assert a @ c ** (k - 1) == pytest.approx(c**k / k, rel=1e-13)
    # Stiffly accurate: the weights are the last row.
    for k in range(1, 2 * stages):
        assert math.fsum(a[-1] * c ** (k - 1)) == pytest.approx(1 / k, rel=2e-15)
    assert math.fsum(a[-1] * c ** (2 * stages - 1)) != pytest.approx(1 / (2 * stages), rel=1e-9)


@pytest.mark.parametrize("family", range(2))
def test_radau_is_transformed_to_one_real_and_several_complex_systems(family):
    stages = radau_tableau.STAGES[family]
    a, t, inverse = (
        matrix[family, :stages, :stages]
        for matrix in (radau_tableau.A, radau_tableau.T, radau_tableau.T_INVERSE)
    )
    eigenvalues = radau_tableau.EIGENVALUES[family, : 1 + stages // 2]
    blocks = np.zeros((stages, stages))
    blocks[0, 0] = eigenvalues[0].real
    for m, value in enumerate(eigenvalues[1:]):
        blocks[1 + 2 * m : 3 + 2 * m, 1 + 2 * m : 3 + 2 * m] = [
            [value.real, -value.imag],
            [value.imag, value.real],
        ]
    assert t @ inverse == pytest.approx(np.eye(stages), abs=1e-12)
    assert t @ blocks @ inverse @ a == pytest.approx(np.eye(stages), abs=1e-11)
    # The characteristic polynomial's first coefficient: the sum of all eigenvalues of A^-1 is s^2.
    assert eigenvalues[0].real + 2 * eigenvalues[1:].real.sum() == pytest.approx(stages**2, rel=1e-12)


@pytest.mark.parametrize("family", range(2))
def test_the_dense_output_of_radau_is_the_collocation_polynomial_and_its_leading_error(family):
    stages = radau_tableau.STAGES[family]
    c = radau_tableau.NODES[family, :stages]
    t, ends = np.linspace(0, 1, 41), np.array([0.0, 1.0])
    for k in range(1, stages + 1):
        rows = radau_tableau.DENSE[family, :stages, :stages] @ c**k
        out = np.empty((1, t.size))
        interpolate_many(ends, ends[:, np.newaxis], rows.reshape(1, stages, 1), t, out)
        assert out[0] == pytest.approx(t**k, abs=1e-13)
    zeros = np.zeros((2, 1))
    leading = radau_tableau.DEFECT[family, :stages].reshape(1, stages, 1)
    near = np.concatenate([c[:-1] - 1e-6, c[:-1] + 1e-6, [0.0, 1e-6]])
    out = np.empty((1, near.size))
    interpolate_many(ends, zeros, np.ascontiguousarray(leading), near, out)
    below, above, start = np.split(out[0], [stages - 1, 2 * stages - 2])
    assert (above - below) / 2e-6 == pytest.approx(0, abs=1e-9)
    assert (start[1] - start[0]) / 1e-6 == pytest.approx(1, abs=1e-4)


# Orders


def test_measured_orders_of_dop853_and_of_its_dense_output(swing):
    end, counts, between = 6.0, (10, 20, 40), np.linspace(0.0, 6.0, 997)
    errors, dense_errors = [], []
    for count in counts:
        run = fixed_steps("dop853", swing, (1.0, 0.0), end=end, count=count)
        errors.append(abs(run.y[0] - math.exp(math.sin(end))))
        dense_errors.append(np.abs(run.at(between)[0] - np.exp(np.sin(between))).max())
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    dense_slope = -np.polyfit(np.log(counts), np.log(dense_errors), 1)[0]
    assert 7.7 < slope < 9.2, errors
    # A dense output of order q errs by O(h^(q+1)) within a step.
    assert 7.7 < dense_slope < 9.2, dense_errors


# Simplified Newton iteration is exact for linear fields, however slack the tolerance.


@pytest.mark.parametrize(
    ("method", "end", "counts"),
    [("radau9", 24.0, (12, 18, 27)), ("radau13", 72.0, (16, 20, 25))],
)
def test_measured_orders_of_radau(method, end, counts):
    stages = STAGES[method]
    compiled = compile_flow(VectorField({x: y, y: -x}, epsilon=None))
    between = np.linspace(0.0, end, 997)
    errors, dense_errors = [], []
    for count in counts:
        run = fixed_steps(method, compiled, (1.0, 0.0), end=end, count=count)
        errors.append(math.hypot(run.y[0] - math.cos(end), run.y[1] + math.sin(end)))
        dense_errors.append(np.abs(run.at(between)[0] - np.cos(between)).max())
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert 2 * stages - 1.7 < slope < 2 * stages - 0.3, errors
    # Degree stages + 1 and so O(h^(stages + 2)) within a step.
    dense_slope = -np.polyfit(np.log(counts), np.log(dense_errors), 1)[0]
    assert stages + 1.5 < dense_slope < 2 * stages, dense_errors


@pytest.mark.parametrize("method", STAGES)
def test_radau_on_the_problem_of_prothero_and_robinson_falls_to_its_stage_order(method):
    """x' = -L (x - u) + u' with u = cos t: order 2s - 1 for L = 1, stage order s and no more for L h >> 1.

    Two rounds of the iteration are exact here, so that a tolerance of 0.5 adds nothing to the error.
    """
    stages = STAGES[method]
    mild = {5: (8, 12, 18), 7: (4, 5, 6)}[stages]
    stiff = {5: (8, 12, 18), 7: (6, 7, 8)}[stages]
    slopes = {}
    for rate, counts in ((1, mild), (10**4, stiff)):
        field = VectorField({x: -rate * (x - sp.cos(y)) - sp.sin(y), y: sp.Integer(1)}, epsilon=None)
        compiled = compile_flow(field)
        errors = []
        for count in counts:
            run = fixed_steps(method, compiled, (1.0, 0.0), end=12.0, count=count, slack=0.5)
            values, t = np.concatenate(run.states)[1:, 0], np.concatenate(run.times)[1:]
            errors.append(math.sqrt(np.mean((values - np.cos(t)) ** 2)))
        slopes[rate] = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert 2 * stages - 3 < slopes[1] < 2 * stages, slopes
    assert stages - 0.7 < slopes[10**4] < stages + 0.7, slopes


def test_every_method_is_exact_for_constant_fields_and_for_their_dense_output():
    compiled = compile_flow(VectorField({x: sp.Integer(3), y: sp.Rational(-1, 2)}, epsilon=None))
    for method in METHODS:
        run = fixed_steps(method, compiled, (1.0, 0.0), end=2.0, count=4)
        assert run.y == pytest.approx([7.0, -1.0], rel=1e-15)
        assert run.at([0.3, 1.9]) == pytest.approx(np.array([[1.9, 6.7], [-0.15, -0.95]]), rel=1e-14)


# Roundings of a step that may add up, on any processor.
ROUNDINGS = 8.0


def grown(method: str) -> float:
    """What a step may multiply roundings of its stages by, which go through T^-1 and come back through T."""
    stages = STAGES[method]
    family = radau_tableau.STAGES.index(stages)
    there, back = (
        np.abs(matrix[family, :stages, :stages]) for matrix in (radau_tableau.T_INVERSE, radau_tableau.T)
    )
    return float((back @ there).sum(axis=1).max())


@pytest.mark.parametrize("method", STAGES)
def test_an_infinitely_stiff_component_is_damped_in_one_step(method):
    """Stiff accuracy: R(infinity) = 0, so one step of any length forgets the start."""
    compiled = compile_flow(VectorField({x: -(10**15) * (x - 2)}, epsilon=None))
    run = fixed_steps(method, compiled, (5.0,), end=1.0, count=1)
    assert abs(run.y[0] - 2.0) <= ROUNDINGS * np.finfo(float).eps * grown(method) * 3.0


def test_dense_output_meets_the_steps_exactly():
    compiled = compile_flow(VectorField({x: y, y: -sp.sin(x)}, epsilon=None))
    for method in METHODS:
        run = Run(method, compiled, (1.0, 0.0), [0.0, 7.0])
        assert run.advance() == integrator.FINISHED
        assert np.array_equal(run.at(np.concatenate(run.times)), np.concatenate(run.states).T)


# The driver


@pytest.mark.parametrize("method", METHODS)
def test_a_run_resumed_from_a_full_record_is_the_same_run(method, swing):
    stops = [0.0, 1.0, 2.5, 9.0]
    whole = Run(method, swing, (1.0, 0.0), stops)
    assert whole.advance() == integrator.FINISHED
    pieces = Run(method, swing, (1.0, 0.0), stops, capacity=3)
    while (code := pieces.advance()) == integrator.RECORD_FULL:
        assert pieces.times[-1].size == 3
    assert code == integrator.FINISHED
    assert np.array_equal(np.concatenate(whole.times), np.concatenate(pieces.times))
    assert np.array_equal(np.concatenate(whole.states), np.concatenate(pieces.states))
    assert np.array_equal(np.concatenate(whole.dense), np.concatenate(pieces.dense))
    assert np.array_equal(whole.counters, pieces.counters)


@pytest.mark.parametrize("method", STAGES)
def test_code_for_one_flow_and_loops_for_any_make_the_same_steps(method, swing):
    written, loops = (Run(method, swing, (1.0, 0.0), [0.0, 1.0, 9.0], loops=which) for which in (False, True))
    assert written.program[integrator.CODE] != 0
    assert written.advance() == loops.advance() == integrator.FINISHED
    t = np.linspace(0.0, 9.0, 101)
    assert written.at(t) == pytest.approx(loops.at(t), rel=1e-7, abs=1e-7)
    assert abs(written.counters[integrator.STEPS] - loops.counters[integrator.STEPS]) <= 1


@pytest.mark.parametrize("loops", [False, True])
@pytest.mark.parametrize("method", [*STAGES, "dop853"])
def test_how_large_a_state_is_costs_no_steps(method, loops, swing):
    # Linear in x, whose square overflows from 1e154 on.
    one, large = (Run(method, swing, (of, 0.0), [0.0, 9.0], loops=loops) for of in (1.0, 2.0**600))
    assert one.advance(5_000) == large.advance(5_000) == integrator.FINISHED
    tried = [int(run.counters[integrator.STEPS] + run.counters[integrator.REJECTED]) for run in (one, large)]
    assert tried[1] <= 2 * tried[0]


@pytest.mark.parametrize("method", STAGES)
def test_a_pivot_of_zero_is_left_to_the_loops(method):
    """x' = x + y, y' = -x at the step for which the shift is just the first entry of the Jacobian."""
    gamma = 1.0 / radau_tableau.EIGENVALUES[(STAGES[method] - 5) // 2, 0].real
    compiled = compile_flow(VectorField({x: x + y, y: -x}, epsilon=None))
    ends = []
    for loops in (False, True):
        run = Run(method, compiled, (1.0, 0.5), [0.0, 1.0], rtol=1.0, atol=1e9, loops=loops)
        run.force_step(1.0 / gamma).stops[:] = 1.0 / gamma
        assert run.advance(1) in (integrator.FINISHED, integrator.TOO_MANY_STEPS)
        assert run.counters[integrator.STEPS] == 1
        ends.append(run.y)
    # The same to the last bit, which two ways to compute would not be.
    assert np.isfinite(ends[0]).all()
    assert np.array_equal(*ends)


@pytest.mark.parametrize("method", STAGES)
def test_loops_are_compiled_into_a_run_once_a_step_wants_them(method):
    """The pivot of zero again, where nobody has asked for the loops before."""
    gamma = 1.0 / radau_tableau.EIGENVALUES[(STAGES[method] - 5) // 2, 0].real
    start, stops = (1.0, 0.5), np.array([1.0 / gamma, 2.0 / gamma])
    known = Run(
        method, compile_flow(VectorField({x: x + y, y: -x}, epsilon=None)), start, [0.0, *stops], rtol=1e-3
    )
    known.force_step(stops[0])
    assert known.advance() == integrator.FINISHED
    compiled = compile_flow(VectorField({x: x + y, y: -x}, epsilon=None))
    program = SOLVERS[Method(method)].program(compiled)
    assert program[integrator.CODE] != 0
    assert program[integrator.LOOPS] == 0
    control = loop.Control(Method(method), 1e-3, known.tolerances[1], 1000)
    asked = loop.Run(compiled, NO_PARAMETERS, start, 0.0, stops, control, first_step=stops[0])
    record = loop.run(asked)
    assert program[integrator.LOOPS] != 0
    # Bit for bit, and what was tried before the loops were there is not counted.
    assert np.array_equal(record.times, np.concatenate(known.times))
    assert np.array_equal(record.states, np.concatenate(known.states))
    assert np.array_equal(record.dense, np.concatenate(known.dense))
    assert record.counters == known.counters[: len(record.counters)].tolist()


@pytest.mark.parametrize("method", STAGES)
def test_code_and_loops_reject_and_estimate_alike(method):
    """From off the slow manifold, with a first step that is much too long: estimate (8.20) and divergence too."""
    rates = {x: -(10**4) * (x**3 - sp.cos(y) - z), y: 1 + x * z, z: sp.sin(x) - y * z}
    compiled = compile_flow(VectorField(rates, epsilon=None))
    written, loops = (
        Run(method, compiled, (3.0, 0.0, 0.5), [0.0, 0.4, 2.0], loops=which).force_step(0.3)
        for which in (False, True)
    )
    # Where the error is lost in rounding, further on, so is what the next step's length follows from.
    assert written.advance(10) == loops.advance(10) == integrator.TOO_MANY_STEPS
    assert written.counters[integrator.REJECTED] > 0
    assert np.array_equal(written.counters[: integrator.FIELD_CALLS], loops.counters[: integrator.FIELD_CALLS])
    for a, b in ((written.times, loops.times), (written.states, loops.states), (written.dense, loops.dense)):
        assert np.concatenate(a) == pytest.approx(np.concatenate(b), rel=1e-6, abs=1e-9)
    assert written.advance() == loops.advance() == integrator.FINISHED
    t = np.linspace(0.0, 2.0, 101)
    assert written.at(t) == pytest.approx(loops.at(t), rel=1e-7, abs=1e-8)


@pytest.mark.parametrize("method", STAGES)
def test_no_step_ends_where_the_field_is_not_finite(method):
    compiled = compile_flow(VectorField({x: 1 + sp.Rational(1, 10**12) * sp.log(1 - x)}, epsilon=None))
    run = Run(method, compiled, (0.0,), [0.0, 2.0])
    assert run.advance() in (integrator.NON_FINITE, integrator.STEP_TOO_SMALL)
    assert np.isfinite(run.rate).all()
    assert run.y[0] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_record_without_dense_output_has_the_same_states(method, swing):
    whole, bare = (Run(method, swing, (1.0, 0.0), [0.0, 1.0, 9.0], rtol=1e-6) for _ in range(2))
    bare.keeps_dense = False
    assert whole.advance() == bare.advance() == integrator.FINISHED
    assert np.array_equal(np.concatenate(whole.states), np.concatenate(bare.states))
    assert np.array_equal(np.concatenate(whole.times), np.concatenate(bare.times))
    spared = 3 * whole.counters[integrator.STEPS] if method == "dop853" else 0
    assert bare.counters[integrator.FIELD_CALLS] == whole.counters[integrator.FIELD_CALLS] - spared


@pytest.mark.parametrize("method", METHODS)
def test_a_run_out_of_steps_can_go_on(method, swing):
    run = Run(method, swing, (1.0, 0.0), [0.0, 9.0])
    assert run.advance(max_steps=5) == integrator.TOO_MANY_STEPS
    assert run.counters[integrator.STEPS] + run.counters[integrator.REJECTED] == 5
    assert run.advance() == integrator.FINISHED
    assert run.y[0] == pytest.approx(math.exp(math.sin(9.0)), rel=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_the_counters_add_up(method, swing):
    run = Run(method, swing, (1.0, 0.0), [0.0, 20.0], rtol=1e-9, atol=1e-9)
    run.advance()
    counters = run.counters
    steps, rejected = counters[integrator.STEPS], counters[integrator.REJECTED]
    assert steps == sum(piece.size for piece in run.times) - 1
    if method in STAGES:
        # That of the guess, which is another in each attempt.
        assert counters[integrator.JACOBIAN_CALLS] == counters[integrator.DECOMPOSITIONS] == steps + rejected
        # Whole rounds, the rate at each new point, the two calls of the start, a second estimate or two.
        rounds, others = divmod(counters[integrator.FIELD_CALLS] - steps - 2, STAGES[method])
        assert steps + rejected <= rounds <= 8 * (steps + rejected)
        assert others <= rejected
    else:
        assert counters[integrator.JACOBIAN_CALLS] == counters[integrator.DECOMPOSITIONS] == 0
        assert counters[integrator.FIELD_CALLS] == 2 + 15 * steps + 12 * rejected


@pytest.mark.parametrize("method", METHODS)
def test_steps_are_chosen_so_that_few_are_rejected(method, pendulum):
    run = Run(method, pendulum, (1.0, 0.0), [0.0, 40.0], rtol=1e-6, atol=1e-8)
    assert run.advance() == integrator.FINISHED
    assert 5 * run.counters[integrator.REJECTED] <= run.counters[integrator.STEPS]


def test_a_step_whose_matrix_is_singular_is_shortened():
    h = 0.5
    growth = sp.Rational(radau_tableau.EIGENVALUES[0, 0].real / h)
    run = Run("radau9", compile_flow(VectorField({x: growth * x}, epsilon=None)), (1.0,), [0.0, 1.0])
    assert run.force_step(h).advance() == integrator.FINISHED
    assert run.counters[integrator.REJECTED] >= 1
    assert run.y[0] == pytest.approx(math.exp(float(growth)), rel=1e-6)


@pytest.mark.parametrize("method", STAGES)
def test_a_matrix_that_stays_singular_ends_the_run(method):
    """The diagonal, a multiple of 1/h, is lost beside entries of 1e300, whatever h."""
    rise = sp.Integer(10) ** 300 * (x + y)
    run = Run(method, compile_flow(VectorField({x: rise, y: rise}, epsilon=None)), (0.0, 0.0), [1.0, 2.0])
    assert run.force_step(0.5).advance() == integrator.SINGULAR_JACOBIAN
    assert run.memory[integrator.TIME] == 1.0


# Linear algebra


@settings(max_examples=40)
@given(st.integers(1, 9), st.integers(0, 2**31))
def test_solving_agrees_with_numpy(n, seed):
    generator = np.random.default_rng(seed)
    matrix, b = generator.normal(size=(n, n)), generator.normal(size=n)
    factors, pivots, solution = matrix.copy(), np.empty(n, np.int64), b.copy()
    assert factorise(factors, pivots)
    solve(factors, pivots, solution)
    assert solution == pytest.approx(np.linalg.solve(matrix, b), rel=1e-8, abs=1e-8)


def test_a_zero_on_the_diagonal_is_pivoted_away():
    factors, pivots, b = np.array([[0.0, 2.0], [4.0, 0.0]]), np.empty(2, np.int64), np.array([6.0, 4.0])
    assert factorise(factors, pivots)
    solve(factors, pivots, b)
    assert np.array_equal(b, [1.0, 3.0])


@pytest.mark.parametrize("bad", [[[1.0, 2.0], [2.0, 4.0]], [[0.0]], [[np.nan]]])
def test_a_singular_matrix_is_not_factorised(bad):
    factors = np.array(bad)
    assert not factorise(factors, np.empty(len(bad), np.int64))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("first_step", [0.0, 0.01])
def test_a_launched_run_is_the_kernels_own_bit_by_bit(method, first_step) -> None:
    compiled = compile_flow(VectorField({x: y, y: 5 * (1 - x**2) * y - x}, epsilon=None))
    by_hand = Run(method, compiled, [2.0, 0.0], [0.0, 30.0, 60.0])
    if first_step:
        by_hand.force_step(first_step)
    assert by_hand.advance() == integrator.FINISHED
    control, looks = loop.Control(Method(method), 1e-8, 1e-10, 10**9), loop.Looks(rows_kept=100)
    stops = np.array([30.0, 60.0])
    record = loop.run(loop.Run(compiled, (np.nan,), (2.0, 0.0), 0.0, stops, control, True, first_step, looks))
    assert np.array_equal(record.times, np.concatenate(by_hand.times))
    assert np.array_equal(record.states, np.concatenate(by_hand.states))
    assert np.array_equal(record.dense, np.concatenate(by_hand.dense))
    assert record.counters == by_hand.counters.tolist()[: integrator.STIFF + 1]
    # More than one record long.
    assert len(record.times) > 101


@pytest.mark.parametrize("method", ["radau9", "radau13"])
@pytest.mark.parametrize("rtol", [1e-8, 1e-10])
@pytest.mark.parametrize("loss", [lambda p: p / (p + 0.2), lambda p: p**2 / 5])
def test_a_linear_layer_does_not_speak_for_a_slow_variable_beside_it(method: str, rtol: float, loss) -> None:
    """m is switched from 15 to 1, and p' = m - loss(p): the iteration contracts at once in m, and not in p."""
    layer, begin, switched, end = 0.01, 0.9, 1.0, 3.0
    flow = VectorField({x: y - loss(x), y: (8 + 7 * sp.sign(1 - z) - y) / layer, z: 1})
    start = {"x": 0.1, "y": 15.0, "z": begin}
    run = integrate(flow, start=start, span=(begin, end), rtol=rtol, atol=1e-3 * rtol, method=method)
    exact = [start["x"]]
    for first, last in ((begin, switched), (switched, end)):
        exact = solve_ivp(
            lambda t, p: 1 + 14 * np.exp(-max(t - switched, 0.0) / layer) - loss(p),
            (first, last), exact, method="DOP853", rtol=1e-13, atol=1e-15, max_step=0.05,
        ).y[:, -1]  # fmt: skip
    assert abs(run["x"][-1] - exact[0]) < 2 * rtol * exact[0]
