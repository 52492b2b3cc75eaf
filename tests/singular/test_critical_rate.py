"""Critical rates of ramps: formulas, runs on both sides, and always and never among the answers."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import DeclarationError
from gsp.singular.ramps.critical_rate import TippingVerdict, _verdict
from gsp.singular.ramps.ramped import RampError

x, l, r, mu, end = sp.symbols("x l r mu end")  # noqa: E741
PARABOLA = gsp.VectorField(states={x: (x + l) ** 2 - mu}, epsilon=None, parameters={l: 0, mu: 1, end: 3})
LOGISTIC = {l: l * (end - l)}

PAIRS = [
    (1, 3), (1, 2.5), (1, 2.1), (1, 10), (0.25, 1.1), (0.25, 4), (0.5, 1.5), (2, 3), (2, 7), (3, 3.6), (0.04, 0.5),
    (9, 6.5), (1.7, 5),
]  # fmt: skip


def parabola(m: float, length: float) -> gsp.CriticalRate:
    root = m**0.5
    return gsp.critical_rate(
        PARABOLA.with_parameters(mu=m, end=length), ramp=LOGISTIC,
        start={"x": -root, "l": 0}, edge={"x": root - length, "l": length},
    )  # fmt: skip


@pytest.mark.parametrize(("m", "length"), PAIRS)
def test_the_rates_of_the_parabola_have_a_formula(m: float, length: float) -> None:
    found = parabola(m, length)
    exact = 4 * m / (length * (length - 2 * m**0.5))
    assert found.verdict is TippingVerdict.ABOVE
    assert found.rates == (pytest.approx(exact, rel=1e-12),)
    assert found.error is not None
    assert found.error < 1e-12 * exact


@pytest.mark.parametrize("length", [0.5, 1.9])
def test_a_short_ramp_never_tips(length: float) -> None:
    found = parabola(1, length)
    assert (found.verdict, found.rate, found.error) == (TippingVerdict.NEVER, None, None)


@pytest.mark.parametrize("m", [1, 0.7, 3])
def test_a_linear_ramp_without_end_tips_at_mu(m: float) -> None:
    field = PARABOLA.with_parameters(mu=m)
    found = gsp.critical_rate(field, ramp={l: 1}, start={"x": -(m**0.5), "l": 0})
    assert found.verdict is TippingVerdict.ABOVE
    assert found.rate == pytest.approx(m, rel=1e-15)
    # Downwards the rest points part.
    back = gsp.critical_rate(field, ramp={l: -1}, start={"x": -(m**0.5), "l": 0})
    assert back.verdict is TippingVerdict.NEVER


u = sp.Symbol("u")


@pytest.mark.parametrize("unit", [1, sp.Rational(1, 10**9), 10**9])
@pytest.mark.parametrize(
    ("f", "rate"),
    [
        (-sp.sin(u), 1.0),
        (-u * sp.exp(-u), np.exp(-1)),
        (-sp.tanh(u) + u / 4, np.sqrt(0.75) - np.arccosh(2.0) / 4),
        # The rest point goes to infinity there.
        (-u / (1 + u), 1.0),
        (-2 * sp.tanh(u), 2.0),
        # It meets no other: f only bends at u = 1, has a pole there, falls for ever, and ends.
        (-((u - 1) ** 3) - 1, None),
        (1 - 1 / (1 - u) ** 2, None),
        (-sp.log(1 + u), None),
        (sp.sqrt(1 - u) - 1, None),
    ],
)
def test_a_ramp_without_end_tips_where_the_rest_point_of_its_frame_is_lost(f, rate: float | None, unit) -> None:
    """In any units, in which places where functions turn are as far apart; 7 units from the origin."""
    moved = gsp.VectorField({x: unit * f.xreplace({u: (x + l) / unit - 7})}, epsilon=None, parameters={l: 0})
    found = gsp.critical_rate(moved, ramp={l: 1}, start={"x": 7 * float(unit), "l": 0})
    assert found.verdict is (TippingVerdict.NEVER if rate is None else TippingVerdict.ABOVE)
    assert found.rate == (rate if rate is None else pytest.approx(rate * float(unit), rel=1e-13))


def test_a_bump_far_away_is_not_missed_where_algebra_tells_it() -> None:
    """-u + 3000/(1 + (u - 1000)^2) turns within 20 of u = 1000."""
    f = -u + 3000 / (1 + (u - 1000) ** 2)
    moved = gsp.VectorField({x: f.xreplace({u: x + l})}, epsilon=None, parameters={l: 0})
    found = gsp.critical_rate(moved, ramp={l: 1}, start={"x": 0.003, "l": 0})
    assert found.rate == pytest.approx(-float(f.subs(u, 981.865537882956)), rel=1e-13)


def test_a_long_linear_ramp_is_near_the_one_without_end() -> None:
    """u' = u^2 - 1 + r from -1 to 1 takes the time 2 atan(1/w)/w, w^2 = r - 1: that of the ramp, L/r."""
    length = 20.0
    found = gsp.critical_rate(
        PARABOLA, ramp={l: 1}, start={"x": -1, "l": 0}, edge={"x": 1 - length, "l": length}
    )
    assert found.rate is not None
    w = (found.rate - 1) ** 0.5
    assert 2 * np.arctan(1 / w) / w == pytest.approx(length / found.rate, rel=1e-12)


