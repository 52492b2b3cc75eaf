"""What looks like a relaxation cycle and is none, or is not known to be one: never proved, and saying why."""

from __future__ import annotations

import pytest
import sympy as sp

import gsp
from tests.cycles.systems import R, orbit_of, system, x, y

CUBIC = y - x**3 / 3 + x
# The slow rate, and what the reason says.
NEVER = {
    "a saddle on the sheet that is followed": (-(x - R(3, 2)) * (x + 3), "does not close"),
    "a slow rate that touches zero on the sheet": (-x * (x - R(3, 2)) ** 2, "does not close"),
    "an equilibrium at a fold": (1 - x, "canard"),
    "equilibria at both folds": (1 - x**2, "canard"),
    "a pole that the jump crosses": (-x - 1 / (1000 * (x + R(3, 10))), "not proved to cross"),
}


@pytest.mark.parametrize("name", NEVER)
def test_what_is_no_relaxation_cycle_is_undecided(name: str) -> None:
    slow, why = NEVER[name]
    found = gsp.certify(orbit_of(system(slow, CUBIC), 2, 0.6), epsilon=1e-3)
    assert found.verdict is gsp.ProofVerdict.UNDECIDED
    assert why in found.reason
    assert found.epsilon_0 == found.epsilon_1 == 0.0


def test_a_pole_on_the_repelling_sheet_is_undecided_without_a_long_search() -> None:
    """What the orbit lands on is no invariant sheet: no delay is looked for along it."""
    found = gsp.certify(orbit_of(system(-x, CUBIC + 1 / (10**6 * (x - R(1, 4)))), 2, 0.6))
    assert found.verdict is gsp.ProofVerdict.UNDECIDED
    assert "does not close" in found.reason


@pytest.mark.exhaustive
def test_a_slow_rate_that_nearly_touches_zero_is_no_obstacle() -> None:
    """x' is at most -1.5e-4 there: a cycle all the same, and a period that allows for the time it takes."""
    slow = -x * ((x - R(3, 2)) ** 2 + R(1, 10_000))
    found = gsp.certify(orbit_of(system(slow, CUBIC), 2, 0.6), epsilon=1e-3).existence
    assert found is not None
    # Over the right sheet and the left one, of (x^2 - 1)/(-f) from the landing points to the folds.
    times = [float(sp.Integral((x**2 - 1) / -slow, (x, *ends)).evalf()) for ends in ((1, 2), (-1, -2))]
    assert found.turn.period[0] < times[0] + times[1] < found.turn.period[1]
