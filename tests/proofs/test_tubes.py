"""Tubes and what is read off them: of linear equations they are as narrow as rounding lets them be."""

import math
from fractions import Fraction

import numpy as np
import pytest
import sympy as sp
from flint import arb

from gsp.proofs import tangential
from gsp.proofs.anchors import ball_at
from gsp.proofs.certification import _is_on
from gsp.proofs.covering import CoveredPart, Covering, Part
from gsp.proofs.equations import EnclosedEquations
from gsp.proofs.programs import Rejected
from gsp.proofs.rational_functions import MOST_BITS, _power
from gsp.proofs.spectrum import spectrum_of
from gsp.proofs.tangential import tangential_rate
from gsp.proofs.tubes import RootTube, inside, krawczyk, middle_of

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
    for at in ([1.5, 2.0], [-0.5, 2.0], [0.5, 3.5], [0.5, 0.5]):
        assert not tube.holds([arb(v) for v in at], [arb(float(v)) for v in SLOPES @ at])


def test_a_tube_about_a_curve_encloses_the_derivative_over_it() -> None:
    # y = sqrt(x) and D_y F = 2 y from 2 to 2.2.
    equations = EnclosedEquations([x], [y], [y**2 - x])
    box = ((1.0, 1.21),)
    middle = middle_of(box)
    root = np.sqrt(middle)
    tube = krawczyk(equations, box, middle, root, (0.5 / root)[None, :])
    assert tube is not None
    assert tube.derivative[0].contains(arb(2))
    assert tube.derivative[0].contains(arb(2.2))
    assert float(tube.derivative[0].rad()) < 0.11
    assert tube.radius[0] < 0.01


def test_the_middle_of_a_box_is_within_it() -> None:
    assert middle_of(((-1.0, 3.0), (2.0, 2.0), (5.0, 6.0))).tolist() == [1.0, 2.0, 5.5]


def test_inside_is_the_interior() -> None:
    for ball in (arb(0), arb(0.5, 0.25), arb(-0.5, 0.25)):
        assert inside(ball, 1.0)
    for ball in (arb(1), arb(-1), arb(0, 1), arb(0.5, 0.5), arb(-0.5, 0.5), arb("nan"), arb(0, "inf")):
        assert not inside(ball, 1.0)


@pytest.mark.parametrize(("graph", "width"), [((x / 3 + 1,), 1e-14), ((1 / x,), 1e-6), (None, 1e-6)])
def test_a_point_of_a_branch_is_held_where_its_formula_has_no_value(graph, width: float) -> None:
    # y + y^3 = x + 2, at x = 0.
    equations = EnclosedEquations([x], [y], [x + 2 - y - y**3])
    (ball,) = ball_at(equations, (np.array([0.0]), np.array([1.0])), graph) or [arb(0, 1)]
    assert ball.contains(arb(1))
    assert ball.is_finite()
    assert float(ball.rad()) <= width


@pytest.mark.exhaustive
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


@pytest.mark.exhaustive
def test_the_largest_of_all_bounds_is_told_whichever_piece_it_is_of() -> None:
    # x' = x^2/2 on y = z = 0: the rate is |x|.
    flat = EnclosedEquations([x], [y], [-y])
    tubes = [
        krawczyk(flat, ((low, high),), np.array([0.5 * (low + high)]), np.zeros(1), np.zeros((1, 1)))
        for low, high in ((0.0, 1.0), (4.0, 5.0), (1.0, 2.0))
    ]
    pieces = [CoveredPart(tube, None) for tube in tubes if tube is not None]
    for order in ((0, 1, 2), (1, 0, 2), (2, 0, 1)):
        for enough in (0.0, 5.25, math.inf):
            assert 5.0 <= tangential_rate(flat, [x**2 / 2], [pieces[k] for k in order], enough=enough) <= 5.3


@pytest.mark.parametrize("off", [0.0, 0.25])
def test_the_condition_holds_for_what_is_returned_recomputed_in_fractions(off: float) -> None:
    """F = A x + B y: |C (A c + B b)| + |C| |A + B T| h + |1 - C B| r < r, by components."""
    h = [Fraction(1, 2), Fraction(1)]
    A = [[Fraction(v) for v in row] for row in ((-1, -1), (-4, -2))]
    B = [[Fraction(v) for v in row] for row in ((2, 1), (1, -3))]
    middle, centre = np.array([0.5, 2.0]), SLOPES @ [0.5, 2.0] + off
    tube = krawczyk(LINEAR, BOX, middle, centre, SLOPES + off)
    assert tube is not None
    C, T = ([[Fraction(float(v)) for v in row] for row in matrix] for matrix in (tube.inverse, tube.slope))
    two = range(2)
    # LINEAR is the negative of A x + B y.
    rate = [[-A[i][k] - sum(B[i][j] * T[j][k] for j in two) for k in two] for i in two]
    at = [-sum(A[i][k] * Fraction(middle[k]) + B[i][k] * Fraction(centre[k]) for k in two) for i in two]
    r = [Fraction(float(v)) for v in tube.radius]
    for i in two:
        left = abs(sum(C[i][k] * at[k] for k in two))
        left += sum(abs(sum(C[i][k] * rate[k][j] for k in two)) * h[j] for j in two)
        left += sum(abs((i == j) + sum(C[i][k] * B[k][j] for k in two)) * r[j] for j in two)
        assert left < r[i]


def test_what_was_proved_holds_the_point_only_where_it_is_in_its_tube() -> None:
    # y^3 = y is three branches over [0, 1], cut in two.
    equations = EnclosedEquations([x], [y], [y - y**3 + 0 * x])
    parts = []
    for low, high in ((0.0, 0.5), (0.5, 1.0)):
        tube = krawczyk(equations, ((low, high),), np.array([0.5 * (low + high)]), np.ones(1), np.zeros((1, 1)))
        assert tube is not None
        parts.append(Part(tube.box, tube.centre, CoveredPart(tube, None)))
    covering = Covering(Part(((0.0, 1.0),), np.ones(1), axis=0, at=0.5, halves=(parts[0], parts[1])))
    for place in (0.0, 0.25, 0.5, 0.75, 1.0):
        assert _is_on(covering, np.array([place]), [arb(1)])
        for other in (arb(0), arb(-1), arb(1, 0.5), arb(1.5)):
            assert not _is_on(covering, np.array([place]), [other])
    parts[1].piece = None
    assert not _is_on(covering, np.array([0.75]), [arb(1)])
