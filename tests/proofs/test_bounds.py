"""What a proof prints is proved: every bound is rounded to its safe side, and decimals are meant as they stand."""

import re
from fractions import Fraction

import pytest
import sympy as sp

from gsp import SlowFastSystem, bound_reduction, certify, expand, solve_critical
from gsp.proofs.sides import written
from gsp.proofs.verification import verify

x, y, eps = sp.symbols("x y epsilon")


def branch(g: sp.Expr, f: sp.Expr | None = None):
    system = SlowFastSystem(slow={x: -x if f is None else f}, fast={y: g}, epsilon=eps)
    return solve_critical(system).branches[0]


def printed(pattern: str, text: str) -> Fraction:
    found = re.search(pattern + r" ([-+.e0-9]*[0-9])", text)
    assert found is not None, text
    return Fraction(found.group(1))


@pytest.mark.parametrize("rate", ["0.1234567", "0.7654321", "1234567.8"])
def test_a_gap_is_never_printed_larger_than_it_is(rate, tmp_path) -> None:
    exact = Fraction(rate)
    found = certify(branch(-sp.Rational(rate) * y), region={"x": (0, 1)}, epsilon=0.01)
    assert printed("gap at least", str(found)) <= exact
    assert printed("epsilon = 0.01: at least", str(found)) <= exact / Fraction("0.01")
    found.save(tmp_path / "proof.json")
    assert printed("at least", str(verify(tmp_path / "proof.json"))) <= exact


def test_a_tangential_rate_is_never_printed_smaller_than_it_is() -> None:
    rate = sp.Rational("1.2345673")
    found = certify(branch(-10 * y, rate * x), region={"x": (0, 1)}, epsilon=0.01)
    assert printed("slow flow at most", str(found)) >= Fraction("1.2345673")


@pytest.mark.parametrize("epsilon", [0.3, 0.1, 0.07, 0.2])
def test_a_tube_holds_for_the_decimal_that_is_printed(epsilon) -> None:
    found = certify(expand(branch(-y + x), order=1), region={"x": (0, 1)}, epsilon=epsilon)
    assert Fraction(found.epsilon_0) >= Fraction(repr(epsilon))
    assert f"(0, {epsilon!r}]" in str(found)
    assert printed(r"\|y - h\| <=", str(found)) >= Fraction(found.delta)


def test_a_ratio_of_rates_is_that_at_the_decimal() -> None:
    found = certify(branch(-3 * y), region={"x": (0, 1)}, epsilon=0.3)
    assert Fraction(found.rate_ratio) <= 3 / Fraction("0.3")
    assert Fraction(0.3) < Fraction("0.3")


def test_a_number_stands_between_the_doubles_about_it() -> None:
    for given, nearest in (
        (0.3, 0.3),
        (0.1, 0.1),
        (Fraction(1, 3), 1 / 3),
        (sp.Rational(2, 3), 2 / 3),
        (1, 1.0),
    ):
        low, high = map(Fraction, written(given, nearest))
        assert low <= Fraction(nearest) <= high
        exact = Fraction(repr(given)) if isinstance(given, float) else Fraction(str(given))
        assert low <= exact <= high


def test_the_error_of_a_reduction_is_printed_rounded_up() -> None:
    series = expand(branch(-y + x), order=1)
    found = bound_reduction(series, start={"x": 1, "y": 1}, span=(0, 1), epsilon=0.1, steps=20)
    assert found.epsilon == 0.1
    assert printed("reduced. <=", str(found).replace("|", ".")) >= Fraction(found.bound)
    assert printed("variables, <=", str(found)) >= Fraction(found.slow[-1])
    assert Fraction(re.findall(r", ([-+.e0-9]+)\)", repr(found))[-1]) >= Fraction(found.bound)
