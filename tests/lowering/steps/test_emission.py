"""What is asked of SymPy while expressions are written as machine code."""

import sympy as sp

from gsp.lowering.steps.emission import is_negated

x = sp.Symbol("x")


def test_a_sign_is_read_off_its_number_without_what_else_may_be_known_of_it() -> None:
    number = sp.Rational(-123457, 1009)
    assert is_negated(number * x)
    assert "negative" not in (number * x).args[0]._assumptions
    terms = (
        x,
        -x,
        sp.Integer(-3),
        sp.Float(-2.5) * x,
        -sp.oo,
        sp.pi,
        x + 1,
        -2 * (x + 1),
        sp.Rational(1, 2) * x,
    )
    for term in terms:
        assert is_negated(term) == bool(term.as_coeff_Mul()[0].is_negative), term
