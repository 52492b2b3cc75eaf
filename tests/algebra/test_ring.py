"""The localised ring: field operations, derivations and adjoined functions agree with SymPy."""

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gsp.algebra.functions import RULES, are_rational
from gsp.algebra.polynomials import LONGEST
from gsp.algebra.ring import LocalisedRing, read
from gsp.algebra.ring_elements import power
from gsp.errors import HyperbolicityError, UnsupportedFunctionError
from tests.cases import sampled

x, a = sp.symbols("x a")


def ring_for(*expressions: sp.Expr) -> LocalisedRing:
    ring = LocalisedRing([x], constants=[a], functions=True, derivations=1)
    ring.set_derivative(x, 0, ring.one)
    return ring


def same(left: sp.Expr, right: sp.Expr, at: float = 0.37) -> bool:
    point = {x: sp.Float(at, 40), a: sp.Float("1.3", 40)}
    return abs(sp.N(left.subs(point) - right.subs(point), 30)) < 1e-20 * (1 + abs(sp.N(right.subs(point), 30)))


integers = st.integers(-4, 4)


@st.composite
def rational_functions(draw: st.DrawFn) -> sp.Expr:
    top = sum(draw(integers) * x**i * a**j for i in range(3) for j in range(2))
    bottom = 1 + x**2 * draw(st.integers(0, 3)) + draw(st.integers(1, 3)) * a**2
    return sp.sympify(top) / bottom


@pytest.mark.exhaustive
@settings(max_examples=20)
@given(rational_functions(), rational_functions())
def test_sums_products_and_derivatives_agree_with_sympy(f: sp.Expr, g: sp.Expr) -> None:
    ring = ring_for(f, g)
    F, G = read(f, ring, {}), read(g, ring, {})
    assert same(ring.to_sympy((F + G).reduced()), f + g)
    assert same(ring.to_sympy((F * G - F).reduced()), f * g - f)
    assert same(ring.to_sympy(ring.derive(F * G, 0).reduced()), sp.diff(f * g, x))


@pytest.mark.exhaustive
@settings(max_examples=30)
@given(rational_functions())
def test_the_inverse_times_the_element_is_one(f: sp.Expr) -> None:
    if sp.cancel(f) == 0:
        return
    ring = ring_for(f)
    element = read(f, ring, {})
    assert ring.to_sympy((element * element.inverse()).reduced()) == 1


@settings(max_examples=30)
@given(rational_functions())
def test_horner_form_has_the_value_of_the_element(f: sp.Expr) -> None:
    ring = ring_for(f)
    assert same(ring.horner(read(f, ring, {}).reduced()), f)


def test_an_element_is_written_once_for_the_sizes_that_are_known() -> None:
    ring = ring_for(x)
    element = read((x**90 + a) / (x - a), ring, {}).reduced()
    first = element.written()
    assert first is element.written()
    assert first == ring.horner(element)
    ring.sizes = {x: 40}
    assert element.written() == ring.horner(element) != first


def test_a_common_factor_is_divided_out_exactly() -> None:
    ring = ring_for(x)
    element = read((x**2 - a**2) / (x - a) ** 3, ring, {}).reduced()
    assert ring.to_sympy(element) == (a + x) / (x - a) ** 2


def test_dividing_by_what_vanishes_is_an_error() -> None:
    ring = ring_for(x)
    with pytest.raises(HyperbolicityError, match="vanishes identically"):
        (read(x, ring, {}) - read(x, ring, {})).inverse()


@pytest.mark.parametrize("name", sorted(RULES))
def test_every_adjoined_function_has_the_derivative_that_sympy_gives(name: str) -> None:
    argument = {"acosh": 2 + x**2, "asin": x / 3, "acos": x / 3, "atanh": x / 3}.get(name, 1 + a * x)
    f = getattr(sp, name)(argument)
    ring = ring_for(f)
    got = ring.to_sympy(ring.derive(read(f, ring, {}), 0).reduced())
    assert same(got, sp.diff(f, x) if name != "sign" else sp.Integer(0))
    assert same(ring.to_sympy(read(f, ring, {})), f)


@pytest.mark.parametrize(
    "f",
    [
        sp.sqrt(1 + x**2) ** 3,
        (1 + x**2) ** sp.Rational(-2, 3),
        x**a,
        (1 + x) ** (x / 2),
        sp.exp(x) * sp.exp(-x) + sp.exp(2 * x),
        sp.sqrt(2) * sp.pi * x,
        sp.Abs(x - 3) * x,
        sp.E**x + sp.E,
    ],
)
def test_powers_roots_and_constants_differentiate_as_in_sympy(f: sp.Expr) -> None:
    ring = ring_for(f)
    got = ring.to_sympy(ring.derive(read(f, ring, {}), 0).reduced())
    point = {x: sp.Rational(37, 100), a: sp.Rational(13, 10)}
    # At the point x < 3, where |x - 3| is 3 - x.
    expected = sp.diff(f.replace(sp.Abs, lambda u: -u), x)
    assert abs(sp.N((got - expected).subs(point), 30)) < 1e-20


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        (sp.sqrt(1 + x) ** 2 - x, 1),
        (sp.sin(x) ** 2 + sp.cos(x) ** 2, 1),
        (sp.cosh(x) ** 2 - sp.sinh(x) ** 2, 1),
        (sp.exp(x) * sp.exp(-x), 1),
        ((1 + x) ** sp.Rational(1, 3) * (1 + x) ** sp.Rational(2, 3) - x, 1),
    ],
)
def test_algebraic_relations_between_functions_are_used(expression: sp.Expr, value: int) -> None:
    ring = ring_for(expression)
    assert ring.to_sympy(read(expression, ring, {}).reduced()) == value


