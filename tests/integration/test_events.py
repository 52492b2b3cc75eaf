"""Events: every crossing is found, located as well as the steps are, and ends the run where it is asked to."""

from __future__ import annotations

import signal

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import DeclarationError, GspError, Status
from gsp.integration.events import CompiledEvents, Event
from gsp.integration.pieces import MOST_SUBDIVISIONS, RunPiece
from gsp.integration.trajectory import Method, integrate
from gsp.systems.system import SlowFastSystem, VectorField
from tests.cases import itertools
from tests.rescaling import scene, scenes

x, y, t, k, epsilon, energy = sp.symbols("x y t k epsilon E")
METHODS = pytest.mark.parametrize("method", list(Method))

OSCILLATOR = VectorField({x: y, y: -x}, epsilon=None, observables={energy: (x**2 + y**2) / 2})
PHASE = np.arctan2(0.3, 1.0)


def oscillate(events, **options):
    options = {"start": {"x": 0.3, "y": 1}, "span": (0, 30), **options}
    return integrate(OSCILLATOR, events=events, **options)


def zeros(count: int = 9) -> np.ndarray:
    """Where sin(t + phase) vanishes."""
    return np.pi * np.arange(1, count + 1) - PHASE


# Where they are


@METHODS
@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
def test_every_crossing_is_as_exact_as_the_steps(method, rtol):
    trajectory = oscillate(Event("x"), method=method, rtol=rtol, atol=rtol / 10)
    times, states = trajectory.events["x"]
    assert times.shape == (9,)
    exact = np.hypot(0.3, 1) * np.sin(trajectory.t + PHASE)
    assert np.abs(times - zeros()).max() <= 1.5 * np.abs(trajectory["x"] - exact).max() + 1e-14
    # The state is that of the method, on the zero to rounding.
    assert np.abs(states[0]).max() < 1e-14
    assert np.abs(states[1]) == pytest.approx(np.full(9, np.hypot(0.3, 1)), abs=3e3 * rtol)


def test_the_order_is_that_of_the_steps_not_of_the_dense_output():
    # Radau of order 13 has a dense output of order 8; with four steps to the crossing the difference is plain.
    # The interpolant's error on these steps is 1e-9 and more, that of the steps 1e-14.
    trajectory = oscillate(Event("x"), method=Method.RADAU13, rtol=1e-9, atol=1e-10)
    between = np.linspace(0, 30, 2001)
    interpolated = np.abs(trajectory.at(between)[0] - np.hypot(0.3, 1) * np.sin(between + PHASE)).max()
    located = np.abs(trajectory.events["x"].times - zeros()).max()
    assert located < 1e-3 * interpolated
    assert located < 1e-11


def test_direction_is_counted_along_the_run():
    rising = Event("x", direction=1, name="rising")
    falling = Event("x", direction=-1, name="falling")
    trajectory = oscillate([rising, falling])
    assert trajectory.events["falling"].times == pytest.approx(zeros()[::2], abs=1e-7)
    assert trajectory.events["rising"].times == pytest.approx(zeros()[1::2], abs=1e-7)
    # Backward in time x falls where it rose.
    back = oscillate([rising, falling], span=(0, -10))
    assert back.events["falling"].times == pytest.approx(np.array([-PHASE, -PHASE - 2 * np.pi]), abs=1e-7)
    assert back.events["rising"].times == pytest.approx(
        np.array([-PHASE - np.pi, -PHASE - 3 * np.pi]), abs=1e-7
    )


