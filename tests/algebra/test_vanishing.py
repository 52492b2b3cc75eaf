"""Polynomials that vanish nowhere in a box, against places where they do."""

from __future__ import annotations

import flint
import numpy as np
import pytest
import sympy as sp

from gsp.algebra.vanishing import has_simple_roots, leading_coefficient, real_roots_within, vanishes_nowhere

CONTEXT = flint.fmpq_mpoly_ctx.get(["x", "y", "z"], flint.Ordering.lex)
x, y, z = CONTEXT.gens()
UNIT = [(flint.fmpq(0), flint.fmpq(1))] * 3


@pytest.mark.parametrize(
    ("polynomial", "told"),
    [
        (x**2 + y**2 + z**2 + 1, True),
        ((x - y) ** 2 + flint.fmpq(1, 10**6), True),
        ((x - y) ** 2 - flint.fmpq(1, 10**6), False),
        # A circle beyond the box, one within it, and one that meets an edge only.
        ((x - 3) ** 2 + (y - 3) ** 2 - 1, True),
        ((x - flint.fmpq(1, 2)) ** 2 + (y - flint.fmpq(1, 2)) ** 2 - flint.fmpq(1, 100), False),
        ((x + 1) ** 2 + y**2 - 1, False),
        (x + y + z, False),
        (x + y + z + 1, True),
        ((x + 1) * (y + 2) * (z + 3), True),
        ((x + 1) * (2 * y - 1), False),
        (x * 0 + 3, True),
        (x * 0, False),
    ],
)
def test_zeros_in_the_box_are_what_decides(polynomial: flint.fmpq_mpoly, told: bool) -> None:
    assert vanishes_nowhere(polynomial, UNIT) is told


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(40))
def test_what_is_said_to_vanish_nowhere_has_one_sign(seed: int) -> None:
    numbers = np.random.default_rng(seed)
    p = CONTEXT.constant(int(numbers.integers(-3, 4)))
    for _ in range(5):
        a, b, c = map(int, numbers.integers(0, 3, 3))
        p = p + int(numbers.integers(-4, 5)) * x**a * y**b * z ** (c if seed % 2 else 0)
    points = numbers.random((400, 3))
    values = [
        sum(float(c) * np.prod(point ** np.array([*map(int, e)])) for e, c in p.to_dict().items())
        for point in points
    ]
    told = vanishes_nowhere(p, UNIT)
    assert not told or min(values) * max(values) > 0.0
    # A square has a zero wherever p has one, and p^2 + 1 has none, whatever is found out about it.
    if min(values) * max(values) < 0.0:
        assert not vanishes_nowhere(p * p, UNIT)


def test_roots_on_the_edge_count_and_those_beyond_it_do_not() -> None:
    p = (x - 1) * (x - 2) * (x**2 + 1)
    assert real_roots_within(p, 0, (flint.fmpq(1), flint.fmpq(3, 2))) == 1
    assert real_roots_within(p, 0, (flint.fmpq(11, 10), flint.fmpq(3, 2))) == 0
    assert leading_coefficient(x**2 * (y + 1) + x * z, 0) == y + 1


def test_simple_roots_are_those_whose_discriminant_and_leading_coefficient_vanish_nowhere() -> None:
    a, b, u = sp.symbols("a b u")
    sides = {a: (0.1, 100.0), b: (0.05, 50.0)}
    # Binding with a dissociation constant of 1/91: the discriminant is least, and positive, on a = b.
    binding = -(u * (b - a + u) * 91 - (a - u)) / 1000
    assert has_simple_roots(binding, u, sides)
    assert not has_simple_roots(binding, u, {**sides, a: (-1.0, 100.0), b: (-1.0, 50.0)})
    assert has_simple_roots(u**2 - a, u, sides)
    assert not has_simple_roots(u**2 - a, u, {a: (0.0, 1.0)})
    # A root that goes to infinity, a field with a pole, and what is no polynomial.
    assert not has_simple_roots((a - 1) * u**2 - 1, u, sides)
    assert not has_simple_roots(1 / (a - 1) + u, u, sides)
    assert not has_simple_roots(sp.exp(a) + u, u, sides)
    assert not has_simple_roots(a, u, sides)
