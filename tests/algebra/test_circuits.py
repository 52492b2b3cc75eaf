"""Programs in the place of polynomials: the same values and derivatives, shared parts, and work that is counted."""

import pickle
from collections.abc import Iterable

import numpy as np
import pytest
import sympy as sp

from gsp.algebra import circuits
from gsp.algebra.circuits import CircuitRing, Factors, derived
from gsp.algebra.ring import LocalisedRing, read
from gsp.algebra.sharing import holding, parts_of, plus, reciprocal, replaced, times
from gsp.errors import BudgetError, HyperbolicityError
from gsp.lowering.compiled_function import compile_function
from gsp.lowering.steps.straight_line import eliminate

x, y, a = sp.symbols("x y a")
HERE = {x: sp.Rational(3, 7), y: sp.Rational(2, 5), a: sp.Rational(5, 3)}


def values(expressions: Iterable[sp.Expr]) -> np.ndarray:
    f = compile_function(list(expressions), arguments=list(HERE), epsilon=None, parameters=[])
    return f(np.array([float(v) for v in HERE.values()]), [np.nan])


def value(expression: sp.Expr) -> float:
    return float(values([expression])[0])


@pytest.mark.parametrize(
    "expression",
    [
        x**2 * y / (1 + x * y) - a,
        sp.exp(x * y) * sp.sin(x) + sp.sqrt(1 + y**2),
        (x + y) ** sp.Rational(5, 3) * sp.tanh(a * x),
        sp.log(1 + x) / (x - 2 * y) ** 3,
    ],
)
def test_a_program_has_the_value_and_the_derivatives_of_its_expression(expression: sp.Expr) -> None:
    ring = CircuitRing((x, y), constants=(a,), derivations=2)
    # D_0 is along x with y' = x y, D_1 is d/dy.
    ring.set_derivative(x, 0, ring.one)
    ring.set_derivative(y, 0, ring.generator(x) * ring.generator(y))
    ring.set_derivative(y, 1, ring.one)
    element = read(expression, ring, {})
    assert value(ring.to_sympy(element)) == pytest.approx(value(expression), rel=1e-14)
    along = sp.diff(expression, x) + x * y * sp.diff(expression, y)
    assert value(ring.to_sympy(ring.derive(element, 0))) == pytest.approx(value(along), rel=1e-13)
    assert value(ring.to_sympy(ring.derive(element, 1))) == pytest.approx(
        value(sp.diff(expression, y)), rel=1e-13
    )
    twice = ring.to_sympy(ring.derive(ring.derive(element, 1), 1))
    assert value(twice) == pytest.approx(value(sp.diff(expression, y, 2)), rel=1e-12)


def test_numbers_are_worked_out_and_constants_known() -> None:
    ring = CircuitRing((x,), constants=(a,), derivations=1)
    ring.set_derivative(x, 0, ring.one)
    third = ring.constant(sp.Rational(1, 3))
    assert (third * 3 - ring.one).is_zero
    assert (third * (third * ring.generator(x)) * 9).index == ring.generator(x).index
    assert ring.is_constant(ring.generator(a) * ring.generator(a) + 1)
    assert not ring.is_constant(ring.generator(x) + ring.generator(a))
    with pytest.raises(HyperbolicityError):
        (third - third).inverse()
    with pytest.raises(BudgetError):
        _ = third.numerator


def test_the_steps_of_a_ring_are_counted_and_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(circuits, "GATES", 20)
    ring = CircuitRing((x,))

    def tower(levels: int) -> None:
        power = ring.generator(x)
        for _ in range(levels):
            power = power * power

    with pytest.raises(BudgetError, match="20 steps"):
        tower(30)
    assert ring.spent == 20