def test_states_observables_parameters_epsilon_and_time_may_be_watched():
    system = SlowFastSystem(
        slow={x: -x}, fast={y: x - y}, epsilon=epsilon, parameters={k: "0.5"}, observables={energy: x + y}
    )
    events = [
        Event(x - k, name="half"),
        Event(energy - epsilon, name="sum"),
        Event(t - sp.Rational(1, 3), name="clock"),
    ]
    trajectory = integrate(
        system, start={"x": 1, "y": 1}, span=(0, 20), epsilon=0.01, rtol=1e-10, atol=1e-13, events=events
    )
    assert trajectory.events["half"].times == pytest.approx(np.array([np.log(2)]), rel=1e-9)
    assert trajectory.events["clock"].times == pytest.approx(np.array([1 / 3]), rel=1e-15)
    # y = x/(1 - epsilon) after the layer.
    expected = np.log((1 + 1 / 0.99) / 0.01)
    assert trajectory.events["sum"].times == pytest.approx(np.array([expected]), rel=1e-8)


def test_return_times_of_van_der_pol_are_its_period():
    mu = sp.Symbol("mu")
    field = VectorField({x: y, y: mu * (1 - x**2) * y - x}, epsilon=None, parameters={mu: 10})
    trajectory = integrate(
        field, start={"x": 2, "y": 0}, span=(0, 100), rtol=1e-11, atol=1e-12, events=Event("x", direction=1)
    )
    periods = np.diff(trajectory.events["x"].times)
    assert len(periods) == 4
    assert periods == pytest.approx(np.full(4, 19.078369566939014), abs=2e-9)


# Which are found


@METHODS
@pytest.mark.parametrize("depth", ["1e-3", "1e-5", "1e-7"])
def test_two_crossings_within_a_fraction_of_a_step_are_found(method, depth):
    # x = sin t is above 1 - depth for a time of 2 sqrt(2 depth) only.
    level = 1 - sp.Rational(depth)
    trajectory = oscillate(
        Event(x - level, name="top"),
        method=method,
        start={"x": 0, "y": 1},
        span=(0, 20),
        rtol=1e-11,
        atol=1e-12,
    )
    first = np.arccos(float(level))
    expected = np.array([np.pi / 2 + 2 * np.pi * n + s * first for n in range(3) for s in (-1, 1)])
    # An error in x is one of error/|x'| in time, and x' is nearly 0.
    error = np.abs(trajectory["x"] - np.sin(trajectory.t)).max() / np.sin(first)
    assert trajectory.events["top"].times == pytest.approx(expected, abs=2 * error)
    if depth != "1e-3":
        assert np.diff(trajectory.t).max() > 2 * first


def test_a_function_that_only_comes_near_is_no_crossing():
    assert oscillate(Event(x - 2, name="far")).events["far"].times.size == 0
    above = oscillate(
        Event(x - sp.Rational("1.0000001"), name="e"), start={"x": 0, "y": 1}, rtol=1e-11, atol=1e-12
    )
    assert above.events["e"].times.size == 0
    assert above.events["e"].states.shape == (2, 0)


@METHODS
def test_a_start_on_the_zero_does_not_fire(method):
    trajectory = oscillate(Event("x"), start={"x": 0, "y": 1}, span=(0, 7), method=method)
    assert trajectory.events["x"].times == pytest.approx(np.array([np.pi, 2 * np.pi]), abs=1e-6)
    # Nor does a run that goes on from a terminal event, whose state is on the zero to rounding only.
    first = oscillate(Event("x", terminal=True), method=method)
    again = oscillate(
        Event("x"), start=dict(zip("xy", first.y[:, -1])), span=(first.t[-1], first.t[-1] + 3), method=method
    )
    assert again.events["x"].times.size == 0


@pytest.mark.parametrize(("units", "met"), [(-12, 0), (12, 0), (-20, 1), (20, 0)])
def test_a_start_is_on_the_zero_within_rounding_only(units, met):
    """x rises through 1, so it meets 1 only where it began below it by more than rounding."""
    begin = 1.0 + units * 2.0**-52
    run = integrate(
        VectorField({x: sp.Integer(1)}, epsilon=None),
        start={"x": begin},
        span=(0, 1),
        events=Event(x - 1, name="one"),
    )
    assert run.events["one"].times.size == met


