"""The determinant of many coupled fast variables' Jacobian and how it changes are those of dense matrices."""

from itertools import pairwise

import numpy as np
import pytest
import sympy as sp

from gsp import SlowFastSystem, Status, expand, integrate, restrict, solve_critical
from gsp.algebra import sharing
from gsp.errors import DeclarationError, HyperbolicityError
from gsp.integration.methods import Method
from gsp.integration.reduction_end import endings
from gsp.integration.reduction_end.sparse_fast_part import SparseFastPart
from gsp.integration.reduction_end.validity import Validity, validity_of
from gsp.integration.watched import Stepper
from gsp.kernels import engine
from gsp.lowering import compiled_function
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_function

x, epsilon = sp.symbols("x epsilon")
STEP = 1e-5


def network(species: int, *, seed: int = 0) -> SlowFastSystem:
    """Mass action between species chosen at random, each fed and washed out."""
    rng = np.random.default_rng(seed)
    y = sp.symbols(f"y1:{species + 1}")
    rates = {s: (1 + x) / 10 - s for s in y}
    for _ in range(species):
        a, b, c, d = (y[i] for i in rng.choice(species, 4, replace=False))
        k = sp.Rational(int(rng.integers(1, 50)), 10)
        for s, sign in ((a, -1), (b, -1), (c, 1), (d, 1)):
            rates[s] += sign * k * a * b
    return SlowFastSystem(slow={x: y[-1] - x}, fast=rates, epsilon=epsilon)


def reduced(system: SlowFastSystem, order: int = 1, start: float = 0.1):
    (branch,) = solve_critical(system).branches
    sheet = branch.through({"x": 10 * start, **{s.name: start for s in system.y}})
    return restrict(expand(sheet, order=order))


@pytest.fixture(scope="module")
def flow():
    return reduced(network(30))


def scaled_determinant(J: np.ndarray) -> float:
    return float(np.linalg.det(J / np.linalg.norm(J, axis=1)[:, None]))


@pytest.mark.exhaustive
def test_what_is_watched_is_that_of_dense_matrices(flow) -> None:
    validity = validity_of(flow)
    parts = validity._parts
    assert isinstance(parts, SparseFastPart)
    z = np.array([1.0, *np.linspace(0.05, 0.3, 30)])
    wanted = [parts._D, parts._along, parts._drift, parts._moved, *parts._rates]
    found = validity._over(validity.states, wanted, parts.calls)(z, [0.01])
    J = validity.fast_jacobian(z)
    g_x = validity.derivatives(z, [0.01])[30 * 30 :]
    f = z[-1] - z[0]
    rate = np.array([f, *np.linalg.solve(J, -g_x * f)])
    assert found[4:] == pytest.approx(rate, rel=1e-10)
    for place, direction in ((1, rate), (3, z)):
        ends = [scaled_determinant(validity.fast_jacobian(z + s * STEP * direction)) for s in (-1, 1)]
        assert found[place] == pytest.approx((ends[1] - ends[0]) / (2 * STEP), rel=1e-5)
    assert found[0] == pytest.approx(scaled_determinant(J), rel=1e-10)
    traces = [np.trace(np.linalg.inv(validity.fast_jacobian(z + s * STEP * rate))) for s in (-1, 1)]
    assert found[2] == pytest.approx((traces[1] - traces[0]) / (2 * STEP), rel=1e-5)


def test_how_the_fast_variables_follow_is_that_of_dense_matrices(flow) -> None:
    validity = validity_of(flow)
    z = np.array([1.0, *np.linspace(0.05, 0.3, 30)])
    J, g_x = validity.fast_jacobian(z), validity.derivatives(z, [0.01])[30 * 30 :]
    expected = -scaled_determinant(J) * np.linalg.solve(J, g_x)
    assert validity.pulled(z, [0.01]) == pytest.approx(expected, rel=1e-9)


@pytest.mark.exhaustive
def test_the_code_of_what_is_watched_grows_as_the_entries_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """Factors fill in: written out, those of 200 species took 200,000 operations, and minutes to compile."""
    lines = [0.0]
    build = compiled_function.build

    def counted(text: str, **more):
        lines[-1] += text.count("\n")
        return build(text, **more)

    monkeypatch.setattr(compiled_function, "build", counted)
    for species in (25, 60):
        system = network(species, seed=7)
        validity = Validity(reduced(system))
        lines.append(0.0)
        assert validity.tests.outputs == 5
        lines[-1] /= len(validity._places[0])
    assert 0.0 < lines[2] < 1.3 * lines[1]


