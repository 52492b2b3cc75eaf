"""Sums of c tau^n exp(lambda tau): SymPy's arithmetic, solved equations put back in, and where the class ends."""

from __future__ import annotations

from fractions import Fraction as F

import numpy as np
import pytest
import sympy as sp

from gsp.algebra.exponential_polynomials import ExponentialPolynomial, ExponentialRing, NotClosed

tau = sp.Symbol("tau")
RING = ExponentialRing(sp.Matrix([[-1]]))
ELEMENTS = {
    "nothing": {},
    "a number": {F(0): [F(-3, 2)]},
    "a line": {F(0): [F(1), F(2)]},
    "one that decays": {F(-1): [F(2), F(0), F(5)]},
    "two that share a rate": {F(-1): [F(-2), F(1, 3)], F(2): [F(0), F(7)]},
    "all kinds": {F(0): [F(0), F(0), F(1, 4)], F(1, 2): [F(3)], F(-5, 3): [F(1), F(-1)]},
}


def element(case: str) -> ExponentialPolynomial:
    return ExponentialPolynomial(RING, ELEMENTS[case])


def is_zero(expression: sp.Expr) -> bool:
    return sp.expand(expression, power_exp=False) == 0 or sp.powsimp(sp.expand(expression)) == 0


@pytest.mark.exhaustive
@pytest.mark.parametrize("one", ELEMENTS)
@pytest.mark.parametrize("other", ELEMENTS)
def test_sums_and_products_are_those_of_the_expressions(one: str, other: str) -> None:
    a, b = element(one), element(other)
    p, q = a.to_sympy(tau), b.to_sympy(tau)
    assert is_zero((a + b).to_sympy(tau) - p - q)
    assert is_zero((a - b).to_sympy(tau) - p + q)
    assert is_zero((a * b).to_sympy(tau) - p * q)
    # One value, one representation: whatever the way to it, and without zeros at the end.
    assert (a + b - b).key == a.reduced().key == a.key
    assert (a * b - b * a).is_zero
    assert (a - b).is_zero == (one == other) == (a.key == b.key)
    assert all(row[-1] != 0 for row in (a * b + a).terms.values())


@pytest.mark.parametrize("case", ELEMENTS)
def test_numbers_scale_and_shift(case: str) -> None:
    a = element(case)
    p = a.to_sympy(tau)
    assert is_zero((a * F(2, 3)).to_sympy(tau) - p * sp.Rational(2, 3))
    assert (a * sp.Rational(2, 3)).key == (a * F(2, 3)).key
    assert is_zero((3 * a).to_sympy(tau) - 3 * p)
    assert is_zero((-a).to_sympy(tau) + p)
    assert is_zero((a + 5).to_sympy(tau) - p - 5)
    assert (a * 0).is_zero


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", ELEMENTS)
@pytest.mark.parametrize("rate", [F(0), F(-1), F(1, 2), F(4, 7)])
def test_the_solution_of_a_linear_equation_satisfies_it_in_resonance_too(case: str, rate: F) -> None:
    forcing = element(case)
    u = forcing.solve(rate, F(5, 6)).to_sympy(tau)
    assert is_zero(sp.diff(u, tau) - sp.Rational(rate.numerator, rate.denominator) * u - forcing.to_sympy(tau))
    assert u.subs(tau, 0) == sp.Rational(5, 6)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "matrix",
    [
        [[-2, 0], [0, -3]],
        [[-2, 1], [0, -3]],
        [[-3, 2], [1, -2]],
        [[-1, 0, 0], [4, -2, 0], [0, 1, -2 + 5]],
        [[0, 1], [0, -1]],
    ],
)
def test_a_linear_layer_is_solved(matrix: list) -> None:
    A = sp.Matrix(matrix)
    ring = ExponentialRing(A)
    cases = ("a line", "one that decays", "all kinds")[: A.rows]
    rest = [ExponentialPolynomial(ring, ELEMENTS[case]) for case in cases]
    start = [F(1, i + 2) for i in range(A.rows)]
    Y = sp.Matrix([y.to_sympy(tau) for y in ring.fast(rest, start)])
    assert all(is_zero(e) for e in Y.diff(tau) - A * Y - sp.Matrix([r.to_sympy(tau) for r in rest]))
    assert list(Y.subs(tau, 0)) == [sp.Rational(1, i + 2) for i in range(A.rows)]
    X = ring.slow(rest[0], F(7)).to_sympy(tau)
    assert is_zero(sp.diff(X, tau) - rest[0].to_sympy(tau))
    assert X.subs(tau, 0) == 7
    assert sorted(ring.rates) == sorted(F(str(e)) for e in A.eigenvals(multiple=True))
    assert (ring.zero.is_zero, ring.one.to_sympy(tau)) == (True, 1)


