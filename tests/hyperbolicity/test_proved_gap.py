"""The gap that is said is the proved one where there is a proof, and never without a caveat where samples missed it."""

import pytest
import sympy as sp

from gsp import SlowFastSystem, classify, solve_critical

x, y, eps = sp.symbols("x y epsilon")
TRUE = 0.1


def sliver():
    """The gap is 1 all over, and 0.1 where no sample lies."""
    dip = sp.exp(-((5000 * x - sp.Rational(3217, 2)) ** 2))
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: -y * (1 - sp.Rational(9, 10) * dip)}, epsilon=eps)
    return solve_critical(system).branches[0]


@pytest.mark.exhaustive
def test_the_headline_of_a_proof_has_the_proved_gap() -> None:
    found = classify(sliver(), region={"x": (0, 1)}, prove=True)
    first = str(found).splitlines()[0]
    said = first.split("gap at least ")[1].split()[0]
    assert float(said) <= found.certificate.gap <= TRUE
    assert "at the samples" in first
    assert said in repr(found)


def test_samples_that_miss_a_sliver_are_told_by_enclosures() -> None:
    found = classify(sliver(), region={"x": (0, 1)})
    assert found.gap < 1.0 or "between them enclosures bound the gap by" in str(found).splitlines()[0]
    assert found.exclusion.gap <= TRUE


def test_a_gap_that_enclosures_confirm_stands_alone() -> None:
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: x - 2 * y}, epsilon=eps)
    found = classify(solve_critical(system).branches[0], region={"x": (0, 1)})
    assert repr(found) == "Hyperbolicity(attracting, gap=2, sampled at 257 points)"


@pytest.mark.exhaustive
@pytest.mark.parametrize("digits", [1, 2, 3, 4, 6])
def test_a_proved_gap_is_never_rounded_up(digits: int) -> None:
    system = SlowFastSystem(
        slow={x: sp.Integer(1)}, fast={y: x - y * sp.Rational(1987654321, 10**9)}, epsilon=eps
    )
    branch = solve_critical(system).branches[0]
    proved = classify(branch, region={"x": (0, 1)}, prove=True)
    assert proved.is_proved
    assert proved.known_gap == proved.certificate.gap
    said = proved.shown_gap(digits).removeprefix("at least ")
    assert said != proved.shown_gap(digits)
    assert proved.known_gap * (1 - 10.0 ** (1 - digits)) < float(said) <= proved.known_gap
    # What is met at samples is no bound, and rounded to the nearest.
    met = classify(branch, region={"x": (0, 1)})
    assert met.known_gap == met.gap
    assert met.shown_gap(digits) == f"{met.gap:.{digits}g}"
