"""Phi, the integral of the eigenvalue along an orbit, against its closed form: up to where it leaves and beyond."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.singular.passage.entry_exit import entry_exit
from gsp.systems.system import SlowFastSystem

x, y, epsilon = sp.symbols("x y epsilon")


@pytest.mark.parametrize(
    ("rate", "integral"),
    [
        (y + y**2, lambda y: y**2 / 2 + y**3 / 3),
        # In panels, several of them beyond the exit.
        (
            y * (2 + sp.cos(40 * y)),
            lambda y: y**2 + y * np.sin(40 * y) / 40 + np.cos(40 * y) / 1600,
        ),
    ],
)
def test_phi_is_its_closed_form_also_beyond_the_exit(rate: sp.Expr, integral) -> None:
    """y' = 1 from -1/2: charts show Phi beyond the exit, and how far rounding carries an orbit is read off it."""
    (branch,) = solve_critical(SlowFastSystem(slow={y: 1}, fast={x: rate * x}, epsilon=epsilon)).branches
    found = entry_exit(branch, start={"y": -0.5})
    place = found.times - 0.5
    assert (found.times > found.t).sum() > 5
    assert found.phi == pytest.approx(integral(place) - integral(-0.5), abs=1e-11)
