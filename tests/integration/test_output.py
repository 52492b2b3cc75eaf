"""Values at the times asked for: as good as the steps are, whatever the dense output is, and at the cost of no step."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.errors import Status
from gsp.integration import output
from gsp.integration.ensemble import integrate_many
from gsp.integration.loop import Control
from gsp.integration.methods import Method
from gsp.integration.output import read
from gsp.integration.run_array import Record
from gsp.integration.trajectory import integrate
from gsp.kernels.dense_output import interpolate_many
from gsp.lowering.compiled_flow import compile_flow
from gsp.systems.system import VectorField
from tests.cases import crossed, thinned
from tests.integration.test_stiff_accuracy import PROBLEMS, STIFF

x, y, z, u = sp.symbols("x y z u")
EVERY = pytest.mark.parametrize("method", list(Method))
NOT_STIFF = {
    "oscillator": ({x: y, y: -x}, {"x": 1, "y": 0}, 30),
    "Lotka and Volterra": ({x: x * (1 - y), y: y * (x - 1)}, {"x": 2, "y": 1}, 20),
    "pendulum": ({x: y, y: -sp.sin(x)}, {"x": 2.5, "y": 0}, 20),
    "logistic": ({x: x * (1 - x)}, {"x": 0.01}, 15),
    "Lorenz": ({x: 10 * (y - x), y: 28 * x - y - x * z, z: x * y - 8 * z / 3}, dict.fromkeys("xyz", 1), 3),
}


def worst(found: np.ndarray, exact: np.ndarray, rtol: float, floor: float | np.ndarray) -> float:
    return float((np.abs(found - exact) / (rtol * np.maximum(np.abs(exact), floor))).max())


@pytest.mark.parametrize(("name", "method"), crossed(PROBLEMS, STIFF))
def test_values_at_the_times_asked_for_are_within_ten_tolerances_or_the_steps_error(name, method):
    problem = PROBLEMS[name]
    field = VectorField(problem.rates, epsilon=None)
    times = np.linspace(0.0, problem.end, 100)
    for rtol in (2.9e-4, 2e-5, 1e-6, 1e-8):
        for start in problem.starts:
            options = {"span": (0, problem.end), "rtol": rtol, "atol": 1e-3 * rtol, "method": method}
            named = {s.name: value for s, value in start.items()}
            free = integrate(field, start=named, **options)
            read = integrate(field, start=named, at=times, **options)
            exact = [
                np.array([problem.exact(t, start)[s] * np.ones_like(t) for s in field.states])
                for t in (times, free.t)
            ]
            steps = worst(free.y, exact[1], rtol, 1e-2)
            assert worst(read.y, exact[0], rtol, 1e-2) < max(10.0, 1.5 * steps), (rtol, start)
            # As many steps as without a grid.
            assert read.stats.steps == free.stats.steps


@EVERY
@pytest.mark.parametrize("name", thinned(NOT_STIFF, 2))
def test_values_of_runs_that_are_not_stiff_are_as_good_as_the_steps(name, method):
    rates, start, end = NOT_STIFF[name]
    field = VectorField(rates, epsilon=None)
    times = np.linspace(0, end, 200)[1:]

    def exact(t):
        return integrate(
            field, start=start, span=(0, end), rtol=1e-13, atol=1e-14, at=t, method=Method.RADAU13
        ).y  # fmt: skip

    for rtol in (1e-4, 1e-7, 1e-10):
        options = {"start": start, "span": (0, end), "rtol": rtol, "atol": 1e-2 * rtol, "method": method}
        free, read = integrate(field, **options), integrate(field, at=times, **options)
        sizes = np.abs(tight := exact(times)).max(axis=1, keepdims=True)
        steps = worst(free.y[:, 1:], exact(free.t[1:]), rtol, sizes)
        assert worst(read.y, tight, rtol, sizes) < max(10.0, 4.0 * steps), rtol
        assert read.stats.steps == free.stats.steps


def read_off(run, times) -> np.ndarray:
    """The dense output (n, m) as it is."""
    record, out = run._record, np.empty((run.y.shape[0], len(times)))
    interpolate_many(record.times, record.states, record.dense, times, out)
    return out


@EVERY
def test_the_methods_without_doubt_are_read_off_the_dense_output(method):
    field = VectorField(NOT_STIFF["pendulum"][0], epsilon=None)
    times = np.linspace(0, 20, 333)
    run = integrate(field, start={"x": 2.5, "y": 0}, span=(0, 20), at=times, rtol=1e-9, method=method)
    assert run.status is Status.SUCCESS
    if method in (Method.RADAU9, Method.RADAU13):
        assert np.array_equal(run.at(times), run.y)
    assert run.at(times) == pytest.approx(run.y, abs=1e-6)
    assert run.at(20.0) == pytest.approx(run.y[:, -1], abs=0)


@pytest.mark.exhaustive
@pytest.mark.parametrize("states", [2, 9])
@pytest.mark.parametrize("count", [5, 40, 900])
def test_what_is_read_is_the_same_along_times_along_states_and_one_by_one(states, count):
    chain = sp.symbols(f"c:{states}")
    rates = {s: 30 * (sp.cos(chain[i - 1]) - s) for i, s in enumerate(chain)}
    times = np.linspace(0, 4, count)
    start = {s: 0.1 * i for i, s in enumerate(chain)}
    run = integrate(
        VectorField(rates, epsilon=None), start=start, span=(0, 4), at=times, rtol=1e-5, method=Method.RADAU9
    )
    assert np.array_equal(run.at(times), run.y)


@pytest.mark.parametrize("method", list(Method))
@pytest.mark.parametrize("rate", [sp.Abs(x - 1), sp.Heaviside(x - 1), sp.Max(x, 1)], ids=str)
def test_steps_end_on_the_grid_where_a_field_has_kinks_or_jumps(method, rate):
    field = VectorField({x: sp.Integer(1), y: rate}, epsilon=None)
    times = np.linspace(0, 2, 23)
    for at in (times, times[1:-3]):
        run = integrate(field, start={"x": 0, "y": 0}, span=(0, 2), at=at, rtol=1e-8, method=method)
        assert np.isin(at, run._record.times).all()
        assert np.array_equal(run.at(at), run.y)
    many = integrate_many(field, {"x": 0, "y": 0}, span=(0, 2), at=at, rtol=1e-8, method=method)
    assert np.array_equal(many.y[0], run.y)


@EVERY
def test_backward_and_on_part_of_the_span(method):
    field = VectorField({x: y, y: -x}, epsilon=None)
    at = np.linspace(9, 1, 50)
    run = integrate(field, start={"x": 1, "y": 0}, span=(10, 0), at=at, rtol=1e-9, atol=1e-11, method=method)
    assert np.array_equal(run.t, at)
    assert run["x"] == pytest.approx(np.cos(at - 10), abs=1e-7)
    assert run.at(0.0) == pytest.approx([np.cos(10), np.sin(10)], abs=1e-7)


@EVERY
def test_a_run_that_fails_keeps_the_times_it_reached(method):
    field = VectorField({x: x**2}, epsilon=None)
    at = np.linspace(0, 2, 40)
    run = integrate(field, start={"x": 1}, span=(0, 2), at=at, method=method)
    assert not run.status.ok
    assert np.array_equal(run.t, at[:20])
    assert run["x"] == pytest.approx(1 / (1 - run.t), rel=1e-6)
    many = integrate_many(field, {"x": 1}, span=(0, 2), at=at, method=method)
    assert np.array_equal(many.y[0, :, :20], run.y)
    assert np.isnan(many.y[0, :, 20:]).all()


@pytest.mark.parametrize("method", [Method.RADAU9, Method.DOP853])
@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-6])
def test_what_is_read_in_the_room_of_a_run_is_what_is_read_of_its_record(method, rtol):
    x, y = sp.symbols("x y")
    field = VectorField({x: y, y: 5 * (1 - x**2) * y - x}, epsilon=None)
    asked = {"start": {x: 2.0, y: 0.0}, "span": (0.0, 6.0), "rtol": rtol, "atol": rtol, "method": method}
    times = np.linspace(0.1, 6.0, 60)
    found = integrate(field, at=times, **asked)
    lies = integrate(field, **asked)._record
    apart = lies.apart()
    assert type(apart) is Record
    compiled = compile_flow(field)
    control = Control(method, rtol, rtol, 1000)
    states, apart = read(compiled, compiled.parameters(None), apart, times, control=control)
    assert len(states) == len(times)
    assert np.array_equal(found.y, states.T)
    assert found.stats == apart.stats
    # Radau's order 9 is trusted.
    assert found.stats.field_calls > lies.stats.field_calls or method is Method.RADAU9


def test_an_explicit_run_is_read_and_corrected_in_one_call_of_compiled_code(monkeypatch):
    rates, start, end = NOT_STIFF["oscillator"]
    field, times = VectorField(rates, epsilon=None), np.linspace(0, end, 100)
    calls, read_all = [], output.read_explicit_run
    monkeypatch.setattr(output, "read_explicit_run", lambda *arguments: calls.append(1) or read_all(*arguments))
    for name in ("read_run", "read_grid", "correct"):
        monkeypatch.setattr(output, name, lambda *arguments: pytest.fail("a second call"))
    asked = {"start": start, "span": (0, end), "rtol": 1e-5, "atol": 1e-7, "method": Method.DOP853}
    run, free = integrate(field, at=times, **asked), integrate(field, **asked)
    corrected = (read_off(run, times) != run.y).any(axis=0)
    steps = np.searchsorted(free.t, times[corrected])
    assert calls == [1]
    # Three places a step, three more after each correction, and nothing is landed on.
    assert corrected.sum() > 20
    spent = run.stats.field_calls - free.stats.field_calls
    assert 3 * (29 + len(set(steps))) <= spent <= 3 * (29 + 2 * len(set(steps)))


def test_which_values_of_an_explicit_run_are_corrected_does_not_depend_on_the_other_times():
    rates, start, end = NOT_STIFF["pendulum"]
    asked = {"start": start, "span": (0, end), "rtol": 1e-4, "atol": 1e-6, "method": Method.DOP853}
    times, field = np.linspace(0, end, 81), VectorField(rates, epsilon=None)
    run = integrate(field, at=times, **asked)
    corrected = (read_off(run, times) != run.y).any(axis=0)
    assert 0 < corrected.sum() < 81
    assert np.array_equal(integrate(field, at=times[::8], **asked).y, run.y[:, ::8])
    many = integrate_many(field, [asked.pop("start")], at=times, **asked)
    assert np.array_equal(many.y[0], run.y)
    assert many.member(0).stats == run.stats


@pytest.mark.parametrize("method", [Method.RADAU9, Method.DOP853])
def test_values_between_the_steps_of_a_backward_run_are_checked_too(method):
    oscillator = VectorField({x: y, y: -x}, epsilon=None)
    run = integrate(oscillator, start={"x": 0, "y": 1}, span=(0, -20), rtol=1e-4, atol=1e-4, method=method)
    times = np.linspace(-20, 0, 201)
    ends = np.abs(run["x"] - np.sin(run.t)).max()
    assert np.abs(run.at(times)[0] - np.sin(times)).max() < 2 * ends + 2e-4
