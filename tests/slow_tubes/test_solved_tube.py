"""Tubes about manifolds that were solved for: implicit branches and fields with functions, against closed forms."""

import math
import random
from dataclasses import replace

import flint
import mpmath
import numpy as np
import pytest
import sympy as sp
from flint import arb
from sympy import Rational as R

import gsp
from gsp.errors import DeclarationError, UnsupportedFunctionError
from gsp.proofs import balls
from gsp.proofs.verdict import ProofVerdict
from gsp.slow.chebyshev import ChebyshevSurface
from gsp.slow.solved_manifold import solve_manifold
from gsp.slow_tubes.certify import certify
from gsp.slow_tubes.series_function import SeriesFunction
from gsp.slow_tubes.solved_flow import SolvedFlow
from tests.slow_tubes.test_slow_tube import epsilon, michaelis_menten, s, saddle, x, y

z = sp.Symbol("z")


def solved(slow, fast, region, value, *, through=None, tolerance=1e-12):
    system = gsp.SlowFastSystem(slow=slow, fast=fast, epsilon=epsilon)
    branch = gsp.solve_critical(system).branches[0]
    return solve_manifold(
        branch.through(through) if through else branch, region=region, epsilon=value, tolerance=tolerance
    )


def forced():
    """x' = 1, epsilon y' = sin x - y: h = (sin x - epsilon cos x)/(1 + epsilon^2) is one that stays bounded."""
    return solved({x: sp.Integer(1)}, {y: sp.sin(x) - y}, {"x": (0.0, 3.0)}, 0.125)


def van_der_pol(value):
    return solved({x: -y}, {y: x - y**3 / 3 + y}, {"x": (-0.4, 2.0)}, value, through={"x": 0.0, "y": 3**0.5})


def enzyme(value=0.1):
    return solve_manifold(michaelis_menten(0).branch, region={"s": (0.1, 5.0)}, epsilon=value, tolerance=1e-12)


def morris_lecar(value):
    v, n = sp.symbols("v n")
    open_share = (1 + sp.tanh((v + R(6, 5)) / 18)) / 2
    fast = (90 - 2 * (v + 60) - R(22, 5) * open_share * (v - 120) - 8 * n * (v + 84)) / 20
    slow = ((1 + sp.tanh((v - 2) / 30)) / 2 - n) * sp.cosh((v - 2) / 60)
    return solved(
        {n: slow}, {v: fast}, {"n": (0.1875, 0.5)}, value, through={"n": 0.3, "v": -45.0}, tolerance=1e-11
    )


def difference(manifold, exact) -> float:
    """The largest distance of the interpolant, in exact arithmetic, from a closed form."""
    surface = manifold.surface
    low, high = map(mpmath.mpf, surface.box[0].tolist())
    with mpmath.workprec(400):
        worst = mpmath.mpf(0)
        for k in range(201):
            at = low + (high - low) * k / 200
            unit = (2 * at - low - high) / (high - low)
            value = sum(
                mpmath.mpf(float(c)) * mpmath.chebyt(j, unit) for j, c in enumerate(surface.coefficients[:, 0])
            )
            worst = max(worst, abs(value - exact(at)))
        return float(worst)


def of_forced(at):
    small = mpmath.mpf(1) / 8
    return (mpmath.sin(at) - small * mpmath.cos(at)) / (1 + small**2)


@pytest.mark.exhaustive
def test_the_tube_holds_the_manifold_and_is_hardly_wider() -> None:
    manifold = forced()
    tube = certify(manifold, region={"x": (0, 3)})
    assert tube.verdict is ProofVerdict.PROVED
    error = difference(manifold, of_forced)
    # The residual holds the error of the slope too, which rounding makes larger than that of the value.
    assert error <= tube.delta <= 20.0 * error + 1e-15
    assert tube.epsilon == 0.125
    assert "others may lie outside the tube" in tube.statement[-1]


