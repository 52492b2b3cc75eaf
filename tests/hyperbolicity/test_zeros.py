"""Zero eigenvalues: which way a pitchfork is pushed, and how many other fast directions are unstable."""

import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.critical.loss_kind import LossKind
from gsp.hyperbolicity.hyperbolicity import classify
from gsp.hyperbolicity.losses import zeros
from gsp.hyperbolicity.losses.kinds import Loss
from gsp.systems.system import SlowFastSystem

x, y, z, w, eps = sp.symbols("x y z w epsilon")


def loss_of(fast: dict, through: dict, kind: LossKind) -> Loss:
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast=fast, epsilon=eps)
    verdict = classify(solve_critical(system).nearest(through), region={"x": (-1, 1)})
    (loss,) = [loss for loss in verdict.losses if loss.kind is kind]
    return loss


def test_nothing_is_said_of_what_passes_a_fold_where_no_slow_rate_is_of_order_1() -> None:
    """They were canards, as where the slow flow vanishes at the fold alone."""
    system = SlowFastSystem(slow={x: -eps * (y + 1)}, fast={y: x - y**2}, epsilon=eps)
    (loss,) = classify(solve_critical(system).branches[0], region={"x": (0, 1)}).losses
    assert system.stands_still
    assert loss.kind is LossKind.FOLD
    assert "kappa" not in loss.coefficients
    assert loss.weights is None
    assert loss.consequence.startswith("every slow rate vanishes at epsilon = 0")


@pytest.mark.exhaustive
@pytest.mark.parametrize(("slope", "push"), [(2, 1), (2, 2), (-1, 1)])
def test_the_push_at_a_pitchfork_is_less_the_slope_of_the_branch(slope: int, push: int) -> None:
    # v = y - slope x has epsilon v' = x v - v^3 + epsilon (push - slope): no push where the two are equal.
    v = y - slope * x
    loss = loss_of(
        {y: sp.expand(x * v - v**3) + push * eps}, {"x": -0.5, "y": -0.5 * slope}, LossKind.PITCHFORK
    )
    assert loss.coefficients["push"] == pytest.approx(push - slope, abs=zeros.ZERO_TERM)
    assert loss.may_reduce is (push != slope)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("rates", "count"), [((-3, -2), 0), ((3, -2), 1), ((3, 2), 2)])
def test_the_other_unstable_directions_at_a_zero_are_counted(rates: tuple[int, int], count: int) -> None:
    v = y - 2 * x
    fast = {y: sp.expand(x * v - v**3), z: rates[0] * z, w: rates[1] * w}
    loss = loss_of(fast, {"x": -0.5, "y": -1.0, "z": 0, "w": 0}, LossKind.PITCHFORK)
    assert loss.note == (
        f"{count} of the other fast directions are unstable, so orbits leave anyway" if count else ""
    )


@pytest.mark.parametrize("unit", [sp.Rational(1, 10**9), 10**9])
@pytest.mark.parametrize("cubic", [0, -1])
def test_a_push_is_one_in_any_unit_of_the_fast_variable(unit: sp.Rational, cubic: int) -> None:
    # In v = y/unit the push is 1: orbits leave at once, as `entry_exit` says too.
    fast = {y: x * y + cubic * y**3 / unit**2 + unit * eps}
    kind = LossKind.PITCHFORK if cubic else LossKind.RANK_CHANGE
    loss = loss_of(fast, {"x": -0.5, "y": 0}, kind)
    assert loss.coefficients["push"] == pytest.approx(float(unit))
    assert "delay" not in loss.consequence


def test_a_delay_is_promised_for_an_invariant_branch_only() -> None:
    # w = y - x^2 - 2 epsilon has epsilon w' = (x - 4 epsilon) w - w^2 - 4 epsilon^2: the push is of second order.
    v = y - x**2
    loss = loss_of({y: v * (x - v)}, {"x": -0.5, "y": 0.25}, LossKind.TRANSCRITICAL)
    assert loss.coefficients["lambda"] == pytest.approx(1.0)
    assert "where the branch is invariant" in loss.consequence


@pytest.mark.parametrize("rate", [10, 10**5, 10**9])
@pytest.mark.parametrize(
    ("fast", "kind"),
    [
        ({y: x * y - y**2 + z * w, z: -z + y**2}, LossKind.TRANSCRITICAL),
        ({y: x * y - z - y**3, z: y + x * z - z**3}, LossKind.HOPF),
    ],
)
def test_a_loss_has_its_name_whatever_contracts_much_faster(fast: dict, kind: LossKind, rate: int) -> None:
    loss = loss_of(fast | {w: -rate * w + y * z}, {"x": -0.5, "y": 0, "z": 0, "w": 0}, kind)
    assert loss.point["x"] == pytest.approx(0, abs=1e-9)