@METHODS
@pytest.mark.parametrize("sign", [1, -1])
def test_a_zero_at_the_end_of_one_run_and_the_start_of_the_next_is_met_once(method, sign):
    """Neither of the two told of it: the first ended on it, and a start on the zero is no crossing."""
    field, met = VectorField({x: sp.Integer(sign)}, epsilon=None), []
    for k in range(4):
        run = integrate(
            field, start={"x": sign * k}, span=(k, k + 1), events=Event(x - 2 * sign), method=method
        )
        met += run.events[str(x - 2 * sign)].times.tolist()
    assert met == pytest.approx([2.0], rel=1e-14)
    terminal = Event(x - 2 * sign, name="end", terminal=True)
    assert integrate(field, start={"x": 0}, span=(0, 2), events=terminal).status is Status.EVENT_REACHED


def test_what_is_not_a_number_is_no_sign():
    field = VectorField({x: sp.Integer(1)}, epsilon=None)
    watched = Event(sp.sqrt(x) - 1, name="root")
    trajectory = integrate(field, start={"x": -1}, span=(0, 3), events=watched)
    assert trajectory.events["root"].times == pytest.approx(np.array([2.0]), rel=1e-14)


@pytest.mark.filterwarnings("error")
def test_a_start_at_which_a_function_is_infinite_is_told_of_no_warning() -> None:
    run = oscillate(Event(sp.log(x) + 1, name="log"), start={"x": 0, "y": 1}, span=(0, 1))
    assert run.events["log"].times == pytest.approx([np.arcsin(np.exp(-1.0))], abs=1e-7)


def test_a_jump_is_located_too():
    field = VectorField({x: sp.Integer(1)}, epsilon=None)
    trajectory = integrate(field, start={"x": 0}, span=(0, 3), events=Event(sp.sign(x - 1), name="jump"))
    assert trajectory.events["jump"].times == pytest.approx(np.array([1.0]), abs=1e-14)


# How they end a run


@METHODS
def test_a_terminal_event_ends_the_run_at_the_crossing(method):
    trajectory = oscillate(Event("x", terminal=True), method=method)
    assert trajectory.status is Status.EVENT_REACHED
    assert trajectory.t[-1] == trajectory.events["x"].times[0]
    assert trajectory.t[-1] == pytest.approx(zeros()[0], abs=1e-7)
    assert np.array_equal(trajectory.y[:, -1], trajectory.events["x"].states[:, 0])
    assert trajectory.t.size == trajectory.stats.steps + 1
    assert np.all(np.diff(trajectory.t) > 0)
    times = np.linspace(0, trajectory.t[-1], 301)
    assert trajectory.at(times)[0] == pytest.approx(np.hypot(0.3, 1) * np.sin(times + PHASE), abs=3e-7)
    assert np.array_equal(trajectory.at(trajectory.t[-1]), trajectory.y[:, -1])
    assert "EVENT_REACHED at t = 2.85" in trajectory.message
    assert "event x" in trajectory.message


def test_the_third_crossing_may_be_the_one_that_ends_it():
    trajectory = oscillate([Event("x", direction=-1, terminal=3), Event("y")])
    assert trajectory.events["x"].times == pytest.approx(zeros()[:5:2], abs=1e-7)
    assert trajectory.t[-1] == trajectory.events["x"].times[-1]
    # Nothing is reported from beyond the end.
    assert trajectory.events["y"].times.max() < trajectory.t[-1]
    assert trajectory.events["y"].times.size == 5


def test_the_first_of_several_terminal_events_counts():
    for events in (["x", "y"], ["y", "x"]):
        trajectory = oscillate([Event(name, terminal=True) for name in events])
        assert trajectory.t[-1] == pytest.approx(np.pi / 2 - PHASE, abs=1e-7)
        assert trajectory.events["x"].times.size == 0


