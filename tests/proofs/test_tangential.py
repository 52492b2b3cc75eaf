"""The rate along the slow flow: a bound over all of the region, of the Jacobian on the branch."""

import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
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
