"""Mixed-mode oscillations: swings counted by events agree with a count on another integrator's output."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from gsp import charts
from gsp.errors import DeclarationError
from gsp.singular.mixed_modes import _large, _pattern, mixed_mode
from gsp.systems.system import SlowFastSystem, VectorField
from tests.rescaling import scene, shifted

x, y, z, epsilon = sp.symbols("x y z epsilon")


def koper(shift: float) -> SlowFastSystem:
    return SlowFastSystem(
        slow={y: x - 2 * y + z, z: y - z},
        fast={x: -10 * y - x**3 + 3 * x - sp.nsimplify(shift)},
        epsilon=epsilon,
        name="koper",
    )


START = {"x": -1.5, "y": 0.5, "z": 0.5}


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("shift", "small", "signature"), [(-6.5, 0.1, "1^1"), (-7, 0.05, "1^2"), (-6, 0.1, "1^0")]
)
def test_kopers_model_oscillates_in_mixed_modes(shift, small, signature):
    found = mixed_mode(koper(shift), "x", start=START, span=(0, 120), epsilon=small)
    assert found.signature == signature
    assert found.repeats > 10


@pytest.mark.exhaustive
def test_the_count_agrees_with_another_integrator():
    found = mixed_mode(koper(-7), "x", start=START, span=(0, 60), epsilon=0.05, settle=0.5)
    run = solve_ivp(
        lambda _, u: [(-10 * u[1] - u[0] ** 3 + 3 * u[0] + 7) / 0.05, u[0] - 2 * u[1] + u[2], u[1] - u[2]],
        (0, 60),
        [-1.5, 0.5, 0.5],
        method="LSODA",
        rtol=1e-9,
        atol=1e-11,
        dense_output=True,
    )
    t = np.linspace(30, 60, 60_001)
    values = run.sol(t)[0]
    tops = t[1:-1][(values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])]
    assert found.times == pytest.approx(tops, abs=2e-3)


def test_swings_of_a_known_function():
    # x = cos t + cos(t sqrt 2) has no period; a circle has one kind of swing.
    circle = VectorField({x: y, y: -x}, epsilon=None)
    found = mixed_mode(circle, "x", start={"x": 0, "y": 1}, span=(0, 40), settle=0.0)
    assert found.signature == "1^0"
    assert found.times == pytest.approx(np.pi / 2 + 2 * np.pi * np.arange(1, 1 + found.times.size), abs=1e-7)
    assert found.sizes == pytest.approx(2.0, abs=1e-7)


def test_patterns_are_the_shortest_that_repeat():
    def of(text: str):
        return _pattern(np.array([c == "L" for c in text]))

    assert of("sL" + "ssL" * 4) == (((1, 2),), 4)
    assert of("s" + "LsLss" * 4 + "L") == (((1, 1), (1, 2)), 4)
    assert of("s" + "LLsss" * 3 + "L") == (((2, 3),), 3)
    assert of("LLLL") == (((1, 0),), 4)
    assert of("sLsLssLsssL") == ((), 0)
    assert of("ss") == ((), 0)


def test_sizes_are_split_at_their_widest_gap():
    assert _large(np.array([4.0, 0.2, 0.5, 3.9])).tolist() == [True, False, False, True]
    assert _large(np.array([1.0, 2.0, 1.5])).all()
    assert _large(np.array([])).size == 0


def test_bad_input_is_named():
    with pytest.raises(DeclarationError, match="settle"):
        mixed_mode(koper(-7), "x", start=START, span=(0, 1), epsilon=0.1, settle=1.0)
    with pytest.raises(DeclarationError, match="forward in time"):
        mixed_mode(koper(-7), "x", start=START, span=(1, 0), epsilon=0.1)
    with pytest.raises(DeclarationError, match="which is no state's"):
        mixed_mode(koper(-7), x, start=START, span=(0, 1), epsilon=0.1)  # pyright: ignore[reportArgumentType]


@pytest.mark.exhaustive
def test_the_chart_tells_large_from_small():
    found = mixed_mode(koper(-7), "x", start=START, span=(0, 60), epsilon=0.05)
    axes = charts.mixed_mode(found)
    assert axes.get_title(loc="right") == "$1^{2}$"
    marks = {line.get_label(): len(line.get_xdata()) for line in axes.lines}
    assert marks["small swing"] == pytest.approx(2 * marks["large swing"], abs=2)
    assert charts.png(axes).startswith(b"\x89PNG")


def test_the_chart_of_a_run_without_swings():
    at_rest = mixed_mode(koper(-7), "x", start=START, span=(0, 0.01), epsilon=0.1)
    axes = charts.mixed_mode(at_rest)
    assert axes.get_title(loc="right") == "no repeating pattern"
    assert charts.png(axes).startswith(b"\x89PNG")


@pytest.mark.parametrize("unit", [1e-12, 1e9])
def test_a_pattern_does_not_depend_on_units(unit: float) -> None:
    plain, exact = koper(-7), sp.Rational(str(unit))
    own = {s: s / exact for s in (x, y, z)}
    rates = {s: exact * rate.xreplace(own) for s, rate in zip(plain.states, plain.rates)}
    small = VectorField(rates, epsilon=epsilon)
    start = {name: unit * value for name, value in START.items()}
    assert mixed_mode(small, "x", start=start, span=(0, 30), epsilon=0.05).signature == "1^2"


def test_swings_that_come_to_be_of_another_kind_little_by_little_repeat_in_nothing() -> None:
    """Of x'' + x'/10 + x = 0 each is exp(-pi/(10 cos(asin(1/20)))) = 0.73 of the one before."""
    damped = VectorField({x: y, y: -x - y / 10}, epsilon=None)
    found = mixed_mode(damped, "x", start={"x": 1, "y": 0}, span=(0, 80))
    assert found.sizes[1:] / found.sizes[:-1] == pytest.approx(np.exp(-np.pi / (10 * np.sqrt(1 - 1 / 400))))
    assert found.is_large.all()
    assert (found.pattern, found.repeats) == ((), 0)
    assert "in a row" not in str(found)
    # Over few of them none is of another kind than the first.
    assert mixed_mode(damped, "x", start={"x": 1, "y": 0}, span=(0, 20), settle=0.0).signature == "1^0"


def test_a_run_that_ended_early_says_so() -> None:
    growing = VectorField({x: y, y: -x + x**3}, epsilon=None)
    found = mixed_mode(growing, "x", start={"x": 1, "y": 1}, span=(0, 30))
    assert not found.run.status.ok
    assert "the run ended early" in str(found)


@pytest.mark.parametrize("far", [1000, -(10**6)])
def test_swings_do_not_depend_on_where_states_have_their_origin(far: int) -> None:
    # From -1e6 there were 723 swings without a pattern, of errors of integration.
    plain = scene("koper")
    moved = shifted(plain, {s.name: far for s in plain.system.states})
    here, there = (
        mixed_mode(asked.system, "x", start=asked.start, span=(0, 30), epsilon=asked.epsilon)
        for asked in (plain, moved)
    )
    assert (there.signature, there.repeats) == (here.signature, here.repeats)
    assert there.sizes == pytest.approx(here.sizes, rel=1e-5)
    assert there.run["x"][-1] == pytest.approx(far + here.run["x"][-1], abs=1e-4)
    tops = there.run.events["maximum"]
    assert there.run.at(tops.times) == pytest.approx(tops.states, abs=1e-6)
