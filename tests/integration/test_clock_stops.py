"""No run steps over a pulse that a clock gives: its area is in what it drives, by every method and in every unit."""

import numpy as np
import pytest
import sympy as sp
from scipy.special import ive

from gsp.critical.critical_manifold import solve_critical
from gsp.errors import Status
from gsp.integration.clock_stops import clock_stops, stops_of
from gsp.integration.ensemble import integrate_many
from gsp.integration.events import Event
from gsp.integration.methods import Method
from gsp.integration.restriction import restrict
from gsp.integration.trajectory import integrate
from gsp.lowering.compiled_flow import compile_flow
from gsp.readers.loading import load
from gsp.slow.series import expand
from gsp.systems.system import SlowFastSystem, VectorField

x, y, t, w, T, eps = sp.symbols("x y t w T epsilon")
PULSES = {
    "a dose": (sp.Piecewise((1 / w, (t > T) & (t < T + w)), (0, True)), 1.0),
    "a kick": (sp.exp(-(((t - T) / w) ** 2)) / w, np.sqrt(np.pi)),
    "a window": ((sp.tanh((t - T) / w) - sp.tanh((t - T - w) / w)) / w, 2.0),
    "a soliton": (1 / sp.cosh((t - T) / w) ** 2 / w, 2.0),
    "a wedge": (sp.Max(0, 1 - sp.Abs(t - T) / w) / w, 1.0),
    "a synapse": (sp.Max(0, t - T) * sp.exp(-sp.Max(0, t - T) / w) / w**2, 1.0),
    "a release": (sp.exp(-((sp.log(t / T) / w) ** 2)) / t / w, np.sqrt(np.pi)),
}


def driven(pulse: sp.Expr, width: float, rate: float = 1.0) -> VectorField:
    return VectorField(
        states={x: pulse, t: sp.Rational(rate)}, epsilon=None, parameters={w: sp.Rational(width), T: 5}
    )


@pytest.mark.parametrize("method", Method)
@pytest.mark.parametrize("width", [0.1, 1e-3, 1e-5])
@pytest.mark.parametrize("name", PULSES)
def test_all_of_a_pulse_is_taken_from_rest(name: str, width: float, method: Method) -> None:
    pulse, area = PULSES[name]
    run = integrate(driven(pulse, width), start={"x": 0, "t": 1e-9}, span=(0, 10), method=method)
    assert run.status is Status.SUCCESS
    assert run["x"][-1] == pytest.approx(area, rel=1e-6)


@pytest.mark.parametrize("method", Method)
@pytest.mark.parametrize("width", [0.1, 1e-3, 1e-7])
def test_what_rises_from_nothing_at_the_start_is_no_narrower_than_it_is_seen(
    width: float, method: Method
) -> None:
    synapse = driven(t * sp.exp(-t / w) / w**2, width)
    run = integrate(synapse, start={"x": 0, "t": 0}, span=(0, 10), method=method)
    assert run["x"][-1] == pytest.approx(1, rel=1e-6)


def test_what_rises_from_nothing_in_every_period_is_seen() -> None:
    """A drug is absorbed from the gut, by mod of the time in other formats."""
    phase = 4 * sp.atan(sp.tan(sp.pi * t / 4)) / sp.pi + 2
    run = integrate(driven(phase * sp.exp(-phase / w) / w**2, 1e-3), start={"x": 0, "t": 2}, span=(2, 42))
    assert run["x"][-1] == pytest.approx(10, rel=1e-6)


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_a_pulse_is_met_in_any_unit_of_time_and_backward(unit: float) -> None:
    pulse, area = PULSES["a dose"]
    field = driven(pulse.subs(T, T * unit), 1e-3 * unit)
    for span, sign in (((0.0, 10 * unit), 1.0), ((10 * unit, 0.0), -1.0)):
        run = integrate(field, start={"x": 0, "t": span[0]}, span=span)
        assert run["x"][-1] == pytest.approx(sign * area, rel=1e-6)


def test_the_clock_is_read_off_its_own_start_and_rate() -> None:
    run = integrate(driven(PULSES["a kick"][0], 1e-3, rate=2), start={"x": 0, "t": -100}, span=(7, 67))
    half = np.interp(0.5 * run["x"][-1], run["x"], run.t)
    assert half == pytest.approx(7 + 105 / 2, abs=1e-2)
    assert run["x"][-1] == pytest.approx(np.sqrt(np.pi) / 2, rel=1e-6)


