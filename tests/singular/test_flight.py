"""Stick-slip: singular orbits that leave the surface of a switch and come back, against stiff runs of SciPy."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from gsp.critical.critical_manifold import solve_critical
from gsp.errors import GspError
from gsp.orbits.periodic.finding import periodic_orbit
from gsp.singular.singular_orbit import SingularOrbit, singular_orbit
from gsp.splitting.splitting import split
from gsp.systems.system import SlowFastSystem, VectorField

x, y, u, v, eps = sp.symbols("x y u v epsilon")
SPEED = 0.2
slip = (sp.Rational(1, 5) - u) / eps
stribeck = sp.Rational(2, 5) * slip / sp.sqrt(1 + slip**2) + sp.Rational(6, 5) * slip / (1 + slip**2)
belt = VectorField({x: u, u: -x + stribeck}, epsilon=eps)


@pytest.fixture(scope="module")
def orbit() -> SingularOrbit:
    system = split(belt).system
    assert system is not None
    branch = solve_critical(system).nearest({"x": 0.5, "v": 0.3})
    return singular_orbit(branch, {"x": 0.5, "v": 0.3}, switched=belt)


def stiff_period(epsilon: float) -> float:
    """The time between passages of x = 0.4 upwards, on the attracting cycle, by SciPy's Radau at 1e-12."""

    def force(w):
        return 0.4 * w / np.sqrt(1 + w * w) + 1.2 * w / (1 + w * w)

    def rates(_, z):
        return [z[1], -z[0] + force((SPEED - z[1]) / epsilon)]

    def slopes(_, z):
        w = (SPEED - z[1]) / epsilon
        slope = 0.4 / (1 + w * w) ** 1.5 + 1.2 * (1 - w * w) / (1 + w * w) ** 2
        return [[0.0, 1.0], [-1.0, -slope / epsilon]]

    def passes(_, z):
        return z[0] - 0.4

    passes.direction = 1
    run = solve_ivp(rates, (0, 22), [0.3, SPEED], "Radau", rtol=1e-12, atol=1e-14, jac=slopes, events=passes)
    return float(np.diff(run.t_events[0])[-1])


@pytest.mark.exhaustive
def test_the_fold_of_the_law_is_known_exactly(orbit: SingularOrbit) -> None:
    """F' = 0 at w^2 = (19 + sqrt(73))/18, to fifty digits 1.2370215965355731808615299799591561002967510690047."""
    w = sp.Symbol("w", positive=True)
    force = sp.Rational(2, 5) * w / sp.sqrt(1 + w**2) + sp.Rational(6, 5) * w / (1 + w**2)
    exact = sp.sqrt((19 + sp.sqrt(73)) / 18)
    place = sp.N(exact, 50)
    assert abs(sp.N(sp.diff(force, w).subs(w, exact), 50)) < sp.Rational(1, 10**45)
    assert sp.N(sp.diff(force, w, 2).subs(w, place), 50) < 0
    assert str(place) == "1.2370215965355731808615299799591561002967510690047"
    assert str(sp.N(force.subs(w, exact), 30)) == "0.897747883876394508756440254784"
    (piece,) = orbit.cycle
    assert piece.fold is not None
    assert piece.fold.point["v"] == pytest.approx(float(place), abs=1e-11)


def test_the_limit_of_stick_slip_is_a_slow_piece_and_a_flight(orbit: SingularOrbit) -> None:
    """Sticking up to the fold at F = 0.897747883876, slipping along an arc of a circle: 8.8832027200 in all."""
    assert orbit.closes
    (piece,) = orbit.cycle
    assert piece.fold is not None
    assert piece.flight is not None
    assert piece.fold.point["x"] == pytest.approx(0.897747883876, abs=1e-11)
    assert piece.flight.point["x"] == pytest.approx(0.8 - 0.897747883876, abs=1e-10)
    assert orbit.coefficients is not None
    assert orbit.coefficients[0] == pytest.approx(8.8832027200, abs=1e-9)
    assert np.isnan(orbit.coefficients[2])
    assert "it flies for a slow time 3.9057" in str(orbit)
    assert "O(epsilon ln epsilon)" in str(orbit)


