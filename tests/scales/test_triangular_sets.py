"""Pieces of algebraic sets: every one is found, each vanishes where its equations do, remainders divide."""

from __future__ import annotations

import flint
import pytest

from gsp.scales.triangular_sets import Variables, coefficients_in, decomposed, pseudo_remainder

context = flint.fmpq_mpoly_ctx.get(["x", "y", "z", "a", "b"], flint.Ordering.degrevlex)
x, y, z, a, b = context.gens()
VARIABLES = Variables(frozenset({0, 1, 2}), (0, 1, 2), (3, 4))


def pieces(*equations, most: int = 3) -> set:
    found = decomposed(equations, VARIABLES, most=most, count=lambda terms: None)
    assert found.unsolved == 0
    return {frozenset(str(psi / psi.leading_coefficient()) for psi in p.equations) for p in found.pieces}


def test_factors_are_pieces_and_where_a_coefficient_vanishes_is_another() -> None:
    assert pieces(x * y, x * z) >= {frozenset({"x"}), frozenset({"y", "z"})}
    assert pieces(x * y, x * z, most=1) == {frozenset({"x"})}
    # x y + z = 0 and x z = 0: the axes of x and y, and nothing else.
    assert pieces(x * y + z, x * z, most=2) == {frozenset({"x", "z"}), frozenset({"y", "z"})}


def test_parameters_alone_do_not_vanish() -> None:
    assert pieces(a * x - b) == {frozenset({"x*a - b"})}
    assert pieces(a * x - b, x) == set()
    assert pieces(a * b) == set()


def test_a_curve_of_degree_two_is_solved_for_a_parameter() -> None:
    """x^2 + y^2 = a and x y = b: irreducible over Q(a, b), linear in the parameters alone."""
    (found,) = decomposed([x**2 + y**2 - a, x * y - b], VARIABLES, most=2, count=lambda terms: None).pieces
    assert len(found.equations) == 2
    for equation in (x**2 + y**2 - a, x * y - b):
        assert found.restricted(equation)[0] == 0
    assert found.restricted(x + y)[0] != 0


def test_what_is_linear_in_nothing_is_told() -> None:
    found = decomposed([x**2 + y**2 - 2, x**2 * y**2 + x**4 - 3], VARIABLES, most=2, count=lambda terms: None)
    assert found.unsolved == 1


def test_work_is_counted() -> None:
    class Enough(Exception):
        pass

    def count(terms: int) -> None:
        raise Enough

    with pytest.raises(Enough):
        decomposed([x], VARIABLES, most=1, count=count)


def test_remainders_divide() -> None:
    divisor, dividend = a * y**2 + x * y - b, x * y**5 - a * y + z
    remainder, below = pseudo_remainder(dividend, divisor, 1)
    assert remainder.degrees()[1] < 2
    assert (below * dividend - remainder) % divisor == 0
    assert coefficients_in(dividend, 1) == {5: x, 1: -a, 0: z}
