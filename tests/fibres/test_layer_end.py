"""Where layers end: at the equilibrium that attracts the start, whatever the units, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.fibres.layer_end import attractor_at, end_of_layer
from gsp.fibres.layer_flow import LayerFlow
from gsp.systems.system import SlowFastSystem

x, y, z, eps = sp.symbols("x y z epsilon")
BISTABLE = {y: y - y**3, z: 5 * y - z}


def layer(rates: dict, start: tuple[float, ...]) -> LayerFlow:
    system = SlowFastSystem(slow={x: -x}, fast={s: rate + 0 * x for s, rate in rates.items()}, epsilon=eps)
    return LayerFlow.within(system, np.array([0.5]), np.array(start))


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ((0.01, -4.0), (1.0, 5.0)),
        ((-0.01, 4.0), (-1.0, -5.0)),
        ((1.0, 5.0), (1.0, 5.0)),
        ((30.0, 0.0), (1.0, 5.0)),
    ],
)
@pytest.mark.parametrize("unit", [1, 10**6, sp.Rational(1, 10**6)])
def test_a_start_is_led_to_its_own_attractor_in_any_units(start, end, unit) -> None:
    rates = {
        s: (rate * unit).subs({y: y / unit, z: z / unit}, simultaneous=True) for s, rate in BISTABLE.items()
    }
    size = float(unit)
    from_here = tuple(value * size for value in start)
    found = end_of_layer(layer(rates, from_here), np.array(from_here))
    assert found is not None
    assert found / size == pytest.approx(end, rel=1e-12)


def test_slow_layers_are_followed_to_their_end() -> None:
    """The slower of two rates is a thousandth of the faster one, by which the first look is measured."""
    found = end_of_layer(layer({y: 1 - y, z: (y - z) / 1000}, (0.0, 5.0)), np.array([0.0, 5.0]))
    assert found == pytest.approx([1.0, 1.0], rel=1e-12)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("rates", "start"),
    [
        ({y: y**2 + 1}, (0.0,)),
        ({y: y}, (1.0,)),
        # A limit cycle, about an equilibrium that repels.
        ({y: y * (1 - y**2 - z**2) - z, z: z * (1 - y**2 - z**2) + y}, (0.5, 0.0)),
        # A line of equilibria attracts as a whole, and no point of it does.
        ({y: -y, z: y}, (1.0, 1.0)),
        # A centre.
        ({y: z, z: -y}, (1.0, 0.0)),
    ],
)
def test_what_settles_on_no_attracting_equilibrium_has_no_end(rates, start) -> None:
    assert end_of_layer(layer(rates, start), np.array(start)) is None


def test_an_attractor_is_near_and_attracts() -> None:
    flow = layer(BISTABLE, (1.0, 1.0))
    point = np.array([1.0, 5.0])
    assert attractor_at(flow, (point + 1e-6) / flow.units) * flow.units == pytest.approx(point, rel=1e-13)
    # The saddle, and a place from which Newton's method comes to an attractor that is far away.
    assert attractor_at(flow, np.zeros(2)) is None
    assert attractor_at(flow, np.array([2.0, 10.0]) / flow.units) is None
    # At its end a rate may have no derivative.
    assert attractor_at(layer({y: -sp.sqrt(y), z: -z}, (1.0, 1.0)), np.zeros(2)) is None
