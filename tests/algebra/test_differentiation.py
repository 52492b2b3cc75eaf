"""Derivatives of powers where their base vanishes, where SymPy's own are 0/0."""

from __future__ import annotations

import pytest
import sympy as sp

from gsp.algebra.bounded_quotients import bounded
from gsp.algebra.differentiation import derivative, gathered_derivative
from gsp.algebra.sharing import plus, times

u, v, n, K = sp.symbols("u v n K")
POWERS = [
    u**n,
    (u / 40) ** n,
    (u / K) ** n,
    (u * v / K) ** n,
    ((u - v) / K) ** (2 * n),
    (u**2 / K) ** n,
    u * u**n,
    1 / (1 + (u / K) ** n),
    (u / K) ** n / (1 + (u / K) ** n),
    sp.exp(sp.sin((u / K) ** n)),
    (1 + u * v) ** n * (u / K) ** n,
]


@pytest.mark.exhaustive
@pytest.mark.parametrize("times", [1, 2])
@pytest.mark.parametrize("power", POWERS, ids=str)
def test_a_power_with_a_symbol_in_its_exponent_has_the_derivative_of_the_written_one(power, times: int) -> None:
    slope, written = power, power.xreplace({n: sp.Integer(2)})
    for _ in range(times):
        slope, written = derivative(slope, u), sp.diff(written, u)
    for place in (0, sp.Rational(1, 3)):
        # Each part is worked out by itself, as machine code does it.
        there = {u: sp.Float(place), v: sp.Float(0.5), K: sp.Float(4), n: sp.Float(2)}
        assert float(slope.xreplace(there)) == pytest.approx(float(written.subs(there)), rel=1e-12), slope


@pytest.mark.parametrize("power", [(u * v) ** sp.Rational(3, 2), ((u / K) ** 2) ** sp.Rational(3, 2)], ids=str)
def test_a_broken_power_of_a_product_has_a_slope_where_a_factor_vanishes(power) -> None:
    assert derivative(power, u).xreplace({u: sp.Float(0), v: sp.Float(0.5), K: sp.Float(4)}) == 0


def test_the_slope_in_the_exponent_is_the_logarithm_s() -> None:
    assert derivative(u**n, n) == u**n * sp.log(u)
    assert derivative((v / 3) ** u, u) == (v / 3) ** u * sp.log(v / 3)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "expression",
    [
        u * v * (u + v + K) * (K - u) ** 2,
        (u + v) / (K + u * v),
        sp.sqrt(u + v) * sp.exp(-u) / (1 + u**2) ** 3,
        sp.sin(u * (u + v)) * (u + v) ** -1,
        K * (u - v) * sp.tanh((u - K) / v) * sp.cosh((u - K) / v),
        sp.atan2(u, v * u) + sp.floor(u * v) + sp.Function("f")(u * v, u),
        3 * (u - v) * (2 * u + K) / (7 * u),
    ],
    ids=str,
)
def test_products_and_sums_have_the_slope_that_sympy_gives_in_the_same_form(expression) -> None:
    for symbol in (u, v, K):
        assert derivative(expression, symbol) == sp.diff(expression, symbol)


def test_a_sum_that_stands_in_many_rates_is_gone_through_once(monkeypatch: pytest.MonkeyPatch) -> None:
    names = sp.symbols("w:40")
    total = sp.Add(*(sp.sin(w * u) for w in names))
    asked = []
    differentiate = sp.sin.fdiff
    monkeypatch.setattr(sp.sin, "fdiff", lambda *given: asked.append(given) or differentiate(*given))
    for w in names:
        assert derivative(w * total * (K + v), u).has(sp.cos)
    assert len(asked) <= len(names)


@pytest.mark.parametrize(
    "expression",
    [
        u / sp.sqrt(1 + u**2) + n,
        -3 * v * (K - u) / sp.sqrt(1 + (K - u) ** 2),
        (v * u) ** 2 * u**4 / (K**4 + u**4),
        u * sp.tanh(u) / (1 + u + u**2 / K) ** 2,
        u**2 * (1 - u) / ((1 + u**2) * (K + u)),
        v / (1 + u),
    ],
    ids=str,
)
def test_a_gathered_slope_is_the_slope(expression) -> None:
    point = {u: sp.Rational(7, 5), v: 2, n: 3, K: sp.Rational(9, 4)}
    for symbol in (u, v, K):
        found = gathered_derivative(expression, symbol).xreplace(point)
        assert abs(sp.N(found - derivative(expression, symbol).xreplace(point), 30)) < 1e-25


def test_what_cancels_in_a_gathered_slope_is_not_there() -> None:
    assert gathered_derivative(v * u / sp.sqrt(1 + u**2), u) == v * (1 + u**2) ** sp.Rational(-3, 2)
    assert gathered_derivative(u**2 / (K + u**2), u) == 2 * K * u / (K + u**2) ** 2


def test_parts_that_are_shared_are_looked_at_once() -> None:
    """e = e^2 + 1, forty times: what writes e out does not end. Its product with a function of v has one slope."""
    e = u
    for _ in range(40):
        e = plus([times(e, e), sp.S.One])
    slope = derivative(sp.Mul(sp.sin(v), e, evaluate=False), v)
    assert e in slope.args
    assert sp.cos(v) in slope.args
    kink = sp.Mul(sp.Abs(v), e, evaluate=False)
    assert e in derivative(kink, v).args
    assert sp.sign(v) in derivative(kink, v).args
    quotient = sp.Mul(plus([e, sp.exp(v)]), sp.Pow(1 + sp.exp(v), -1), evaluate=False)
    assert quotient.free_symbols == bounded(quotient, {}).free_symbols


@pytest.mark.parametrize("power", [sp.Rational(1, 2), sp.Rational(1, 3), sp.Rational(3, 2), n])
@pytest.mark.parametrize("whole", [1, 2, 3])
@pytest.mark.parametrize("base", [u, v - u, 2 * u - v])
def test_a_slope_of_powers_of_a_size_exists_where_it_vanishes(base, whole: int, power) -> None:
    """That of u sqrt|u| was 0/0 at u = 0."""
    expression = K * base**whole * sp.Abs(base) ** power
    slope = derivative(expression, u).subs({K: 3, n: sp.Rational(1, 4)})
    assert slope.subs({u: 0, v: 0}) == 0
    size = whole + power.subs(n, sp.Rational(1, 4))
    for at in (-2, 2):
        point = {u: (at + 1) / sp.diff(base, u) if base.has(v) else at, v: 1 if base == 2 * u - v else -1}
        value = base.subs(point)
        expected = 3 * size * sp.sign(value) ** (whole + 1) * sp.Abs(value) ** (size - 1) * sp.diff(base, u)
        assert sp.N(slope.subs(point) - expected) == pytest.approx(0, abs=1e-12)
