"""Exits, their losses and singular orbits in other units of time: the same points, and times in those units."""

import numpy as np
import pytest
import sympy as sp

import gsp

x, y, u, v, eps = sp.symbols("x y u v epsilon")
FASTER = (1e-6, 1e6)
START = {"x": -1}
PASSED = {
    "invariant": {y: x * y - y**3},
    "exchange": {y: x * y - y**2 - eps},
    "first order": {y: x * y - y**3 + eps},
    "second order": {y: x * y - y**3 + eps**2},
    "second order, escape": {y: x * y + y**3 + eps**2},
    "third order, transcritical": {y: x * y + y**2 + 2 * eps**3},
    "pair": {u: x * u + v + eps, v: -u + x * v},
}


def passage(name: str, faster: float) -> gsp.DelayedExit:
    fast = PASSED[name]
    unit = sp.Rational(faster) if faster > 1 else 1 / sp.Rational(round(1 / faster))
    system = gsp.SlowFastSystem(slow={x: unit}, fast={s: unit * g for s, g in fast.items()}, epsilon=eps)
    branch = gsp.solve_critical(system).nearest({"x": -1, **{s.name: 0 for s in fast}})
    return gsp.entry_exit(branch, start=START, region={"x": (-1, 3)})


@pytest.mark.exhaustive
@pytest.mark.parametrize("faster", FASTER)
@pytest.mark.parametrize("name", PASSED)
def test_a_loss_that_is_passed_is_the_same(name: str, faster: float) -> None:
    plain, found = passage(name, 1.0), passage(name, faster)
    assert len(found.losses) == len(plain.losses) == 1
    for a, b in zip(plain.losses, found.losses):
        assert (a.kind, a.outcome) == (b.kind, b.outcome)
        assert b.t * faster == pytest.approx(a.t, rel=1e-9)
        assert b.point == pytest.approx(dict(a.point), abs=1e-9)
        assert set(a.coefficients) == set(b.coefficients)
        if "rho_k" in a.coefficients:
            assert b.coefficients["rho_k"] / faster == pytest.approx(a.coefficients["rho_k"], rel=1e-6)
        if np.isfinite(a.limit):
            assert b.limit == pytest.approx(a.limit, abs=1e-9)


@pytest.mark.parametrize("unit", [1e-9, 1e9])
@pytest.mark.parametrize(
    ("rate", "start", "end"),
    [
        (x + x**2, -0.5, (3**0.5 - 1) / 2),
        (x - 1, 0.0, 2.0),
        (sp.Rational(1, 2) - sp.exp(-x), 0.0, 1.5936242600400401),
    ],
)
def test_an_exit_is_where_it_was_in_any_unit_of_the_slow_variable(
    rate, start: float, end: float, unit: float
) -> None:
    """Also where g vanishes on the branch, so that the eigenvalue alone tells a size of x: a start at 0 has none."""
    size = sp.nsimplify(unit)
    system = gsp.SlowFastSystem(slow={x: size}, fast={y: rate.xreplace({x: x / size}) * y}, epsilon=eps)
    found = gsp.entry_exit(gsp.solve_critical(system).branches[0], start={"x": start * unit})
    assert found.point["x"] / unit == pytest.approx(end, rel=1e-9)


@pytest.mark.parametrize("year", [0, 2020, -10000])
def test_an_exit_is_as_far_from_the_loss_in_any_year(year: int) -> None:
    """Loss and exit lie between two nodes of the first panel, which is as long as x is far from 0."""
    since = x - year
    system = gsp.SlowFastSystem(slow={x: 1}, fast={y: (since + since**2) * y}, epsilon=eps)
    found = gsp.entry_exit(gsp.solve_critical(system).branches[0], start={"x": year - 0.5})
    assert found.point["x"] - year == pytest.approx((3**0.5 - 1) / 2, abs=1e-6)


@pytest.mark.parametrize(("slow", "fast"), [(9, -9), (0, -9), (9, 9)])
def test_orbits_in_extended_precision_hold_their_digits_in_any_units(slow: int, fast: int) -> None:
    """x' = 1, epsilon y' = x y from -2 to 2: back at its size after falling by exp(-40)."""
    lengths = sp.Integer(10) ** slow, sp.Integer(10) ** fast
    system = gsp.SlowFastSystem(slow={x: lengths[0]}, fast={y: x / lengths[0] * y}, epsilon=eps)
    begin = {"x": -2 * lengths[0], "y": lengths[1]}
    found = gsp.follow(system, start=begin, span=(0, 4), epsilon=sp.Rational(1, 20), digits=30)
    assert float(found.end["y"] / lengths[1] - 1) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.exhaustive
@pytest.mark.parametrize("power", [-6, 6])
def test_a_singular_orbit_lasts_as_long(power: int) -> None:
    unit = sp.Integer(10) ** power
    system = gsp.SlowFastSystem(slow={y: -unit * x}, fast={x: unit * (y - x**3 / 3 + x)}, epsilon=eps)
    orbit = gsp.singular_orbit(gsp.solve_critical(system).branches[0], {"x": 2, "y": 0.6})
    expected = np.array([3.0 - 2.0 * np.log(2.0), 7.014322, 1.0 / 3.0])
    assert orbit.coefficients is not None
    assert np.array(orbit.coefficients) * 10.0**power == pytest.approx(expected, rel=1e-6)