def test_a_grid_is_cut_at_the_event():
    grid = np.linspace(0, 30, 61)
    trajectory = oscillate(Event("x", terminal=True), at=grid)
    assert np.array_equal(trajectory.t, grid[grid <= zeros()[0]])
    assert trajectory["x"] == pytest.approx(np.hypot(0.3, 1) * np.sin(trajectory.t + PHASE), abs=1e-7)
    assert trajectory.at(zeros()[0] - 1e-6).shape == (2,)


def test_an_event_before_a_failure_is_found_first():
    field = VectorField({x: x**2}, epsilon=None)
    trajectory = integrate(
        field, start={"x": 1}, span=(0, 2), events=Event(x - 1000, name="big", terminal=True)
    )
    assert trajectory.status is Status.EVENT_REACHED
    assert trajectory.t[-1] == pytest.approx(0.999, rel=1e-8)
    going_on = integrate(field, start={"x": 1}, span=(0, 2), events=Event(x - 1000, name="big"))
    assert going_on.status is not Status.SUCCESS
    assert going_on.events["big"].times == pytest.approx(np.array([0.999]), rel=1e-8)


def test_events_change_nothing_else_and_what_they_cost_is_counted():
    plain = oscillate(())
    watched = oscillate(Event("x"))
    assert np.array_equal(plain.y, watched.y)
    assert plain.events == {}
    extra = watched.stats.field_calls - plain.stats.field_calls
    assert 0 < extra < 60 * 9
    assert watched.stats.steps == plain.stats.steps


def test_events_on_a_reduced_flow_know_the_parameters_and_the_slow_variables():
    a = sp.Symbol("a")
    system = SlowFastSystem(slow={y: a - x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon, parameters={a: "0.5"})
    branch = gsp.solve_critical(system).nearest({"x": 2, "y": 2 / 3})
    flow = gsp.restrict(gsp.expand(branch, order=0))
    trajectory = integrate(
        flow,
        start={"x": 2, "y": 2 / 3},
        span=(0, 5),
        epsilon=0.01,
        events=Event(x - a - 1, name="e", terminal=True),
    )
    assert trajectory.status is Status.EVENT_REACHED
    assert trajectory["x"][-1] == pytest.approx(1.5, rel=1e-13)


# What is refused


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Event("x", direction=2), "direction is 1 for rising"),
        (lambda: Event("x", terminal=-1), "terminal is True, False"),
        (lambda: oscillate(Event("z")), 'event "z" is no state and no observable'),
        (lambda: oscillate(Event(x - k)), "contains k, which is no state"),
        (lambda: oscillate("x"), "events is a sequence of Event"),
        (lambda: oscillate([x]), "events is a sequence of Event"),
        # An array without axes.
        (lambda: oscillate(np.ma.masked), "events is a sequence of Event"),
        (lambda: oscillate([Event("x"), Event("x", direction=1)]), 'two events are called "x"'),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_wrong_event_is_named(make, words):
    with pytest.raises(DeclarationError, match=words):
        make()


def test_how_they_show():
    assert repr(Event(x - 1, direction=-1, terminal=2, name="one")) == (
        "Event(x - 1, direction=-1, terminal=2, name='one')"
    )
    assert repr(Event("x")) == "Event(x)"


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_keeps_the_crossings_found():
    def interrupt(fraction):
        if fraction > 0.1:
            signal.raise_signal(signal.SIGINT)

    trajectory = oscillate(Event("x"), span=(0, 2000), rtol=1e-12, atol=1e-12, progress=interrupt)
    assert trajectory.status is Status.INTERRUPTED
    times = trajectory.events["x"].times
    assert times[-1] <= trajectory.t[-1] < times[-1] + np.pi + 0.1
    assert np.diff(times) == pytest.approx(np.full(times.size - 1, np.pi), abs=1e-3)


