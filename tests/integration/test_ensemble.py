"""`integrate_many` is `integrate`, bit for bit, many times over; members fail alone; wrong calls name the member."""

from __future__ import annotations

import signal
import threading
import time

import numpy as np
import pytest
import sympy as sp

from gsp import charts
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import BranchError, DeclarationError, GspError, Status
from gsp.integration import parallel
from gsp.integration.ensemble import integrate_many
from gsp.integration.restriction import restrict
from gsp.integration.trajectory import Method, integrate
from gsp.kernels import ensemble as kernels
from gsp.kernels import integrator
from gsp.models import load
from gsp.slow.series import expand
from gsp.systems.system import SlowFastSystem, VectorField
from tests.example_systems import enzyme, oscillator

x, y, s, c, a, k, epsilon, energy = sp.symbols("x y s c a k epsilon E")
EVERY = pytest.mark.parametrize("method", list(Method))

OSCILLATOR, ENZYME = oscillator(), enzyme()
BLOW_UP = VectorField({x: k * x**2}, epsilon=None, parameters={k: 1})
CLOUD = np.random.default_rng(0).uniform(0.2, 2, (23, 2))


def oscillate(starts=CLOUD, **options):
    return integrate_many(OSCILLATOR, starts, **{"span": (0, 10), "rtol": 1e-6, "atol": 1e-8, **options})


def alone(flow, start, **options):
    return integrate(flow, start=dict(zip([state.name for state in flow.states], start)), **options)


# The same numbers as one by one


@pytest.mark.exhaustive
@EVERY
@pytest.mark.parametrize("at", [None, [0, 0.7, 3, 5], [0], [0.3, 5.0]], ids=str)
def test_every_number_is_that_of_the_run_alone(method, at):
    options = {"span": (0, 5), "epsilon": 0.01, "rtol": 1e-6, "atol": 1e-9, "method": method}
    many = integrate_many(ENZYME, CLOUD, at=at, **options)
    assert many.y.shape == (23, 2, len(many.t))
    for i, start in enumerate(CLOUD):
        one = alone(ENZYME, start, at=at, **options)
        assert np.array_equal(many.t, [5.0] if at is None else one.t)
        assert np.array_equal(many.y[i], one.y[:, -1:] if at is None else one.y)
        assert np.array_equal(many.last[i], one.at(5.0))
        assert many.member(i).stats == one.stats
        assert many.statuses[i] is one.status is Status.SUCCESS


@EVERY
def test_also_with_more_steps_than_the_scratch_holds_and_backward(method):
    options = {"span": (300, 0), "rtol": 1e-7, "atol": 1e-8, "at": [200, 50.5, 0], "method": method}
    many = oscillate(CLOUD[:3], **options)
    for i, start in enumerate(CLOUD[:3]):
        one = alone(OSCILLATOR, start, **options)
        assert one.stats.steps > 128
        assert np.array_equal(many.y[i], one.y)
        assert many.member(i).stats == one.stats


@pytest.mark.exhaustive
def test_a_scene_with_three_states_and_the_default_methods():
    field = load("chaplygin_sleigh").system
    starts = np.random.default_rng(1).uniform(-1, 1, (12, 3))
    for rtol in (1e-5, 1e-8, 1e-10):
        many = integrate_many(field, starts, span=(0, 4), epsilon=1e-3, rtol=rtol)
        for i, start in enumerate(starts):
            one = alone(field, start, span=(0, 4), epsilon=1e-3, rtol=rtol)
            assert many.method is one.stats.method
            assert np.array_equal(many.last[i], one.y[:, -1])
    # Read at many times at a loose tolerance, where the method is another one than for the end alone.
    options = {"span": (0, 4), "epsilon": 1e-3, "rtol": 1e-3, "at": np.linspace(0, 4, 30)}
    many = integrate_many(field, starts, **options)
    assert many.method is Method.RADAU9
    for i, start in enumerate(starts):
        assert np.array_equal(many.y[i], alone(field, start, **options).y)


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("chunk", [1, 7, 64])
def test_threads_and_chunks_change_nothing(monkeypatch, threads, chunk):
    # Work that is uneven: a factor of 400 in the frequency.
    field = VectorField({x: k * y, y: -k * x}, epsilon=None, parameters={k: 1})
    options = {"parameters": {k: np.geomspace(0.1, 40, 23)}, "span": (0, 10), "at": [1, 10], "rtol": 1e-6}
    plain = integrate_many(field, CLOUD, threads=1, **options)
    monkeypatch.setattr(parallel, "LARGEST_CHUNK", chunk)
    many = integrate_many(field, CLOUD, threads=threads, **options)
    assert np.array_equal(many.y, plain.y)
    assert np.array_equal(many.steps, plain.steps)
    assert many.steps.max() > 20 * many.steps.min()