@pytest.mark.exhaustive
@pytest.mark.parametrize("epsilon", [1e-2, 1e-3, 1e-4])
def test_the_periods_are_those_of_a_stiff_run(epsilon: float) -> None:
    found = periodic_orbit(belt, start={"x": 0.3, "u": 0.2}, epsilon=epsilon)
    assert found.period == pytest.approx(stiff_period(epsilon), abs=1e-7)


@pytest.mark.exhaustive
def test_periods_approach_the_limit_with_the_power_of_the_fold(orbit: SingularOrbit) -> None:
    """(T - T_0)/epsilon^(2/3) -> T_1; what is left goes as epsilon^(1/3) ln epsilon and epsilon^(1/3)."""
    assert orbit.coefficients is not None
    leading, first, _ = orbit.coefficients
    epsilons = 10.0 ** -np.arange(4.0, 8.5, 0.5)
    periods = [periodic_orbit(belt, start={"x": 0.3, "u": 0.2}, epsilon=epsilon).period for epsilon in epsilons]
    scaled = (np.array(periods) - leading) / epsilons ** (2 / 3)
    third = epsilons ** (1 / 3)
    basis = np.column_stack([np.ones_like(third), third * np.log(epsilons), third, third**2])
    assert np.linalg.lstsq(basis, scaled, rcond=None)[0][0] == pytest.approx(first, rel=5e-3)
    assert orbit.period(1e-8) == pytest.approx(periods[-1], rel=1e-6)


def test_an_orbit_without_its_field_ends_where_it_leaves(orbit: SingularOrbit) -> None:
    left = singular_orbit(orbit.branch, {"x": 0.5, "v": 0.3})
    assert not left.closes
    assert "lands on nothing: it escapes" in left.message


def test_a_flight_takes_the_field_that_was_split(orbit: SingularOrbit) -> None:
    other = SlowFastSystem(slow={x: 1}, fast={y: x + y**2}, epsilon=eps)
    branch = solve_critical(other).nearest({"x": -1, "y": -1})
    with pytest.raises(GspError, match="whose fast variable is the switch's, v"):
        singular_orbit(branch, {"x": -1, "y": -1}, switched=belt)


def test_a_flight_comes_down_in_any_unit_of_the_slip() -> None:
    """Over slips of 1e6 the sheet was sought at v up to 1304, and the orbit never came back."""
    w = slip / 10**6
    force = sp.Rational(2, 5) * w / sp.sqrt(1 + w**2) + sp.Rational(6, 5) * w / (1 + w**2)
    wide = VectorField({x: u, u: -x + force}, epsilon=eps)
    system = split(wide).system
    assert system is not None
    start = {"x": 0.5, "v": 3e5}
    found = singular_orbit(solve_critical(system).nearest(start), start, switched=wide)
    assert found.closes
    (piece,) = found.cycle
    assert piece.flight is not None
    assert piece.flight.point["v"] == pytest.approx(-61293.186, rel=1e-7)


@pytest.mark.parametrize("unit", ["1/10000000000000", "1000000000"])
def test_a_flight_does_not_depend_on_the_unit_of_length(orbit: SingularOrbit, unit: str) -> None:
    S = sp.Rational(unit)
    own = {x: x / S, u: u / S}
    small = VectorField({s: S * rate.xreplace(own) for s, rate in belt.equations.items()}, epsilon=eps)
    system = split(small).system
    assert system is not None
    start = {"x": 0.5 * float(S), "v": 0.3}
    found = singular_orbit(solve_critical(system).nearest(start), start, switched=small)
    assert found.closes
    (piece,), (plain,) = found.cycle, orbit.cycle
    assert piece.flight is not None
    assert plain.flight is not None
    assert piece.flight.duration == pytest.approx(plain.flight.duration, rel=1e-11)
