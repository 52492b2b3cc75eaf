"""Systems of hundreds of states: their sparse Jacobians, by counters, and the accuracy of what runs over them."""

import numpy as np
import pytest
import sympy as sp

from gsp import Event, Method, VectorField, integrate, integrate_many
from gsp.algebra import differentiation
from gsp.integration.methods import choose_method
from gsp.lowering import compiled_flow
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.steps import flow_code

STIFF = (Method.RADAU9, Method.RADAU13)
A, B = 1, 3
CELLS = 24


def brusselator(cells: int) -> tuple[VectorField, dict[str, float]]:
    """Hairer and Wanner II, section IV.10: u' = 1 + u^2 v - 4u + u_xx/50, v' = 3u - u^2 v + v_xx/50, along a line."""
    u, v = sp.symbols(f"u0:{cells}"), sp.symbols(f"v0:{cells}")
    c = sp.Rational((cells + 1) ** 2, 50)

    def bend(w, end):
        line = (end, *w, end)
        return [c * (a - 2 * b + d) for a, b, d in zip(line, line[1:], line[2:])]

    rates = {p: A + p**2 * q - (B + 1) * p + s for p, q, s in zip(u, v, bend(u, A))}
    rates |= {q: B * p - p**2 * q + s for p, q, s in zip(u, v, bend(v, B))}
    x = np.arange(1, cells + 1) / (cells + 1)
    start = dict(zip(map(str, u), (1 + np.sin(2 * np.pi * x)).tolist())) | {str(q): 3.0 for q in v}
    return VectorField(rates, epsilon=None), start


@pytest.fixture(scope="module")
def line():
    return brusselator(CELLS)


@pytest.fixture(scope="module")
def written(line):
    """A run with code for each step of the same field, to ten digits."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flow_code, "_MOST_STATES", 1000)
        flow, start = brusselator(CELLS)
        assert compile_flow(flow).is_written
        return integrate(flow, start=start, span=(0, 2), rtol=1e-11, atol=1e-12, method=Method.RADAU9)


@pytest.mark.exhaustive
@pytest.mark.parametrize("method", STIFF)
def test_every_stiff_method_is_as_exact_as_asked_for(line, written, method):
    flow, start = line
    assert compile_flow(flow).is_sparse
    errors = []
    for rtol in (1e-4, 1e-7):
        run = integrate(flow, start=start, span=(0, 2), rtol=rtol, atol=1e-2 * rtol, method=method)
        assert run.status.ok
        t = np.linspace(0.0, 2.0, 81)
        errors.append(float(np.abs(run.at(t) - written.at(t)).max()))
        read = integrate(flow, start=start, span=(0, 2), rtol=rtol, atol=1e-2 * rtol, method=method, at=t)
        assert np.abs(read.y - written.at(t)).max() < 20 * rtol
        assert np.abs(run.y[:, -1] - written.y[:, -1]).max() < 20 * rtol
    assert errors[0] < 2e-3
    assert errors[1] < 3e-6


def test_steps_are_those_of_dense_loops(line, monkeypatch):
    """The same arithmetic but for the order of elimination: the same steps, and states but for rounding."""
    flow, start = line
    for method in STIFF:
        sparse = integrate(flow, start=start, span=(0, 0.5), rtol=1e-5, atol=1e-7, method=method)
        with monkeypatch.context() as patch:
            patch.setattr(compiled_flow, "is_sparse", lambda code: False)
            again, _ = brusselator(CELLS)
            dense = integrate(again, start=start, span=(0, 0.5), rtol=1e-5, atol=1e-7, method=method)
            assert not compile_flow(again).is_sparse
        assert sparse.stats == dense.stats
        assert sparse.y == pytest.approx(dense.y, rel=1e-6, abs=1e-9)


@pytest.mark.exhaustive
def test_no_work_is_done_for_entries_that_are_zero(monkeypatch):
    taken, made = [], []
    derivative, compiling = differentiation.derivative, compiled_flow.compile_function
    monkeypatch.setattr(flow_code, "derivative", lambda e, s: taken.append(s) or derivative(e, s))
    monkeypatch.setattr(
        compiled_flow,
        "compile_function",
        lambda outputs, **more: made.append(len(outputs)) or compiling(outputs, **more),
    )
    flow, start = brusselator(150)
    run = integrate(flow, start=start, span=(0, 10), rtol=1e-5, atol=1e-7)
    entries = 8 * 150 - 4
    assert len(taken) == entries
    assert sorted(made) == [300, entries]
    assert run.stats.method is Method.RADAU13
    assert run.stats.steps < 60
    elimination = compile_flow(flow).expressions.elimination
    assert len(elimination.places) <= 10 * 300
    assert elimination.operations <= 20 * 300


def test_jacobians_are_those_of_the_field(line):
    flow, start = line
    compiled = compile_flow(flow)
    z, p = np.array(flow.initial(start)), np.array(compiled.parameters(None))
    J = compiled.jacobians(z, p)
    exact = compiled.derivatives(z, p).reshape(2 * CELLS, 2 * CELLS)
    assert np.array_equal(J, exact)
    assert np.array_equal(compiled.jacobians(z[None, :], p)[0], exact)


@pytest.mark.exhaustive
def test_events_and_ensembles_go_the_same_way(line, written):
    flow, start = line
    u = flow.states[8]
    event = Event(u - 1, name="level", terminal=True)
    run = integrate(flow, start=start, span=(0, 2), rtol=1e-8, atol=1e-10, events=event)
    t = run.events["level"].times[0]
    assert written.at(t)[8] == pytest.approx(1.0, abs=1e-6)
    ends = integrate_many(
        flow, starts={name: [value, value] for name, value in start.items()}, span=(0, 2), rtol=1e-8, atol=1e-10
    )
    assert ends.y[0, :, -1] == pytest.approx(written.y[:, -1], abs=1e-6)


@pytest.mark.exhaustive
def test_a_network_that_fills_in_has_the_borders_of_written_code():
    rng = np.random.default_rng(5)
    x = sp.symbols("x0:60")
    rates = {s: -s for s in x}
    for i, j, k in (rng.choice(60, 3, replace=False) for _ in range(240)):
        flux = int(rng.integers(1, 9)) * x[i] * x[j]
        rates[x[i]] -= flux
        rates[x[k]] += flux
    field, start = VectorField(rates, epsilon=None), {str(s): 0.5 for s in x}
    compiled = compile_flow(field)
    assert compiled.is_sparse
    elimination = compiled.expressions.elimination
    assert elimination.operations > 16 * len(elimination.places)
    assert choose_method(compiled, 1e-4) is Method.RADAU9
    run = integrate(field, start=start, span=(0, 3), rtol=1e-8, atol=1e-10)
    tight = integrate(field, start=start, span=(0, 3), rtol=1e-11, atol=1e-13, method="dop853")
    assert run.y[:, -1] == pytest.approx(tight.y[:, -1], abs=1e-7)
