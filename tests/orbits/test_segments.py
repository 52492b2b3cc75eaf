"""Orbits and the quantities that are read off them, on straight lines and circles where all is known."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.collocation.bordered import OrbitChange
from gsp.lowering.compiled_flow import parameter_vector
from gsp.orbits.canard_orbits.canard import deviation
from gsp.orbits.canard_orbits.canard_finder import CanardFinder
from gsp.orbits.canard_orbits.collocation import SCHEME, OrbitSegment
from gsp.orbits.canard_orbits.frame import Plane
from gsp.orbits.periodic import finding
from gsp.orbits.periodic.collocation import OrbitProblem
from gsp.systems.system import SlowFastSystem

X, Y = sp.symbols("x y")
ONE = sp.Integer(1)


def straight(begin: list[float], end: list[float]) -> OrbitSegment:
    mesh = np.linspace(0.0, 1.0, 9)
    inside = mesh[:-1, None] + np.diff(mesh)[:, None] * SCHEME.c

    def line(share: np.ndarray) -> np.ndarray:
        return np.array(begin) + share[..., None] * (np.array(end) - np.array(begin))

    return OrbitSegment(mesh, line(mesh), line(inside), 1.0, 0.01)


@pytest.mark.parametrize(("reach", "largest"), [(1.0, 0.1), (0.5, 0.05)])
def test_an_orbit_and_an_axis_are_apart_by_what_they_are_near_the_section(reach: float, largest: float) -> None:
    # The orbit is 0.1 (x - 2) above the axis, on which it crosses the section x = 2 half-way.
    orbit = straight([0.0, 0.0, -0.2], [4.0, 0.0, 0.2])
    axis = straight([0.0, 0.0, 0.0], [2.0, 0.0, 0.0]), straight([2.0, 0.0, 0.0], [4.0, 0.0, 0.0])
    # Looked at between places, so a little less than all of the reach.
    found = deviation(orbit, 0.5, axis, Plane(0, 2.0), reach)
    assert 0.9 * largest < found <= largest * (1 + 1e-9)


def test_a_step_of_epsilon_moves_epsilon_and_one_without_does_not() -> None:
    orbit = straight([0.0, 1.0], [2.0, 3.0])
    ones = OrbitChange(np.ones_like(orbit.states), np.ones_like(orbit.stages), np.array([0.5, 0.002]))
    moved = orbit.moved(ones, 0.5)
    assert (moved.time, moved.epsilon) == pytest.approx((1.25, 0.011))
    assert moved.states == pytest.approx(orbit.states + 0.5)
    fixed = orbit.moved(OrbitChange(ones.states, ones.stages, np.array([0.5])))
    assert (fixed.time, fixed.epsilon) == (1.5, 0.01)


def test_the_free_parameter_stands_where_the_field_looks_for_it() -> None:
    x, y, epsilon, a, b, c = sp.symbols("x y epsilon a b c")
    system = SlowFastSystem(
        slow={x: a - y}, fast={y: x - b * y - c}, epsilon=epsilon, parameters={a: 2.0, b: 3.0, c: 5.0}
    )
    p = parameter_vector(system, 0.125)
    for symbol, value in ((epsilon, 0.125), (a, 2.0), (b, 3.0), (c, 5.0)):
        assert p[OrbitProblem(system, p, symbol).place] == value


UNEVEN = {X: X * (1 - X**2 - Y**2) - Y * (1 + X / 2), Y: Y * (1 - X**2 - Y**2) + X * (1 + X / 2)}
PERIOD = 4 * math.pi / math.sqrt(3)


def circle(*, size: sp.Expr = ONE, time: sp.Expr = ONE) -> gsp.VectorField:
    """The unit circle with theta' = 1 + cos(theta)/2 in other units."""
    own = {X: X / size, Y: Y / size}
    return gsp.VectorField(
        {s: size / time * rate.subs(own, simultaneous=True) for s, rate in UNEVEN.items()}, epsilon=None
    )


@pytest.mark.parametrize("time", [10**6, sp.Rational(1, 10**6)])
def test_an_orbit_is_the_same_in_any_unit_of_time(time) -> None:
    orbit = gsp.periodic_orbit(circle(time=sp.sympify(time)), start={"x": 1, "y": 0})
    assert orbit.status.ok
    assert orbit.period / float(time) == pytest.approx(PERIOD, rel=1e-12)


@pytest.mark.parametrize("size", [ONE, sp.Rational(1, 10**7)])
def test_a_lap_of_a_rough_orbit_closes_after_a_few_corrections_in_any_unit(size: sp.Expr) -> None:
    orbit = gsp.periodic_orbit(circle(size=size), start={"x": float(size), "y": 0}, tolerance=1e-4, degree=3)
    shot = gsp.shoot(orbit)
    assert shot.status.ok
    assert shot.period == pytest.approx(PERIOD, rel=1e-12)
    assert math.hypot(*shot.point.values()) == pytest.approx(float(size), rel=1e-11)
    assert abs(orbit.period / PERIOD - 1) > 1e-9


def test_what_is_stable_has_every_multiplier_inside_the_circle() -> None:
    orbit = gsp.periodic_orbit(circle(), start={"x": 1, "y": 0})
    assert orbit.is_stable
    for other in (1.2, -1.2, 1.2j):
        unstable = replace(orbit, multipliers=np.array([1.0, other]))
        assert not unstable.is_stable
        assert unstable.unstable == 1


@pytest.mark.parametrize(
    ("first", "closer", "taken"),
    [
        ((True, 0), (True, 1), 0),
        ((True, 1), (True, 0), 1),
        ((True, 1), (True, 1), 0),
        ((True, 1), (False, 0), 0),
        ((False, 0), (True, 1), 1),
    ],
)
def test_of_two_settled_orbits_the_stable_one_is_taken(
    first, closer, taken, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What a run settles on, each as (whether it was solved, unstable directions), by how nearly the run has to close.
    orbits = {
        closes: SimpleNamespace(status=SimpleNamespace(ok=ok), unstable=unstable)
        for closes, (ok, unstable) in ((finding.CLOSES, first), (finding.CLOSER, closer))
    }
    monkeypatch.setattr(finding, "settled_lap", lambda *_, closes, **__: closes)
    monkeypatch.setattr(finding, "_solved", lambda _, lap, **__: lap)
    monkeypatch.setattr(finding, "assembled", lambda _, lap: orbits[lap])
    found = gsp.periodic_orbit(circle(), start={"x": 1, "y": 0})
    assert found is orbits[(finding.CLOSES, finding.CLOSER)[taken]]


def test_no_canard_is_at_a_crossing_that_there_is_not() -> None:
    finder = CanardFinder.__new__(CanardFinder)
    finder.columns, finder.scale = [0, 1], np.ones(2)
    here, elsewhere = (SimpleNamespace(place=np.array([v, 0.0])) for v in (0.0, 1.0))
    solved = SimpleNamespace(crossing=here, state=np.zeros(3))
    assert not finder._is_at(solved, None)
    assert finder._is_at(solved, here)
    assert not finder._is_at(solved, elsewhere)
