"""Taylor polynomials in several variables, by SymPy's derivatives at the point."""

from __future__ import annotations

import itertools

import flint
import pytest
import sympy as sp

from gsp.algebra.algebraic_numbers import NumberField
from gsp.algebra.functions import RULES
from gsp.algebra.local_series import BITS, LocalRing, LocalSeries
from gsp.algebra.ring import read
from gsp.errors import HyperbolicityError
from tests.cases import sampled

x, y = sp.symbols("x y")
DEGREE = 3


def series(expression: sp.Expr, point: dict, ring: LocalRing) -> LocalSeries:
    environment = {
        s: ring.constant(sp.Rational(v)) + ring.variable(i) for i, (s, v) in enumerate(point.items())
    }
    return read(expression, ring, environment)


def by_derivatives(expression: sp.Expr, point: dict) -> dict:
    found = {}
    for m in itertools.product(range(DEGREE + 1), repeat=2):
        if sum(m) <= DEGREE:
            slope = sp.diff(expression, x, m[0], y, m[1]).subs(point) / sp.factorial(m[0]) / sp.factorial(m[1])
            found[m] = sp.simplify(slope)
    return found


EXPRESSIONS = {
    "a quotient": ((1 + x * y) / (2 + x - y**2), {x: sp.Rational(1, 2), y: 3}),
    "a product cut off": ((x + y) ** 5 - x**2 * y**2, {x: 0, y: 0}),
    "a root": (sp.sqrt(4 + x + x * y), {x: 0, y: 2}),
    "a power": ((1 + x) ** sp.Rational(1, 3) + (8 + y) ** sp.Rational(-2, 3), {x: 0, y: 0}),
    "a power that moves": ((1 + x) ** (2 + y), {x: 0, y: 0}),
}
EXPRESSIONS |= {
    name: (getattr(sp, name)((1 if name == "log" else 0) + x + y**2 - x * y), {x: 0, y: 0})
    for name, rule in RULES.items()
    if rule.at_zero is not None or name == "log"
}
# Functions by the same rules as others.
ONE_OF_EACH = set(EXPRESSIONS) - {"erf", "sinh", "asinh", "tanh", "atan", "asin", "atanh", "a quotient"}


@pytest.mark.parametrize("name", sampled((name for name in EXPRESSIONS if name != "erf"), always=ONE_OF_EACH))
def test_coefficients_are_derivatives_and_exact(name: str) -> None:
    expression, point = EXPRESSIONS[name]
    ring = LocalRing(2, DEGREE)
    found = {m: ring.expression(c) for m, c in series(expression, point, ring).terms()}
    assert ring.is_exact
    assert found == {m: c for m, c in by_derivatives(expression, point).items() if c != 0}


@pytest.mark.exhaustive
def test_values_outside_the_field_are_near_and_said_to_be() -> None:
    ring = LocalRing(2, DEGREE)
    expression, point = sp.exp(x) * sp.sin(y) + sp.erf(x * y), {x: 1, y: 2}
    found = {m: ring.expression(c) for m, c in series(expression, point, ring).terms()}
    assert not ring.is_exact
    wanted = by_derivatives(expression, point)
    assert found.keys() == wanted.keys()
    assert all(abs(sp.N(wanted[m] - c, 30)) < 1e-14 * abs(float(wanted[m])) for m, c in found.items())
    # sin^2 + cos^2 is 1 to rounding, so that nothing else is left.
    one = series(sp.sin(x) ** 2 + sp.cos(x) ** 2, point, ring)
    assert [(m, ring.expression(c)) for m, c in one.terms() if not ring.reduced(c).is_zero()] == [((0, 0), 1)]


@pytest.mark.exhaustive
def test_coefficients_may_be_in_a_number_field() -> None:
    root = sp.sqrt(2)
    ring = LocalRing(2, DEGREE, NumberField(flint.fmpq_poly([-2, 0, 1]), root))
    theta = ring.scalar(ring.element(flint.fmpq_poly([0, 1])))
    environment = {x: theta + ring.variable(0), y: ring.variable(1)}
    expression = (x**2 - 2 + y) / (x + y) + x**3
    found = {m: ring.expression(c) for m, c in read(expression, ring, environment).terms()}
    wanted = by_derivatives(expression, {x: root, y: 0})
    assert {m: sp.radsimp(c) for m, c in wanted.items() if sp.simplify(c) != 0} == {
        m: sp.expand(c) for m, c in found.items()
    }


def test_a_variable_is_replaced_by_a_series() -> None:
    ring = LocalRing(2, DEGREE)
    origin = {x: 0, y: 0}
    whole = series((1 + x + y) ** 3 / (1 - x), origin, ring)
    image = series(2 * y + y**2 - x**2, origin, ring)
    there = series((1 + (2 * y + y**2 - x**2) + y) ** 3 / (1 - (2 * y + y**2 - x**2)), origin, ring)
    assert (whole.with_variable(0, image) - there).is_zero
    assert [p.terms() for p in whole.without([1]).powers(1)][1:] == [[], [], []]


@pytest.mark.parametrize("expression", [1 / x, sp.Abs(x), sp.sqrt(x), sp.log(x)])
def test_there_is_no_series_where_the_function_is_not_smooth(expression: sp.Expr) -> None:
    with pytest.raises(HyperbolicityError):
        series(expression, {x: 0, y: 0}, LocalRing(2, DEGREE))


def test_numbers_that_are_not_exact_stay_as_short_as_they_are_known() -> None:
    # Fractions would double their length with each square.
    ring = LocalRing(1, 2)
    power = series(sp.exp(sp.Rational(-1, 3)) + x / 3, {x: 0}, ring)
    assert not ring.is_exact
    for _ in range(6):
        power = power * power
    top = flint.fmpq(power[0].leading_coefficient())
    assert max(int(top.p).bit_length(), int(top.q).bit_length()) <= 2 * BITS
    exact = sp.exp(sp.Rational(-64, 3))
    assert abs(sp.N(sp.Rational(int(top.p), int(top.q)) / exact - 1, 40)) < 1e-60
