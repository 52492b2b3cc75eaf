"""An eigenvalue that nearly touches the imaginary axis is no loss, and one that touches it is: enclosures tell them
apart where doubles cannot.
"""

import pytest
import sympy as sp

import gsp
from gsp.critical.loss_kind import LossKind
from tests.cases import crossed

x, y, u, v, eps = sp.symbols("x y u v epsilon")
REGION = {"x": (0, 2)}


def verdict(fast: dict, *, through: dict | None = None, prove: bool = False) -> gsp.Hyperbolicity:
    system = gsp.SlowFastSystem(slow={x: 1}, fast=fast, epsilon=eps)
    (branch,) = gsp.solve_critical(system).branches
    if through is not None:
        branch = branch.through(through)
    return gsp.classify(branch, region=REGION, prove=prove)


def real(least, at):
    return {y: -((x - at) ** 2 + least) * (y - x)}


def pair(least, at):
    rate = (x - at) ** 2 + least
    return {u: -rate * (u - x) + v, v: -u + x - rate * v}


def implicit(least, at):
    return {y: -((x - at) ** 2 + least) * (y**5 + y - x)}


@pytest.mark.parametrize(("fast", "at"), crossed([real, pair, implicit], [1, sp.Rational(1, 3), sp.sqrt(2)]))
def test_a_gap_below_what_doubles_tell_from_zero_is_a_gap(fast, at):
    least = sp.Rational(1, 10**12)
    found = verdict(fast(least, at))
    assert (found.kind, found.losses, found.holds) == ("attracting", (), True)
    # The implicit sheet has the rate (5 y^4 + 1) least.
    assert float(least) * (1 - 1e-3) <= found.gap <= 22 * float(least)


@pytest.mark.exhaustive
@pytest.mark.parametrize("at", [1, sp.Rational(1, 3), sp.sqrt(2)])
@pytest.mark.parametrize("fast", [real, pair, implicit])
def test_an_eigenvalue_on_the_axis_is_a_loss_wherever_it_lies(fast, at):
    found = verdict(fast(0, at))
    assert (found.kind, found.holds) == ("lost", False)
    (loss,) = found.losses
    assert loss.point["x"] == pytest.approx(float(at), rel=1e-3)
    assert loss.kind is not LossKind.FOLD


@pytest.mark.exhaustive
def test_a_sheet_and_the_whole_implicit_branch_have_the_same_answer():
    for least, kind in ((sp.Rational(1, 10**12), "attracting"), (0, "lost")):
        fast = implicit(least, 1)
        assert {verdict(fast).kind, verdict(fast, through={"x": 0.5, "y": 0.4}).kind} == {kind}


@pytest.mark.exhaustive
@pytest.mark.parametrize("power", [12, 15, 18])
def test_what_is_proved_is_not_said_to_be_lost(power):
    found = verdict(real(sp.Rational(1, 10**power), sp.Rational(1, 3)), prove=True)
    assert (found.is_proved, found.kind, found.losses) == (True, "attracting", ())
    assert found.certificate.gap == pytest.approx(10.0**-power, rel=1e-4)


@pytest.mark.exhaustive
def test_what_is_lost_is_not_proved():
    found = verdict(real(0, sp.Rational(1, 3)), prove=True)
    assert (found.kind, found.certificate.verdict) == ("lost", "undecided")


@pytest.mark.exhaustive
def test_a_verdict_that_only_the_proof_decides_keeps_the_conditions_at_its_epsilon():
    """Seventy places that nearly touch are more boxes than `classify` spends; a report asks for the proof later."""
    rate = sp.sin(110 * x) ** 2 + sp.Rational(1, 10**11)
    system = gsp.SlowFastSystem(slow={x: -x}, fast={y: -rate * (y - x)}, epsilon=eps)
    branch = gsp.solve_critical(system).branches[0]
    found = gsp.classify(branch, region=REGION, epsilon=0.01)
    proved = found.with_proof()
    assert found.kind == "lost"
    assert (proved.kind, proved.is_proved, proved.losses) == ("attracting", True, ())
    assert [c.name for c in proved.conditions] == [c.name for c in found.conditions]
    # The gap of 1e-11 does not dominate x' = -x.
    assert not proved.conditions[-1].holds
    assert proved.shortfall is not None
