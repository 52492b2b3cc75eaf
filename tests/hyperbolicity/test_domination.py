"""Where the normal rate does not dominate: the place, the direction, and the part where it does."""

import pytest
import sympy as sp

from gsp import SlowFastSystem, classify, solve_critical
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity
from tests.cases import sampled

x, u, y, epsilon = sp.symbols("x u y epsilon")


def judge(slow: dict, region: dict, small: float) -> Hyperbolicity:
    (branch,) = solve_critical(SlowFastSystem(slow=slow, fast={y: x - y}, epsilon=epsilon)).branches
    return classify(branch, region=region, epsilon=small)


@pytest.mark.parametrize("unit", sampled([1, 10**6, sp.Rational(1, 10**6)], always=[10**6]))
def test_the_worst_place_its_direction_and_the_part_where_it_holds_are_told(unit) -> None:
    """u' = -u^3/3 has the rate u^2, at most 16 of the allowed 4; x only turns round."""
    slow = {x: -x / 10, u: -(u**3) / (3 * unit**2)}
    found = judge(slow, {"x": (-1, 1), "u": (0, 4 * unit)}, 0.25)
    short = found.shortfall
    assert short is not None
    assert not found.holds
    assert (short.rate, short.allowed) == (pytest.approx(-16), pytest.approx(4))
    assert short.point["u"] == pytest.approx(4 * unit)
    assert short.direction == pytest.approx({"x": 0.0, "u": 1.0})
    assert "falls short: neighbours on the branch approach at a rate of up to 16, where 4 is allowed" in str(
        found
    )
    part = found.sub_region
    assert part is not None
    low, high = (side / unit for side in part.interval)
    assert (part.axis, low) == ("u", 0)
    # Up to 2, short of it by one sample of 33 at most.
    assert 2 - 4 / 32 <= high <= 2


@pytest.mark.exhaustive
def test_where_it_holds_nothing_falls_short() -> None:
    slow = {x: u, u: -x}
    region = {"x": (-1, 1), "u": (-1, 1)}
    assert judge(slow, region, 0.5).shortfall is None
    assert judge(slow, region, 0.5).holds
    # Nowhere is the rate of 10 x allowed: there is no part.
    everywhere = judge({x: -10 * x, u: -u}, region, 0.5)
    assert everywhere.shortfall is not None
    assert everywhere.sub_region is None