@pytest.mark.exhaustive
@pytest.mark.parametrize("size", [1e-12, 1e-9, 1e-6, 1e-3])
@pytest.mark.parametrize("place", [0, 3, 9])
def test_a_wrong_interpolant_has_a_tube_that_holds_the_manifold_or_none(size: float, place: int) -> None:
    right = forced()
    surface = right.surface
    assert surface is not None
    coefficients = surface.coefficients.copy()
    coefficients[place] += size
    wrong = replace(right, surface=ChebyshevSurface(surface.box, coefficients))
    tube = certify(wrong, region={"x": (0, 3)})
    assert not tube.is_isolating or tube.delta >= difference(wrong, of_forced)
    assert tube.is_isolating
    assert tube.delta >= 0.9 * size


@pytest.mark.exhaustive
def test_michaelis_menten_at_a_tenth_to_rounding() -> None:
    manifold = enzyme()
    tube = certify(manifold, region={"s": (0.1, 5)}, epsilon=0.1)
    assert tube.verdict is ProofVerdict.PROVED
    assert tube.delta <= 1e-12
    assert tube.tried < 1000
    # Where the flow enters the tubes meet, and what starts in both of them stays in both.
    series = michaelis_menten(4)
    other = certify(series, region={"s": (0.1, 5)}, epsilon=0.1)
    at = np.linspace(0.1, 5.0, 101)[:, None]
    apart = np.abs(manifold.evaluate(at) - series.evaluate(at, 0.1)).max()
    assert 1e-9 < apart <= tube.delta + other.delta + 1e-15


@pytest.mark.exhaustive
@pytest.mark.parametrize("value", [0.1, 0.01])
def test_an_implicit_branch(value: float) -> None:
    tube = certify(van_der_pol(value), region={"x": (-0.4, 2.0)})
    assert tube.verdict is ProofVerdict.PROVED
    assert tube.delta <= 1e-11
    narrow = certify(van_der_pol(value), region={"x": (0.0, 1.0)})
    assert narrow.delta <= tube.delta


@pytest.mark.exhaustive
@pytest.mark.parametrize("value", [0.01, 0.002])
def test_a_field_with_functions_of_the_fast_variable(value: float) -> None:
    tube = certify(morris_lecar(value), region={"n": (0.1875, 0.5)})
    assert tube.verdict is ProofVerdict.PROVED
    assert tube.delta <= 1e-8


@pytest.mark.exhaustive
def test_a_saddle_and_a_pair() -> None:
    found = solve_manifold(saddle(0).branch, region={"s": (-1, 1)}, epsilon=0.1, tolerance=1e-12)
    tube = certify(found, region={"s": (-1, 1)})
    assert tube.verdict is ProofVerdict.PROVED
    assert sorted(tube.signs) == [-1, 1]
    # x = -s^2/(1 + 2 epsilon), which solves it exactly: epsilon x' = x + s^2 with s' = -s.
    assert tube.widths["x"] < 1e-13
    pair = solved({s: -s}, {x: -x - 8 * y + sp.exp(s), y: x - y}, {"s": (-1.0, 1.0)}, 0.05)
    assert certify(pair, region={"s": (-1, 1)}).verdict is ProofVerdict.PROVED


def test_attraction_that_ends_inside_is_never_proved() -> None:
    # y' = (x - 1/2) y: an interpolant of 0 solves the equation everywhere, and repels from x = 1/2 on.
    found = solved({x: sp.Integer(1)}, {y: (x - R(3, 4)) * y}, {"x": (0.0, 0.5)}, 0.01)
    surface = found.surface
    assert surface is not None
    assert certify(found, region={"x": (0, 0.5)}).verdict is ProofVerdict.PROVED
    wider = replace(found, surface=ChebyshevSurface(np.array([[0.0, 1.0]]), surface.coefficients))
    tube = certify(wider, region={"x": (0, 1)})
    assert tube.verdict is ProofVerdict.UNDECIDED
    assert not tube.is_isolating


def test_a_pole_and_a_branch_point_are_never_proved() -> None:
    found = solved({x: sp.Integer(1)}, {y: -y + x}, {"x": (0.5, 1.0)}, 0.01)
    for fast in (-y + sp.log(x - R(3, 4)), -y + sp.sqrt(x - R(3, 4)), -y + 1 / (x - R(5, 8))):
        system = gsp.SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: fast}, epsilon=epsilon)
        moved = replace(found, branch=gsp.solve_critical(system).branches[0])
        region = {"x": (0.5, 1.0)}
        tube = certify(moved, region=region, most_boxes=200)
        assert tube.verdict is ProofVerdict.UNDECIDED
        assert not tube.is_isolating