def test_two_python_threads_may_run_ensembles_at_once():
    expected = oscillate().y
    found = []
    callers = [threading.Thread(target=lambda: found.append(oscillate(threads=2).y)) for _ in range(4)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    assert len(found) == 4
    assert all(np.array_equal(other, expected) for other in found)


# What varies


def test_parameters_and_epsilon_are_those_of_separate_flows():
    epsilons, values = np.geomspace(1e-3, 0.1, 6), np.linspace(0.1, 0.9, 6)
    many = integrate_many(
        ENZYME, {"s": 1, "c": 0}, span=(0, 2), epsilon=epsilons, parameters={"a": values}, at=[1, 2]
    )
    for i, member in enumerate(many):
        one = integrate(
            ENZYME.with_parameters(a=values[i]), start={s: 1, c: 0}, span=(0, 2), epsilon=epsilons[i], at=[1, 2]
        )
        assert np.array_equal(many["s"][i], one["s"])
        assert np.array_equal(many["E"][i], one["E"])
        assert (member.epsilon, member.parameters) == (epsilons[i], {"a": values[i]})
    assert np.array_equal(many.epsilon, epsilons)
    assert np.array_equal(many.parameters["a"], values)


def test_starts_come_in_columns_rows_or_one_by_one():
    columns = {"x": CLOUD[:, 0], y: CLOUD[:, 1]}
    plain = oscillate()
    one_by_one = [dict(zip("xy", row)) for row in CLOUD]
    for starts in (columns, one_by_one, tuple(one_by_one), CLOUD.tolist()):
        assert np.array_equal(oscillate(starts).y, plain.y)
    assert np.array_equal(plain.starts, CLOUD)
    single = oscillate({"x": 1, "y": 0})
    assert len(single) == 1
    assert np.array_equal(single.y, oscillate([1, 0]).y)
    assert np.array_equal(oscillate({"x": CLOUD[:, 0], "y": [0]}).starts[:, 1], np.zeros(23))


def test_a_reduced_flow_starts_at_its_slow_variables():
    flow = restrict(expand(solve_critical(ENZYME).branches[0], order=2))
    slow = np.linspace(0.1, 2, 9)
    many = integrate_many(flow, {"s": slow, "c": 7.0}, span=(0, 2), epsilon=0.05, at=[0, 2])
    assert many.method is Method.DOP853
    for i, value in enumerate(slow):
        one = integrate(flow, start={"s": value}, span=(0, 2), epsilon=0.05, at=[0, 2])
        assert np.array_equal(many["s"][i], one["s"])
        assert np.array_equal(many["c"][i], one["c"])
    with pytest.raises(DeclarationError, match=r"no value for s"):
        integrate_many(flow, {"c": slow}, span=(0, 2), epsilon=0.05)
    with pytest.raises(DeclarationError, match=r"in a reduced flow their values are put in. Got a"):
        integrate_many(flow, {"s": slow}, span=(0, 2), epsilon=0.05, parameters={"a": slow})


def test_an_implicit_manifold_takes_its_starts_one_by_one():
    system = SlowFastSystem(slow={x: -x}, fast={y: x - y - y**5}, epsilon=epsilon)
    flow = restrict(expand(solve_critical(system).branches[0], order=1))
    many = integrate_many(flow, {"x": [0.5, 1.0]}, span=(0, 1), epsilon=0.05)
    for i, value in enumerate((0.5, 1.0)):
        one = integrate(flow, start={"x": value}, span=(0, 1), epsilon=0.05)
        assert np.array_equal(many["y"][i, -1:], one["y"][-1:])
    folded = SlowFastSystem(slow={x: -x}, fast={y: x + y - y**5}, epsilon=epsilon)
    with pytest.raises(BranchError, match="member 1: "):
        # One sheet over x = 2, three over x = 0.
        integrate_many(
            restrict(expand(solve_critical(folded).branches[0], order=1)),
            {"x": [2, 0]},
            span=(0, 1),
            epsilon=0.05,
        )


# What comes back


def test_memory_does_not_grow_with_the_steps():
    long = oscillate(span=(0, 2000), at=[1000, 2000])
    assert long.steps.min() > 1000
    assert long.y.nbytes == 23 * 2 * 2 * 8


def test_names_and_members():
    many = oscillate(at=[5, 10])
    assert many["x"].shape == many[energy].shape == (23, 2)
    assert many["E"][:, 1] == pytest.approx((CLOUD**2).sum(axis=1) / 2, rel=1e-4)
    member = many.member(4)
    assert member.start == dict(zip("xy", CLOUD[4]))
    assert member.last == dict(zip("xy", many.y[4, :, -1]))
    assert (member.epsilon, member.parameters, member.reached) == (None, {}, 10.0)
    assert [m.index for m in many] == list(range(23))
    for array in (many.y, many.t, many["x"], many["E"], many.starts, many.last, many.reached, many.steps):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(GspError, match=r"'xx' is no state and no observable\. Those are x, y, E\."):
        many["xx"]
    with pytest.raises(GspError, match=r"numbered 0 to 22\. Got 23"):
        many.member(23)


def test_how_it_shows():
    many = integrate_many(ENZYME, CLOUD, span=(0, 1), epsilon=np.geomspace(0.01, 0.1, 23))
    assert repr(many) == "Ensemble([s, c], members=23, times=1, SUCCESS: 23)"
    text = str(many)
    assert "epsilon = 0.01 to 0.1" in text
    assert "50 %" in text
    assert text.endswith("all 23 members reached the end")
    assert all(len(line) <= 120 for line in [*text.splitlines(), *str(many.member(0)).splitlines()])
    assert repr(many.member(2)) == "Member(2, t=1, SUCCESS)"


def test_its_spread_is_drawn_over_the_members_that_are_left():
    many = integrate_many(BLOW_UP, {"x": np.linspace(-1, 1.8, 40)}, span=(0, 1), at=np.linspace(0, 1, 21))
    axes = charts.spread(many, name="x")
    assert charts.png(axes).startswith(b"\x89PNG")
    assert np.isfinite(axes.lines[-1].get_ydata()).all()
    assert "24 of 40 members" in [text.get_text() for text in axes.get_legend().get_texts()]
    with pytest.raises(DeclarationError, match=r"two times or more that a member reached\. Got 1"):
        charts.spread(oscillate(), name="x")


# Failures stay where they are


@EVERY
def test_a_member_that_fails_spoils_no_other(method):
    starts = {"x": [0.5, 2.0, -1.0, 0.25, 4.0]}
    many = integrate_many(BLOW_UP, starts, span=(0, 1), method=method, at=[0.3, 1])
    # x = x0/(1 - x0 t) blows up at 1/x0.
    assert np.array_equal(many.failed, [1, 4])
    assert many.reached == pytest.approx([1, 0.5, 1, 1, 0.25], abs=1e-6)
    assert np.array_equal(np.isnan(many["x"]), [[0, 0], [0, 1], [0, 0], [0, 0], [1, 1]])
    for i, start in enumerate(starts["x"]):
        one = integrate(BLOW_UP, start={x: start}, span=(0, 1), method=method, at=[0.3, 1])
        assert many.statuses[i] is one.status
        assert np.array_equal(many["x"][i, : one.t.size], one["x"])
        assert many.member(i).stats == one.stats
    assert "first member 1 at t = 0.5, x = " in many.message
    assert many.member(1).message.startswith(f"member 1 stopped: {many.statuses[1].name} at t = 0.5, x = ")
    assert many.message.endswith("3 of 5 reached the end")
    assert str(many).count("\n") > 3


def test_each_way_to_fail_has_its_line_the_worst_first():
    # The root is infinitely steep at 0, where no implicit step can start, and not real below.
    field = VectorField({x: 1 + k * sp.sqrt(x)}, epsilon=None, parameters={k: 1})
    many = integrate_many(
        field,
        {"x": [1, 0, -1, 1]},
        parameters={k: [1, 1, 1, -1e9]},
        span=(0, 1),
        method=Method.RADAU9,
        max_steps=40,
    )
    assert [status.name for status in many.statuses[1:3]] == ["SINGULAR_JACOBIAN", "NON_FINITE"]
    assert many.statuses[0] is Status.SUCCESS
    assert not many.statuses[3].ok
    lines = many.message.splitlines()
    assert lines[0].startswith("1 of 4 NON_FINITE, first member 2 at t = 0, x = -1; ")
    assert lines[1].startswith("1 of 4 SINGULAR_JACOBIAN, first member 1 ")
    assert "Method.DOP853" in lines[1]
    assert lines[-1] == "1 of 4 reached the end"


def test_steps_are_counted_for_each_member():
    field = VectorField({x: k * y, y: -k * x}, epsilon=None, parameters={k: 1})
    many = integrate_many(field, [1, 0], parameters={k: [0.1, 50.0, 0.1]}, span=(0, 10), max_steps=50)
    assert [status.name for status in many.statuses] == ["SUCCESS", "TOO_MANY_STEPS", "SUCCESS"]
    assert many.steps[1] <= 50
    assert "raise max_steps" in many.message


def test_an_observable_is_not_a_number_where_its_state_is_not():
    field = VectorField({x: x**2}, epsilon=None, observables={energy: sp.Heaviside(x, 0)})
    many = integrate_many(field, {"x": [2.0, -1.0]}, span=(0, 1))
    assert np.array_equal(np.isnan(many["E"]), [[True], [False]])


# Progress and interrupts


def test_progress_rises_to_one():
    seen: list[float] = []
    oscillate(progress=seen.append, threads=2)
    assert seen == sorted(seen)
    assert len(seen) > 2
    assert seen[-1] == 1.0


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_keeps_what_is_done():
    def interrupt(fraction):
        if fraction > 0.2:
            signal.raise_signal(signal.SIGINT)

    starts = np.ones((400, 2))
    options = {"span": (0, 300), "rtol": 1e-6, "atol": 1e-8, "at": [100, 300]}
    many = oscillate(starts, progress=interrupt, threads=2, **options)
    one = alone(OSCILLATOR, starts[0], **options)
    done = np.array([status.ok for status in many.statuses])
    assert 0.2 * 400 < done.sum() < 400
    assert {status for status in many.statuses if not status.ok} == {Status.INTERRUPTED}
    assert all(np.array_equal(values, one.y) for values in many.y[done])
    # Those in hand stopped within one record; the others never began.
    waiting = many.steps == 0
    assert (~done & ~waiting).sum() <= 2
    assert np.array_equal(many.last[waiting], starts[waiting])
    assert (many.reached[waiting] == 0.0).all()
    assert "call again to go on" in many.message


@pytest.mark.usefixtures("interruptible")
def test_one_long_member_is_interrupted_too(monkeypatch):
    # Once it is under way, however long that takes here.
    run_members = kernels.run_members

    def watched(*arguments):
        *_, (_, _, _, counters, _), _ = arguments
        interrupter = threading.Thread(target=interrupt_once, args=(counters[0],))
        interrupter.start()
        run_members(*arguments)
        interrupter.join()

    def interrupt_once(counters):
        while counters[integrator.STEPS] == 0:
            time.sleep(0.001)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(kernels, "run_members", watched)
    many = oscillate([1, 0], span=(0, 1e9), max_steps=10**12, threads=1)
    assert many.statuses == (Status.INTERRUPTED,)
    assert 0 < many.reached[0] < 1e9
    assert np.hypot(*many.last[0]) == pytest.approx(1, abs=0.5)


def test_an_error_in_progress_is_the_callers_and_ends_the_rest():
    def fail(fraction):
        raise RuntimeError("mine")

    with pytest.raises(RuntimeError, match="mine"):
        oscillate(progress=fail)


def test_an_error_in_a_worker_is_raised():
    def work(low, high, halt):
        raise MemoryError("no room")

    with pytest.raises(MemoryError, match="no room"):
        parallel.share(lambda: work, 10, threads=2)


# What is refused


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"starts": {"x": [1, float("nan")], "y": 0}}, r"starts\['x'\] is nan for member 1"),
        ({"starts": [[1, 0], [1, 0], [1, float("inf")]]}, "starts must be finite. Got y = inf at point 2"),
        ({"starts": [{"x": 1, "y": 0}, {"x": 1}]}, r"Got x, y in starts\[0\] and x in starts\[1\]"),
        ({"starts": [{"x": 1, "y": 0}, {"x": "one", "y": 0}]}, r"starts\[1\] gives x the value 'one'"),
        ({"starts": [{"x": 1, "y": 0}, 3]}, r"starts\[1\] is a mapping"),
        ({"starts": {"x": [1, 2], "y": [1, 2, 3]}}, r"2 in starts\['x'\] and 3 in starts\['y'\]"),
        ({"starts": {"x": [1, 2]}}, "starts gives no value for y"),
        ({"starts": {"x": 1, "y": 2, "z": 3}}, 'starts names "z", which is no state'),
        ({"starts": {"x": [[1, 2]], "y": 0}}, r"Got the shape \(1, 2\). Flatten it"),
        ({"starts": {"x": [], "y": 0}}, r"one member or more. Got no value in starts\['x'\]"),
        ({"starts": np.empty((0, 2))}, "one member or more"),
        ({"starts": []}, "starts"),
        ({"starts": np.ones((3, 4))}, r"shape \(3, 4\)"),
        ({"starts": "x"}, "starts"),
        ({"starts": {"x": "one", "y": 0}}, r"starts\['x'\] is a number"),
        ({"starts": {x: 1, "x": 2, "y": 0}}, 'starts gives "x" twice'),
        ({"epsilon": [0.1, 0.2]}, "no small parameter"),
        ({"parameters": {"k": 1}}, "no parameters"),
        ({"threads": 0}, "threads is an integer, 1 or more. Got 0"),
        ({"at": [11]}, "at must lie inside"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_a_wrong_call_says_what_is_wrong(options, message):
    with pytest.raises(DeclarationError, match=message):
        oscillate(**options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"epsilon": [0.1, -0.1]}, "epsilon of member 1 must be finite and positive. Got -0.1"),
        ({"epsilon": [0.1, float("nan")]}, "epsilon is nan for member 1"),
        ({"epsilon": None}, "Got epsilon=None"),
        ({"epsilon": np.full(5, 0.1)}, r"2 in starts\['s'\] and 5 in epsilon"),
        ({"parameters": {"b": 1}}, 'no parameter "b". The parameters are a'),
        ({"parameters": {"a": [1, float("inf")]}}, r"parameters\['a'\] is inf for member 1"),
        ({"parameters": {"a": [1, 2, 3]}}, r"2 in starts\['s'\] and 3 in parameters\['a'\]"),
        ({"parameters": [1, 2]}, "parameters is a mapping"),
    ],
    ids=str,
)
def test_a_wrong_sweep_says_which_member(options, message):
    with pytest.raises(DeclarationError, match=message):
        integrate_many(ENZYME, {"s": [1, 2], "c": 0}, **{"span": (0, 1), "epsilon": 0.1, **options})


def test_no_worker_outlives_an_interrupt_while_threads_are_started(monkeypatch):
    working, start = threading.Event(), threading.Thread.start
    ended = []

    def interrupted_start(thread):
        # Ctrl-C after the thread has begun and before the pool has noted it, which then does not wait for it.
        start(thread)
        working.wait()
        raise KeyboardInterrupt

    def work(low, high, halt):
        working.set()
        while not halt[0]:
            time.sleep(0.001)
        time.sleep(0.05)
        ended.append(low)

    monkeypatch.setattr(threading.Thread, "start", interrupted_start)
    assert parallel.share(lambda: work, 1, threads=1) is False
    assert ended == [0]
