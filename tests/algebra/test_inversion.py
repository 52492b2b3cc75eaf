"""Explicit inversion: every formula solves the equations, and two-valued ones are refused."""

from __future__ import annotations

import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gsp.algebra.inversion import INVERSES, one_inverse, solve_for

x, y, z, p, q, a = sp.symbols("x y z p q a")


def solves(solution, equations) -> bool:
    # Over the reals: SymPy's own symbols are complex, where log(exp(x)) is not x.
    point = {x: 0.3, y: 0.7, z: 0.4, p: 0.9, q: 0.2, a: 0.6}
    defects = [(e.xreplace(solution) - value).subs(point) for value, e in equations.items()]
    return all(abs(float(defect)) < 1e-14 for defect in defects)


SOLVABLE = [
    {p: a * x + y, q: x - a * y},
    {p: x * sp.exp(z) + 1},
    {p: y**3 - x},
    {p: x + y**2, q: y},
    {p: sp.exp(x) * z + 2},
    {p: sp.log(2 * x + z) - a},
    {p: sp.tanh(x - z)},
    {p: sp.asin(z) + sp.sinh(x)},
    {p: x / (1 + y), q: y - z},
    {p: z - 3 * x**5},
    {p: a * x**3 / 7},
    {p: z * sp.log(3 * x + z) - a},
    {p: 2 - z * sp.sinh(a * x - 1) / 3},
    {p: 3 * x - a * y / 2 + 1, q: 5 * y - z * x},
]


@pytest.mark.parametrize("equations", SOLVABLE)
def test_the_solution_solves_the_equations(equations) -> None:
    unknown = (x, y)[: len(equations)]
    solution = solve_for(unknown, equations)
    assert set(solution) == set(unknown)
    assert solves(solution, equations)


@pytest.mark.parametrize("equations", [{p: x**2}, {p: x + sp.exp(x)}, {p: x**3 + x}, {p: sp.sin(x)}])
def test_what_has_no_single_formula_is_refused(equations) -> None:
    assert solve_for((x,), equations) is None


def test_a_singular_linear_system_is_refused() -> None:
    assert solve_for((x, y), {p: x + y, q: 2 * x + 2 * y}) is None


def test_nothing_to_solve_needs_no_equations() -> None:
    assert solve_for((), {}) == {}


@pytest.mark.exhaustive
@given(st.lists(st.integers(-3, 3), min_size=9, max_size=9))
@settings(max_examples=30)
def test_linear_systems_are_inverted_exactly(entries: list[int]) -> None:
    matrix = sp.Matrix(3, 3, entries)
    assume(matrix.det() != 0)
    values = sp.symbols("v0:3")
    equations = dict(zip(values, matrix * sp.Matrix([x, y, z])))
    solution = solve_for((x, y, z), equations)
    assert sp.Matrix([solution[s] for s in (x, y, z)]).jacobian(list(values)) == matrix.inv()


@pytest.mark.parametrize("function", INVERSES, ids=str)
def test_each_inverse_undoes_its_function(function) -> None:
    point = sp.Rational(1, 3)
    value = one_inverse(function(2 * x + point) - y, x)
    assert value is not None
    back = function(2 * value + point).subs(y, sp.Rational(2, 5))
    assert float(back) == pytest.approx(0.4, rel=1e-14)


@pytest.mark.parametrize(
    "equation", [sp.sin(x) - y, sp.exp(x) + x - y, sp.exp(x**2) - y, sp.exp(x) ** 2 + sp.exp(x) - y]
)
def test_one_inverse_refuses_what_it_cannot_isolate(equation) -> None:
    assert one_inverse(equation, x) is None


def test_the_solution_comes_in_the_order_of_the_unknowns() -> None:
    # z is found first, x second; whoever zips the values with the unknowns must not notice.
    solution = solve_for((x, z), {p: x * sp.exp(z), q: z})
    assert list(solution.items()) == [(x, p * sp.exp(-q)), (z, q)]