def test_what_is_asked_wrongly_is_refused() -> None:
    manifold = forced()
    with pytest.raises(DeclarationError, match=r"0\.125"):
        certify(manifold, region={"x": (0, 3)}, epsilon=0.1)
    with pytest.raises(DeclarationError, match="solved over"):
        certify(manifold, region={"x": (0, 4)})
    with pytest.raises(DeclarationError, match="has none"):
        certify(replace(manifold, surface=None), region={"x": (0, 3)})
    with pytest.raises(UnsupportedFunctionError, match="erf"):
        certify(
            solved({x: sp.Integer(1)}, {y: sp.erf(x) - y}, {"x": (0.0, 1.0)}, 0.1, tolerance=1e-8),
            region={"x": (0, 1)},
        )


def test_a_spent_budget_and_an_interruption_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    tube = certify(enzyme(), region={"s": (0.1, 5)}, most_boxes=3)
    assert tube.verdict is ProofVerdict.UNDECIDED
    assert "3 boxes" in tube.reason
    assert (tube.is_isolating, tube.has_cones, tube.signs, tube.widths) == (False, False, (), {})

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(SolvedFlow, "residual", interrupted)
    tube = certify(enzyme(), region={"s": (0.1, 5)})
    assert tube.verdict is ProofVerdict.UNDECIDED
    assert "interrupted" in tube.reason


# -- what it is made of: held by inclusion ------------------------------------------------------


@pytest.mark.exhaustive
def test_residuals_are_held_and_sharp() -> None:
    manifold = forced()
    surface = manifold.surface
    assert surface is not None
    draw = random.Random(11)
    low, high = map(mpmath.mpf, surface.box[0].tolist())

    def p(at):
        unit = (2 * at - low - high) / (high - low)
        return sum(
            mpmath.mpf(float(c)) * mpmath.chebyt(j, unit) for j, c in enumerate(surface.coefficients[:, 0])
        )

    with flint.ctx.workprec(balls.PRECISION):
        flow = SolvedFlow(manifold, sp.eye(1))
    with mpmath.workprec(300):
        for _ in range(60):
            centre = draw.uniform(0.0, 3.0)
            width = draw.choice([0.0, 1e-9, 1e-3, 0.05])
            first, last = max(0.0, centre - width), min(3.0, centre + width)
            at = mpmath.mpf(first) + (mpmath.mpf(last) - mpmath.mpf(first)) * draw.random()
            slope, bend = mpmath.diff(p, at), mpmath.diff(p, at, 2)
            exact = mpmath.sin(at) - p(at) - slope / 8
            with flint.ctx.workprec(balls.PRECISION):
                ball, small = balls.hull(first, last), arb(0.125)
                (found,) = flow.residual([ball, small])
                steep = flow.residual_slopes([ball, small])
                normal = flow.normal([ball, arb(0), small])
            assert found.is_finite()
            if width <= 0.05:
                assert balls.magnitude(found) < 1e-11
            for held, value in ((found, exact), (steep[0], mpmath.cos(at) - slope - bend / 8), (normal[0], -1)):
                assert balls.below(held) <= value + mpmath.mpf(10) ** -40
                assert value - mpmath.mpf(10) ** -40 <= balls.above(held)


@pytest.mark.exhaustive
def test_rates_are_those_of_the_field_at_the_point_and_the_epsilon() -> None:
    manifold = solved({x: 1 + 7 * epsilon + y}, {y: x - y}, {"x": (0.0, 1.0)}, 0.125)
    with flint.ctx.workprec(balls.PRECISION):
        flow = SolvedFlow(manifold, sp.Matrix([[2]]))
        (found,) = flow.rates([arb(0.5), arb(0.25), arb(0.125)])
    assert manifold.surface is not None
    assert float(found.mid()) == pytest.approx(
        1 + 7 / 8 + manifold.surface(np.array([[0.5]]))[0, 0] + 0.5, rel=1e-12
    )