def test_an_unknown_function_is_named_with_those_that_are_known() -> None:
    ring = ring_for(x)
    with pytest.raises(UnsupportedFunctionError, match=r"gamma\(x\) has no power series rule.*tanh"):
        read(sp.gamma(x), ring, {})


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "f",
    [
        sp.Abs(x - 3) * sp.sign(x),
        sp.sign(3 - 2 * x) + sp.sign(2 * x - 3) + sp.sign(4 * x - 6),
        sp.Max(x, 2 - x, a * x**2),
        sp.Min(x, 2 - x) * sp.Max(1, sp.Abs(x)),
        sp.Heaviside(a - x) / (2 + sp.sign(x)),
    ],
)
def test_functions_with_a_kink_have_their_real_values_and_derivatives_off_it(f: sp.Expr) -> None:
    ring = ring_for(f)
    element = read(f, ring, {})
    value, slope = ring.to_sympy(element), ring.to_sympy(ring.derive(element, 0).reduced())
    step = sp.Rational(1, 10**12)
    for at in (sp.Rational(-7, 3), sp.Rational(2, 7), sp.Rational(9, 5), sp.Rational(17, 4)):
        put = {a: sp.Rational(13, 10)}
        assert value.subs({x: at, **put}) == f.subs({x: at, **put})
        # Pieces are at most quadratic (times a constant), so that a central difference is their slope.
        difference = (f.subs({x: at + step, **put}) - f.subs({x: at - step, **put})) / (2 * step)
        assert slope.subs({x: at, **put}) == difference


def test_the_square_of_a_sign_is_one_and_a_distance_is_shown_as_one() -> None:
    ring = ring_for(sp.Abs(x - a))
    element = read(sp.Abs(x - a), ring, {})
    assert sp.expand(ring.to_sympy((element * element).reduced()) - (a - x) ** 2) == 0
    assert ring.to_sympy((element.inverse() * element).reduced()) == 1
    assert ring.to_sympy(element) in (sp.Abs(x - a), sp.Abs(a - x))


def test_the_function_that_an_error_names_is_the_first_one_met() -> None:
    f = sp.besselj(0, x) + sp.gamma(sp.zeta(x)) + sp.zeta(x)
    with pytest.raises(UnsupportedFunctionError) as first:
        are_rational([f])
    name = str(first.value).split(" has ")[0]
    assert name == next(str(e) for e in sp.preorder_traversal(f) if isinstance(e, sp.Function))


@pytest.mark.exhaustive
def test_room_is_made_for_as_many_functions_as_are_adjoined() -> None:
    ring = ring_for(x)
    early = read(sp.exp(x) / (1 + sp.exp(x)), ring, {})
    key = early.key
    many = sum(sp.tanh(x / k) for k in range(1, 30))
    element = read(many, ring, {})
    assert early.key == key
    assert (early - read(sp.exp(x) / (1 + sp.exp(x)), ring, {})).reduced().is_zero
    assert same(ring.to_sympy(ring.derive(early * element, 0).reduced()), sp.diff(many / (1 + sp.exp(-x)), x))


@pytest.mark.parametrize("power", sampled([LONGEST - 1, LONGEST, 5 * LONGEST + 1], always=[LONGEST]))
def test_the_nested_form_of_a_long_polynomial_is_shallow_and_has_its_value(power: int) -> None:
    ring = ring_for(x + 1)
    nested = ring.horner(read((x + 1) ** power, ring, {}))
    depth, level = 0, {nested}
    while level:
        depth, level = depth + 1, {part for e in level for part in e.args}
    assert depth <= 3 * LONGEST
    assert same(nested, (x + 1) ** power)


@pytest.mark.parametrize("k", [-12, -3, -1, 2, 12])
def test_an_exponential_of_a_multiple_is_a_power(k: int) -> None:
    ring = ring_for()
    u = a * x**2 + x / (1 + a)
    _, many = (read(sp.exp(sp.expand(j * u)), ring, {}) for j in (1, k))
    power = sp.prod([sp.exp(u)] * abs(k))
    assert same(ring.to_sympy(many), power ** (1 if k > 0 else -1))
    assert (many * read(sp.exp(sp.expand(-k * u)), ring, {}) - 1).reduced().is_zero


@pytest.mark.parametrize("u", [3 * x / 2, x + a, 2 * x + a, x**2, 13 * x, x / 2])
def test_what_is_no_small_multiple_is_an_exponential_of_its_own(u: sp.Expr) -> None:
    ring = ring_for()
    read(sp.exp(x), ring, {})
    other = read(sp.exp(u), ring, {})
    assert len(other.numerator) == 1
    assert other.numerator.total_degree() == 1
    assert same(ring.to_sympy(ring.derive(other, 0)), sp.exp(u).diff(x))


def test_denominators_are_the_same_before_and_after_the_first_function() -> None:
    """3 x + a^2 is monic by a^2 in a ring without functions, and by x where there are some."""
    ring = LocalisedRing((x, a))
    below = read(3 * x + a**2, ring, {})
    before = power(below.inverse(), 2)
    root = read(sp.sqrt(9 - x * a**3), ring, {})
    after = power(read(3 * x + a**2, ring, {}).inverse(), 2)
    assert (before - after).is_zero
    assert before.reduced().key == after.reduced().key
    assert (before * below * below - ring.one).reduced().is_zero
    # q^2 = u lowers the power of q, though the degree of u is larger, so that 1/u ends.
    inverse = (root * root).inverse()
    assert (inverse * root * root - ring.one).reduced().is_zero
    assert sp.simplify(ring.to_sympy(after) - 1 / (3 * x + a**2) ** 2) == 0
