"""Boxes that are cut further: until the gap that is proved is as large as the normal rate has to be."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.proofs.verdict import ProofVerdict
from gsp.proofs.verification import verify

x, y, z, eps = sp.symbols("x y z epsilon")
# On y = x the eigenvalue is -(2 - x)^2/4 - 1/10, which one box over (0, 2) bounds by 1/10 less what it is wide.
WIDE = gsp.SlowFastSystem(
    slow={x: sp.Rational(1, 2) - x}, fast={y: -((2 - x) ** 2 / 4 + sp.Rational(1, 10)) * (y - x) * (1 + y) / (1 + x)},
    epsilon=eps,
)  # fmt: skip


def branch(system: gsp.SlowFastSystem, **through: float):
    return gsp.solve_critical(system).branches[0].through(through)


def certified(**given: float) -> gsp.Certificate:
    return gsp.certify(branch(WIDE, x=1.0, y=1.0), region={"x": (0, 2)}, **given)


@pytest.fixture(scope="module")
def alone() -> gsp.Certificate:
    return certified()


@pytest.mark.exhaustive
def test_boxes_are_cut_until_the_normal_rate_is_proved_to_dominate(alone, tmp_path) -> None:
    # The rate along the slow flow is 1; the epsilon at which r is 1 for the true gap is 1/10.
    epsilon = 0.09
    assert alone.verdict is ProofVerdict.PROVED
    assert alone.gap < epsilon
    found = certified(epsilon=epsilon)
    assert found.verdict is ProofVerdict.PROVED
    assert epsilon <= found.gap <= 0.1
    assert 1 <= found.rate_ratio <= 1 / 0.9
    assert len(found.gaps) == len(found.boxes) > len(alone.boxes)
    assert found.tried < 60
    # The parts that are left cover the box.
    sides = sorted(box[0] for box in found.boxes)
    assert [sides[0][0], sides[-1][1]] == [0, 2]
    assert np.array_equal([high for _, high in sides[:-1]], [low for low, _ in sides[1:]])
    assert not found._covering.undecided
    found.save(tmp_path / "proof.json")
    assert verify(tmp_path / "proof.json").gap == pytest.approx(found.gap, rel=1e-9)


@pytest.mark.exhaustive
def test_where_the_gap_itself_is_too_small_nothing_is_cut(alone) -> None:
    found = certified(epsilon=2.0)
    assert found.verdict is ProofVerdict.UNDECIDED
    assert "only r >= 0.0" in found.reason
    # The part with the least gap is halved until its middle says so.
    assert found.tried <= alone.tried + 4


@pytest.mark.exhaustive
def test_the_budget_bounds_the_cuts(alone) -> None:
    found = certified(epsilon=0.0999999, most_boxes=alone.tried + 3)
    assert found.tried <= alone.tried + 3
    assert found.verdict is ProofVerdict.UNDECIDED
    assert alone.gap < found.gap < 0.0999999


@pytest.mark.parametrize("steep", [1, 4, 16])
def test_the_gap_that_is_proved_is_within_a_factor_of_two_where_the_branch_alone_takes_one_box(
    steep: int,
) -> None:
    """The eigenvalue is -1 - (x^2 - s x)^2, at least 1 away; over one box x^2 - s x is anything up to s^2 + 1."""
    system = gsp.SlowFastSystem(
        slow={x: sp.Integer(1)}, fast={y: -(1 + (x**2 - steep * x) ** 2 / 10) * y + z / 10, z: -z}, epsilon=eps
    )
    found = gsp.certify(branch(system, x=0.5, y=0.0, z=0.0), region={"x": (0, 1)})
    assert found.verdict is ProofVerdict.PROVED
    assert 0.5 <= found.gap <= 1
    assert found.tried < 40


def test_a_bound_that_cuts_do_not_raise_ends_them() -> None:
    """(c + x)/(c d) is 1/d + x/(c d), and balls see c/c as anything from 1/4 to 4: cuts across d and x do not help."""
    c, d = sp.symbols("c d")
    system = gsp.SlowFastSystem(
        slow={x: -x}, fast={y: -y * (c + x**2 * d) / (c * d)}, epsilon=eps, parameters={c: 1, d: 1}
    )
    region = {"x": (0, 1), "c": (sp.Rational(1, 2), 2), "d": (sp.Rational(1, 2), 2)}
    found = gsp.certify(gsp.solve_critical(system).branches[0], region=region)
    assert found.verdict is ProofVerdict.PROVED
    assert found.tried < 100
