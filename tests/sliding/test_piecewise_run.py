"""Runs of fields that switch: crossing, sliding and leaving, against exact solutions and stiff runs of SciPy."""

from __future__ import annotations

from itertools import groupby

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from gsp.critical.loss_kind import LossKind
from gsp.errors import DeclarationError, GspError
from gsp.sliding.law import W
from gsp.sliding.piecewise_field import PiecewiseField
from gsp.sliding.piecewise_run import PiecewiseRun, Side, run_piecewise
from tests.sliding.filippov import filippov

x, y, z, u, t = sp.symbols("x y z u t")
fold = PiecewiseField({x: 1, y: x}, {x: 1, y: 1}, y)
belt = PiecewiseField(
    {x: u, u: -x + sp.Rational(2, 5)}, {x: u, u: -x - sp.Rational(2, 5)}, sp.Rational(1, 5) - u
)
stribeck = W / sp.sqrt(1 + W**2) + 3 * W / (1 + W**2)
PEAK = 0.897747883876394


def sides(run: PiecewiseRun) -> list[Side]:
    return [piece.side for piece in run.pieces]


@pytest.mark.exhaustive
def test_a_run_crosses_slides_and_leaves() -> None:
    """From (-3, -1) up to y = 0 at t = 1, where x = -2; sliding to the fold at x = 0; then y = x^2/2."""
    run = run_piecewise(fold, start={"x": -3, "y": -1}, span=(0, 4))
    assert sides(run) == [Side.MINUS, Side.SLIDING, Side.PLUS]
    assert run.changes == pytest.approx((1.0, 3.0), abs=1e-10)
    assert [piece.loss for piece in run.pieces] == [None, LossKind.VISIBLE_FOLD, None]
    assert (run["x"][-1], run["y"][-1]) == pytest.approx((1.0, 0.5), abs=1e-9)
    steps = sum(piece.run.stats.steps for piece in run.pieces)
    assert f"3 pieces and {steps} steps: t = 4, x = 1" in run.message
    crossing = run_piecewise(fold, start={"x": 1, "y": -1}, span=(0, 2))
    assert sides(crossing) == [Side.MINUS, Side.PLUS]
    assert crossing["y"][-1] == pytest.approx((9 - 4) / 2, abs=1e-9)


@pytest.mark.exhaustive
def test_the_belt_with_an_overshooting_law_sticks_and_slips_with_the_limit_period() -> None:
    """Sticking from x_l to the fold at the belt's speed, and an arc of a circle about x = 0.4."""
    run = run_piecewise(belt, start={"x": 0, "u": 0.2}, span=(0, 40), phi=stribeck)
    assert {piece.loss for piece in run.pieces} == {LossKind.SLIP_ONSET, None}
    angle = np.arctan2(0.2, PEAK - 0.4)
    period = 2 * (PEAK - 0.4) / 0.2 + np.pi + 2 * angle
    assert period == pytest.approx(8.8832027200, abs=1e-9)
    assert np.diff(run.changes[::2]) == pytest.approx(period, abs=1e-9)


def test_a_relay_that_acts_through_a_second_state_crosses_and_never_slides() -> None:
    """x'' = -sign(x) from rest at 1: parabolas, with x = 0 at the times (2 k + 1) sqrt(2)."""
    relay = PiecewiseField({x: y, y: -1}, {x: y, y: 1}, x)
    run = run_piecewise(relay, start={"x": 1, "y": 0}, span=(0, 10))
    assert sides(run) == [Side.PLUS, Side.MINUS, Side.PLUS, Side.MINUS, Side.PLUS]
    assert run.changes == pytest.approx(np.sqrt(2) * np.array([1, 3, 5, 7]), abs=1e-9)
    assert "two-fold" in run_piecewise(relay, start={"x": 0, "y": 0}, span=(0, 1)).message
    for answer in ("sliding", "share"):
        with pytest.raises(DeclarationError, match="at the same rate, y, so that no run slides"):
            getattr(relay, answer)


