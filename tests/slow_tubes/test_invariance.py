"""The flow about a series: what it leaves over is 0 where the series is right, and wrong where that is proved."""

from dataclasses import replace

import pytest
import sympy as sp
from sympy import Rational as R

from gsp.critical.critical_manifold import solve_critical
from gsp.proofs.verdict import ProofVerdict
from gsp.slow.series import SeriesManifold, expand
from gsp.slow_tubes.certify import certify
from gsp.slow_tubes.invariance import Invariance
from gsp.slow_tubes.reduction_error import bound_reduction
from gsp.systems.system import SlowFastSystem

epsilon, x, z, y = sp.symbols("epsilon x z y")


def series(slow: dict[sp.Symbol, sp.Expr], fast: dict[sp.Symbol, sp.Expr]) -> SeriesManifold:
    system = SlowFastSystem(slow=slow, fast=fast, epsilon=epsilon)
    return expand(solve_critical(system).branches[0], order=1)


# y = b/a of epsilon y' = b - a y, written in exponentials of one argument.
SHARED = {
    "a multiple": (sp.exp(2 * x), sp.exp(x)),
    "two": (sp.exp(2 * x), sp.exp(x) + sp.exp(-x)),
    "a fraction": (sp.exp(x / 2), 1 + sp.exp(3 * x)),
    "a negative one": (1 + sp.exp(-2 * x), sp.exp(4 * x)),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", SHARED)
def test_exponentials_of_one_argument_are_powers_of_one(name: str) -> None:
    a, b = SHARED[name]
    manifold = series({x: -x}, {y: b - a * y})
    tube = certify(manifold, region={"x": (0, 1)}, epsilon=0.05)
    assert tube.verdict is ProofVerdict.PROVED
    # The first term left out: h_2 = (x h_1)'/a with h_1 = x (b/a)'/a and ' the derivative.
    h = b / a
    for _ in range(2):
        h = sp.simplify(x * sp.diff(h, x) / a)
    largest = max(abs(float(h.subs(x, R(k, 64)))) for k in range(65))
    assert largest * 0.05**2 * 0.8 <= tube.delta <= largest * 0.05**2 * 1.3
    bound = bound_reduction(manifold, start={"x": 1.0}, span=(0.0, 1.0), epsilon=0.05)
    assert bound.verdict is ProofVerdict.PROVED


# h_0 is the root of degree 6 to the power of 7, which no algebra of square and cube roots sees.
UNSEEN = (1 + x) ** R(3, 2) - y * (1 + x) ** R(1, 3)


def test_a_right_series_that_is_not_seen_to_be_right_is_not_called_wrong() -> None:
    manifold = series({x: -x}, {y: UNSEEN})
    tube = certify(manifold, region={"x": (0, 1)}, epsilon=0.05)
    bound = bound_reduction(manifold, start={"x": 1.0}, span=(0.0, 1.0), epsilon=0.05)
    for found in (tube, bound):
        assert found.verdict is ProofVerdict.UNDECIDED
        assert "epsilon^0 is left over that may be 0" in found.reason
    assert not tube.is_isolating
    assert not len(bound.times)
    assert "may be 0" in str(bound)


@pytest.mark.parametrize("fast", [UNSEEN, sp.exp(x) - 2 * y, x - 3 * y])
@pytest.mark.parametrize(("k", "sign"), [(0, 1), (0, -1), (1, 1)])
def test_a_wrong_series_is_called_wrong_with_functions_and_without(fast: sp.Expr, k: int, sign: int) -> None:
    right = series({x: -x}, {y: fast})
    ring = right.chart.ring
    wrong = [
        [e + ring.constant(R(sign, 10**9)) if i == k else e for i, e in enumerate(row)] for row in right._h
    ]
    manifold = replace(right, _h=wrong)
    tube = certify(manifold, region={"x": (0, 1)}, epsilon=0.05)
    bound = bound_reduction(manifold, start={"x": 1.0}, span=(0.0, 1.0), epsilon=0.05)
    # Of the unseen one the term in epsilon^0 comes first, and is 0 where only h_1 is wrong.
    hidden = fast is UNSEEN and k == 1
    for found in (tube, bound):
        assert found.verdict is (ProofVerdict.UNDECIDED if hidden else ProofVerdict.REFUTED)
        assert f"epsilon^{0 if hidden else k}" in found.reason


def test_the_flow_is_the_one_of_the_system() -> None:
    # x' = y - x, epsilon y' = x^2 - y (1 + x): with y = h_0 + epsilon h_1 + epsilon^2 z, in exact numbers.
    manifold = series({x: y - x}, {y: x**2 - y * (1 + x)})
    invariance = Invariance(manifold, values={})
    (gamma,), ((h_0,), (h_1,)) = invariance.gamma, manifold.coefficients
    (w,) = invariance.z
    graph = h_0 + epsilon * h_1 + epsilon**2 * w
    rate = (y - x).subs(y, graph)
    left = (x**2 - y * (1 + x)).subs(y, graph) - epsilon * sp.diff(graph, x) * rate
    at = {x: R(2, 7), w: R(3, 5), epsilon: R(1, 11)}
    assert (left / epsilon**2 - gamma).subs(at) == 0
    assert Invariance(series({x: -x}, {y: x - y + epsilon * x}), values={}).order == 1
