"""`integrate` and `Trajectory` as seen by a caller: what comes back, what is refused, how it ends."""

from __future__ import annotations

import dataclasses
import signal

import numpy as np
import pytest
import sympy as sp

from gsp.errors import DeclarationError, GspError, Status
from gsp.integration import loop, output, run_array
from gsp.integration.events import Event
from gsp.integration.loop import Control, Run, run
from gsp.integration.trajectory import Method, integrate
from gsp.lowering.compiled_flow import compile_flow
from gsp.systems.system import SlowFastSystem, VectorField
from tests.example_systems import enzyme, oscillator

x, y, s, c, a, epsilon, energy = sp.symbols("x y s c a epsilon E")
BOTH = pytest.mark.parametrize("method", list(Method))

OSCILLATOR, ENZYME = oscillator(), enzyme()


def oscillate(**options):
    return integrate(OSCILLATOR, **{"start": {"x": 1, "y": 0}, "span": (0, 10), **options})


# What comes back


@BOTH
def test_without_a_grid_t_holds_the_ends_of_the_steps(method):
    trajectory = oscillate(method=method)
    assert trajectory.status is Status.SUCCESS
    assert trajectory.t[0] == 0.0
    assert trajectory.t[-1] == 10.0
    assert np.all(np.diff(trajectory.t) > 0)
    assert trajectory.y.shape == (2, trajectory.t.size) == (2, trajectory.stats.steps + 1)
    assert np.array_equal(trajectory.y[:, 0], [1.0, 0.0])
    assert trajectory["x"] == pytest.approx(np.cos(trajectory.t), abs=1e-7)
    assert trajectory[y] == pytest.approx(-np.sin(trajectory.t), abs=1e-7)


@BOTH
@pytest.mark.parametrize(
    "grid", [[0, 2.5, 10], [0], [0.1, 0.2], [3, 3.0000001, 9.5, 9.6], np.linspace(0, 10, 301)], ids=len
)
def test_a_grid_is_returned_exactly(method, grid):
    trajectory = oscillate(method=method, at=grid)
    assert np.array_equal(trajectory.t, grid)
    assert trajectory.y.shape == (2, len(grid))
    assert trajectory["x"] == pytest.approx(np.cos(trajectory.t), abs=1e-7)
    # Where the dense output serves; elsewhere a step ends on the time.
    assert trajectory.at(trajectory.t) == pytest.approx(trajectory.y, abs=1e-7)
    assert trajectory.at(10.0) == pytest.approx([np.cos(10), -np.sin(10)], abs=1e-7)


def stopped(method, stops):
    """A run of the oscillator whose steps end on the stops."""
    flow = compile_flow(OSCILLATOR)
    start, ends = (flow.parameters(None), [1.0, 0.0], 0.0), np.append(stops, 40.0)
    return run(Run(flow, *start, ends, Control(Method(method), 1e-8, 1e-10, 10_000))).stats


@BOTH
def test_a_grid_that_is_landed_on_costs_at_most_one_step_for_each_point(method):
    free = stopped(method, [])
    for count in (5, 40, 400):
        clipped = stopped(method, np.linspace(0.05, 39.95, count))
        assert clipped.steps > count
        assert clipped.steps <= free.steps + 1.1 * count + 5
        assert clipped.rejected <= free.rejected + 0.1 * clipped.steps + 3