def test_a_piece_that_fails_says_which_it_is() -> None:
    """Below y = 0 the state x blows up, x = 1/(2 - t) from x = 1 at t = 1."""
    run = run_piecewise(PiecewiseField({x: 0, y: -1}, {x: x**2, y: -1}, y), start={"x": 1, "y": 1}, span=(0, 3))
    assert run.t[-1] == pytest.approx(2, abs=1e-9)
    assert run.message.startswith("piece 2 stopped after ")


def test_a_narrow_and_steep_feature_is_crossed_where_both_fields_lead_down() -> None:
    """y = 1 - 2/(1 + u^2) with u = 100 (x - sqrt(2)) falls through 0 at u = -1, at the rate -100; below it is -5."""
    height = 1 - 2 / (1 + (100 * (x - sp.sqrt(2))) ** 2)
    field = PiecewiseField({x: 1, y: sp.diff(height, x)}, {x: 1, y: -5}, y)
    run = run_piecewise(field, start={"x": 0, "y": height.subs(x, 0)}, span=(0, 3))
    assert sides(run) == [Side.PLUS, Side.MINUS]
    assert run.changes == pytest.approx((np.sqrt(2) - 0.01,), abs=1e-9)


def test_rates_that_are_exponentials_slide_and_leave() -> None:
    """Y+ = -exp(-x) < 0 < Y- = exp(x) - 2 from x = ln 2 on, leaving where X- turns away."""
    field = PiecewiseField({x: -1, y: -sp.exp(-x)}, {x: -1, y: sp.exp(x) - 2}, y)
    run = run_piecewise(field, start={"x": 2, "y": 0}, span=(0, 2))
    assert sides(run) == [Side.SLIDING, Side.MINUS]
    assert run.changes == pytest.approx((2 - np.log(2),), abs=1e-10)


def test_a_monotone_law_lets_go_at_the_fold_of_the_field() -> None:
    run = run_piecewise(belt, start={"x": 0, "u": 0.2}, span=(0, 4))
    assert run.changes == pytest.approx((2.0,), abs=1e-10)
    assert run.pieces[0].run["x"][-1] == pytest.approx(0.4, abs=1e-10)


def test_an_orbit_that_touches_the_surface_stays_on_its_side() -> None:
    """Leaving the fold at (0.4, 0.2) the orbit is a circle that comes back to touch the surface there."""
    run = run_piecewise(belt, start={"x": 0.4, "u": 0.2 - 1e-3}, span=(0, 30))
    assert sides(run) == [Side.PLUS]
    touching = run_piecewise(belt, start={"x": 0, "u": 0.2}, span=(0, 20))
    assert Side.MINUS not in sides(touching)


@pytest.mark.exhaustive
def test_a_block_on_a_shaken_table_sticks_and_slips_as_the_stiff_run_does() -> None:
    """u' = A cos(t) - mu g sign(u), smoothed by tanh at epsilon = 1e-6: times of change to 1e-5."""
    rates = {t: sp.S.One, u: 3 * sp.cos(t) - 2}, {t: sp.S.One, u: 3 * sp.cos(t) + 2}
    run = run_piecewise(PiecewiseField(*rates, u), start={"t": 0, "u": 0}, span=(0, 12))
    epsilon = 1e-6

    def rate(time, state):
        return [3 * np.cos(time) - 2 * np.tanh(state[0] / epsilon)]

    def slope(time, state):
        return [[-2 / np.cosh(min(abs(state[0]) / epsilon, 300.0)) ** 2 / epsilon]]

    stiff = solve_ivp(rate, (0, 12), [0.0], "Radau", rtol=1e-10, atol=1e-14, jac=slope, dense_output=True)
    for change in run.changes:
        before, after = (abs(stiff.sol(change + shift)[0]) for shift in (-1e-2, 1e-2))
        assert min(before, after) < 20 * epsilon < max(before, after)
    assert Side.SLIDING in sides(run)
    assert abs(run["u"][-1] - stiff.y[0, -1]) < 1e-5