@pytest.mark.parametrize("method", Method)
def test_no_pulse_of_a_train_is_missed(method: Method) -> None:
    """Ten doses, and ten smooth ones, in ten days: from rest to rest."""
    angle, level = 2 * sp.pi * t / 24, sp.Rational(999, 1000)
    dose = sp.pi / (24 * sp.acos(level)) * (1 + sp.sign(sp.cos(angle) - level)) / 2
    smooth = sp.exp(1000 * (sp.cos(angle) - 1)) / 24
    field = VectorField(states={x: dose, y: smooth, t: 1}, epsilon=None)
    run = integrate(field, start={"x": 0, "y": 0, "t": 12}, span=(0, 240), method=method)
    assert run["x"][-1] == pytest.approx(10, rel=1e-6)
    assert run["y"][-1] == pytest.approx(10 * ive(0, 1000.0), rel=1e-6)


def test_a_wave_of_more_periods_than_steps_has_no_stops() -> None:
    field = VectorField(states={x: sp.sign(sp.sin(10**9 * t)) - x, t: 1}, epsilon=None)
    run = integrate(field, start={"x": 0, "t": 0}, span=(0, 10), max_steps=500)
    assert run.status is Status.TOO_MANY_STEPS


def test_a_power_of_a_wave_is_a_train_of_pulses() -> None:
    field = VectorField(states={x: sp.cos(sp.pi * t / 24) ** 1000, t: 1}, epsilon=None)
    run = integrate(field, start={"x": 0, "t": 12}, span=(0, 240))
    assert run["x"][-1] == pytest.approx(240 * float(sp.binomial(1000, 500)) / 2.0**1000, rel=1e-6)


@pytest.mark.parametrize("pulse", ["heav(mod(c,24)-6)*heav(6.01-mod(c,24))", "exp(-((mod(c-2,24)-4)/w)^2)"])
def test_pulses_in_a_remainder_of_a_clock_are_met(pulse: str, tmp_path) -> None:
    path = tmp_path / "doses.ode"
    path.write_text(f"x'={pulse}\nc'=1\npar w=0.01\nc(0)=12\ndone\n")
    run = integrate(load(path).system, start={"x": 0, "c": 12}, span=(0, 240))
    area = 0.01 if "heav" in pulse else 0.01 * np.sqrt(np.pi)
    assert run["x"][-1] == pytest.approx(10 * area, rel=1e-6)


@pytest.mark.parametrize(
    "function",
    [sp.Heaviside(w * t - 1, 0), sp.Heaviside(w * t**2 + t - 11, 0), sp.sign(sp.sin(w * t))],
    ids=str,
)
def test_next_to_nothing_before_a_clock_is_as_good_as_nothing(function: sp.Expr) -> None:
    field = VectorField(states={x: function, t: 1}, epsilon=None, parameters={w: sp.Rational(1, 10**320)})
    run = integrate(field, start={"x": 0, "t": 0}, span=(0, 10))
    assert run.status is Status.SUCCESS


def test_members_of_an_ensemble_meet_their_own_pulses_as_single_runs_do() -> None:
    field, times = driven(PULSES["a dose"][0], 1e-3), np.array([1.0, 5.0, 7.0, 30.0])
    many = integrate_many(field, {"x": 0, "t": 0}, parameters={"T": times}, span=(0, 10), at=[4, 10])
    for i, time in enumerate(times):
        alone = integrate(field.with_parameters(T=time), start={"x": 0, "t": 0}, span=(0, 10), at=[4, 10])
        assert many["x"][i] == pytest.approx([float(time < 4), float(time < 10)], abs=1e-6)
        assert many["x"][i].tolist() == alone["x"].tolist()