@BOTH
def test_a_clipped_step_does_not_shrink_the_next(method):
    free = oscillate(method=method, span=(0, 40))
    middle = float(free.t[free.t.size // 2])
    assert stopped(method, [middle, middle + 1e-9]).steps <= free.stats.steps + 3


@BOTH
def test_backward_integration_returns_to_the_start(method):
    there = oscillate(method=method, rtol=1e-11, atol=1e-12)
    back = oscillate(
        method=method,
        start=dict(zip("xy", there.y[:, -1])),
        span=(10, 0),
        rtol=1e-11,
        atol=1e-12,
        at=[10, 4, 0],
    )
    assert np.array_equal(back.t, [10.0, 4.0, 0.0])
    assert back["x"] == pytest.approx(np.cos(back.t), abs=1e-9)
    assert back.at(7.5) == pytest.approx([np.cos(7.5), -np.sin(7.5)], abs=1e-7)


@BOTH
def test_the_dense_output_between_the_steps(method):
    trajectory = oscillate(method=method)
    t = np.linspace(0, 10, 1001)
    assert trajectory.at(t).shape == (2, 1001)
    assert trajectory.at(t)[0] == pytest.approx(np.cos(t), abs=2e-7)
    assert trajectory.at(3).shape == (2,)
    assert np.array_equal(trajectory.at([3.0])[:, 0], trajectory.at(3.0))
    assert trajectory.at([]).shape == (2, 0)
    backwards = trajectory.at(t[::-1])
    assert np.array_equal(backwards, trajectory.at(t)[:, ::-1])


@pytest.mark.parametrize("t", [-1e-9, 10.1, [1, 2, 11], float("nan")])
def test_outside_the_interval_covered_there_is_no_value(t):
    with pytest.raises(GspError, match=r"covers \[0, 10\]"):
        oscillate().at(t)


def test_observables_are_read_by_name_with_epsilon_and_parameters():
    trajectory = integrate(ENZYME, start={"s": 1, "c": 0}, span=(0, 2), epsilon=0.1)
    assert trajectory["E"] == pytest.approx(trajectory["s"] + 0.05 * trajectory["c"], rel=1e-15)
    assert trajectory[energy].shape == trajectory.t.shape


def test_a_sample_has_its_own_times_and_every_name():
    trajectory = oscillate(at=[5.0])
    t = [9.0, 0.25, 4.0]
    sample = trajectory.sample(t)
    assert np.array_equal(sample.t, t)
    assert np.array_equal(sample.y, trajectory.at(t))
    assert sample["E"] == pytest.approx([0.5] * 3, abs=1e-7)
    assert sample.at(1.0) == pytest.approx([np.cos(1), -np.sin(1)], abs=1e-7)
    assert trajectory.sample(2.0).t.shape == (1,)


def test_an_unknown_name_gets_the_nearest():
    trajectory = integrate(ENZYME, start={"s": 1, "c": 0}, span=(0, 1), epsilon=0.1)
    with pytest.raises(
        GspError, match=r"'ss' is no state and no observable\. Those are s, c, E\. Did you mean \"s\""
    ):
        trajectory["ss"]
    with pytest.raises(GspError, match="no state"):
        trajectory[0]


def test_a_trajectory_is_frozen():
    trajectory = oscillate(at=[1.0, 2.0])
    with pytest.raises(dataclasses.FrozenInstanceError):
        trajectory.t = None
    with pytest.raises(dataclasses.FrozenInstanceError):
        trajectory.stats.steps = 0
    for array in (trajectory.t, trajectory.y, trajectory["x"], trajectory["E"], trajectory.sample([1.0]).y):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_a_sample_keeps_how_the_run_ended_and_what_it_cost():
    trajectory = oscillate(max_steps=5)
    sample = trajectory.sample([0.0])
    assert sample.status is trajectory.status is Status.TOO_MANY_STEPS
    assert sample.stats == trajectory.stats
    assert sample.message == trajectory.message


def test_the_grid_is_a_copy_of_the_callers():
    grid = np.array([1.0, 2.0])
    trajectory = oscillate(at=grid)
    grid[0] = 5.0
    assert np.array_equal(trajectory.t, [1.0, 2.0])


@BOTH
def test_a_short_span_at_a_late_time(method):
    trajectory = oscillate(method=method, span=(1e10, 1e10 + 1e-3))
    assert trajectory.status is Status.SUCCESS
    assert trajectory["y"][-1] == pytest.approx(-np.sin(trajectory.t[-1] - 1e10), rel=1e-9)
    hopeless = integrate(
        VectorField({x: -(10**9) * x}, epsilon=None), start={x: 1}, span=(1e10, 1e10 + 1), method=Method.DOP853
    )
    assert hopeless.status is Status.STEP_TOO_SMALL


def test_the_method_follows_the_flow_unless_given():
    class Reduced(VectorField):
        is_stiff = False

    stiff = {"start": {"s": 1, "c": 0}, "span": (0, 10), "epsilon": 1e-4}
    assert integrate(ENZYME, rtol=1e-1, **stiff).stats.method is Method.RADAU9
    assert integrate(ENZYME, rtol=1e-4, **stiff).stats.method is Method.RADAU9
    assert integrate(ENZYME, rtol=1e-4, events=Event("s"), **stiff).stats.method is Method.RADAU9
    assert integrate(ENZYME, rtol=1e-11, **stiff).stats.method is Method.RADAU13
    assert oscillate(rtol=1e-6).stats.method is Method.RADAU13
    reduced = Reduced({x: -x}, epsilon=None)
    assert integrate(reduced, start={x: 1}, span=(0, 1)).stats.method is Method.DOP853
    assert oscillate(method="dop853").stats.method is Method.DOP853


@BOTH
def test_a_run_without_dense_output_has_the_same_states(method):
    bare, whole = (oscillate(method=method, at=[3.0, 7.0], dense=which) for which in (False, True))
    assert np.array_equal(bare.y, whole.y)
    with pytest.raises(GspError, match="no values between its steps"):
        bare.at(5.0)


def test_how_it_shows():
    trajectory = integrate(ENZYME, start={"s": 1, "c": 0}, span=(0, 1), epsilon=0.1)
    assert repr(trajectory).startswith("Trajectory([s, c], t=0..1, points=")
    assert "\n" not in repr(trajectory)
    assert trajectory.message.startswith("reached the end after ")
    assert "epsilon = 0.1" in str(trajectory)
    assert all(len(line) <= 120 for line in str(trajectory).splitlines())


# How it ends


@BOTH
@pytest.mark.parametrize("rtol", [1e-4, 1e-8, 1e-12])
def test_blow_up_keeps_the_last_good_point(method, rtol):
    trajectory = integrate(
        VectorField({x: x**2}, epsilon=None), start={x: 2}, span=(0, 1), method=method, rtol=rtol
    )
    assert trajectory.status in (Status.NON_FINITE, Status.STEP_TOO_SMALL)
    assert trajectory.t[-1] == pytest.approx(0.5, abs=100 * rtol + 1e-12)
    assert np.isfinite(trajectory.y).all()
    assert trajectory["x"][-1] > 1e6
    before = trajectory.t < 0.49
    assert trajectory["x"][before] == pytest.approx(1 / (0.5 - trajectory.t[before]), rel=1e4 * rtol)
    assert trajectory.message.startswith(
        f"stopped after {trajectory.stats.steps} steps: {trajectory.status.name} at t = "
    )
    assert trajectory.message.endswith(trajectory.status.remedy)


@BOTH
@pytest.mark.parametrize("rtol", [1e-4, 1e-7])
def test_a_state_beyond_the_root_of_the_largest_number_ends_as_a_blow_up(method, rtol):
    # y follows exp(x), x = tan t: squares overflow at 1e154, numbers at 1e308, both long before steps are lost in t.
    field = SlowFastSystem(slow={x: 1 + x**2}, fast={y: sp.exp(x) - y}, epsilon=epsilon)
    trajectory = integrate(
        field, start={"x": 0, "y": 1}, span=(0, 3), epsilon=0.1, method=method, rtol=rtol, max_steps=20_000
    )
    assert trajectory.status in (Status.NON_FINITE, Status.SINGULAR_JACOBIAN)
    assert trajectory["y"][-1] > 1e290


@BOTH
def test_the_border_of_the_domain_is_reached_and_not_crossed(method):
    field = VectorField({x: -1 - sp.sqrt(x)}, epsilon=None)
    trajectory = integrate(field, start={x: 1}, span=(0, 1), method=method, at=[0.25, 0.5, 0.75, 1.0])
    assert trajectory.status is Status.NON_FINITE
    assert np.array_equal(trajectory.t, [0.25, 0.5])
    assert np.isfinite(trajectory.y).all()
    # The last point is one where the field exists.
    for rtol in (1e-3, 1e-5, 1e-8, 1e-11):
        assert integrate(field, start={x: 1}, span=(0, 1), method=method, rtol=rtol)["x"].min() >= 0
    # dt = -dx/(1 + sqrt x) from x = 1 to 0 gives 2 - 2 ln 2.
    assert trajectory.at(2 - 2 * np.log(2) - 1e-5)[0] == pytest.approx(1e-5, rel=1e-1)


@BOTH
def test_division_by_zero_at_the_start_returns_the_start(method):
    field = VectorField({x: 1 / x}, epsilon=None)
    trajectory = integrate(field, start={x: 0}, span=(0, 1), method=method)
    assert trajectory.status is Status.NON_FINITE
    assert np.array_equal(trajectory.t, [0.0])
    assert np.array_equal(trajectory.y, [[0.0]])
    assert np.array_equal(trajectory.at(0.0), [0.0])
    assert trajectory.stats.steps == 0
    empty = integrate(field, start={x: 0}, span=(0, 1), method=method, at=[0.5])
    assert empty.y.shape == (1, 0)
    assert empty["x"].shape == (0,)


@pytest.mark.parametrize("method", [method for method in Method if method is not Method.DOP853])
def test_an_infinite_jacobian_at_the_start_is_named(method):
    field = VectorField({x: 1 + sp.sqrt(x)}, epsilon=None)
    trajectory = integrate(field, start={x: 0}, span=(0, 1), method=method)
    assert trajectory.status is Status.SINGULAR_JACOBIAN
    assert np.array_equal(trajectory.y, [[0.0]])
    assert "Method.DOP853" in trajectory.message
    explicit = integrate(field, start={x: 0}, span=(0, 1), method=Method.DOP853)
    assert explicit.status is Status.SUCCESS
    # t = 2 (r - ln(1 + r)) for the root r of x.
    r = np.sqrt(explicit["x"][-1])
    assert 2 * (r - np.log1p(r)) == pytest.approx(1, abs=1e-6)


@BOTH
def test_the_number_of_steps_is_bounded(method):
    trajectory = oscillate(method=method, max_steps=5)
    assert trajectory.status is Status.TOO_MANY_STEPS
    assert trajectory.stats.steps + trajectory.stats.rejected == 5
    assert 0 < trajectory.t[-1] < 10


def test_the_explicit_method_says_that_a_field_is_stiff():
    field = VectorField({x: -(10**6) * (x - sp.cos(y)), y: sp.Integer(1)}, epsilon=None)
    options = {"start": {"x": 2, "y": 0}, "span": (0, 10), "rtol": 1e-5, "atol": 1e-5}
    explicit = integrate(field, method=Method.DOP853, max_steps=2000, **options)
    assert explicit.status is Status.TOO_MANY_STEPS
    assert explicit.stats.stiff
    assert "RADAU9" in explicit.message
    implicit = integrate(field, method=Method.RADAU9, max_steps=2000, **options)
    assert implicit.status is Status.SUCCESS
    for rtol in (1e-2, 1e-5, 1e-8, 1e-12):
        assert not oscillate(method=Method.DOP853, span=(0, 500), rtol=rtol, max_steps=100).stats.stiff


@BOTH
def test_progress_rises_to_one_and_steps_beyond_one_record_are_kept(method):
    seen: list[float] = []
    trajectory = oscillate(method=method, span=(0, 20000), rtol=1e-6, atol=1e-6, progress=seen.append)
    assert trajectory.stats.steps > 5000
    assert len(seen) > 4
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert np.all(np.diff(trajectory.t) > 0)
    assert trajectory.t.size == trajectory.stats.steps + 1


@pytest.mark.usefixtures("interruptible")
@BOTH
def test_an_interrupt_returns_what_was_computed(method):
    def interrupt(fraction):
        if fraction > 0.3:
            signal.raise_signal(signal.SIGINT)

    trajectory = oscillate(method=method, span=(0, 20000), rtol=1e-6, atol=1e-6, progress=interrupt)
    assert trajectory.status is Status.INTERRUPTED
    assert 6000 < trajectory.t[-1] < 20000
    assert trajectory.t.size == trajectory.stats.steps + 1
    assert "INTERRUPTED" in trajectory.message


def test_an_error_in_progress_is_the_callers():
    def fail(fraction):
        raise RuntimeError("mine")

    with pytest.raises(RuntimeError, match="mine"):
        oscillate(progress=fail)


# What is refused


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"span": (0, 0)}, "span must have a length"),
        ({"span": (0, float("inf"))}, "span must be finite"),
        ({"span": (-1e308, 1.7e308)}, "span must have a length|finite"),
        ({"span": 3}, "span is two numbers"),
        ({"rtol": 0.0}, "rtol is a finite number, at least 1e-14"),
        ({"rtol": 1e-16}, "rtol is a finite number, at least 1e-14"),
        ({"atol": 0}, "atol is a finite number, positive"),
        ({"at": [1, 11]}, r"at must lie inside the span \(0, 10\)"),
        ({"at": [-1, 1]}, "at must lie inside the span"),
        ({"at": [2, 1]}, "without repeats. Got 2, then 1"),
        ({"at": [1, 1]}, "without repeats. Got 1, then 1"),
        ({"at": [0.5, 0.2]}, r"without repeats. Got 0\.5, then 0\.2\. Sort"),
        ({"at": [0.1, 10.3]}, r"inside the span \(0, 10\). Got 10\.3\. Drop"),
        ({"at": [1, 2], "span": (10, 0)}, "without repeats"),
        ({"at": []}, "one or more times"),
        ({"at": [[1, 2]]}, "one or more times"),
        ({"method": "radau"}, 'is no method.*Did you mean "radau9"'),
        ({"method": "rodas5p"}, 'rodas5p. was removed. Take "radau9"'),
        ({"method": "RODAS5P"}, 'RODAS5P. was removed. Take "radau9"'),
        ({"max_steps": 0}, "max_steps is an integer, 1 or more"),
        ({"epsilon": 0.1}, "no small parameter"),
        ({"start": {"x": 1}}, "no value for y"),
        ({"start": {"x": 1, "y": 0, "z": 1}}, "no state"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_a_wrong_call_says_what_is_wrong(options, message):
    with pytest.raises(DeclarationError, match=message):
        oscillate(**options)


def test_a_run_keeps_the_checked_epsilon_and_prints() -> None:
    for value in (sp.Rational(1, 100), "0.01"):
        run = integrate(ENZYME, start={"s": 1, "c": 0}, span=(0, 1), epsilon=value)
        assert run.epsilon == 0.01
        assert "epsilon = 0.01" in str(run)


def test_a_run_of_one_step_holds_nothing_inside_it_unless_asked_to():
    short = {"span": (0, 1e-12), "method": Method.RADAU9}
    assert oscillate(**short).stats.steps == 1
    assert oscillate(**short).at(5e-13) == pytest.approx([1.0, -5e-13], abs=1e-15)
    with pytest.raises(GspError, match="holds no values between its steps"):
        oscillate(dense=False, **short).at(5e-13)


@pytest.mark.parametrize("shape", [(1, 1), (2, 3)])
def test_times_in_rows_and_columns_are_refused(shape):
    with pytest.raises(GspError, match=r"one-dimensional array. Got the shape"):
        oscillate().at(np.full(shape, 0.5))


@pytest.mark.parametrize("at", [None, [0.5, 1.0]])
def test_a_run_and_its_reading_are_a_call_of_compiled_code_each_and_nothing_is_cut_before_it_is_read(
    at, monkeypatch
):
    field = oscillator()
    asked = {"start": {"x": 1.0, "y": 0.0}, "span": (0.0, 1.0), "at": at, "method": Method.RADAU9}
    run_before = integrate(field, **asked)
    expected = run_before.at(0.3), run_before.y
    calls = []

    def counted(module, name):
        function = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *given: calls.append(name) or function(*given))

    counted(loop, "launch")
    counted(output, "read_run")
    counted(run_array, "recorded_steps")
    found = integrate(field, **asked)
    assert calls == ["launch", *["read_run"] * (at is not None)]
    assert np.array_equal(found.at(0.3), expected[0])
    assert np.array_equal(found.y, expected[1])
    assert calls[-1] == "recorded_steps"
    assert calls.count("recorded_steps") == 1


@pytest.mark.parametrize("cells", [1, 60])
def test_without_values_between_the_steps_times_asked_for_cut_nothing_out_of_a_small_run(cells, monkeypatch):
    states = sp.symbols(f"x0:{cells}")
    field = VectorField({s: -s * (i + 1) for i, s in enumerate(states)}, epsilon=None)
    asked = {"start": dict.fromkeys(states, 1.0), "span": (0.0, 1.0), "at": [0.3, 1.0], "method": Method.RADAU9}
    expected = integrate(field, **asked)
    calls = []
    recorded_steps = run_array.recorded_steps
    monkeypatch.setattr(run_array, "recorded_steps", lambda *given: calls.append(1) or recorded_steps(*given))
    found = integrate(field, **asked, dense=False)
    assert calls == [1] * (cells > 1)
    assert np.array_equal(found.y, expected.y)
    assert found.stats == expected.stats
    assert found._record.dense.size == 0
    assert np.array_equal(found._record.times, expected._record.times)
    with pytest.raises(GspError, match="no values between its steps"):
        found.at(0.5)
