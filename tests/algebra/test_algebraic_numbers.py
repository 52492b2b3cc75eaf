"""Real points of polynomial systems: all of them, exactly, in order; and the numbers that their coordinates are."""

from __future__ import annotations

import flint
import pytest
import sympy as sp
from sympy.polys.polyerrors import PolynomialError

from gsp.algebra.algebraic_numbers import (
    InfinitelyManyPoints,
    NumberField,
    arb,
    rational_point,
    real_points,
)

x, y, z = sp.symbols("x y z")
R = sp.Rational
ROOT = sp.sqrt(2)
FIELD = NumberField(flint.fmpq_poly([-2, 0, 1]), ROOT)
CUBIC = NumberField(flint.fmpq_poly([-2, 0, 0, 1]), sp.cbrt(2))
SYSTEMS = {
    "one in one unknown": ([x**2 - 2], [(-ROOT,), (ROOT,)]),
    "complex ones are left out": ([x**3 - x**2 + x - 1], [(1,)]),
    "none is real": ([x**2 + 1], []),
    "multiple ones count once": ([(x - 1) ** 3 * (x + R(1, 2)) ** 2], [(-R(1, 2),), (1,)]),
    "contradictory": ([x - 1, x - 2], []),
    "a number that is not zero": ([x - 1, sp.Integer(3)], []),
    "an equation that says nothing": ([x - 1, sp.Integer(0), x * y - 2], [(1, 2)]),
    "poles are left out": ([(x**2 - 1) / (x - 1)], [(-1,)]),
    "poles that do not cancel": ([(x**2 - 1) * (x - 2) / (x * (x - 1)), y - x], [(-1, -1), (2, 2)]),
    "a pole in another equation": ([x**2 - 1, y - 1 / (x - 1)], [(-1, -R(1, 2))]),
    # No coordinate tells the points apart, and x + y is 0 twice.
    "the corners of a square": ([x**2 - 1, y**2 - 1], [(-1, -1), (-1, 1), (1, -1), (1, 1)]),
    # Those on a diagonal come in the field of 3 sqrt(2), the others in that of sqrt(2).
    "irrational corners": ([x**2 - 2, y**2 - 2], [(-ROOT, -ROOT), (-ROOT, ROOT), (ROOT, -ROOT), (ROOT, ROOT)]),
    "of degrees that differ": ([x**2 - 2 * y, y**2 - y], [(-ROOT, 1), (0, 0), (ROOT, 1)]),
    "a circle and a line": ([x**2 + y**2 - 1, x - y], [(-ROOT / 2, -ROOT / 2), (ROOT / 2, ROOT / 2)]),
    "tangent to each other": ([x**2 + y**2 - 1, y - 1], [(0, 1)]),
}  # fmt: skip


@pytest.mark.parametrize("case", SYSTEMS)
def test_every_real_point_is_found_once_exactly_and_in_order(case: str) -> None:
    equations, expected = SYSTEMS[case]
    unknowns = [x, y][: max(1, len(expected[0]) if expected else 1)]
    found = real_points(equations, unknowns)
    assert [tuple(point.expressions().values()) for point in found] == expected
    for point, values in zip(found, expected):
        assert list(point.numbers().values()) == pytest.approx([float(v) for v in values], rel=1e-16, abs=0)
        assert point.is_rational == all(sp.sympify(v).is_rational for v in values)
        # Off their poles the equations are zero there, and what they are made of has its value.
        assert all(point.value(sp.together(e)).is_zero() for e in equations)


def test_a_cubic_point_stays_a_root_of_its_polynomial() -> None:
    (point,) = real_points([x**3 - 2, y - x**2 + 1], [x, y])
    assert not point.is_rational
    assert point.numbers() == pytest.approx({x: 2 ** (1 / 3), y: 2 ** (2 / 3) - 1}, abs=1e-15)
    assert point.value(x**3 + 2 * x**2 - 2 * y) == flint.fmpq_poly([4])
    assert point.value(1 / (x * y + x)) == flint.fmpq_poly([R(1, 2).p]) / 2
    assert point.value(R(2, 3) * x**-2 + 1) == flint.fmpq_poly([1, flint.fmpq(1, 3)])
    with pytest.raises(PolynomialError, match="not rational"):
        point.value(sp.sin(x))
    with pytest.raises(PolynomialError, match="not rational"):
        point.value(sp.sqrt(x))


def test_solutions_that_are_not_isolated_are_refused() -> None:
    with pytest.raises(InfinitelyManyPoints, match="not isolated in x, y"):
        real_points([x * y], [x, y])
    with pytest.raises(InfinitelyManyPoints):
        real_points([sp.Integer(0), x], [x, y])


@pytest.mark.parametrize(
    ("equations", "is_tried"),
    [
        ([sp.sin(x)], False),
        ([x - z], False),
        ([x**16 - 1], True),
        ([x**17 - 1], False),
        # Bezout's number is 200, then 202, though there is one solution.
        ([x**2 - 1, x**4 - 1, x**25 - 1], True),
        ([x**2 - 1, x**101 - 1], False),
    ],
)
def test_what_is_no_task_for_exact_algebra_is_left_alone(equations: list[sp.Expr], is_tried: bool) -> None:
    found = real_points(equations, [x])
    assert (found is not None) == is_tried
    if found is not None:
        assert [point.numbers()[x] for point in found] == ([-1.0, 1.0] if len(equations) == 1 else [1.0])


