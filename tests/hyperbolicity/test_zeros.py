"""Zero eigenvalues: which way a pitchfork is pushed, and how many other fast directions are unstable."""

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.critical.loss_kind import LossKind
from gsp.critical.sampling import Sampler
from gsp.hyperbolicity.hyperbolicity import classify
from gsp.hyperbolicity.losses import zeros
from gsp.hyperbolicity.losses.diagnosis import Diagnosis
from gsp.hyperbolicity.losses.kinds import Loss
from gsp.hyperbolicity.samples import sampled
from gsp.systems.system import SlowFastSystem

x, y, z, w, u, eps = sp.symbols("x y z w u epsilon")


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


@pytest.mark.parametrize("factor", [1, -1, 10**6])
@pytest.mark.parametrize("origin", [0, 7])
@pytest.mark.parametrize("others", [{}, {u: x - 2 * u}], ids=["two fast", "three fast"])
def test_a_fold_beside_a_double_zero_is_a_fold(factor: int, origin: int, others: dict) -> None:
    """It was a degenerate point there: moved over the region along its kernel, w leaves the region 50,000 times."""
    rates = {x: w, w: y - origin + z * w + x**2 + 3 * x * w, **others}
    fast = {name: factor * rate for name, rate in rates.items()}
    system = SlowFastSystem(slow={y: sp.Integer(1), z: sp.Integer(1)}, fast=fast, epsilon=eps)
    sampler = Sampler(solve_critical(system).branches[0])
    box = {"y": (origin - 1, origin + 0.2), "z": (-0.7, 0.6)}
    samples = sampled(sampler, box)
    diagnosis = Diagnosis(sampler, box, float(np.abs(samples.eigenvalues).max()), samples.z)
    loss = zeros.zero(diagnosis, np.array([origin, 0.004, *[0.0] * len(fast)]))
    assert loss.kind is LossKind.FOLD
    # Both a and b_y are -1/z along x.
    assert loss.coefficients["kappa"] == pytest.approx((factor / 0.004) ** 2)


@pytest.mark.parametrize("unit", [sp.Rational(1, 1000), 1, 10, 100, 10**6])
def test_folds_are_found_whatever_the_unit_of_a_variable_that_is_0_on_the_branch(unit: int) -> None:
    """With w in a unit ten times as small the search left the region along z, and one fold of 13 was found."""
    v = w / unit
    fast = {x: v, w: unit * (y + z * v + x**2 + 3 * x * v)}
    system = SlowFastSystem(slow={y: sp.Integer(1), z: sp.Integer(1)}, fast=fast, epsilon=eps)
    branch = solve_critical(system).branches[1]
    losses = classify(branch, region={"y": (-1, 0.2), "z": (-0.7, 0.6)}).losses
    (fold,) = [loss for loss in losses if loss.kind is LossKind.FOLD]
    assert fold.samples > 10
    assert fold.coefficients["kappa"] == pytest.approx(fold.point["z"] ** -2)