@pytest.mark.parametrize("start", [(-1.0, -0.5), (-1.0, -1.0), (-0.3, -1.7), (-2.0, -0.01)])
def test_a_run_into_a_two_fold_ends_there_by_name(start: tuple[float, float]) -> None:
    """With w = -(x + z) and u = x - z, w' = -1 and u' = -3 u/w: u = u_0 (w/w_0)^3, so that all sliding orbits end at 0.

    Both folds and the end of sliding are one event to rounding, whichever is located first.
    """
    given = PiecewiseField({x: -1, y: x, z: 2}, {x: 2, y: -z, z: -1}, y)
    run = run_piecewise(given, start={"x": start[0], "y": 0, "z": start[1]}, span=(0, 4))
    (piece,) = run.pieces
    assert piece.loss is LossKind.TWO_FOLD
    assert "two-fold" in run.message
    assert run["x"][-1] == pytest.approx(0.0, abs=1e-3)
    assert run.t[-1] == pytest.approx(-sum(start), abs=1e-6)


def test_a_run_ends_by_name_where_sliding_repels() -> None:
    given = PiecewiseField({x: 1, y: x, z: 0}, {x: 0, y: -z, z: 1}, y)
    # A visible two-fold: both fields bend away.
    both = run_piecewise(given, start={"x": 0, "y": 0, "z": 0}, span=(0, 1))
    assert "more than one side" in both.message
    repelling = run_piecewise(given, start={"x": 1, "y": 0, "z": 1}, span=(0, 1))
    assert "repels" in repelling.message
    assert repelling.pieces == ()


@pytest.mark.parametrize(
    ("start", "side"),
    [
        ((0.0, 0.0), Side.PLUS),
        ((-0.5, 0.0), Side.SLIDING),
        ((0.5, 0.0), Side.PLUS),
        ((0.5, -0.1), Side.MINUS),
        ((-0.5, 0.1), Side.PLUS),
    ],
)
def test_where_a_run_begins(start, side) -> None:
    run = run_piecewise(fold, start=dict(zip("xy", start)), span=(0, 0.05))
    assert sides(run)[0] is side


def test_at_an_invisible_fold_sliding_begins() -> None:
    given = PiecewiseField({x: 1, y: -x}, {x: 1, y: 1}, y)
    assert sides(run_piecewise(given, start={"x": 0, "y": 0}, span=(0, 1))) == [Side.SLIDING]
    below = PiecewiseField({x: 1, y: -1}, {x: 1, y: -x}, y)
    assert sides(run_piecewise(below, start={"x": 0, "y": 0}, span=(0, 1))) == [Side.MINUS]


def test_the_table_has_a_row_for_each_point_and_a_value_for_each_piece() -> None:
    run = run_piecewise(fold, start={"x": -3, "y": -1}, span=(0, 4))
    table = run.as_json()
    assert table["variables"]["side"]["values"] == ["MINUS", "SLIDING", "PLUS"]
    assert table["variables"]["loss"]["values"] == ["", "VISIBLE_FOLD", ""]
    assert len(run.as_rows()) == run.t.size
    assert "sliding  t = 1 to 3" in str(run)
    assert "s < 0, sliding, s > 0" in repr(run)


@pytest.mark.exhaustive
def test_too_many_pieces_end_a_run() -> None:
    run = run_piecewise(belt, start={"x": 0, "u": 0.2}, span=(0, 100), phi=stribeck, max_pieces=3)
    assert len(run.pieces) == 3
    assert "raise max_pieces" in run.message


def test_wrong_calls_are_refused() -> None:
    with pytest.raises(GspError, match="forward in time"):
        run_piecewise(fold, start={"x": 0, "y": 0}, span=(1, 0))
    with pytest.raises(DeclarationError, match="no state"):
        run_piecewise(fold, start={"q": 0, "x": 0, "y": 0}, span=(0, 1))