def test_a_name_that_no_event_has_is_told_what_there_is() -> None:
    x = sp.Symbol("x")
    decay = VectorField(states={x: -x}, epsilon=None)
    run = integrate(decay, start={"x": 1}, span=(0, 1), events=Event(x - sp.Rational(1, 2), name="half"))
    assert "other" not in run.events
    with pytest.raises(GspError, match=r"The names are half\. Did you mean"):
        run.events["hlf"]
    with pytest.raises(KeyError, match="nothing was asked for"):
        integrate(decay, start={"x": 1}, span=(0, 1)).events["x"]


@METHODS
@pytest.mark.parametrize("last", [10, -10])
@pytest.mark.parametrize("unit", [sp.Integer(1), sp.Rational(1, 2**30), sp.Integer(2**30)])
def test_every_event_of_the_instant_that_ends_a_run_is_recorded(method, last, unit):
    events = [
        Event(x, terminal=True, name="first"),
        Event(x, terminal=True, name="second"),
        Event(3 * x + x**3, name="third"),
        Event(x, direction=1, name="wrong way"),
        Event(y + 2, name="never"),
        Event(x + sp.Rational(1, 10**9), name="just behind"),
    ]
    run = integrate(
        VectorField({x: y / unit, y: -x / unit}, epsilon=None),
        start={"x": 1, "y": 0},
        span=(0, last * unit),
        events=events,
        method=method,
    )
    assert run.status is Status.EVENT_REACHED
    for name in ("first", "second", "third"):
        assert run.events[name].times.tolist() == [run.t[-1]]
        assert np.array_equal(run.events[name].states[:, 0], run.y[:, -1])
    for name in ("wrong way", "never", "just behind"):
        assert run.events[name].times.size == 0


@METHODS
@pytest.mark.parametrize("at", [None, [1.0, 2.0, 3.0]])
@pytest.mark.parametrize("sign", [1, -1])
def test_one_instant_is_met_whole_also_where_a_step_ends(method, at, sign):
    field = VectorField({x: sp.Integer(sign), y: -y}, epsilon=None)
    events = [
        Event(x - 2, name="last", terminal=True),
        Event(sp.exp(x) - sp.exp(sp.Integer(2)), name="exponential"),
        Event((x - 2) ** 3 / 1000 + (x - 2) * (1 + y**2), name="cubic"),
        Event(1 / (x - 2), name="pole"),
    ]
    start, span = {"x": 2 - 2 * sign, "y": 1}, (0, 4)
    run = integrate(field, start=start, span=span, events=events, method=method, at=at)
    assert run.status is Status.EVENT_REACHED
    assert run.events["last"].times == pytest.approx([2.0], rel=1e-14)
    for name in ("exponential", "cubic"):
        assert run.events[name].times.tolist() == run.events["last"].times.tolist()
        assert run.events[name].states.tolist() == run.events["last"].states.tolist()
    assert run.events["pole"].times.size == 0


# Each built-in scene in one direction, every other one backward, but not that of a Lagrangian: its equations are long.
TOGETHER = [
    (name, bool(place % 2)) for place, name in enumerate(gsp.models.names()) if name != "sleigh_from_lagrangian"
]


