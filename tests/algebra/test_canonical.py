"""Sums, products and functions that are only put in order are those that SymPy would build, to the last part."""

from __future__ import annotations

import random

import pytest
import sympy as sp

from gsp.algebra.canonical import function_of, new_parts, product_of, sum_of

A, S, X, Z = sp.symbols("a s x10 z")
REAL, POSITIVE = sp.symbols("r p", real=True), sp.Symbol("q", positive=True)
ORDERED, CHAOTIC = sp.symbols("m n", commutative=False)
FUNCTIONS = (
    sp.sin,
    sp.cos,
    sp.tan,
    sp.sinh,
    sp.cosh,
    sp.tanh,
    sp.exp,
    sp.log,
    sp.atan,
    sp.asin,
    sp.acosh,
    sp.Abs,
)


def pool() -> list[sp.Expr]:
    numbers = [sp.Integer(k) for k in (-3, -1, 0, 1, 2)] + [sp.Rational(-2, 3), sp.Rational(1, 2)]
    symbols = [A, S, X, Z, *REAL, POSITIVE]
    sums = [A - S, S - A, A + 2 * S, 2 * A - 2, 3 - X, X - Z - 1, -A - S + 1, A * S - X, X**2 - A, S - sp.pi]
    quotients = [1 / A, S**2, S**3, 1 / (S + 3), (A - S) ** 2, (2 * A - 2) ** -1, -X / 3, A / S, sp.sqrt(A), -A]
    others = [sp.pi, sp.sqrt(2), 2**A, A**S, sp.pi * A, -sp.Mul(1, A + S, evaluate=False), ORDERED, CHAOTIC]
    calls = [f(u) for f in FUNCTIONS[:8] for u in (A, A - S, -X / 3, sp.Integer(2), 2 * sp.log(Z))]
    return [
        *numbers,
        *symbols,
        *sums,
        *quotients,
        *others,
        *calls,
        sp.tanh(A) ** 2,
        sp.exp(A) ** 2,
        -sp.exp(-A),
    ]


def same(left: sp.Expr, right: sp.Expr) -> bool:
    return type(left) is type(right) and sp.srepr(left) == sp.srepr(right)


@pytest.mark.exhaustive
def test_sums_and_products_are_those_of_sympy() -> None:
    parts, chance = pool(), random.Random(7)
    for _ in range(700):
        drawn = [chance.choice(parts) for _ in range(chance.randint(1, 6))]
        assert same(sum_of(drawn), sp.Add(*drawn)), drawn
        assert same(product_of(drawn), sp.Mul(*drawn)), drawn


@pytest.mark.exhaustive
@pytest.mark.parametrize("function", FUNCTIONS)
def test_functions_are_those_of_sympy(function: type[sp.Function]) -> None:
    parts, chance = [u for u in pool() if u.is_commutative], random.Random(11)
    linear = [
        chance.choice((-2, -1, 1, 3)) * u for u in (A, S, X, Z, sp.Integer(1), A * S, 1 / A) for _ in range(3)
    ]
    arguments = [*parts, *(sp.Add(*chance.sample(linear, k % 4 + 2)) for k in range(120))]
    for argument in arguments:
        assert same(function_of(function, [argument]), function(argument)), argument
    for argument in chance.sample(arguments, 60):
        other = chance.choice(parts)
        assert same(function_of(sp.Max, [A, other]), sp.Max(A, other))
        assert same(product_of([argument, other]), argument * other)


@pytest.mark.exhaustive
def test_powers_of_sums_are_those_of_sympy() -> None:
    parts, chance = [u for u in pool() if u.is_commutative], random.Random(13)
    bases = [*parts, *(sp.Add(*chance.sample(parts, k % 4 + 2)) for k in range(150))]
    bases += [sp.oo * A + S, sp.I * A + S, sp.I + 2, sp.sqrt(2) + 1, 1 + sp.exp(-(A - S) / 3)]
    for base in bases:
        for exponent in (-2, -1, 0, 1, 2, sp.Rational(1, 2), A):
            value = function_of(sp.Pow, [base, sp.sympify(exponent)])
            expected = sp.Pow(base, exponent)
            assert same(value, expected), (base, exponent)
            assert value.is_commutative == expected.is_commutative


def test_functions_have_what_sympy_gives_them() -> None:
    for function in (sp.tanh, sp.exp, sp.sin):
        value, expected = function_of(function, [A - S]), function(A - S)
        assert value == expected
        assert value.nargs == expected.nargs
        assert value.is_commutative


def test_what_has_one_answer_is_not_asked_of_sympy(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    for kind in (sp.Add, sp.Mul):
        monkeypatch.setattr(kind, "flatten", classmethod(lambda cls, parts: asked.append(cls)))
    for kind in (sp.tanh, sp.exp):
        monkeypatch.setattr(kind, "eval", classmethod(lambda cls, argument: asked.append(cls)))
    monkeypatch.setattr(sp.Add, "_eval_power", lambda base, exponent: asked.append(base))
    difference = sum_of([Z, X, sp.Integer(5)])
    power = sp.exp(Z, evaluate=False)
    value = product_of([function_of(sp.tanh, [difference]), X, function_of(sp.exp, [Z])])
    total = sum_of([power, sp.Integer(1)])
    quotient = function_of(sp.Pow, [total, sp.Integer(-1)])
    assert asked == []
    assert quotient.args == (total, -1)
    assert set(value.args) == {sp.tanh(difference, evaluate=False), X, power}


def test_a_part_is_new_once() -> None:
    first, second = sp.tanh(A - S) + X, sp.tanh(A - S) * Z
    seen = new_parts(first, set())
    assert seen == set(sp.preorder_traversal(first))
    assert new_parts(second, seen) == {second, Z}
    assert new_parts(first, seen) == set()
