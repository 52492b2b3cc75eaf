"""Where a system has its own origin."""

import pytest
import sympy as sp

from gsp.algebra.centres import centres

x, y, z, t = symbols = sp.symbols("x y z t")
# Rates that are shortest about the origin, and about no other place.
FIELDS = [
    (y - x**3 / 3 + x, -x),
    (x - (x + 1) * y, -x + (x + sp.Rational(1, 2)) * y),
    (x * z + 1 + (x + z) ** 3 - (2 + sp.cos(x)) * y, x - z, -z),
    (x + y**2 + y**3 / 10, z / 8 - y, sp.Integer(1)),
    (1 / (1 + sp.exp(-3 * x)) - y, -x / 10 + y),
    ((x + t) ** 4 - y, -x, sp.Integer(1)),
    (y * sp.exp(x / (1 + x / 20)) - 8 * x, 1 - y - y * sp.exp(x / (1 + x / 20))),
    (-x, x - y, 1 - x),
]


@pytest.mark.parametrize("rates", FIELDS)
def test_a_field_that_is_shifted_has_its_origin_found(rates: tuple[sp.Expr, ...]) -> None:
    assert centres(rates, symbols) == {}
    own = [s for s in symbols if any(rate.has(s) for rate in rates)]
    there = {s: 300 * (k + 1) for k, s in enumerate(own)}
    moved = tuple(e.xreplace({s: s - c for s, c in there.items()}) for e in rates)
    # About a place 1 beside it a field may be as short.
    assert {s: float(c) for s, c in centres(moved, symbols).items()} == pytest.approx(there, abs=1.0)
    if all(rate.is_polynomial() for rate in rates):
        # A cubic may be shorter without its square.
        assert centres(tuple(map(sp.expand, moved)), symbols) == pytest.approx(there, abs=30.0)


@pytest.mark.parametrize("rates", FIELDS)
def test_centres_are_the_same_in_other_units(rates: tuple[sp.Expr, ...]) -> None:
    there = {s: 300 * (k + 1) for k, s in enumerate(symbols)}
    moved = tuple(sp.expand(e.xreplace({s: s - c for s, c in there.items()})) for e in rates)
    units = dict(zip(symbols, (10**6, sp.Rational(7, 300), sp.Rational(1, 2**20), 3)))
    in_units = tuple(e.xreplace({s: s / unit for s, unit in units.items()}) for e in moved)
    assert {s: c / units[s] for s, c in centres(in_units, symbols).items()} == centres(moved, symbols)


def test_of_two_places_that_save_as_much_the_one_that_is_written_more_often_is_the_centre() -> None:
    """A predator's prey comes as near to 0 as exp(-9), and the half of what is eaten to 1/4."""
    u, v = x - 1000, y - 1000
    eaten = u / (u + sp.Rational(1, 4))
    assert centres(((1 - u) * u - eaten * v, v * (eaten - sp.Rational(1, 2))), symbols) == {x: 1000, y: 1000}


def test_parts_of_a_rate_that_is_over_the_budget_are_looked_at() -> None:
    parameters = sp.symbols("p0:6")
    long = sp.prod([1 + p + (x - 1000) ** (k + 2) for k, p in enumerate(parameters)])
    assert centres((sum(parameters) ** 6 / long - (y - 300), x - y), symbols)[x] == 1000


def test_far_terms_do_not_make_a_centre_far_from_where_all_is_short() -> None:
    # (y + 1000/3)^3 has no square, and at y = 1 it cancels by a factor of 10,000.
    assert centres((x + 1000 * y**2 + y**3, 1 - y), symbols) == {}


def test_a_constant_that_is_only_moved_into_a_centre_stays_where_it_is() -> None:
    assert centres((3 - x, x - y), symbols) == {}


def test_a_place_that_a_root_is_taken_of_is_no_centre() -> None:
    assert centres((sp.sqrt(x) - y, -x), symbols) == {}