@pytest.mark.parametrize(
    "matrix",
    [[[sp.sqrt(2)]], [[-1, 1], [0, -1]], [[0, -1], [1, 0]], [[0, 2], [1, 0]], [[sp.Float(0.5)]], [[-2.0]]],
    ids=["irrational entry", "Jordan block", "rotation", "irrational eigenvalues", "float", "a whole float"],
)
def test_layers_outside_the_class_are_refused(matrix: list) -> None:
    with pytest.raises(NotClosed):
        ExponentialRing(sp.Matrix(matrix))


def full(n: int) -> sp.Matrix:
    """A matrix (n, n) without zeros, of determinant 1."""
    lower = sp.Matrix(
        [[sp.Rational((j + 1) * int(j < i), i + 2) + int(i == j) for j in range(n)] for i in range(n)]
    )
    return lower * lower.T


@pytest.mark.exhaustive
@pytest.mark.parametrize("n", [2, 3, 4, 5, 6])
def test_full_matrices_are_taken_by_their_rational_spectrum_and_refused_without_one(
    n: int, monkeypatch
) -> None:
    # Eigenvectors in radicals of a quartic take SymPy minutes.
    for name in ("is_diagonalizable", "diagonalize", "eigenvects", "eigenvals"):
        monkeypatch.setattr(sp.Matrix, name, None)
    V = full(n)
    # One of them twice: a basis of eigenvectors is there all the same.
    spectrum = [sp.Rational(-k - 1, 3) for k in range(n - 1)] + [sp.Rational(-1, 3)]
    A = V * sp.diag(*spectrum) * V.inv()
    ring = ExponentialRing(A)
    assert sorted(ring.rates) == sorted(F(str(rate)) for rate in spectrum)
    Y = sp.Matrix([y.to_sympy(tau) for y in ring.fast([ring.zero] * n, [F(1, i + 2) for i in range(n)])])
    assert all(is_zero(e) for e in Y.diff(tau) - A * Y)
    assert list(Y.subs(tau, 0)) == [sp.Rational(1, i + 2) for i in range(n)]
    for refused in (A + V * sp.diag(*[0] * (n - 2), sp.Matrix([[0, -7], [1, 0]])) * V.inv(), V + sp.eye(n) / 3):
        with pytest.raises(NotClosed):
            ExponentialRing(refused)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("sign", F(-3), -1), ("sign", F(0), 0), ("sign", F(1, 9), 1),
        ("Abs", F(-3, 4), F(3, 4)), ("Abs", F(2), 2),
        ("sqrt", F(9, 4), F(3, 2)), ("sqrt", F(0), 0), ("sqrt", F(1), 1),
        ("exp", F(0), 1), ("cos", F(0), 1), ("cosh", F(0), 1),
        ("sin", F(0), 0), ("tanh", F(0), 0), ("erf", F(0), 0),
    ],
)  # fmt: skip
def test_functions_of_numbers_that_are_rational_are_taken(name: str, value: F, expected) -> None:
    assert RING.constant(value).apply(name).key == RING.constant(expected).key


@pytest.mark.parametrize(
    ("name", "value"),
    [("sqrt", F(2)), ("sqrt", F(2, 9)), ("sqrt", F(-4)), ("exp", F(1)), ("log", F(0)), ("acos", F(0)), ("pow", F(0))],
)  # fmt: skip
def test_functions_of_numbers_that_are_not_rational_are_refused(name: str, value: F) -> None:
    with pytest.raises(NotClosed):
        RING.constant(value).apply(name)


@pytest.mark.parametrize("case", ["a line", "one that decays", "all kinds"])
def test_what_is_no_number_has_neither_functions_nor_an_inverse(case: str) -> None:
    with pytest.raises(NotClosed):
        element(case).apply("sign")
    with pytest.raises(NotClosed):
        element(case).inverse()


def test_the_inverse_of_a_number() -> None:
    assert element("a number").inverse().key == RING.constant(F(-2, 3)).key
    with pytest.raises(ZeroDivisionError):
        RING.zero.inverse()


def test_what_grows_what_decays_and_what_remains() -> None:
    assert [element(case).growing for case in ELEMENTS] == [0, 0, 0, 0, 2, F(1, 2)]
    assert element("all kinds").outer == (0, 0, F(1, 4))
    assert element("nothing").outer == element("one that decays").outer == (0,)
    times = np.array([0.0, 0.3, 2.0])
    for case in ELEMENTS:
        a = element(case)
        outer = sum(float(c) * times**n for n, c in enumerate(a.outer))
        expected = [float(a.to_sympy(tau).subs(tau, sp.Float(t))) for t in times]
        assert a.decaying(times) + outer == pytest.approx(expected, rel=1e-14)
    assert not element("a line").decaying(times).any()
