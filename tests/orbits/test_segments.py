"""Segments of orbits and the quantities that are read off them, on straight lines where all is known."""

import numpy as np
import pytest
import sympy as sp

from gsp.collocation.bordered import Step
from gsp.lowering.compiled_flow import parameter_vector
from gsp.orbits.canard_orbits.canard import deviation
from gsp.orbits.canard_orbits.collocation import SCHEME, OrbitSegment
from gsp.orbits.canard_orbits.frame import Plane
from gsp.orbits.periodic.collocation import OrbitProblem
from gsp.orbits.periodic.explosion import ROWS, explosions
from gsp.systems.system import SlowFastSystem


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
    ones = Step(np.ones_like(orbit.states), np.ones_like(orbit.stages), np.array([0.5, 0.002]))
    moved = orbit.moved(ones, 0.5)
    assert (moved.time, moved.epsilon) == pytest.approx((1.25, 0.011))
    assert moved.states == pytest.approx(orbit.states + 0.5)
    fixed = orbit.moved(Step(ones.states, ones.stages, np.array([0.5])))
    assert (fixed.time, fixed.epsilon) == (1.5, 0.01)


def test_the_free_parameter_stands_where_the_field_looks_for_it() -> None:
    x, y, epsilon, a, b, c = sp.symbols("x y epsilon a b c")
    system = SlowFastSystem(
        slow={x: a - y}, fast={y: x - b * y - c}, epsilon=epsilon, parameters={a: 2.0, b: 3.0, c: 5.0}
    )
    p = parameter_vector(system, 0.125)
    for symbol, value in ((epsilon, 0.125), (a, 2.0), (b, 3.0), (c, 5.0)):
        assert p[OrbitProblem(system, p, symbol).place] == value


def test_an_explosion_has_so_many_rows_at_least() -> None:
    def found(rows: int):
        # A slow rise, then `rows` rows whose parameters hardly differ, then a slow rise.
        values = np.concatenate(
            [np.linspace(0.0, 1.0, 20), 1.0 + 1e-9 * np.arange(1, rows), np.linspace(1.1, 2.0, 20)]
        )
        amplitudes = np.concatenate(
            [np.linspace(0.1, 0.11, 20), np.linspace(0.2, 0.9, rows - 1), np.linspace(0.91, 1.0, 20)]
        )
        return explosions(values, amplitudes[None, :])

    (explosion,) = found(ROWS)
    assert explosion.last - explosion.first + 1 == ROWS
    assert explosion.value == pytest.approx(1.0)
    assert found(ROWS - 1) == ()