SERIES = {
    "exp": sp.exp(x), "log": sp.log(x + 3), "sin": sp.sin(x), "cos": sp.cos(2 * x), "tan": sp.tan(x / 2),
    "tanh": sp.tanh(x), "sinh": sp.sinh(x), "cosh": sp.cosh(x), "atan": sp.atan(x), "sqrt": sp.sqrt(x + 3),
    "root": (x + 3) ** R(-2, 3), "power": (x + 3) ** (x / 2), "quotient": (x - 1) / (x**2 + 2), "cube": (x - 2) ** 3,
    "constants": sp.pi * x + sp.E,
}  # fmt: skip


@pytest.mark.parametrize("name", SERIES)
def test_power_series_hold_the_coefficients(name: str) -> None:
    expression = SERIES[name]
    length = 6
    with flint.ctx.workprec(balls.PRECISION):
        function = SeriesFunction([x], [expression])
    at = R(3, 10)
    exact = [(expression.diff(x, k) / sp.factorial(k)).subs(x, at).evalf(50) for k in range(length)]
    for wide in (R(0), R(1, 100)):
        with flint.ctx.workprec(balls.PRECISION):
            ball = balls.exact(0.3) + balls.hull(-float(wide) - 1e-16, float(wide) + 1e-16)
            (found,) = function([[ball, arb(1)]], length)
        assert len(found) == length
        for value, held in zip(exact, found):
            assert held.is_finite()
            assert sp.Float(balls.below(held), 50) <= value <= sp.Float(balls.above(held), 50)


@pytest.mark.parametrize("expression", [sp.log(x), sp.sqrt(x), 1 / x, sp.tan(x), x ** R(1, 3), 1 / x**2])
def test_power_series_outside_the_domain_are_not_finite(expression: sp.Expr) -> None:
    with flint.ctx.workprec(balls.PRECISION):
        function = SeriesFunction([x], [expression])
        ball = balls.hull(-1.0, 3.0)
        (found,) = function([[ball, arb(1)]], 3)
    assert not all(value.is_finite() for value in found)


def test_the_region_is_rounded_outwards() -> None:
    low, high = R(1, 3), R(5, 3)
    found = gsp.certify(forced(), region={"x": (low, high)})
    assert found.verdict == "proved"
    first, last = (sp.Rational(float(end)) for end in found.region["x"])
    assert low - R(1, 10**15) < first < low
    assert high < last < high + R(1, 10**15)


@pytest.mark.parametrize(("far", "length", "unit"), [(300, 1, 1), (0, R(1, 10**6), 60)])
def test_a_tube_is_the_same_far_from_the_origin_and_in_other_units(far: int, length: R, unit: int) -> None:
    here = van_der_pol(0.0625)
    X, Y = (x - far) / length, (y - far) / unit
    there = solved(
        {x: -length * Y},
        {y: unit * (X - Y**3 / 3 + Y)},
        {"x": (float(far - R(2, 5) * length), float(far + 2 * length))},
        0.0625,
        through={"x": float(far), "y": float(far + unit * 3**0.5)},
    )
    tube, moved = (certify(of, region=of.region) for of in (here, there))
    assert tube.verdict is moved.verdict is ProofVerdict.PROVED
    # The coefficients of the interpolant are doubles of its size.
    assert moved.delta < unit * tube.delta + 20.0 * math.ulp(float(far + unit))


def test_values_far_from_the_origin_are_rounded_once() -> None:
    """They were off by up to three units in the last place, and a proved bound is not about that."""
    found = solved({x: 300 - x}, {y: 300 + (x - 300) ** 3 - y}, {"x": (300.2, 301.0)}, 0.0625)
    (low, high), coefficients = found.surface.box[0], found.surface.coefficients[:, 0]
    for place in np.linspace(300.2, 301.0, 41):
        inner = 2 * (R(place) - R(low)) / (R(high) - R(low)) - 1
        exact = sum(R(c) * sp.chebyshevt(j, inner) for j, c in enumerate(coefficients))
        assert abs(R(float(found.evaluate(place)[0])) - exact) < 0.51 * math.ulp(300.0)