def test_a_reduced_flow_and_a_run_with_events_meet_the_pulse() -> None:
    pulse = PULSES["a dose"][0]
    system = SlowFastSystem(
        slow={x: pulse - y / 10, t: 1}, fast={y: x - y}, epsilon=eps,
        parameters={w: sp.Rational(1, 1000), T: 5},
    )  # fmt: skip
    (branch,) = solve_critical(system).branches
    reduced = restrict(expand(branch, order=1), order=1)
    start, expected = {"x": 0, "t": 0}, np.exp(-0.5)
    slow = integrate(reduced, start=start, span=(0, 10), epsilon=1e-4)
    assert slow["x"][-1] == pytest.approx(expected, rel=1e-3)
    full = integrate(system, start={**start, "y": 0}, span=(0, 10), epsilon=1e-4, events=Event(x - 1 / sp.S(2)))
    assert full["x"][-1] == pytest.approx(expected, rel=1e-3)
    (crossings,) = full.events.values()
    assert crossings.times == pytest.approx([5.0005], abs=1e-4)


def test_stops_are_in_order_each_once_and_within_the_span() -> None:
    grid = np.array([0.0, 1.0, 2.0])
    assert stops_of(grid, 0.0, 2.0).tolist() == [1.0, 2.0]
    assert stops_of(grid, 0.0, 2.0, [(t, t) for t in (1.5, -1.0, 0.0, 1.0, 3.0)]).tolist() == [1.0, 1.5, 2.0]
    assert stops_of(None, 2.0, 0.0, [(0.5, 0.5), (1.5, 1.5)]).tolist() == [1.5, 0.5, 0.0]


def test_what_lies_behind_a_jump_stands_twice() -> None:
    grid = np.array([0.0, 1.0, 2.0])
    assert stops_of(grid, 0.0, 2.0, [(0.75, 1.25)]).tolist() == [0.75, 1.0, 1.0, 1.25, 1.25, 2.0]
    assert stops_of(None, 2.0, 0.0, [(0.75, 1.25)]).tolist() == [1.25, 0.75, 0.75, 0.0]
    assert stops_of(None, 0.0, 2.0, [(-0.25, 0.25), (1.75, 2.25)]).tolist() == [0.25, 0.25, 1.75, 2.0, 2.0]


@pytest.mark.parametrize("method", Method)
def test_a_jump_is_crossed_however_high_it_is(method: Method) -> None:
    """No step of a length that rounding leaves would meet the tolerance there."""
    for time, width in ((10**6, 1e-3), (5, 1e-9), (10**4, 1e-3)):
        field = driven(PULSES["a dose"][0].subs(T, time), width)
        for span, sign in (((0.0, 2.0 * time), 1.0), ((2.0 * time, 0.0), -1.0)):
            run = integrate(field, start={"x": 0, "t": span[0]}, span=span, method=method)
            assert run.status is Status.SUCCESS
            assert run["x"][-1] == pytest.approx(sign, abs=1e-6 + 1e-14 * time / width)


def stops(function: sp.Expr, rate: float, first: float, last: float, most: int = 100) -> np.ndarray:
    """The stops within a span for a function of a clock that begins at 1."""
    field = VectorField(states={x: function, t: sp.Rational(rate)}, epsilon=None)
    compiled = compile_flow(field)
    found = clock_stops(compiled, compiled.parameters(None), (0.0, 1.0), first, last, most)
    return np.unique(stops_of(None, first, last, found))[:-1]


def test_stops_stand_where_the_function_switches_and_peaks() -> None:
    clock = 1.0 + 2.0 * (stops(sp.Heaviside(t - 3, 0) - sp.Heaviside(t - 4, 0), 2, 10, 20) - 10.0)
    assert clock == pytest.approx([3, 3, 4, 4], abs=1e-12)
    assert np.diff(clock)[[0, 2]].min() > 0.0
    # cos(3 t + 1) = 1/2 at 3 t + 1 = +-pi/3 + 2 pi k.
    clock = 1.0 + 0.5 * stops(sp.sign(sp.cos(3 * t + 1) - sp.Rational(1, 2)), 0.5, 0, 8)
    angles = np.array([5, 7, 11, 13]) * np.pi / 3
    assert clock[::2] == pytest.approx((angles - 1) / 3, abs=1e-12)
    # sin(t) + cos(t) is largest at pi/4, and 0 at 3 pi/4 and 7 pi/4.
    clock = 1.0 + stops(sp.exp(9 * sp.sin(t) + 9 * sp.cos(t)), 1, 0, 5)
    assert clock == pytest.approx(np.array([3, 5, 7]) * np.pi / 4, abs=1e-12)
    assert stops(sp.sign(sp.sin(t)), 1, 0, 700, most=100).size == 0