def test_sixteen_solutions_of_two_equations_are_counted_and_seventeen_are_too_many() -> None:
    assert len(real_points([x**4 - 5 * x**2 + 4, y**4 - 5 * y**2 + 4], [x, y])) == 16
    assert real_points([x**17 - x, y - x**2], [x, y]) is None


def test_folds_of_a_calcium_pump_are_too_many_and_that_takes_no_minutes() -> None:
    """They have 19 complex ones; a Groebner basis of them and of what is not a pole was not found in ten minutes."""
    release = R(1, 50) + 8 * x**2 / ((x**2 + R(49, 100)) * (1 + 8 * x**3))
    rate = release * (R(27, 5) * (y - x) - x) - R(9, 10) * x**2 / (x**2 + R(1, 100))
    assert real_points([rate, sp.diff(rate, x)], [x, y]) is None


def test_zeros_at_poles_are_left_out_where_they_fill_a_curve() -> None:
    # Both numerators vanish where x = y, which is a pole of the first.
    assert [
        p.numbers() for p in real_points([(x - y) * (x - 2) / (x - y) ** 2, (x - y) * (y - 3)], [x, y])
    ] == [{x: 2.0, y: 3.0}]


@pytest.mark.parametrize("coefficients", [[3], [1, 1], [-3, 2], [0, flint.fmpq(2, 7)]])
@pytest.mark.parametrize("field", [FIELD, CUBIC])
def test_a_number_times_its_inverse_is_one(field: NumberField, coefficients: list) -> None:
    a = flint.fmpq_poly(coefficients)
    assert field.multiply(a, field.inverse(a)) == flint.fmpq_poly([1])
    assert abs(sp.N(field.expression(a) * field.expression(field.inverse(a)) - 1, 30)) < 1e-25


def test_numbers_are_reduced_and_zero_has_no_inverse() -> None:
    assert FIELD.reduce(flint.fmpq_poly([0, 0, 1])) == flint.fmpq_poly([2])
    assert FIELD.reduce(flint.fmpq_poly([1, 5])) == flint.fmpq_poly([1, 5])
    assert CUBIC.multiply(flint.fmpq_poly([0, 0, 1]), flint.fmpq_poly([0, 1])) == flint.fmpq_poly([2])
    assert FIELD.expression(flint.fmpq_poly([1, 2, 3])) == 7 + 2 * ROOT
    with pytest.raises(ZeroDivisionError):
        FIELD.inverse(flint.fmpq_poly([0]))


def test_signs_are_decided_however_near_zero() -> None:
    theta = flint.fmpq_poly([0, 1])
    assert [FIELD.sign(flint.fmpq_poly([c])) for c in (-2, 0, 5)] == [-1, 0, 1]
    assert FIELD.sign(theta * theta - 2) == 0
    # Convergents of sqrt(2) lie on both sides of it in turns, here to within 1e-60.
    p, q = 1, 1
    for k in range(160):
        assert k < 155 or FIELD.sign(theta - flint.fmpq(p, q)) == (1 if p * p < 2 * q * q else -1)
        p, q = p + 2 * q, p + q
    assert flint.ctx.prec == 53


@pytest.mark.parametrize("bits", [53, 200])
def test_balls_enclose_their_number_and_are_small(bits: int) -> None:
    before, flint.ctx.prec = flint.ctx.prec, bits + 20
    try:
        ball = CUBIC.ball(flint.fmpq_poly([-1, 2, 3]), bits)
        exact = flint.arb(2).root(3)
        assert ball.contains(2 * exact + 3 * exact * exact - 1)
        assert float(ball.rad()) < 2.0 ** (8 - bits)
        assert arb(R(-7, 3)).contains(flint.fmpq(-7, 3))
    finally:
        flint.ctx.prec = before


def test_a_rational_point_is_one_of_numbers() -> None:
    point = rational_point({x: R(2, 3), y: sp.Integer(-1)})
    assert point.is_rational
    assert point.expressions() == {x: R(2, 3), y: -1}
    assert point.value((x + 1) * y / 5 - x**2) == flint.fmpq_poly([flint.fmpq(-7, 9)])


def test_numbers_are_right_where_all_but_their_last_digits_cancel() -> None:
    """Roots near 5 and near 953 belong to places 1e-6 apart: the middle of a ball half as wide as itself was taken."""
    gain = y - R(213, 10000) * x**3 / (1 + x**2 / 25) ** 3
    g = gain * x + R(11, 10000)
    points = real_points([g, sp.diff(g, x)], [y, x])
    assert points is not None
    slope = sp.lambdify((y, x), sp.diff(g, x))
    assert len(points) == 4
    for point in points:
        values = point.numbers()
        assert {s: float(v) for s, v in point.near(100).items()} == pytest.approx(values, rel=1e-15)
        assert slope(values[y], values[x]) == pytest.approx(0.0, abs=1e-15 * (1 + abs(values[y])))
        assert {s: float(sp.N(e, 20)) for s, e in point.expressions().items()} == pytest.approx(
            values, rel=1e-15
        )