WELLS = gsp.VectorField(
    states={x: (x + l) * (1 - x - l) * (1 + x + l) + (x + l) ** 2 / 5}, epsilon=None, parameters={l: 0}
)


def test_a_double_well_tips_on_the_side_that_is_said() -> None:
    """Runs of x and l together, at rates a millionth below and above."""
    low, high = (sp.Rational(1, 10) - s * sp.sqrt(101) / 10 for s in (1, -1))
    assert float(low) < 0.0 < float(high)
    found = gsp.critical_rate(
        WELLS, ramp={l: l * (3 - l) * (1 + l / 4)}, start={"x": low, "l": 0}, edge={"x": -3, "l": 3}
    )
    assert (found.verdict, len(found.rates)) == (TippingVerdict.ABOVE, 1)
    assert found.rate is not None
    together = gsp.VectorField(
        states={x: WELLS.rates[0], l: r * l * (3 - l) * (1 + l / 4)}, epsilon=None, parameters={r: 1}
    )
    f_x, f_l = (float(WELLS.rates[0].diff(s).subs({x: low, l: 0})) for s in (x, l))
    slope = f_l / (3 * found.rate - f_x)
    begun = {"x": float(low) + slope * 1e-5, "l": 1e-5}  # along the unstable set
    ends = [
        gsp.integrate(
            together.with_parameters(r=found.rate * factor), start=begun, span=(0, 60), rtol=1e-11, atol=1e-13
        )["x"][-1] + 3
        for factor in (1 - 1e-6, 1 + 1e-6)
    ]  # fmt: skip
    assert ends == [pytest.approx(float(low)), pytest.approx(float(high))]


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(6))
def test_no_verdict_is_wrong_about_wells_that_move_to_and_fro(seed: int) -> None:
    """Where the end of runs over l changes between rates there is one of those found, unless it is undecided."""
    drawn = np.random.default_rng(seed)
    a, b, c, d = (sp.Rational(int(k), 10) for k in drawn.integers(-20, 21, size=4))
    u = x + 3 * (a * l + b * l**2 + c * sp.sin(3 * l) / 2)
    rate = u - u**3 + d * l * (1 - l) / 3
    end = -float(u.subs({x: 0, l: 1}))
    field = gsp.VectorField(states={x: rate}, epsilon=None, parameters={l: 0})
    found = gsp.critical_rate(field, ramp={l: 1}, start={"x": -1, "l": 0}, edge={"x": end, "l": 1})
    over = gsp.VectorField(states={x: rate / r, l: 1}, epsilon=None, parameters={r: 1})
    tried = np.logspace(-1.5, 1.5, 31)
    above = [
        gsp.integrate(over.with_parameters(r=value), start={"x": -1, "l": 0}, span=(0, 1), rtol=1e-9)["x"][-1]
        > end
        for value in tried
    ]
    changes = [(p, q) for p, q, i, j in zip(tried, tried[1:], above, above[1:]) if i != j]
    between = [value for value in found.rates if tried[0] < value < tried[-1]]
    if found.verdict is not TippingVerdict.UNDECIDED:
        assert len(changes) == len(between)
        assert all(p <= value <= q for (p, q), value in zip(changes, between))


def test_a_ramp_past_a_fold_always_tips() -> None:
    cubic = gsp.VectorField(states={x: x - x**3 + l}, epsilon=None, parameters={l: 0})
    found = gsp.critical_rate(cubic, ramp={l: 1 - l**2}, start={"x": -1.3247, "l": -1}, edge={"x": 0, "l": 1})
    assert found.verdict is TippingVerdict.ALWAYS
    assert "a fold on the way" in found.message


