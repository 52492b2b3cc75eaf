"""Laws of a switch: where they stop rising, and how."""

from __future__ import annotations

import pytest
import sympy as sp

from gsp.errors import DeclarationError
from gsp.sliding.law import LAWS, LawEndKind, W, switch_law

clipped = sp.Max(-1, sp.Min(1, W))
TAIL = W / (1 + sp.Abs(W) ** sp.Rational(3, 2)) ** sp.Rational(2, 3)


def rounded(n) -> sp.Expr:
    """1 - (1 - |w|)^n, odd, up to |w| = 1."""
    return sp.sign(W) * (1 - (1 - sp.Min(1, sp.Abs(W))) ** n)


stribeck = W / sp.sqrt(1 + W**2) + 3 * W / (1 + W**2)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("phi", "kind", "place", "order", "coefficient", "exponent"),
    [
        ("linear", LawEndKind.CLIPPED, 1.0, 1, 1.0, "1"),
        ("cubic", LawEndKind.CLIPPED, 1.0, 2, 1.5, "2/3"),
        ((15 * clipped - 10 * clipped**3 + 3 * clipped**5) / 8, LawEndKind.CLIPPED, 1.0, 3, 2.5, "3/5"),
        (sp.Max(-1, sp.Min(1, W / 3)), LawEndKind.CLIPPED, 3.0, 1, 1 / 3, "1"),
        ("algebraic", LawEndKind.ALGEBRAIC_TAIL, sp.oo, -2, 0.5, "2/5"),
        ("atan", LawEndKind.ALGEBRAIC_TAIL, sp.oo, -1, 2 / float(sp.pi), "1/3"),
        (rounded(sp.Rational(5, 2)), LawEndKind.CLIPPED, 1.0, sp.Rational(5, 2), 1.0, "5/8"),
        (rounded(7), LawEndKind.CLIPPED, 1.0, 7, 1.0, "7/13"),
        (TAIL, LawEndKind.ALGEBRAIC_TAIL, sp.oo, sp.Rational(-3, 2), 2 / 3, "3/8"),
        ("tanh", LawEndKind.FLAT_TAIL, sp.oo, None, None, None),
        (sp.erf(W), LawEndKind.FLAT_TAIL, sp.oo, None, None, None),
        (stribeck, LawEndKind.PEAK, float(sp.nsolve(stribeck.diff(W), 1.2)), None, None, None),
    ],
)
def test_where_a_law_stops_rising(phi, kind, place, order, coefficient, exponent) -> None:
    law = switch_law(phi)
    for end in (law.upper, law.lower):
        assert end.kind is kind
        assert end.place == pytest.approx(float(place), rel=1e-14)
        assert end.order == order
        assert end.coefficient == (None if coefficient is None else pytest.approx(coefficient, rel=1e-9))
        assert end.exponent == (None if exponent is None else sp.Rational(exponent))
    assert law.overshoots is (kind is LawEndKind.PEAK)
    small = sp.Rational(1, 10**9)
    assert law.slope == pytest.approx(float(law.at(small) / small))


@pytest.mark.exhaustive
def test_the_peak_of_the_law_of_the_belt() -> None:
    """F = 0.4 w/sqrt(1 + w^2) + 1.2 w/(1 + w^2) has its fold at F = 0.897747883876."""
    end = switch_law(stribeck).upper
    assert 0.4 * end.value == pytest.approx(0.897747883876, abs=1e-12)


def test_the_peak_of_stribecks_law_is_known_in_closed_form() -> None:
    end = switch_law("stribeck").upper
    assert end.kind is LawEndKind.PEAK
    assert (end.place, end.value) == pytest.approx((3**0.5, 0.75 * 3**0.5), rel=1e-14)


@pytest.mark.parametrize(
    "unit", [sp.Rational(1, 10**9), sp.Rational(1, 1000), sp.Integer(1000), sp.Integer(10**9)]
)
def test_a_law_is_the_same_over_slips_in_any_unit(unit: sp.Expr) -> None:
    """In millimetres a second Stribeck's law lost its maximum, and atan its limits over slips of 1e9."""
    peak, tail, flat = (
        switch_law(LAWS[name].xreplace({W: W / unit})).upper for name in ("stribeck", "atan", "cubic")
    )
    assert peak.kind is LawEndKind.PEAK
    assert (peak.place / float(unit), peak.value) == pytest.approx((3**0.5, 0.75 * 3**0.5), rel=1e-12)
    assert (tail.kind, tail.order) == (LawEndKind.ALGEBRAIC_TAIL, -1)
    assert tail.coefficient == pytest.approx(float(2 * unit / sp.pi), rel=1e-6)
    assert (flat.order, flat.place) == (2, pytest.approx(float(unit)))
    assert flat.coefficient == pytest.approx(1.5 / float(unit) ** 2)


def test_the_two_ends_of_a_law_that_is_not_odd() -> None:
    law = switch_law(sp.Max(-1, sp.Min(1, W + sp.Min(0, W))))
    assert (law.upper.place, law.lower.place) == (1.0, 0.5)
    assert "w = -0.5, flat from there on" in str(law)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", LAWS)
def test_laws_tend_to_both_ends_and_are_odd(name: str) -> None:
    law = switch_law(name)
    assert law.at(-W).equals(-law.at(W)) or law.at(sp.Rational(-1, 3)) == -law.at(sp.Rational(1, 3))
    assert switch_law(law) is law


@pytest.mark.parametrize(
    ("phi", "says"),
    [
        ("quadratic", "is no law"),
        (sp.Symbol("a") * W, "one symbol"),
        (sp.S.One, "one symbol"),
        (3.0, "one symbol"),
        (2 * sp.tanh(W), "tends to 2.0"),
        (-sp.tanh(W), "tends to -1.0"),
        (W, "tends to 1.0"),
        (sp.tanh(W**3), "does not rise at 0"),
    ],
)
def test_what_is_no_law_is_refused(phi, says) -> None:
    with pytest.raises(DeclarationError, match=says):
        switch_law(phi)


def test_a_law_with_an_infinite_slope_at_its_end_or_without_a_limit_is_refused() -> None:
    with pytest.raises(DeclarationError, match="infinite slope"):
        _ = switch_law(rounded(sp.Rational(1, 2))).upper
    with pytest.raises(DeclarationError, match="tends to nan"):
        switch_law(sp.tanh(clipped / (1 - clipped**2)))