@pytest.mark.exhaustive
@pytest.mark.parametrize("number", range(10))
def test_a_run_of_a_random_field_is_filippovs_by_scipy(number: int) -> None:
    """Both fields carry an oscillator, by which they push onto the curved surface at times, and away at others."""
    draw = np.random.default_rng(number)
    p, q, r, *numbers = [sp.Rational(int(k), 8) for k in draw.integers(-8, 9, 9)]
    push = sp.Rational(int(draw.integers(4, 12)), 8)
    a, b = numbers[:3], numbers[3:]
    plus, minus = (
        {x: z, y: k[0] * x + k[1] * z + k[2] * x * z - y / 4 + way * push, z: -2 * x}
        for k, way in ((a, -1), (b, 1))
    )
    surface = y + p / 2 * x**2 + q / 2 * sp.sin(z) + r / 2
    start = [*(draw.integers(-8, 9, 3) / 8 + 0.01)]
    signs, ends, last = filippov(plus, minus, surface, start, 10.0)
    run = run_piecewise(
        PiecewiseField(plus, minus, surface),
        start=dict(zip("xyz", start)),
        span=(0, 10),
        rtol=1e-11,
        atol=1e-12,
    )
    names = {1: Side.PLUS, -1: Side.MINUS, 0: Side.SLIDING}
    assert sides(run) == [names[sign] for sign in signs]
    assert [piece.run.t[-1] for piece in run.pieces] == pytest.approx(ends, abs=1e-8)
    assert run.pieces[-1].run.y[:, -1] == pytest.approx(last, abs=1e-8)


@pytest.mark.parametrize("unit", [sp.Integer(1), sp.Rational(1, 10**6), sp.Integer(10**6)])
@pytest.mark.parametrize("start", [-1.0, 0.0])
def test_where_the_rate_of_a_fold_is_zero_too_the_next_ones_decide(unit: sp.Expr, start: float) -> None:
    """Y+ = x^3 in units of x: it slides to x = 0 and leaves along y = x^4/4. By the first rate, 0 there, it ended."""
    cubic = PiecewiseField({x: 1 / unit, y: (unit * x) ** 3}, {x: 1 / unit, y: 1}, y)
    run = run_piecewise(cubic, start={"x": start / float(unit), "y": 0}, span=(0, 2))
    # Where rounding puts the fold a little early the run touches the surface once more, and goes on as it was.
    passed = [side for side, _ in groupby(sides(run))]
    assert passed == ([Side.SLIDING, Side.PLUS] if start else [Side.PLUS])
    assert run["y"][-1] == pytest.approx((2 + start) ** 4 / 4, rel=1e-8)


def test_a_run_that_cannot_begin_has_no_points() -> None:
    run = run_piecewise(PiecewiseField({x: 1, y: x}, {x: 1, y: -x}, y), start={"x": 0, "y": 0}, span=(0, 1))
    assert (run.pieces, run.t.size, run["x"].size) == ((), 0, 0)
    assert run.as_json()["dimensions"]["point"] == 0


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_a_run_does_not_depend_on_the_unit_of_its_states(unit: float) -> None:
    """A pendulum with dry friction that is pushed; where u = 0 it sticks, or turns and goes on from the surface."""
    x, u, c = sp.symbols("x u c")

    def changes(S: sp.Expr) -> tuple[float, ...]:
        push = 6 * sp.cos(7 * c / 10) / 5

        def rates(friction: sp.Rational) -> dict[sp.Symbol, sp.Expr]:
            return {x: u, u: S * (push - sp.sin(x / S) - friction) - u / 10, c: sp.S.One}

        field = PiecewiseField(rates(sp.Rational(2, 5)), rates(-sp.Rational(2, 5)), u)
        start = {"x": 0.3 * float(S), "u": 0.0, "c": 0.0}
        return run_piecewise(field, start=start, span=(0, 40)).changes

    assert changes(sp.Rational(str(unit))) == pytest.approx(changes(sp.S.One), rel=1e-8)
