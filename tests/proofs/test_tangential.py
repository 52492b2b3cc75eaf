"""The rate along the slow flow: a bound over all of the region, of the Jacobian on the branch."""

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.proofs import balls, tangential
from gsp.proofs.tangential import narrowed
from gsp.proofs.verdict import ProofVerdict
from gsp.slow_tubes.certify import certify
from gsp.systems.system import SlowFastSystem

x, y, epsilon = sp.symbols("x y epsilon")


def certified(f: sp.Expr, g: sp.Expr, small: float):
    system = SlowFastSystem(slow={x: f}, fast={y: g}, epsilon=epsilon)
    return certify(solve_critical(system).branches[0], region={"x": (0, 2)}, epsilon=small)


@pytest.mark.parametrize(
    ("f", "g", "rate"),
    [(x + y, 3 * x - y, 4.0), (x + y, -3 * x - y, 2.0), (-(x**3), x - y, 12.0), (-2 * x, x - y, 2.0)],
)
def test_the_rate_is_that_of_the_flow_on_the_branch(f: sp.Expr, g: sp.Expr, rate: float) -> None:
    assert rate <= certified(f, g, 0.001).tangential <= rate * 1.05


@pytest.mark.parametrize(("small", "said"), [(0.99, ProofVerdict.PROVED), (1.05, ProofVerdict.UNDECIDED)])
def test_the_condition_on_the_rates_is_at_least_one(small: float, said: ProofVerdict) -> None:
    found = certified(-x, -y, small)
    assert found.verdict is said
    assert found.rate_ratio == pytest.approx(1 / small, rel=1e-9)


def test_the_rate_is_bounded_in_tubes_that_are_as_narrow_as_their_parts() -> None:
    """Over one box y = tanh(10 t) lies in a tube of 18: y/(1 + y^2) has a slope of at most 1 along the branch."""
    t, x, y, eps = sp.symbols("t x y epsilon")
    system = SlowFastSystem(
        slow={t: sp.Integer(1), x: -x + y / (1 + y**2)}, fast={y: -y + sp.tanh(10 * (t - 1))}, epsilon=eps
    )
    (branch,) = solve_critical(system).branches
    found = certify(branch, region={"t": (0, 2), "x": (-1, 1)}, epsilon=0.02)
    assert found.verdict is ProofVerdict.PROVED
    assert len(found.boxes) == 1
    # x' = -x + ... has the rate 1, in units in which what t drives is as small as is liked.
    assert 1 <= found.tangential <= 50
    tube = found._covering.pieces[0].tube
    part = ((0.9, 0.95), (0.0, 0.5))
    own = narrowed(found._equations, tube, part)
    assert own.radius[0] < 0.1 * tube.radius[0]
    for place in (0.9, 0.92, 0.95):
        (value,) = own.over([balls.exact(place), balls.exact(0.25)])
        assert abs(float(value.mid()) - np.tanh(10 * (place - 1))) <= float(value.rad())


def test_a_part_over_which_no_tube_is_found_keeps_that_of_the_whole(monkeypatch) -> None:
    t, y, eps = sp.symbols("t y epsilon")
    (branch,) = solve_critical(SlowFastSystem(slow={t: sp.Integer(1)}, fast={y: t - y}, epsilon=eps)).branches
    found = certify(branch, region={"t": (0, 1)})
    tube = found._covering.pieces[0].tube
    monkeypatch.setattr(tangential, "enclose", lambda *given: None)
    assert narrowed(found._equations, tube, ((0.2, 0.3),)) is tube