@pytest.mark.exhaustive
def test_a_push_that_ends_soon_enough_does_not_tip() -> None:
    """x' = x^2 - 1 + 8 l (1 - l): no rest point half way, and the one of the start where the ramp ends."""
    pushed = gsp.VectorField(states={x: x**2 - 1 + 8 * l * (1 - l)}, epsilon=None, parameters={l: 0})
    found = gsp.critical_rate(pushed, ramp={l: 1}, start={"x": -1, "l": 0}, edge={"x": 1, "l": 1})
    assert (found.verdict, len(found.rates)) == (TippingVerdict.BELOW, 1)
    assert found.rate is not None
    for factor, reached in ((1 - 1e-6, True), (1 + 1e-6, False)):
        rate = found.rate * factor
        over = gsp.VectorField(states={x: pushed.rates[0] / rate, l: 1}, epsilon=None)
        run = gsp.integrate(over, start={"x": -1, "l": 0}, span=(0, 1), rtol=1e-11, atol=1e-13)
        assert (run["x"][-1] > 1) == reached


@pytest.mark.exhaustive
def test_a_branch_that_folds_is_not_followed_on_another_sheet() -> None:
    """Cessi's two boxes under a pulse of fresh water past a fold: slow pulses tip, and fast ones are over too soon."""
    flux = sp.Rational(11, 10) + l - x * (1 + sp.Rational(62, 10) * (1 - x) ** 2)
    boxes = gsp.VectorField(states={x: flux}, epsilon=None, parameters={l: 0})
    pulse = gsp.Ramp.there_and_back({l: (0, sp.Rational(2, 5))})
    found = gsp.critical_rate(boxes, ramp=pulse, start={"x": 0.24}, edge={"x": 0.69})
    assert (found.verdict, len(found.rates)) == (TippingVerdict.BELOW, 1)
    assert found.rate is not None
    far = [found.run(factor * found.rate, after=50)["x"][-1] > 1 for factor in (0.999, 1.001)]
    assert far == [True, False]


def test_the_orbit_leads_from_the_start_to_the_edge() -> None:
    found = parabola(2, 7)
    (orbit,) = found.connections
    assert (orbit.phase[0], orbit.x[0]) == (0.0, pytest.approx(-(2**0.5)))
    assert (orbit.phase[-1], orbit.x[-1]) == (7.0, pytest.approx(2**0.5 - 7))
    assert orbit.x == pytest.approx(orbit.x[0] + (orbit.x[-1] - orbit.x[0]) * orbit.phase / 7, abs=1e-12)


def test_units_do_not_matter() -> None:
    field = gsp.VectorField(
        states={x: 1000 * ((x / 1000 + l * 1e6) ** 2 - 1) * 60}, epsilon=None, parameters={l: 0}
    )
    found = gsp.critical_rate(
        field, ramp={l: l * (3e-6 - l)}, start={"x": -1000, "l": 0}, edge={"x": -2000, "l": 3e-6}
    )
    assert found.rate == pytest.approx(4 / 3 * 60 * 1e6, rel=1e-12)


@pytest.mark.parametrize(
    ("tips", "count", "verdict"),
    [
        ((False, True), 1, TippingVerdict.ABOVE),
        ((True, False), 1, TippingVerdict.BELOW),
        ((False, False), 2, TippingVerdict.WINDOWS),
        ((False, True), 3, TippingVerdict.WINDOWS),
        ((False, False), 0, TippingVerdict.NEVER),
        ((True, True), 0, TippingVerdict.ALWAYS),
        ((False, True), 0, TippingVerdict.UNDECIDED),
        ((False, False), 1, TippingVerdict.UNDECIDED),
    ],
)
def test_the_verdict_counts_rates_between_slow_and_fast(tips, count, verdict) -> None:
    assert _verdict(tips, count)[0] is verdict


@pytest.mark.parametrize(
    ("given", "error", "said"),
    [
        ({"start": {"x": 1, "l": 0}}, RampError, "no attracting rest point"),
        # What was given, and not where Newton's method went from there.
        ({"start": {"x": 5, "l": 0}}, RampError, r"no attracting rest point .* Got x = 5, l = 0\."),
        ({"edge": {"x": -4, "l": 3}}, RampError, "no repelling rest point"),
        ({"edge": {"x": -3, "l": 4}}, RampError, "does not lead"),
        ({"ramp": {l: l**2 * (3 - l)}}, RampError, "multiple zero"),
        ({"ramp": {l: l * (3 - l)}, "edge": None}, RampError, "moving frame"),
        ({"ramp": {r: 1}}, DeclarationError, "one parameter of the field"),
        ({"ramp": {l: r}}, DeclarationError, "holds r"),
        ({"start": {"x": -1}}, DeclarationError, "start names x and l"),
    ],
)
def test_a_ramp_that_cannot_be_told_is_refused_by_name(given: dict, error: type, said: str) -> None:
    whole = {"ramp": LOGISTIC, "start": {"x": -1, "l": 0}, "edge": {"x": -2, "l": 3}, **given}
    with pytest.raises(error, match=said):
        gsp.critical_rate(PARABOLA, **whole)