def test_factors_of_a_line_take_steps_in_proportion_to_it_and_solve() -> None:
    steps, n = [], 30
    for count in (n // 2, n):
        ring = CircuitRing((x, y))
        entries = {(i, i): read(3 + x**2 + i * y, ring, {}) for i in range(count)}
        entries |= {(i, i + 1): read(x * (i + 1), ring, {}) * sp.Rational(1, 50) for i in range(count - 1)}
        entries |= {(i + 1, i): read(y - i, ring, {}) * sp.Rational(1, 50) for i in range(count - 1)}
        order = eliminate(count, entries)
        factors = Factors(ring, entries, order.order, order.rows, order.columns)
        solution = factors.solve([ring.one] * count)
        steps.append(ring.spent)
    assert steps[1] < 2.1 * steps[0]
    found = values(map(ring.to_sympy, solution))
    matrix = np.zeros((n, n))
    for place, entry in zip(entries, values(map(ring.to_sympy, entries.values()))):
        matrix[place] = entry
    np.testing.assert_allclose(found, np.linalg.solve(matrix, np.ones(n)), rtol=1e-12)
    # d log det along x, from the pivots.
    slopes = derived(ring, factors.pivots, {ring.generator(x).index: ring.one})
    rate = (values(map(ring.to_sympy, slopes)) / values(map(ring.to_sympy, factors.pivots))).sum()
    changed = np.diag(np.full(n, 2 * float(HERE[x]))) + np.diag((np.arange(n - 1) + 1) / 50, 1)
    assert rate == pytest.approx(np.trace(np.linalg.solve(matrix, changed)), rel=1e-12)


def test_a_program_goes_to_another_process() -> None:
    ring = CircuitRing((x,), derivations=1)
    ring.set_derivative(x, 0, ring.generator(x) * 2)
    gate = ring.generator(x)
    for _ in range(2000):
        gate = gate * gate + sp.Rational(1, 3) * gate
    sent = pickle.loads(pickle.dumps(gate))
    assert sent.length == gate.length
    assert sent.ring.to_sympy(sent) == ring.to_sympy(gate)
    assert sent.ring.derive(sent, 0).length == ring.derive(gate, 0).length


def nested(levels: int) -> sp.Expr:
    found = plus([x, times(y, sp.Integer(2))])
    for _ in range(levels):
        found = plus([times(found, reciprocal(plus([times(found, found), sp.S.One]))), x])
    return found


@pytest.mark.exhaustive
def test_shared_parts_are_compared_shown_and_searched_without_a_walk() -> None:
    # Written out this has 2^1000 parts.
    one, two = nested(1000), nested(1000)
    assert one is not two
    assert one == two
    assert hash(one) == hash(two)
    assert one != nested(999)
    assert str(one) == f"({len(parts_of(one))} shared operations)"
    assert one.free_symbols == {x, y}
    assert one.has(x)
    assert not one.has(a)
    moved = replaced(one, {x: a})
    assert moved.free_symbols == {a, y}
    assert moved == one.xreplace({x: a})
    assert replaced(moved, {a: x}) == one


class Looked(frozenset):
    """Atoms that count how often they are asked for."""

    times = 0

    def __contains__(self, part: object) -> bool:
        Looked.times += 1
        return super().__contains__(part)


def test_parts_that_many_expressions_share_are_looked_at_once() -> None:
    levels = [nested(1)]
    for _ in range(200):
        levels.append(plus([times(levels[-1], reciprocal(plus([levels[-1], sp.S.One]))), x]))
    unreal = Looked((sp.nan, sp.I, sp.oo))
    assert holding(levels, unreal) == [False] * 201
    assert 0 < Looked.times < 10, "x, y and the numbers"


def test_what_holds_an_atom_is_told_from_what_shares_parts_with_it() -> None:
    inner = plus([x, times(y, sp.Integer(2))])
    bad = plus([inner, sp.nan])
    asked = [inner, times(bad, inner), bad, reciprocal(inner), sp.nan, sp.Integer(3) / 7, x + sp.I]
    assert holding(asked, [sp.nan]) == [False, True, True, False, True, False, False]
    assert holding(asked, [sp.I]) == [False, False, False, False, False, False, True]


def test_shared_parts_are_what_they_stand_for() -> None:
    plain = x + 2 * y
    for _ in range(3):
        plain = plain / (plain**2 + 1) + x
    assert value(nested(3)) == pytest.approx(value(plain), rel=1e-15)
    assert pickle.loads(pickle.dumps(nested(5))) == nested(5)


def test_polynomials_and_programs_agree() -> None:
    expression = (x + y) ** 3 / (x - a) + x * y
    written, kept = LocalisedRing((x, y), constants=(a,)), CircuitRing((x, y), constants=(a,))
    both = [value(ring.to_sympy(read(expression, ring, {}).inverse())) for ring in (written, kept)]
    assert both[0] == pytest.approx(both[1], rel=1e-13)
