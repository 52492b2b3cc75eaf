"""Where functions of a clock switch or peak is read off the rates."""

import pytest
import sympy as sp

from gsp.algebra.clocks import clocks
from gsp.algebra.sharing import plus, reciprocal, times

x, t, w = sp.symbols("x t w")


def polynomials(function: sp.Expr) -> tuple[set, set]:
    """The real zeros of the polynomials for `function` in the rate of x, beside a clock t."""
    (clock,) = clocks((x, t), (function - x, sp.S.One))
    assert clock.state == 1
    switches, peaks = (
        {root for z in of for root in sp.Poly(z.numbers, t).all_roots(multiple=True) if root.is_real}
        for of in (clock.switches, clock.peaks)
    )
    return switches, peaks


@pytest.mark.parametrize(
    ("function", "switches", "peaks"),
    [
        (sp.Piecewise((1, (t > 5) & (t < 6)), (0, True)), {5, 6}, set()),
        (sp.Heaviside(2 * t - 3, 0) * x, {sp.Rational(3, 2)}, set()),
        (sp.exp(-((t - 5) ** 2)), set(), {5}),
        (1 / (1 + 100 * (t - 4) ** 2), set(), {4}),
        (x / sp.cosh(9 * t - 18), set(), {2, sp.Rational(17, 9), sp.Rational(19, 9)}),
        (sp.tanh(2 * t - 2), set(), {1, sp.Rational(1, 2), sp.Rational(3, 2)}),
        (sp.exp(-sp.Max(0, 8 * t - 40)), {5}, {5, sp.Rational(39, 8), sp.Rational(41, 8)}),
        (sp.Max(0, 1 - sp.Abs(4 * t - 8)), {sp.Rational(7, 4), 2, sp.Rational(9, 4)}, set()),
        (x**2 * sp.exp(-1 / (t - 3) ** 2), set(), {2, 3, 4}),
        (sp.Max(0, t**2 - 4), {-2, 2}, set()),
        (sp.exp(-((t - 5) ** 8)), set(), {5}),
    ],
    ids=lambda of: "" if isinstance(of, set) else str(of),
)
def test_switches_and_peaks_of_functions_of_a_clock(function: sp.Expr, switches: set, peaks: set) -> None:
    assert polynomials(function) == (switches, peaks)


@pytest.mark.parametrize(
    ("function", "switches", "peaks"),
    [
        (sp.sign(sp.sin(3 * t + w) - w), [(3, w, 1, 0, -w)], []),
        (sp.exp(2 * sp.cos(t)), [], [(1, 0, 0, 2, 0), (1, 0, -2, 0, 0)]),
        (sp.Heaviside(sp.sin(t) + 2 * sp.cos(t) - 1, 0), [(1, 0, 1, 2, -1)], []),
        (sp.floor(t / 24), [(sp.pi / 24, 0, 1, 0, 0)], []),
        (sp.cos(t) ** 9, [], [(1, 0, 0, 1, 0), (1, 0, -1, 0, 0)]),
        (sp.sign(sp.atan(sp.tan(sp.pi * t / 24 - 1)) - w), [(sp.pi / 24, -1 - w, 1, 0, 0)], []),
    ],
    ids=str,
)
def test_switches_and_peaks_of_waves_of_a_clock(function: sp.Expr, switches: list, peaks: list) -> None:
    (clock,) = clocks((x, t), (function - x, sp.S.One))
    assert [z.numbers for z in clock.switches if z.is_wave] == switches
    assert [z.numbers for z in clock.peaks if z.is_wave] == peaks


@pytest.mark.parametrize(
    "function",
    [sp.cos(t), sp.cos(t) ** 2, t**3 * x, sp.Piecewise((1, t > x), (0, True)), sp.sign(t * sp.sin(t))],
    ids=str,
)
def test_what_switches_with_the_states_or_varies_all_along_has_no_places(function: sp.Expr) -> None:
    assert clocks((x, t), (function - x, sp.S.One)) == ()


@pytest.mark.parametrize(
    ("argument", "place"),
    [
        ((sp.log(t) - w) / 9, sp.exp(w)),
        (sp.sqrt(t) / 3 - 2 * w, 36 * w**2),
        (5 - 3 * 2**t, sp.log(sp.Rational(5, 3), 2)),
        ((t / 7) ** w - 3, 7 * 3 ** (1 / w)),
        (sp.exp(-sp.exp(-(t - 2) / w) + 3) - 1, 2 - w * sp.log(3)),
    ],
    ids=str,
)
def test_a_function_that_has_an_inverse_is_undone(argument: sp.Expr, place: sp.Expr) -> None:
    (clock,) = clocks((x, t), (sp.exp(-(argument**2)) - x, sp.S.One))
    at = {w: sp.Rational(7, 5)}
    places = [-z.numbers[1] / z.numbers[0] for z in clock.peaks]
    assert min(abs(sp.N((found - place).subs(at))) for found in places) < 1e-12


def test_what_never_is_has_no_place() -> None:
    (clock,) = clocks((x, t), (sp.exp(-((sp.exp(t) + 2) ** 2)) - x, sp.S.One))
    assert not any(number.has(sp.I) for z in clock.peaks for number in z.numbers)


def test_kinks_side_by_side_are_not_taken_in_every_way() -> None:
    """Twenty of them would make a million smooth functions."""
    table = sum(sp.Max(0, t - k) for k in range(20))
    (clock,) = clocks((x, t), (sp.exp(-table) - x, sp.S.One))
    assert len(clock.switches) == 20
    assert clock.peaks == ()


def test_zeros_that_are_close_are_zeros_of_their_own_polynomials() -> None:
    (clock,) = clocks((x, t), (sp.sign((t - 5) ** 2 - w**2 / 4) - x, sp.S.One))
    assert {z.numbers for z in clock.switches} == {(2, -w - 10), (2, w - 10)}


def test_what_a_program_shares_is_looked_at_once_and_has_the_places_of_its_formula() -> None:
    """Written out the rate would have 2^80 parts; `choose` on a forced model of order 2 ended in a defect."""
    argument = times(plus([times(sp.Integer(100), t), sp.Integer(-300)]), reciprocal(w))
    rate = plus([sp.tanh(argument), x])
    for _ in range(80):
        rate = plus([times(rate, rate), x])
    (clock,) = clocks((x, t), (rate, sp.S.One))
    assert [z.numbers for z in clock.peaks] == [(1, -3), (100, w - 300), (100, -w - 300)]
    assert clock.switches == ()


def test_a_state_whose_rate_moves_is_no_clock() -> None:
    pulse = sp.exp(-((t - 5) ** 2))
    assert clocks((x, t), (pulse - x, 1 + x)) == ()
    assert clocks((x, t), (pulse - x, sp.S.Zero)) == ()
    assert clocks((x, t), (pulse - x, 1 / w))[0].rate == 1 / w