@pytest.mark.exhaustive
def test_a_ramp_there_and_back_past_two_folds_ends_where_it_began() -> None:
    """Grazing: at c = 1 there is one rest point that attracts, at c = 2.8 another one, and no ramp tips."""
    v, c = sp.symbols("v c")
    field = gsp.VectorField({v: v * (1 - v / 10) - c * v**2 / (1 + v**2)}, epsilon=None, parameters={c: 1})
    ramp = gsp.Ramp.there_and_back({c: (1, 2.8)})
    found = gsp.critical_rate(field, ramp=ramp, start={"v": 8.5}, edge={"v": 2.9})
    assert (found.verdict, found.rates) == (TippingVerdict.NEVER, ())
    # The edge state that was taken is told, without rounding.
    assert "edge v = 0, c = 1" in str(found)
    runs = [found.run(rate, after=200.0) for rate in (0.002, 0.5)]
    assert [float(run["v"][-1]) for run in runs] == pytest.approx(2 * [found.start["v"]], rel=1e-3)
    assert runs[0]["v"].min() < 1.0 < runs[1]["v"].min()
    # From where no rest point repels there is no edge state at all.
    alone = gsp.critical_rate(field, ramp=ramp, start={"v": 8.5}, edge={"v": 5.5})
    assert alone.verdict is TippingVerdict.NEVER


def test_a_ramp_there_and_back_past_one_fold_of_two_leaves_its_branch() -> None:
    """x' = p + x - x^3/3 with p to 2 and back: slow ramps come back on the other branch, fast ones on their own."""
    found = gsp.critical_rate(
        gsp.VectorField({x: l + x - x**3 / 3}, epsilon=None, parameters={l: 0}),
        ramp=gsp.Ramp.there_and_back({l: (0, 2)}), start={"x": -1.7}, edge={"x": 0},
    )  # fmt: skip
    assert found.verdict is TippingVerdict.BELOW
    ends = [float(found.run(share * found.rates[0], after=60.0)["x"][-1]) for share in (0.99, 1.01)]
    assert ends == pytest.approx([np.sqrt(3), -np.sqrt(3)], abs=1e-3)
    assert "edge x = 0, l = 0" in str(found)


@pytest.mark.parametrize("origin", [0, 5, -1000])
def test_a_ramp_there_and_back_past_both_folds_comes_back_from_any_origin(origin: int) -> None:
    """x' = 4 l x^2/(1 + x^2) - x + l/10 rests at 0 alone without l, also where that is written as 0."""
    X = x - origin
    found = gsp.critical_rate(
        gsp.VectorField({x: 4 * l * X**2 / (1 + X**2) - X + l / 10}, epsilon=None, parameters={l: 0}),
        ramp=gsp.Ramp.there_and_back({l: (0, 1)}), start={"x": origin}, edge={"x": origin + 1},
    )  # fmt: skip
    assert found.verdict is TippingVerdict.NEVER


def test_a_ramp_without_end_tells_its_start() -> None:
    field = gsp.VectorField({x: (x + l) ** 2 - 1}, epsilon=None, parameters={l: 0})
    assert "start x = -1, l = 0" in str(gsp.critical_rate(field, ramp=gsp.Ramp.linear({l: 0}), start={"x": -1}))


def test_the_command_draws_the_first_ramp_with_a_threshold_and_tells_them_all(tmp_path) -> None:
    from click.testing import CliRunner

    from gsp.cli import cli

    never = '[ramps.a]\nprofile = "there and back"\nparameters = {l = [0, 0.5]}\nedge = {x = 1}\n'
    tips = '[ramps.b]\nprofile = "logistic"\nparameters = {l = [0, 3]}\nedge = {x = -2}\n'
    head = '[parameters]\nl = 0\n[states]\nx = "(x + l)^2 - 1"\n[start]\nx = -1\n[scene]\nspan = [0, 5]\n'
    file, chart = tmp_path / "model.toml", tmp_path / "chart.svg"
    file.write_text(head + never + tips)
    done = CliRunner().invoke(cli, ["ramp", str(file), "-o", str(chart)])
    assert done.exit_code == 0
    assert chart.is_file()
    chart.unlink()
    file.write_text(head + never)
    done = CliRunner().invoke(cli, ["ramp", str(file), "-o", str(chart)])
    # What is known is told, though nothing can be drawn.
    assert "a: never tips" in done.output
    assert done.exit_code != 0
    assert not chart.exists()


