"""Poles of the slow field that stand over fast variables of an implicit sheet, and a pair that the slow flow is tangent
to.
"""

import pytest
import sympy as sp

import gsp
from gsp.critical.loss_kind import LossKind

x, y, u, v, eps = sp.symbols("x y u v epsilon")


@pytest.mark.exhaustive
@pytest.mark.parametrize("size", [1, 1000, 10**6])
@pytest.mark.parametrize("power", [1, 2])
def test_a_pole_over_a_fast_variable_is_met_where_the_sheet_comes_to_it(size: int, power: int) -> None:
    """The sheet x = y + y^5/5 - 1 comes to y = 0.42, whatever the divisor is multiplied by."""
    at = sp.Rational(42, 100)
    slow = 1 / (size * (y**power - at**power))
    system = gsp.SlowFastSystem(slow={x: slow}, fast={y: x - y - y**5 / 5 + 1}, epsilon=eps)
    sheet = gsp.solve_critical(system).branches[0].through({"x": 0, "y": 0.9})
    found = gsp.classify(sheet, region={"x": (-0.9, 0.5)})
    (loss,) = found.losses
    assert loss.kind is LossKind.FIELD_POLE
    assert dict(loss.point) == pytest.approx({"x": float(at + at**5 / 5 - 1), "y": float(at)}, rel=1e-9)


def test_a_pair_to_which_the_slow_flow_is_tangent_does_not_cross() -> None:
    """x' = x rests where the pair is on the axis."""
    system = gsp.SlowFastSystem(slow={x: x}, fast={u: x * u + v, v: -u + x * v}, epsilon=eps)
    (loss,) = gsp.classify(gsp.solve_critical(system).branches[0], region={"x": (-1, 1)}).losses
    assert (loss.kind, loss.coefficients["crossing"]) == (LossKind.HOPF, 0.0)
    assert "tangent to the place, or vanishes there" in str(loss)
