"""The gap that is said is the proved one where there is a proof, and never without a caveat where samples missed it."""

import pytest
import sympy as sp

from gsp import SlowFastSystem, classify, solve_critical
from gsp.report.content import hyperbolicity_as_json
from gsp.results.bounds import at_least

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
    # One number, wherever it is asked for.
    assert found.gap == found.rates.normal == found.certificate.gap < found.sampled_gap
    condition = next(c for c in found.conditions if c.name == "hyperbolic equilibria")
    assert (condition.value, condition.holds) == (found.gap, True)
    assert f"hyperbolic equilibria: at least {said} (least |Re lambda|, proved; above 0 needed)" in str(found)
    assert hyperbolicity_as_json(found)["gap"] == found.gap


def test_a_condition_has_the_number_that_is_proved() -> None:
    """Beside "gap at least 1.9999, proved" the condition had what samples met."""
    system = SlowFastSystem(slow={x: -x}, fast={y: x - y * sp.Rational(1987654321, 10**9)}, epsilon=eps)
    branch = solve_critical(system).branches[0]
    found = classify(branch, region={"x": (0, 1)}, epsilon=0.1, prove=True)
    assert found.is_proved
    assert found.gap == found.certificate.gap <= 1.987654321
    told = {c.name: c for c in found.conditions}
    assert told["hyperbolic equilibria"].value == found.gap
    assert told["normal rate dominates"].value == found.certificate.rate_ratio
    assert all(
        c.is_proved and "at least" in c.fact
        for c in (told["hyperbolic equilibria"], told["normal rate dominates"])
    )
    assert found.holds
    # Without a proof it is said where the number is from, and a proof at no epsilon has no ratio.
    met = classify(branch, region={"x": (0, 1)}, epsilon=0.1)
    assert "at the samples" in next(c.fact for c in met.conditions if c.name == "hyperbolic equilibria")
    half = met.with_proof()
    ratio = next(c for c in half.conditions if c.name == "normal rate dominates")
    assert not ratio.is_proved
    assert f"at the samples, {at_least(half.rates.r(0.1))} with the proved gap; at least 1" in ratio.fact
    assert half.gap == half.certificate.gap


def test_samples_that_miss_a_sliver_are_told_by_enclosures() -> None:
    found = classify(sliver(), region={"x": (0, 1)})
    condition = next(c for c in found.conditions if c.name == "hyperbolic equilibria")
    assert (
        found.gap < 1.0
        or "at the samples, above 0 needed; between them enclosures bound the gap by" in condition.fact
    )
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
    assert proved.gap == proved.certificate.gap
    said = proved.shown_gap(digits).removeprefix("at least ")
    assert said != proved.shown_gap(digits)
    assert proved.gap * (1 - 10.0 ** (1 - digits)) < float(said) <= proved.gap
    # What is met at samples is no bound, and rounded to the nearest.
    met = classify(branch, region={"x": (0, 1)})
    assert met.sampled_gap == met.gap
    assert met.shown_gap(digits) == f"{met.gap:.{digits}g}"
