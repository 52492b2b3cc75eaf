"""Exits from sliding at a visible fold: the power of epsilon and its coefficient, measured on the smooth field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from scipy.special import ai_zeros

from gsp.critical.loss_kind import LossKind
from gsp.integration.events import Event
from gsp.integration.trajectory import integrate
from gsp.sliding.law import W
from gsp.sliding.piecewise_field import PiecewiseField, switching
from gsp.sliding.sliding_exit import SlidingExitError, latest, sliding_exit
from gsp.systems.system import SlowFastSystem

x, y, z, eps = sp.symbols("x y z epsilon")
field = PiecewiseField({x: 1, y: x}, {x: 1, y: 1}, y)
clipped = sp.Max(-1, sp.Min(1, W))


def flat(n: int) -> sp.Expr:
    """The odd polynomial with slope (1 - w^2)^(n - 1), clipped: 1 - phi ~ C (1 - w)^n."""
    whole = sp.integrate(sp.expand((1 - W**2) ** (n - 1)), W)
    return sp.expand(whole / whole.subs(W, 1)).subs(W, clipped)


def pure(n: sp.Rational) -> sp.Expr:
    """1 - (1 - w)^n for 0 < w < 1, odd, clipped."""
    return sp.sign(W) * (1 - (1 - sp.Min(1, sp.Abs(W))) ** n)


def measured(
    given: PiecewiseField, phi, epsilons: np.ndarray, start: dict, end: float, side: int
) -> np.ndarray:
    """x where the smooth field leaves the layer, |s| = end epsilon."""
    smooth = switching(given.plus, minus=given.minus, surface=y, phi=phi, epsilon=eps)
    leaves = Event(side * y - eps * end, direction=1, terminal=True)
    found = []
    for epsilon in epsilons:
        run = integrate(
            smooth, start=start, span=(0, 4), epsilon=epsilon, rtol=1e-11, atol=1e-11 * epsilon, events=leaves
        )
        found.append(run["x"][-1])
    return np.array(found)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("phi", "n"), [("linear", 1), ("cubic", 2), *((flat(n), n) for n in (3, 4, 5, 6))])
def test_the_exit_has_the_exponent_and_the_prefactor_of_the_theory(phi, n) -> None:
    found = sliding_exit(field, {"x": 0.01, "y": 0}, phi=phi)
    exponent = sp.Rational(n, 2 * n - 1)
    assert (found.kind, found.end.order, found.exponent) == (LossKind.VISIBLE_FOLD, n, exponent)
    epsilons = 10.0 ** np.arange(-2, -6.5, -0.5)
    late = measured(field, phi, epsilons, {"x": -0.5, "y": 0.0}, 1.0, 1)
    slope = np.polyfit(np.log(epsilons), np.log(late), 1)[0]
    assert slope == pytest.approx(float(exponent), abs=0.02)
    # What is left of late/epsilon^p is a series in the size of u, epsilon^(1/(2n - 1)).
    power = float(exponent)
    basis = np.vander(epsilons ** (1.0 / (2 * n - 1)), 4, increasing=True)
    prefactor = np.linalg.lstsq(basis, late / epsilons**power, rcond=None)[0][0]
    assert found.prefactor == pytest.approx(prefactor, rel=0.01)
    # Cut after the leading order it is off by a share of that size.
    assert found.exit(1e-6)["x"] == pytest.approx(late[-1], rel=max(0.02, 0.2 * 1e-6 ** (1.0 / (2 * n - 1))))


@pytest.mark.parametrize("side", [1, -1])
def test_a_fold_that_moves_off_the_surface_is_left_where_it_is_at_the_end_of_the_law(side: int) -> None:
    """Y+ = x + y/5: at s = epsilon it is 0 at x = -epsilon/5, and a clipped law leaves 2 epsilon later."""
    bent, other = {x: 1 + side * y, y: side * (x + x**2 / 3) + y / 5}, {x: 2 * sp.S.One, y: side * (1 + x / 2)}
    given = PiecewiseField(*((bent, other) if side > 0 else (other, bent)), y)
    found = sliding_exit(given, {"x": 0, "y": 0}, phi="linear")
    assert found.side == side
    late = measured(given, "linear", np.array([1e-5]), {"x": -0.5, "y": 0.0}, 1.0, side)
    assert found.exit(1e-5)["x"] == pytest.approx(late[0], rel=1e-2)
    assert found.exit(1e-5) == pytest.approx({"x": 1.8e-5, "y": side * 1e-5}, rel=1e-9)


def test_a_contact_order_need_not_be_whole() -> None:
    """n = 3/2: exponent 3/4, and T_n with it; the rest is of the size epsilon^(1/4) times what bends phi, here 0."""
    found = sliding_exit(field, {"x": 0, "y": 0}, phi=pure(sp.Rational(3, 2)))
    assert (found.end.order, found.exponent) == (sp.Rational(3, 2), sp.Rational(3, 4))
    # Off w = 0, where sign and Abs are not smooth, the same without them.
    upper = 1 - (1 - sp.Min(1, W)) ** sp.Rational(3, 2)
    v = sp.Symbol("v")
    late = []
    for epsilon in (1e-6, 1e-8):
        phi = upper.xreplace({W: v})
        run = integrate(
            SlowFastSystem(slow={x: 1}, fast={v: (1 + x) / 2 + phi * (x - 1) / 2}, epsilon=eps),
            start={"x": -0.5, "v": 1 - (2.0 / 3.0) ** (2.0 / 3.0)},
            span=(0, 2),
            epsilon=epsilon,
            rtol=1e-11,
            atol=1e-13,
            events=Event(v - 1, direction=1, terminal=True),
        )
        late.append(run["x"][-1])
    assert np.log10(late[0] / late[1]) / 2 == pytest.approx(0.75, abs=0.02)
    assert found.exit(1e-8)["x"] == pytest.approx(late[1], rel=0.01)


@pytest.mark.exhaustive
def test_the_exit_scales_with_what_bends_and_what_pushes() -> None:
    """X+ = (2, 3 x), X- = (1, 5), cubic: beta = 6, gamma = 5; then upside down, from s < 0."""
    bent = PiecewiseField({x: 2, y: 3 * x}, {x: 1, y: 5}, y)
    found = sliding_exit(bent, {"x": 0, "y": 0}, phi="cubic")
    assert (found.side, found.bending, found.push) == (1, 6.0, 5.0)
    late = measured(bent, "cubic", np.array([1e-8]), {"x": -0.5, "y": 0.0}, 1.0, 1)
    assert found.exit(1e-8)["x"] == pytest.approx(late[0], rel=5e-3)
    mirrored = PiecewiseField({x: 1, y: -5}, {x: 2, y: -3 * x}, y)
    other = sliding_exit(mirrored, {"x": 0, "y": 0}, phi="cubic")
    assert (other.side, other.bending, other.push) == (-1, 6.0, 5.0)
    assert other.prefactor == found.prefactor


def test_the_numbers_of_the_scaled_equation() -> None:
    assert latest(sp.Integer(1)) == pytest.approx(1.0, abs=1e-10)
    assert latest(sp.Integer(2)) == pytest.approx(-ai_zeros(1)[1][0], abs=1e-10)


def test_tails_have_a_power_without_a_coefficient_or_none() -> None:
    algebraic, flat = (sliding_exit(field, {"x": 0, "y": 0}, phi=phi) for phi in ("algebraic", "tanh"))
    assert (algebraic.exponent, algebraic.prefactor) == (sp.Rational(2, 5), None)
    assert "goes as epsilon^(2/5)" in str(algebraic)
    assert (flat.exponent, flat.prefactor) == (None, None)
    assert np.isnan(flat.time(0.01))
    assert "no power of epsilon" in str(flat)


def test_a_push_of_zero_has_no_sign() -> None:
    two = sliding_exit(PiecewiseField({x: 1, y: -x}, {x: 1, y: x}, y), {"x": 0, "y": 0}, phi="cubic")
    assert "beta = -1, gamma = 0; " in str(replace(two, push=-0.0))


def test_folds_are_named() -> None:
    invisible = sliding_exit(PiecewiseField({x: 1, y: -x}, {x: 1, y: 1}, y), {"x": 0, "y": 0}, phi="cubic")
    assert (invisible.kind, invisible.exponent) == (LossKind.INVISIBLE_FOLD, None)
    two = sliding_exit(PiecewiseField({x: 1, y: x}, {x: 1, y: -x}, y), {"x": 0, "y": 0}, phi="cubic")
    assert (two.kind, two.exponent) == (LossKind.TWO_FOLD, None)


@pytest.mark.parametrize(
    ("plus", "minus", "says"),
    [
        ({x: 1, y: -1}, {x: 1, y: 1}, "neither field is tangent"),
        ({x: 1, y: 1 + x**2}, {x: 1, y: 1}, "neither field is tangent"),
        ({x: 1, y: x}, {x: 1, y: -1}, "no orbit slides beside this fold"),
    ],
)
def test_where_there_is_no_exit_it_is_said(plus, minus, says) -> None:
    with pytest.raises(SlidingExitError, match=says):
        sliding_exit(PiecewiseField(plus, minus, y), {"x": 0.3, "y": 0}, phi="linear")


@pytest.mark.parametrize("unit", [sp.Rational(1, 10**9), sp.Rational(1, 10**6), 10**6])
def test_a_fold_is_found_from_as_far_in_any_units(unit) -> None:
    """From x = 0.3, with both states in the unit: where y was 0 only a step of 1 could be taken towards the fold."""
    plus, minus = {x: 1 / unit, y: sp.sin(unit * x) / unit}, {x: 1 / unit, y: 1 / unit}
    for start in (0.3, 1e-17):
        found = sliding_exit(PiecewiseField(plus, minus, y * unit), {"x": start / unit, "y": 0}, phi="cubic")
        assert found.kind is LossKind.VISIBLE_FOLD
        assert found.point["x"] * unit == pytest.approx(0.0, abs=1e-12)
        assert found.prefactor == pytest.approx(1.121326758, rel=1e-8)


@pytest.mark.parametrize("start", [0.0, 0.1])
def test_a_tangency_of_higher_order_is_no_fold(start: float) -> None:
    """Y+ = x^3 has no beta, so that (2) would be late by any time; at x = 0 it was an invisible fold."""
    cubic = PiecewiseField({x: 1, y: x**3}, {x: 1, y: 1}, y)
    with pytest.raises(SlidingExitError, match="of a higher order than that of a fold"):
        sliding_exit(cubic, {"x": start, "y": 0}, phi="cubic")
