"""The search for a tube: what it hands on was proved over all of the region and for all of epsilon."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import sympy as sp
from flint import arb
from sympy import Rational as R

from gsp.algebra.precision import precision
from gsp.proofs import balls
from gsp.proofs.tubes import Box
from gsp.proofs.verdict import ProofVerdict
from gsp.slow_tubes.adapted_basis import AdaptedBasis
from gsp.slow_tubes.certify import certify
from gsp.slow_tubes.invariance import Invariance
from gsp.slow_tubes.isolation import Tally
from gsp.slow_tubes.tube_search import TubeSearch, supremum
from tests.slow_tubes.test_slow_tube import epsilon, series, x, y

v, z = sp.symbols("v z")


@pytest.fixture(autouse=True)
def in_balls():
    with precision(balls.PRECISION):
        yield


def search(slow: dict, fast: dict, *, order: int = 0, region: Box = ((-1.0, 1.0),)) -> TubeSearch:
    """Tubes about the series of a system in which every fast direction is stable and a block of its own."""
    m = len(fast)
    basis = AdaptedBasis(sp.eye(m), tuple((i,) for i in range(m)), (-1,) * m)
    return TubeSearch(Invariance(series(slow, fast, order), values={}), basis, region, Tally(20_000))


# -- what was proved of less is not taken for more -------------------------------------------------


def test_a_tube_that_isolates_for_some_epsilon_is_asked_again_for_larger_ones() -> None:
    # epsilon z' = -(1 - 2 epsilon) z - 2 x + 1: |z| <= 7/2 is crossed while epsilon < 2/7.
    problem = search({x: sp.Integer(1)}, {y: -(1 - 2 * epsilon) * y - x}, region=((-0.25, 0.25),))
    widths = np.array([3.5])
    for low, high, said in ((0.0, 0.125, True), (0.0, 0.0625, True), (0.125, 0.25, True), (0.25, 0.5, False)):
        assert problem._isolates(problem.over(low, high), widths) is said
    assert problem._isolates(problem.over(0.0, 0.25), widths)
    assert not problem._isolates(problem.over(0.0, 0.5), widths)
    assert not problem._isolates(problem.over(0.0, 0.125), 0.25 * widths)


@pytest.mark.exhaustive
@pytest.mark.parametrize("shares", [(4.0, 0.5), (0.5, 4.0)])
def test_cones_of_a_tube_are_those_of_a_narrower_one_only(shares: tuple[float, float]) -> None:
    problem = search({x: -x}, {y: -y + x, z: -z + x})
    found = problem.least(0.0625)
    assert found is not None
    assert found.cones
    wider = replace(found, widths=2.0 * found.widths)
    inside = problem.least(0.0625, wider)
    assert inside is not None
    assert inside.cones is wider.cones
    assert (inside.widths <= wider.widths).all()
    across = replace(found, widths=found.widths * shares)
    other = problem.least(0.0625, across)
    assert other is not None
    assert other.cones is not across.cones or (other.widths <= across.widths).all()


@pytest.mark.exhaustive
def test_cones_that_fail_between_samples_do_not_hold() -> None:
    # Within 1/1000 of one place neighbours approach at the rate 100 along the slow flow, and 1/epsilon is 10.
    place, width = R(3086, 10_000), R(1, 1000)
    off = x - place
    problem = search({x: 1 - 100 * width**2 * off / (width**2 + off**2)}, {y: -y})
    part = problem.over(0.0, 0.1)
    assert not problem._hold(part, np.array([1e-6]), 1.0, 0.0)
    smooth = search({x: sp.Integer(1)}, {y: -y})
    assert smooth._hold(smooth.over(0.0, 0.1), np.array([1e-6]), 1.0, 0.0)


# -- the collar ------------------------------------------------------------------------------------


def test_a_collar_is_cut_off_the_shortest_side() -> None:
    # In the time of the fast rate the flow goes 0.1, five times as far as the side of v is long.
    manifold = series({x: sp.Integer(1), v: -v}, {y: -y + x}, 1)
    tube = certify(manifold, region={"x": (-1, 1), "v": (-0.01, 0.01)}, epsilon=0.1)
    assert tube.verdict is ProofVerdict.UNDECIDED
    assert "leaves something of the region" in tube.reason


def test_a_collar_is_as_wide_as_every_step_needs() -> None:
    # |f| is 1 at the sides, so that c w >= 1 in each step.
    tube = certify(series({x: -x}, {y: -y + x**2}, 1), region={"x": (-1, 1)})
    assert tube._proof is not None
    cones = tube._proof.cones
    assert len(cones) > 1
    assert all(Fraction(tube.collar) * Fraction(cone.collar) >= 1 for cone in cones)
    assert min(cone.collar for cone in cones) * tube.collar <= 1.1
    # A first step whose collar is narrow already does not make that of the others narrower.
    problem = search({x: -x}, {y: -y + x**2})
    found = problem.least(0.1)
    assert found is not None
    (cone,) = found.cones
    steps = (replace(cone, high=0.01, collar=8.0 * cone.collar), replace(cone, low=0.01))
    narrow = problem.narrowed(replace(found, cones=steps))
    assert all(Fraction(narrow.collar) * Fraction(cone.collar) >= 1 for cone in narrow.cones)


# -- bounds ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-0.25, 0.875)])
def test_a_supremum_is_a_bound_and_near(low: float, high: float) -> None:
    # x (1 - x)^2 is 4/27 at 1/3, which no halving comes to.
    found = supremum(lambda x: x[0] * (1 - x[0]) ** 2, ((low, high),))
    largest = max(R(4, 27), abs(R(low) * (1 - R(low)) ** 2))
    assert largest <= R(found) <= largest * (1 + R(6, 1000))


def test_a_supremum_that_is_not_finite_is_no_number() -> None:
    assert supremum(lambda x: 1 / x[0], ((-1.0, 1.0),)) == np.inf
    assert supremum(lambda x: arb(0), ((-1.0, 1.0),)) == 0.0


@pytest.mark.parametrize("small", [0.1, 0.07, 0.05, 0.03, 0.02])
def test_bounds_of_the_tube_are_rounded_up(small: float) -> None:
    manifold = series({x: -x}, {y: -3 * y + z / 2 + x, z: y - 2 * z + x**2}, 1)
    tube = certify(manifold, region={"x": (R(1, 10), R(1, 3))}, epsilon=small)
    assert tube._proof is not None
    low, high = map(Fraction, tube.region["x"])
    assert low <= Fraction(1, 10)
    assert high >= Fraction(1, 3)
    basis, widths = tube._proof.basis, [Fraction(float(w)) for w in tube._proof.widths]
    P = [[abs(Fraction(int(e.p), int(e.q))) for e in row] for row in basis.matrix.tolist()]
    assert all(len(block) == 1 for block in basis.blocks)
    power = Fraction(tube.epsilon_0) ** 2
    reach = [sum(e * w for e, w in zip(row, widths)) * power for row in P]
    assert all(Fraction(tube.widths[name]) >= size for name, size in zip("yz", reach))
    assert Fraction(tube.delta) ** 2 >= sum(size**2 for size in reach)
    assert tube.delta <= 1.02 * float(sum(size**2 for size in reach)) ** 0.5
