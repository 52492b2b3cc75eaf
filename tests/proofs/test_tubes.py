"""Tubes and what is read off them: of linear equations they are as narrow as rounding lets them be."""

import math
from fractions import Fraction

import numpy as np
import pytest
import sympy as sp
from flint import arb

from gsp.proofs import tangential
from gsp.proofs.anchors import ball_at
from gsp.proofs.covering import CoveredPart
from gsp.proofs.equations import EnclosedEquations
from gsp.proofs.programs import Rejected
from gsp.proofs.rational_functions import MOST_BITS, _power
from gsp.proofs.spectrum import spectrum_of
from gsp.proofs.tangential import tangential_rate
from gsp.proofs.tubes import RootTube, krawczyk

x, u, y, z = sp.symbols("x u y z")
# 2 y + z = x + u and y - 3 z = 4 x + 2 u: (y, z) = (x + 5 u/7, -x - 3 u/7).
LINEAR = EnclosedEquations([x, u], [y, z], [x + u - 2 * y - z, 4 * x + 2 * u - y + 3 * z])
SLOPES = np.array([[1.0, 5 / 7], [-1.0, -3 / 7]])
BOX = ((0.0, 1.0), (1.0, 3.0))


def linear_tube() -> RootTube:
    middle = np.array([0.5, 2.0])
    tube = krawczyk(LINEAR, BOX, middle, SLOPES @ middle, SLOPES)
    assert tube is not None
    return tube


def test_a_tube_about_a_plane_is_a_hardly_thicker_plane() -> None:
    tube = linear_tube()
    assert (tube.radius < 1e-6).all()
    for at in ([0.0, 1.0], [0.25, 3.0], [1.0, 2.0]):
        place = [arb(v) for v in at]
        assert tube.holds(place, [arb(float(v)) for v in SLOPES @ at])
        assert not tube.holds(place, [arb(float(v) + 1e-3) for v in SLOPES @ at])


@pytest.mark.parametrize(("entry", "expected"), [(-2.0, (1, 0, [-1])), (3.0, (0, 1, [1]))])
def test_a_single_eigenvalue_is_its_own_spectrum(entry: float, expected: tuple) -> None:
    found = spectrum_of([arb(entry)], np.array([[entry]]))
    assert found is not None
    assert (found.stable, found.unstable, list(found.signs)) == expected
    assert found.gap == pytest.approx(abs(entry), rel=1e-12)
    assert spectrum_of([arb(0, 1)], np.array([[0.0]])) is None


@pytest.mark.parametrize(("graph", "width"), [((x / 3 + 1,), 1e-14), ((1 / x,), 1e-6), (None, 1e-6)])
def test_a_point_of_a_branch_is_held_where_its_formula_has_no_value(graph, width: float) -> None:
    # y + y^3 = x + 2, at x = 0.
    equations = EnclosedEquations([x], [y], [x + 2 - y - y**3])
    (ball,) = ball_at(equations, (np.array([0.0]), np.array([1.0])), graph) or [arb(0, 1)]
    assert ball.contains(arb(1))
    assert ball.is_finite()
    assert float(ball.rad()) <= width


def test_growth_along_the_slow_flow_is_bounded_no_closer_than_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[object] = []
    over = tangential._Rates.over

    def counted(self, tube, box) -> float:
        looked.append(box)
        return over(self, tube, box)

    monkeypatch.setattr(tangential._Rates, "over", counted)
    tube = linear_tube()
    spectrum = spectrum_of(
        LINEAR.derivative([arb(0), arb(0)], [arb(0), arb(0)]), np.array([[-2.0, -1.0], [-1.0, 3.0]])
    )
    assert spectrum is not None
    piece = CoveredPart(tube, spectrum)
    # x' = y^2/2 is x^2/2 + ... on the plane, and u drives x: in small units of x that is nothing beside the rate of x.
    slow = [y**2 / 2, sp.Integer(0)]
    coarse = tangential_rate(LINEAR, slow, [piece], enough=math.inf)
    assert len(looked) == 1
    fine = tangential_rate(LINEAR, slow, [piece])
    assert len(looked) > 100
    exact = 1.0 + 15 / 7
    assert exact <= fine <= 1.01 * exact
    assert fine <= coarse


def test_powers_of_numbers_have_so_many_bits_at_most() -> None:
    assert _power(Fraction(3), MOST_BITS // 2) == 3 ** (MOST_BITS // 2)
    for exponent in (MOST_BITS // 2 + 1, -MOST_BITS // 2 - 1):
        with pytest.raises(Rejected, match="bits"):
            _power(Fraction(3), exponent)
