"""Power series in epsilon over the ring: every node equals the Taylor coefficients SymPy finds."""

import pytest
import sympy as sp

from gsp.algebra.functions import RULES
from gsp.algebra.power_series import SeriesProgram
from gsp.algebra.ring import LocalisedRing, read

x, y, a, eps = sp.symbols("x y a epsilon")
ORDER = 4


def coefficients(expression: sp.Expr, inner: sp.Expr) -> list[sp.Expr]:
    """Coefficients of `expression` with y = `inner`(x, epsilon), by the program."""
    ring = LocalisedRing([x], constants=[a], functions=True, derivations=1)
    ring.set_derivative(x, 0, ring.one)
    known = [read(sp.diff(inner, eps, k).subs(eps, 0) / sp.factorial(k), ring, {}) for k in range(ORDER + 1)]
    program = SeriesProgram(ring, epsilon=eps, inputs={y: known}, constants={})
    node = program.compile(expression)
    for k in range(ORDER + 1):
        program.extend(k)
    return [ring.to_sympy(c.reduced()) for c in node.coefficients]


def check(expression: sp.Expr, inner: sp.Expr) -> None:
    full = expression.subs(y, inner)
    point = {x: sp.Rational(2, 7), a: sp.Rational(3, 2)}
    for k, got in enumerate(coefficients(expression, inner)):
        expected = sp.diff(full, eps, k).subs(eps, 0) / sp.factorial(k)
        assert abs(sp.N((got - expected).subs(point), 30)) < 1e-18, (k, got, expected)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", sorted(set(RULES) - {"sign"}))
def test_functions_of_a_series_have_the_taylor_coefficients_that_sympy_finds(name: str) -> None:
    function = getattr(sp, name)
    inner = {"acosh": 2 + x, "asin": x / 2, "acos": x / 2, "atanh": x / 2}.get(name, 1 + x) + eps * x - eps**2
    check(function(y), inner)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "expression",
    [
        y**5 - a * y * eps,
        1 / (1 + y + eps * x) ** 2,
        y ** sp.Rational(3, 2),
        y ** sp.Rational(-1, 3),
        y**a,
        (1 + eps * y) ** y,
        sp.exp(sp.sin(y)) * x,
        (x + eps) / (y - eps / (1 + eps)),
    ],
)
def test_powers_quotients_and_compositions_have_the_right_coefficients(expression: sp.Expr) -> None:
    check(expression, 1 + x + eps * (x - 2) + 3 * eps**2)


def test_the_absolute_value_follows_the_sign_of_the_leading_term() -> None:
    inner = -1 - x + eps * x
    got = coefficients(sp.Abs(y) * y, inner)
    expected = sp.Poly(sp.expand(-(inner**2)), eps).all_coeffs()[::-1]
    point = {x: sp.Rational(2, 7)}
    assert [sp.expand(c.subs(point)) for c in got[:3]] == [c.subs(point) for c in expected]


def test_extending_an_order_twice_replaces_it() -> None:
    ring = LocalisedRing([x], derivations=1)
    known = [ring.generator(x), ring.zero]
    program = SeriesProgram(ring, epsilon=eps, inputs={y: known}, constants={})
    node = program.compile(y**2)
    program.extend(0)
    program.extend(1)
    assert node.coefficients[1].is_zero
    known[1] = ring.one
    program.extend(1)
    assert ring.to_sympy(node.coefficients[1]) == 2 * x


@pytest.mark.parametrize(
    "exponent", [sp.Rational(1, n) for n in (2, 3, 5)] + [sp.Rational(-1, 2), sp.Rational(2, 3)]
)
def test_roots_are_those_of_their_exponent(exponent: sp.Expr) -> None:
    check((1 + y) ** exponent, 3 + x + eps)