def test_shared_observables_are_not_searched_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of 200 observables holds most of the program of all: searching it for each took a third of the whole way."""
    has, asked = sharing._Shared.has, []

    def counted(self, *patterns):
        if not all(isinstance(pattern, sp.Symbol) for pattern in patterns):
            asked.append(patterns)
        return has(self, *patterns)

    monkeypatch.setattr(sharing._Shared, "has", counted)
    flow = reduced(network(25, seed=3))
    assert any(isinstance(value, sharing._Shared) for value in flow.observables.values())
    assert not asked


@pytest.mark.exhaustive
def test_a_network_runs_and_keeps_to_its_manifold(flow) -> None:
    system = flow.manifold.branch.system
    run = integrate(flow, start={"x": 1.0}, span=(0.0, 1.0), epsilon=0.01)
    assert run.status is Status.SUCCESS
    start = {"x": 1.0, **{s.name: float(run[s.name][0]) for s in system.y}}
    full = integrate(system, start=start, span=(0.0, 1.0), epsilon=0.01, rtol=1e-9, atol=1e-11)
    assert run["x"][-1] == pytest.approx(full["x"][-1], abs=1e-4)


def test_an_eigenvalue_that_passes_zero_ends_the_run_at_the_fold() -> None:
    """y_0 has a fold at x = 1/4; the others are coupled in a ring, and to it."""
    y = sp.symbols("y0:12")
    rates = {s: y[i - 1] / 3 + y[(i + 1) % 12] / 4 - 2 * s - s**3 for i, s in enumerate(y)}
    rates[y[0]] = x + y[0] ** 2 + y[0] + y[1] / 1000
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast=rates, epsilon=epsilon)
    (branch,) = solve_critical(system).branches
    flow = restrict(expand(branch.through({"x": 0.0, **dict.fromkeys(map(str, y), 0.0), "y0": -1.0}), order=0))
    assert isinstance(validity_of(flow)._parts, SparseFastPart)
    run = integrate(flow, start={"x": 0.0}, span=(0.0, 1.0), epsilon=0.01)
    assert run.status is Status.FOLD_REACHED
    assert run["x"][-1] == pytest.approx(0.25, abs=1e-3)
    state = np.array([run[str(s)][-1] for s in (x, *y)])
    assert abs(np.linalg.eigvals(validity_of(flow).fast_jacobian(state))).min() < 1e-3


def cascade(length: int) -> SlowFastSystem:
    """Each variable drives the next by 50 and feeds back a little: the pivots are a fiftieth of the rows' sizes."""
    y = sp.symbols(f"y1:{length + 1}")
    after = (*y[1:], sp.Integer(0))
    rates = {
        s: -s - s**3 + 50 * before + sp.Rational(1, 10_000) * behind
        for s, before, behind in zip(y, (x, *y), after)
    }
    return SlowFastSystem(slow={x: -x}, fast=rates, epsilon=epsilon)


@pytest.mark.exhaustive
def test_a_determinant_too_small_for_a_double_is_no_loss() -> None:
    flow = reduced(cascade(140), order=0, start=0.0)
    stepper = Stepper(compile_flow(flow), np.array([0.01]), Method.DOP853, 1e-6, 1e-9)
    start = np.zeros(len(flow.states))
    with pytest.raises(DeclarationError, match="too small for a double") as refused:
        endings.Ending(flow, stepper, (0.0, 1.0), start)
    assert not isinstance(refused.value, HyperbolicityError)
    assert 0.0 < abs(refused.value.value) < refused.value.limit


def test_long_functions_are_selected_instruction_by_instruction() -> None:
    body = "  store double 0.0, double* %0\n" * (engine.LONGEST_SCHEDULED - 3)
    short, long = (f"define void @f(double* %0)\n{{\n{part}}}\n" for part in (body, 2 * body))
    assert engine.effort(short) == 1
    assert engine.effort(long) == 0
    assert engine.effort(short + long) == 0
    # What schedules take grows with the square of a function, and with the number of functions.
    assert engine.effort(short + short + short) == 1


def test_long_code_gives_the_same_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    z = sp.symbols("z0:40")
    outputs = [sp.exp(a) * b - a / (1 + b**2) + sp.sin(a * b) for a, b in pairwise(z)]
    at = np.linspace(0.1, 2.0, 40)
    found = []
    for bound, scheduled in ((10**9, True), (0, True), (10**9, False)):
        monkeypatch.setattr(engine, "LONGEST_SCHEDULED", bound)
        compiled_function._compile.cache_clear()
        f = compile_function(outputs, arguments=z, epsilon=None, parameters=[], scheduled=scheduled)
        found.append(f(at, [np.nan]))
    assert np.array_equal(found[0], found[1])
    assert np.array_equal(found[0], found[2])
