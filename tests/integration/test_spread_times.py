"""Times spread over a run: even ones, and where its states move."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.integration.spread_times import spread_times
from gsp.integration.trajectory import integrate
from gsp.systems.system import VectorField

x, y = sp.symbols("x y")


@pytest.mark.parametrize("unit", [1, 10**9])
def test_what_passes_early_has_its_share_of_times_in_any_unit(unit: int) -> None:
    field = VectorField(states={x: -1000 * x, y: -y / 1000}, epsilon=None)
    run = integrate(field, start={"x": 1, "y": unit}, span=(0, 1000), rtol=1e-6, atol=1e-9)
    times = spread_times(run, 0.0, 1000.0, 50)
    assert (np.diff(times) > 0.0).all()
    assert set(np.linspace(0.0, 1000.0, 50)) <= set(times)
    assert 20 < (times < 0.02).sum() < 50
    assert 40 < (times > 1.0).sum() < 90


def test_a_run_at_rest_and_a_part_of_a_run_have_times_too() -> None:
    rest = integrate(VectorField(states={x: -x}, epsilon=None), start={"x": 0}, span=(0, 1))
    assert spread_times(rest, 0.0, 1.0, 5).tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    run = integrate(VectorField(states={x: -x}, epsilon=None), start={"x": 1}, span=(0, 10))
    part = spread_times(run, 2.0, 3.0, 5)
    assert part.min() == 2.0
    assert part.max() == 3.0
