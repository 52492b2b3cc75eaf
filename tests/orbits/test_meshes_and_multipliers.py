"""Discrete cycles of known functions: their algebra, estimated errors and meshes; multipliers of known transfers."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.collocation.gauss import gauss
from gsp.errors import Status
from gsp.orbits.periodic.collocation import Cycle
from gsp.orbits.periodic.explosion import GROWN, ROWS, STEEP, explosions
from gsp.orbits.periodic.floquet import isolation, joined, multipliers
from gsp.orbits.periodic.mesh import FEWEST, GROWTH, MARGIN, adapted, growth_density, interval_errors
from gsp.orbits.periodic.orbit import OrbitStats, PeriodicOrbit

TURN = 2 * np.pi


def circle(count: int, *, stages: int = 4, widths: np.ndarray | None = None) -> Cycle:
    """(cos, 2 sin) of 2 pi s, by its values at the collocation points."""
    mesh = (
        np.linspace(0.0, 1.0, count + 1) if widths is None else np.append(0.0, np.cumsum(widths / widths.sum()))
    )
    mesh[-1] = 1.0
    phase = TURN * gauss(stages).places(mesh)
    return Cycle(mesh, np.stack([np.cos(phase), 2 * np.sin(phase)], axis=2), 3.0, 0.5)


def test_a_cycle_is_its_function_with_its_slopes_and_amplitudes() -> None:
    cycle = circle(20)
    s = np.linspace(0, 1, 57)
    truth = np.stack([np.cos(TURN * s), 2 * np.sin(TURN * s)], axis=1)
    np.testing.assert_allclose(cycle.at(s), truth, atol=1e-6)
    np.testing.assert_allclose(cycle.on(circle(33).mesh).values, circle(33).values, atol=1e-6)
    phase = TURN * cycle.scheme.places(cycle.mesh)[:, 1:]
    np.testing.assert_allclose(cycle.slopes, TURN * np.stack([-np.sin(phase), 2 * np.cos(phase)], 2), atol=1e-3)
    assert cycle.amplitudes == pytest.approx([2.0, 4.0], rel=1e-2)
    moved = cycle.moved(cycle.times(2.0), 0.25)
    np.testing.assert_allclose(moved.values, 1.5 * cycle.values)
    assert (moved.period, moved.parameter) == (4.5, 0.75)
    assert cycle.moved(cycle).period == 6.0


@pytest.mark.parametrize("stages", [2, 3, 4])
def test_the_estimated_error_is_the_leading_term_and_falls_with_its_order(stages: int) -> None:
    # The largest (m + 1)-th derivative of the second state over its amplitude 4 is (2 pi)^(m + 1)/2.
    scales = np.array([2.0, 4.0])
    coarse, fine = (interval_errors(circle(n, stages=stages), scales).max() for n in (30, 60))
    expected = gauss(stages).constant * (TURN / 60) ** (stages + 1) / 2
    assert fine == pytest.approx(expected, rel=0.1)
    assert coarse / fine == pytest.approx(2.0 ** (stages + 1), rel=0.1)
    assert interval_errors(circle(60, stages=stages), scales / 10).max() == pytest.approx(10 * fine)


def test_a_mesh_has_as_many_intervals_as_the_tolerance_takes_and_spreads_them_evenly() -> None:
    scales, tolerance = np.array([2.0, 4.0]), 1e-8
    uneven = circle(60, widths=np.linspace(1.0, 3.0, 60))
    mesh = adapted(uneven, scales, tolerance, most=1000)
    # A circle is the same everywhere, but for the two states' turns.
    assert np.diff(mesh).max() / np.diff(mesh).min() < 1.3
    assert (interval_errors(uneven.on(mesh), scales) <= tolerance).all()
    assert (interval_errors(uneven.on(mesh), scales) >= tolerance / MARGIN**10).all()
    assert len(adapted(uneven, scales, tolerance, most=20)) == 21
    assert len(adapted(uneven, scales, 1.0, most=1000)) == FEWEST + 1
    dense = adapted(uneven, scales, 1.0, most=1000, least=np.full(60, 199.5))
    assert len(dense) == 201
    # Neighbours are averaged with the weights 1/4, 1/2, 1/4, which add up to 1.
    even = circle(50)
    wanted = MARGIN * (interval_errors(even, scales) / tolerance) ** (1 / 5) * 50 * even.widths
    assert len(adapted(even, scales, tolerance, most=1000)) - 1 == pytest.approx(wanted.sum(), abs=1)
    broken = Cycle(even.mesh, np.where(even.values > 0.99, np.inf, even.values), 1.0)
    assert adapted(broken, scales, tolerance, most=1000) is broken.mesh


def test_growth_and_decay_are_resolved_whichever_is_less() -> None:
    cycle = circle(4, stages=2)

    def density(rates: list[float]) -> np.ndarray:
        matrices = np.broadcast_to(np.diag(rates), (4, 2, 2, 2))
        return growth_density(SimpleNamespace(jacobians=lambda _: matrices), cycle)  # pyright: ignore[reportArgumentType]

    assert density([1.0, -5.0]) == pytest.approx(3.0 / GROWTH)
    assert density([5.0, -1.0]) == pytest.approx(3.0 / GROWTH)
    assert density([2.0, -2.0]) == pytest.approx(6.0 / GROWTH)
    assert density([-1.0, -2.0]) == pytest.approx(0.0)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 8])
def test_multipliers_are_the_eigenvalues_of_the_product_in_any_units(count: int) -> None:
    rng = np.random.default_rng(count)
    parts = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0] * rng.uniform(0.3, 3.0, (count, 1, 1))
    product = np.linalg.multi_dot([*parts[::-1], np.eye(3)]) if count > 1 else parts[0]
    # The last one closes them to a product with the multipliers 1, 0.5 and -3.
    basis = rng.normal(size=(3, 3))
    closing = basis @ np.diag([0.5, 1.0, -3.0]) @ np.linalg.inv(basis) @ np.linalg.inv(product)
    transfers = np.concatenate([parts, closing[None]])
    for scales in (np.ones(3), np.array([1.0, 10.0, 0.1])):
        assert multipliers(transfers, 0.0, scales) == pytest.approx([1.0, -3.0, 0.5], rel=1e-6)
    B, C = joined(transfers)
    assert np.linalg.solve(C, B) == pytest.approx(closing @ product, rel=1e-6, abs=1e-8)


def test_in_the_plane_the_divergence_gives_the_other_multiplier() -> None:
    transfers = np.diag([1.0, 0.3])[None]
    assert multipliers(transfers, np.log(0.25), np.ones(2)) == pytest.approx([1.0, 0.25])
    assert multipliers(transfers, 1e4, np.ones(2))[1].real == np.inf


def test_a_cycle_among_cycles_is_not_isolated_and_one_that_attracts_is() -> None:
    rates = np.array([[2.0, 0.0], [1.0, 0.0]])
    family = np.broadcast_to(np.eye(2), (2, 2, 2))
    assert isolation(family, rates, np.ones(2)) == pytest.approx(0.0, abs=1e-15)
    found = [
        isolation(np.stack([np.eye(2), np.diag([1.0, mu])]), rates, np.ones(2)) for mu in (0.99, 0.5, 0.0, 1e9)
    ]
    # Across the flow M dz = dz is off by mu - 1, in rows of the length of (1, mu); along it by the change of period.
    expected = [min(abs(mu - 1) / np.hypot(1, mu), np.sqrt(0.5)) for mu in (0.99, 0.5, 0.0, 1e9)]
    assert found == pytest.approx(expected, rel=1e-6)
    # A shear along the flow changes the period with the amplitude: neighbours there are all the same.
    shear = np.stack([np.eye(2), np.array([[1.0, 4.0], [0.0, 1.0]])])
    assert isolation(shear, rates, np.ones(2)) == pytest.approx(0.0, abs=1e-12)


def test_an_explosion_is_a_stretch_that_is_steep_and_long_and_grows_enough() -> None:
    def rows(steep: int, slope: float, grown: float) -> tuple[np.ndarray, np.ndarray]:
        """The amplitude rises to 1 - grown with the parameter, then by `grown` in `steep` steps at `slope`."""
        amplitudes = np.append(
            np.linspace(0.1, 1.0 - grown, 6), 1.0 - grown + grown * np.arange(1, steep + 1) / steep
        )
        values = np.append(np.linspace(0.0, 1.0, 6), 1.0 + slope * grown * np.arange(1, steep + 1) / steep)
        return values / np.ptp(values), amplitudes[None]

    (found,) = explosions(*rows(ROWS - 1, 0.9 * STEEP, 1.1 * GROWN))
    assert (found.first, found.last) == (5, 5 + ROWS - 1)
    assert found.rows == slice(5, 5 + ROWS)
    assert found.width == pytest.approx(0.9 * STEEP * 1.1 * GROWN, rel=0.01)
    assert explosions(*rows(ROWS - 2, 0.9 * STEEP, 1.1 * GROWN)) == ()
    assert explosions(*rows(ROWS - 1, 1.1 * STEEP, 1.1 * GROWN)) == ()
    assert explosions(*rows(ROWS - 1, 0.9 * STEEP, 0.9 * GROWN)) == ()
    assert explosions(np.zeros(3), np.ones((1, 3))) == ()


# -- what is read off the polynomials --------------------------------------------------------------


def humped(place: int, top: float, at: float, half: float, flat: dict[int, float]) -> PeriodicOrbit:
    """One state on five intervals: `top` - ((u - `at`)/`half`)^2 on one, u from 0 to 1 there, and constants.

    The others are -1e6, but for those in `flat`.
    """
    scheme, mesh = gauss(2), np.linspace(0.0, 1.0, 6)
    values = np.full((5, 3, 1), -1e6)
    values[place, :, 0] = top - ((scheme.x - at) / half) ** 2
    for j, level in flat.items():
        values[j] = level
    x = sp.Symbol("x")
    return PeriodicOrbit(
        flow=gsp.VectorField({x: -x}, epsilon=None),
        epsilon=None,
        parameters={},
        period=1.0,
        multipliers=np.array([1.0]),
        divergence=0.0,
        error=0.0,
        period_error=0.0,
        residual=0.0,
        status=Status.SUCCESS,
        stats=OrbitStats(0, 0, 5),
        _cycle=Cycle(mesh, values, 1.0),
        _constants=np.array([np.nan]),
    )


@pytest.mark.parametrize("share", [0.25, 0.5, 0.75])
def test_a_hump_between_two_places_of_a_mesh_is_crossed_twice(share: float) -> None:
    # It is above the level over 0.22 of the way from one Gauss point to the next: four samples a gap see it.
    first, second = gauss(2).x[1:]
    at, half = first + share * (second - first), 0.11 * (second - first)
    orbit = humped(2, 1.0, at, half, {})
    np.testing.assert_allclose(orbit.crossings("x"), (2 + at + np.array([-half, half])) / 5, rtol=1e-12)


@pytest.mark.parametrize("highest", [0, 2, 4])
@pytest.mark.parametrize("side", [-1, 1])
def test_an_extreme_beside_the_interval_of_the_largest_sample_is_found(highest: int, side: int) -> None:
    # Between samples the neighbour reaches 1.25, at its samples it is under the 1 of the interval `highest`.
    orbit = humped((highest + side) % 5, 1.25, 7 / 16, 1 / 16, {highest: 1.0})
    assert orbit.maximum["x"] == pytest.approx(1.25, rel=1e-9)
    below = replace(orbit, _cycle=orbit._cycle.times(-1.0))
    assert below.minimum["x"] == pytest.approx(-1.25, rel=1e-9)