@pytest.mark.parametrize(
    ("name", "backward"),
    [
        pytest.param(*case, marks=() if case in TOGETHER else pytest.mark.exhaustive)
        for case in itertools.product(scenes(), [False, True])
    ],
)
def test_events_of_one_instant_are_one_instant_in_every_system(name, backward):
    free = integrate(scene(name), rtol=1e-6, atol=1e-9)
    states, options = free.flow.states, {"epsilon": free.epsilon, "rtol": 1e-6, "atol": 1e-9}
    first, last = free.t[0], free.t[-1]
    middle = float(0.7 * last + 0.3 * first)
    values = free.at(middle)
    # What a run crosses for certain: the state that changes most, half way of its change to the middle.
    begun = free.y[:, 0]
    k = int(np.argmax(np.abs(values - begun) / (np.abs(begun) + np.abs(values) + 1e-300)))
    level = sp.Float(0.5 * (begun[k] + values[k]))
    g = states[k] - level
    events = [
        Event(g, name="plain"),
        Event(-3 * g, name="turned"),
        Event(g * (2 + sp.sin(states[0])), name="factor"),
        Event(g**3 / (1 + level**2) + g, name="cubic"),
    ]
    start, span = (values, (middle, first)) if backward else (begun, (first, last))
    # Backward a fast part grows, and may end the run.
    run = integrate(
        free.flow,
        start=dict(zip((s.name for s in states), start)),
        span=span,
        events=events,
        max_steps=2_000,
        **options,
    )
    assert run.events["plain"].times.size or backward
    for other in ("turned", "factor", "cubic"):
        assert run.events[other].times.tolist() == run.events["plain"].times.tolist()
        assert run.events[other].states.tolist() == run.events["plain"].states.tolist()


@pytest.mark.exhaustive
@pytest.mark.parametrize("method", ["radau9", "radau13", "dop853", None])
@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
def test_crossings_that_lie_close_within_a_step_are_all_found(method, rtol) -> None:
    """x = t, in steps as long as the run: a triple of crossings, and oscillations that no step knows of."""
    field = VectorField({x: sp.Integer(1)}, epsilon=None)
    apart = sp.Rational(1, 10)
    events = (
        Event((x - 1) * (x - 1 - apart) * (x - 1 - 2 * apart), name="three"),
        Event(sp.sin(5 * x), name="sine"),
    )
    fast = tuple(Event(sp.sin(rate * x), name=str(rate)) for rate in (50, 123, 400, 1000))
    run = integrate(field, start={"x": 0.1}, span=(0, 9.4), method=method, rtol=rtol, events=events + fast)
    found = [sorted(run.events[event.name].times) for event in events]
    assert np.allclose(found[0], [0.9, 1.0, 1.1], atol=1e-9)
    assert np.allclose(found[1], np.pi / 5 * np.arange(1, 16) - 0.1, atol=1e-9)
    for event in fast:
        rate = int(event.name)
        zeros = np.pi / rate * np.arange(1, 4 * rate) - 0.1
        expected = zeros[(zeros > 0.0) & (zeros < 9.4)]
        assert np.allclose(sorted(run.events[event.name].times), expected, atol=1e-9)


@pytest.mark.parametrize("length", [1.0, 2 * np.pi / 5, 8.0, 16 * np.pi / 5])
def test_an_oscillation_in_time_with_the_steps_is_seen(length: float) -> None:
    # With equal parts of these steps all points were on one side, or every one on a zero.
    times = np.array([0.0, 1.0, 2.0]) * length
    piece = RunPiece(times, times[:, None], np.zeros((2, 2, 1)))
    object.__setattr__(piece, "at", lambda t: t[:, None])
    t, g = piece.sample(lambda t, states: np.sin(50.0 * states + 0.3))
    changes = np.flatnonzero(g[1:, 0] * g[:-1, 0] < 0.0)
    zeros = (np.pi * np.arange(1, 400) - 0.3) / 50.0
    assert len(changes) == np.sum(zeros < times[-1])
    assert (np.searchsorted(zeros, t[changes + 1]) - np.searchsorted(zeros, t[changes]) == 1).all()


def test_a_jump_is_looked_at_no_more_closely_than_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    field = VectorField({x: sp.Integer(1)}, epsilon=None)
    looked: list[int] = []
    values = CompiledEvents.values
    monkeypatch.setattr(
        CompiledEvents, "values", lambda self, t, states: looked.append(len(t)) or values(self, t, states)
    )
    run = integrate(field, start={"x": -1}, span=(0, 2), events=Event(sp.sign(x), name="jump"), max_steps=100)
    assert run.events["jump"].times == pytest.approx([1.0])
    assert sum(looked) <= 2 * MOST_SUBDIVISIONS * run.stats.steps