@pytest.mark.parametrize(("unit_x", "unit_y"), [("1", "0.001"), ("1000000000", "1")])
def test_the_rate_of_a_level_does_not_depend_on_the_units_of_the_states(unit_x: str, unit_y: str) -> None:
    """The start x = 0 stays where it is along the ramp, so that nothing but rounding is left of x there."""
    X, Y, r, epsilon = sp.symbols("X Y r epsilon")

    def rate(a: sp.Expr, b: sp.Expr) -> float | None:
        push = (Y / b + r + X / a * (X / a - 1)) / epsilon
        field = gsp.VectorField({X: a * push, Y: -b * X / a}, epsilon=epsilon, parameters={r: 0})
        ramp = gsp.Ramp.tanh({r: (0, sp.Rational(1, 2))})
        level = {"X": 3 * float(a)}
        return gsp.critical_rate(field, ramp=ramp, start={"X": 0, "Y": 0}, edge=level, epsilon=0.05).rate

    assert rate(sp.Rational(unit_x), sp.Rational(unit_y)) == pytest.approx(3.92920200395, rel=1e-10)


@pytest.mark.parametrize("far", [10**6, -(10**6)])
def test_a_ramp_far_from_the_origin_has_the_same_rate(far: int) -> None:
    """Its state, its parameter and both; the error is that of the ramp at the origin."""
    near = parabola(1, 3)
    for states, moved in ((far, 0), (0, far), (-far, far)):
        field = gsp.VectorField({x: (x - states + l - moved) ** 2 - 1}, epsilon=None, parameters={l: moved})
        found = gsp.critical_rate(
            field, ramp={l: (l - moved) * (3 + moved - l)},
            start={"x": states - 1, "l": moved}, edge={"x": states - 2, "l": moved + 3},
        )  # fmt: skip
        assert found.rate == pytest.approx(near.rate, rel=1e-13)
        assert found.error is not None
        assert found.error < 1e-12
        assert found.start == {"x": states - 1, "l": moved}
        run = found.run(0.9 * found.rate)
        assert [run["x"][0], run["x"][-1]] == pytest.approx([states - 1, states - 4], abs=1e-3)
        assert found.connections[0].phase[[0, -1]] == pytest.approx([moved, moved + 3], rel=1e-15)
    assert f"x = {states - 1}" in str(found)


def test_a_state_ten_units_away_has_an_error_that_holds() -> None:
    """The formula is 4/3; what rounding of x does to it was left out."""
    far = gsp.VectorField({x: (x + l - 10) ** 2 - 1}, epsilon=None, parameters={l: 0})
    found = gsp.critical_rate(far, ramp={l: l * (3 - l)}, start={"x": 9, "l": 0}, edge={"x": 8, "l": 3})
    assert found.rate is not None
    assert found.error is not None
    assert abs(found.rate - 4 / 3) <= found.error < 1e-12


@pytest.mark.parametrize("first", [sp.Rational(1, 5), sp.Rational(7, 10), 300])
def test_a_parameter_that_comes_back_is_told_without_the_rounding_of_its_ends(first: sp.Expr) -> None:
    """l - 1/5 is what a lake's load is to its state; there is one rest point more behind the hump."""
    field = gsp.VectorField(
        {x: l - first + sp.Rational(1, 5) - 3 * x / 5 + x**4 / (1 + x**4)}, parameters={l: first}
    )
    ramp = gsp.Ramp.there_and_back({l: (first, first + sp.Rational(3, 10))})
    found = gsp.critical_rate(field, ramp=ramp, start={"x": 0.35}, edge={"x": 0.75})
    assert str(found).count(f"l = {float(first):g}") == 2
    # By SciPy's runs, bisected.
    assert abs((found.rate or 0.0) - 1.909974183) < 1e-8


@pytest.mark.parametrize(
    ("ends", "words"), [((1, -2), "where the ramp begins"), ((-1, -4), "where the ramp ends")]
)
def test_ends_that_are_no_rest_points_say_where_to_give_one(ends: tuple[int, int], words: str) -> None:
    field = gsp.VectorField({x: (x + l) ** 2 - 1}, parameters={l: 0})
    ramp = gsp.Ramp.logistic({l: (0, 3)})
    with pytest.raises(RampError, match=f"Give a place near one that there is {words}"):
        gsp.critical_rate(field, ramp=ramp, start={"x": ends[0]}, edge={"x": ends[1]})
